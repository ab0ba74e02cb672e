"""Clearance of footprints against its twin, and against what the LiDAR sees."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.types import Array, OccupancyGrid, World
from core import twins
from core.arenas import (
    BOUNDS,
    box,
    footprints,
    grids,
    mirrored,
    moved,
    moved_pose,
    polygons,
    poses,
    random_world,
    turn_of,
    worlds,
)
from core.arenas import circles as circle_rows
from core.arenas import discs as disc_rows
from core.arenas import segments as segment_rows
from core.twins import Pose

DISC = np.empty((0, 2))
RADIUS_M = 0.2
radii = st.floats(0.05, 0.5)


def clearance(
    world: World, pose: Pose, radius_m: float, footprint: Array, limit_m: float = 1.0, time_s: float = 0.0
) -> float:
    return float(_core.clearance(world.native, np.array([pose]), radius_m, footprint, limit_m, time_s)[0])


def assert_is_the_twins(
    world: World, pose: Pose, radius_m: float, footprint: Array, limit_m: float = 1.0, time_s: float = 0.0
) -> None:
    """Overlaps are 0 or less: how deep they are is nobody's promise."""
    expected = twins.clearance(world, pose, radius_m, footprint, limit_m, time_s)
    measured = clearance(world, pose, radius_m, footprint, limit_m, time_s)
    assert abs(max(measured, 0.0) - max(expected, 0.0)) < 1e-9, f"{measured}, twin {expected}"


@given(circle_rows, poses, radii, footprints)
def test_circles(circles: Array, pose: Pose, radius_m: float, footprint: Array):
    assert_is_the_twins(World(bounds=BOUNDS, circles=circles), pose, radius_m, footprint)


@given(st.lists(polygons, max_size=4), poses, radii, footprints)
def test_polygons(corners: list[Array], pose: Pose, radius_m: float, footprint: Array):
    assert_is_the_twins(World(bounds=BOUNDS, polygons=tuple(corners)), pose, radius_m, footprint)


@given(segment_rows, poses, radii, footprints)
def test_segments(segments: Array, pose: Pose, radius_m: float, footprint: Array):
    assert_is_the_twins(World(bounds=BOUNDS, segments=segments), pose, radius_m, footprint)


@given(disc_rows, poses, radii, footprints, st.floats(0.0, 20.0))
def test_moving_discs(discs: Array, pose: Pose, radius_m: float, footprint: Array, time_s: float):
    assert_is_the_twins(World(bounds=BOUNDS, discs=discs), pose, radius_m, footprint, time_s=time_s)


@given(grids(), poses, radii, footprints)
def test_bitmaps_at_any_origin_and_yaw(grid: OccupancyGrid, pose: Pose, radius_m: float, footprint: Array):
    assert_is_the_twins(World(bounds=BOUNDS, grid=grid), pose, radius_m, footprint)


@settings(max_examples=200)
@given(st.integers(0, 39), st.integers(0, 39), poses, radii, footprints, st.floats(1e-6, 0.1))
def test_a_lone_cell_is_found_up_to_its_very_distance(row, column, pose, radius_m, footprint, beyond_m):
    """Far from everything the kernel looks no further than its distance field: that must not hide a cell."""
    solid = np.zeros((40, 40), dtype=np.uint8)
    solid[row, column] = 1
    grid = OccupancyGrid(solid=solid, resolution_m=0.25, origin=(-4.0, -6.0, 0.2))
    world = World(bounds=BOUNDS, grid=grid)
    exact = twins.clearance(world, pose, radius_m, footprint, 99.0)
    assume(exact > 0.0)
    assert_allclose(clearance(world, pose, radius_m, footprint, exact + beyond_m), exact, atol=1e-9)


@settings(max_examples=60)
@given(worlds(), poses, radii, footprints, st.floats(0.01, 6.0), st.floats(0.0, 20.0))
def test_worlds_of_all_kinds_up_to_any_limit(world, pose, radius_m, footprint, limit_m, time_s):
    assert_is_the_twins(world, pose, radius_m, footprint, limit_m, time_s)


@given(poses, st.floats(0.02, 0.1))
def test_a_footprint_within_an_obstacle_overlaps_it(pose: Pose, half: float):
    """It touches none of its edges; and an obstacle within the footprint touches none of the footprint's."""
    x, y, _ = pose
    solid = np.ones((40, 40), dtype=np.uint8)
    for footprint in (DISC, box(0.0, 0.0, half, half)):
        for world in (
            World(bounds=BOUNDS, polygons=(box(x, y, 1.0, 1.0, 0.4),)),
            World(bounds=BOUNDS, circles=np.array([[x, y, 1.0]])),
            World(
                bounds=BOUNDS, grid=OccupancyGrid(solid=solid, resolution_m=0.05, origin=(x - 1, y - 1, 0.0))
            ),
            World(
                bounds=BOUNDS,
                grid=OccupancyGrid(solid=solid[:1, :1], resolution_m=2.0, origin=(x - 1, y - 1, 0.0)),
            ),
        ):
            assert clearance(world, pose, half, footprint) <= 0.0
    big = box(0.0, 0.0, 0.5, 0.5)
    for footprint in (DISC, big):
        for world in (
            World(bounds=BOUNDS, polygons=(box(x, y, half, half, 0.4),)),
            World(bounds=BOUNDS, circles=np.array([[x, y, half]])),
            World(bounds=BOUNDS, segments=np.array([[x - half, y, x + half, y + half]])),
            World(
                bounds=BOUNDS, grid=OccupancyGrid(solid=solid[:1, :1], resolution_m=half, origin=(x, y, 0.0))
            ),
        ):
            assert clearance(world, pose, 0.5, footprint) <= 0.0


@settings(max_examples=60)
@given(worlds(), poses, footprints, poses)
def test_moving_world_and_robot_together_changes_nothing(
    world: World, pose: Pose, footprint: Array, by: Pose
):
    here = clearance(world, pose, RADIUS_M, footprint)
    assert_allclose(
        max(clearance(moved(world, by), moved_pose(pose, by), RADIUS_M, footprint), 0),
        max(here, 0),
        atol=1e-9,
    )


@settings(max_examples=60)
@given(worlds(), poses, footprints)
def test_mirrored_world_mirrored_robot(world: World, pose: Pose, footprint: Array):
    there = (pose[0], -pose[1], -pose[2])
    flipped = np.ascontiguousarray((footprint * [1.0, -1.0])[::-1])
    here = clearance(world, pose, RADIUS_M, footprint)
    assert_allclose(max(clearance(mirrored(world), there, RADIUS_M, flipped), 0.0), max(here, 0.0), atol=1e-9)


@settings(max_examples=60)
@given(worlds(), poses, footprints, poses)
def test_a_robot_that_moves_by_a_metre_gains_at_most_a_metre(
    world: World, pose: Pose, footprint: Array, by: Pose
):
    """Conservative advancement rests on this: no clearance changes faster than the robot moves."""
    there = (pose[0] + by[0] / 8.0, pose[1] + by[1] / 8.0, pose[2])
    change = clearance(world, there, RADIUS_M, footprint, 9.0) - clearance(
        world, pose, RADIUS_M, footprint, 9.0
    )
    assert abs(change) <= math.hypot(by[0], by[1]) / 8.0 + 1e-9


# --- the same geometry as the LiDAR's -----------------------------------------------------------


@settings(max_examples=60)
@given(worlds(), poses, st.floats(0.0, 9.0))
def test_no_beam_is_shorter_than_clearance_and_radius(world: World, pose: Pose, time_s: float):
    """Seen from a disc's centre, what is at range r is r - radius away: nothing is nearer."""
    free = clearance(world, pose, RADIUS_M, DISC, 5.0, time_s)
    assume(free > 0.0)
    angles = turn_of(720)
    ranges = _core.raycast(world.native, np.array([pose]), angles, 6.0, time_s)[0]
    assert ranges.min() - RADIUS_M >= free - 1e-6


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_the_nearest_beam_is_clearance_and_radius(seed: int, bitmap: bool):
    """The other way: with beams every 0.2 degrees some beam finds the nearest obstacle."""
    rng = np.random.default_rng(seed)
    world = random_world(rng, 5)
    if bitmap:
        solid = (rng.random((30, 30)) < 0.1).astype(np.uint8)
        grid = OccupancyGrid(
            solid=solid, resolution_m=0.2, origin=(*rng.uniform(-4, 0, 2), rng.uniform(-3, 3))
        )
        world = World(bounds=BOUNDS, grid=grid)
    # A segment seen edge on has no width to meet a beam: leave it out.
    world = replace(world, segments=np.empty((0, 4)))
    pose = (*rng.uniform(-4, 4, 2), rng.uniform(-3, 3))
    free = clearance(world, pose, RADIUS_M, DISC, 5.0)
    assume(free > 0.0)
    ranges = _core.raycast(world.native, np.array([pose]), turn_of(1800), 6.0)[0]
    nearest = min(float(ranges.min()), 5.0 + RADIUS_M)
    assert_allclose(nearest - RADIUS_M, free, atol=0.03)


# --- bad input ----------------------------------------------------------------------------------


def test_arrays_of_the_wrong_kind_are_refused():
    native, here = World(bounds=BOUNDS).native, np.zeros((1, 3))
    for poses_in, footprint in (
        (np.zeros((1, 2)), DISC),
        (np.zeros((1, 3), np.float32), DISC),
        (here, np.zeros((3, 3))),
        (here, box(0, 0, 1, 1).astype(np.float32)),
        (here, np.asfortranarray(box(0, 0, 1, 1))),
    ):
        with pytest.raises(TypeError):
            _core.clearance(native, poses_in, 0.2, footprint, 1.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="16"):
        _core.clearance(native, here, 0.2, np.zeros((17, 2)), 1.0)


def test_nothing_there_is_as_far_as_the_limit():
    assert_array_equal(
        _core.clearance(World(bounds=BOUNDS).native, np.zeros((2, 3)), 0.2, DISC, 0.75), [0.75, 0.75]
    )
    assert_array_equal(
        _core.clearance(World(bounds=BOUNDS).native, np.zeros((2, 3)), 0, box(0, 0, 1, 1), 0.75), 0.75
    )
