"""Laws of ray casting that need no twin: symmetry, monotony, and no gap where obstacles meet."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl import _core
from adrl.types import Array, OccupancyGrid, World
from core.arenas import (
    BOUNDS,
    box,
    circles,
    discs,
    mirrored,
    moved,
    moved_pose,
    polygons,
    poses,
    random_world,
    segments,
)
from core.twins import Pose

RANGE_M = 6.0
BEAMS = np.linspace(-math.pi, math.pi, 61)
TOLERANCE_M = 1e-5

seeds = st.integers(0, 2**32 - 1)


def scan(world: World, pose: Pose, angles: Array = BEAMS, max_range_m: float = RANGE_M) -> Array:
    return _core.raycast(world.native, np.array([pose]), angles, max_range_m, 3.0)[0].astype(np.float64)


def a_world(seed: int) -> World:
    """A world in general position, with a bitmap that is turned."""
    rng = np.random.default_rng(seed)
    solid = (rng.random((20, 30)) < 0.1).astype(np.uint8)
    origin = (float(rng.uniform(-3, 0)), float(rng.uniform(-3, 0)), float(rng.uniform(-3, 3)))
    return replace(random_world(rng, 6), grid=OccupancyGrid(solid=solid, resolution_m=0.1, origin=origin))


def assert_same_but_for_grazing(one: Array, other: Array) -> None:
    """Beams in general position agree; one in a few thousand grazes an edge closer than rounding can tell."""
    assert np.mean(np.abs(one - other) > TOLERANCE_M) <= 1.5 / len(one)


@given(seeds, poses, poses)
def test_moving_world_and_robot_together_leaves_the_scan_unchanged(seed: int, pose: Pose, by: Pose):
    world = a_world(seed)
    assert_same_but_for_grazing(scan(world, pose), scan(moved(world, by), moved_pose(pose, by)))


@given(seeds, poses)
def test_mirrored_world_mirrored_scan(seed: int, pose: Pose):
    world = a_world(seed)
    reflected = (pose[0], -pose[1], -pose[2])
    assert_same_but_for_grazing(scan(world, pose), scan(mirrored(world), reflected, -BEAMS))


@given(seeds, poses, st.floats(-7.0, 7.0))
def test_turning_the_sensor_is_turning_the_beams(seed: int, pose: Pose, turn: float):
    world = a_world(seed)
    assert_same_but_for_grazing(scan(world, pose, BEAMS + turn), scan(world, (*pose[:2], pose[2] + turn)))


@settings(max_examples=50)
@given(seeds, poses, circles, st.lists(polygons, max_size=2), segments, discs)
def test_one_more_obstacle_never_lengthens_a_beam(
    seed, pose, more_circles, more_polygons, more_segments, more_discs
):
    world = a_world(seed)
    before = scan(world, pose)
    for more in (
        replace(world, circles=np.vstack([world.circles, more_circles])),
        replace(world, polygons=(*more_polygons, *world.polygons)),
        replace(world, segments=np.vstack([more_segments, world.segments])),
        replace(world, discs=np.vstack([world.discs, more_discs])),
    ):
        assert np.all(scan(more, pose) <= before)


@given(seeds, poses, st.integers(0, 19), st.integers(0, 29))
def test_one_more_solid_cell_never_lengthens_a_beam(seed: int, pose: Pose, row: int, column: int):
    world = a_world(seed)
    assert world.grid is not None
    solid = world.grid.solid.copy()
    solid[row, column] = 1
    # The free boxes that a ray jumps over change with the cell, and with them the rounding.
    assert np.all(
        scan(replace(world, grid=replace(world.grid, solid=solid)), pose) <= scan(world, pose) + 1e-6
    )


@given(seeds, poses, st.floats(0.2, 6.0))
def test_a_shorter_range_only_cuts_the_scan_off(seed: int, pose: Pose, limit_m: float):
    world = a_world(seed)
    assert_allclose(
        scan(world, pose, max_range_m=limit_m), np.minimum(scan(world, pose), np.float32(limit_m)), atol=1e-6
    )


# --- no leaks -----------------------------------------------------------------------------------


def towards(pose: Pose, points: Array) -> Array:
    """Beam angles from a pose straight at points."""
    return np.arctan2(points[:, 1] - pose[1], points[:, 0] - pose[0]) - pose[2]


def ring(count: int, radius_m: float, turn: float) -> Array:
    """(count, 2) points around the origin."""
    at = turn + 2.0 * math.pi * np.arange(count) / count
    return radius_m * np.column_stack([np.cos(at), np.sin(at)])


@given(st.integers(3, 40), st.floats(0.5, 3.5), st.floats(0, 7), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_no_beam_leaves_a_closed_ring_of_walls_through_its_corners(count, radius_m, turn, x, y):
    corners = ring(count, radius_m, turn)
    world = World(bounds=BOUNDS, segments=np.hstack([corners, np.roll(corners, -1, axis=0)]))
    pose = (x, y, 0.7)
    distance = np.hypot(*(corners - pose[:2]).T)
    for nudge in (0.0, 1e-16, -1e-16, 1e-15, -1e-15, 1e-13, -1e-13):
        assert_allclose(scan(world, pose, towards(pose, corners) + nudge), distance, atol=1e-5)


@given(poses, st.floats(0.05, 0.8), st.floats(0.05, 0.8))
def test_no_beam_passes_between_boxes_that_share_a_corner(pose: Pose, half_x: float, half_y: float):
    """Two boxes that touch in one corner on a diagonal, and the same made of two cells of a bitmap."""
    x, y, yaw = pose
    if abs(x) < 2.0 * half_x and abs(y) < 2.0 * half_y:
        x = x + 4.0 * half_x
    boxes = World(
        bounds=BOUNDS, polygons=(box(-half_x, half_y, half_x, half_y), box(half_x, -half_y, half_x, half_y))
    )
    solid = np.array([[0, 1], [1, 0]], dtype=np.uint8)
    cells = World(
        bounds=BOUNDS, grid=OccupancyGrid(solid=solid, resolution_m=half_x, origin=(-half_x, -half_x, 0.0))
    )
    at_corner = towards((x, y, yaw), np.zeros((1, 2)))
    nudges = np.array([0.0, 1e-16, -1e-16, 1e-15, -1e-15, 1e-12, -1e-12])
    for world in (boxes, cells):
        ranges = scan(world, (x, y, yaw), at_corner + nudges, max_range_m=20.0)
        assert np.all(ranges <= math.hypot(x, y) + 1e-5)


@pytest.mark.parametrize("start", [0.5, 2.5, 7.5])
@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_no_beam_slips_down_a_diagonal_of_cells(start: float, quarter: int):
    """Cells that touch only in corners, and a beam at 45 degrees through those very corners."""
    solid = np.rot90(np.fliplr(np.eye(16, dtype=np.uint8)), quarter)
    world = World(bounds=BOUNDS, grid=OccupancyGrid(solid=np.ascontiguousarray(solid), resolution_m=1.0))
    exact = np.array([math.pi / 4 + quarter * math.pi / 2, math.pi / 4 - quarter * math.pi / 2])
    grid_range = 40.0
    for x, y in ((start, start), (16 - start, start), (start, 16 - start), (16 - start, 16 - start)):
        if solid[int(y), int(x)]:
            continue
        inward = math.atan2(8.0 - y, 8.0 - x)
        beams = np.concatenate([[inward], exact])
        ranges = scan(world, (x, y, 0.0), beams, max_range_m=grid_range)
        assert ranges[0] <= math.hypot(8.0 - x, 8.0 - y) + 1e-5


@given(poses, st.floats(-3.0, 3.0), st.floats(0.1, 2.0), st.floats(0.1, 3.0))
def test_a_wall_seen_end_on_is_passed_by_or_hit_at_its_near_end(pose: Pose, bearing: float, near_m, length_m):
    """Where a beam along a wall would meet it is all rounding: it may miss, it may not make a range up."""
    ahead = np.array([math.cos(bearing), math.sin(bearing)])
    ends = np.concatenate([pose[:2] + near_m * ahead, pose[:2] + (near_m + length_m) * ahead])
    beam = np.array([bearing - pose[2]])
    for segment in (ends, np.roll(ends, 2)):
        measured = scan(World(bounds=BOUNDS, segments=segment[None]), pose, beam, max_range_m=9.0)[0]
        assert measured == 9.0 or abs(measured - near_m) < 1e-5


def test_no_beam_enters_a_box_through_its_own_corners_even_from_afar():
    corners = box(2.0, 1.0, 0.3, 0.2, 0.6)
    world = World(bounds=BOUNDS, polygons=(corners,))
    for distance in (0.7, 3.0, 50.0, 900.0):
        for bearing in np.linspace(0.0, 6.2, 41):
            pose = (2.0 + distance * math.cos(bearing), 1.0 + distance * math.sin(bearing), 0.3)
            near = np.argmin(np.hypot(*(corners - pose[:2]).T))
            middle = towards(pose, corners[[near]] * 0.999 + 0.001 * corners.mean(axis=0))
            beams = np.concatenate([towards(pose, corners[[near]]), middle])
            ranges = scan(world, pose, beams, max_range_m=2000.0)
            assert_allclose(ranges[0], np.hypot(*(corners[near] - pose[:2])), rtol=2e-6, atol=1e-5)


@settings(max_examples=30)
@given(seeds)
def test_a_maze_of_cells_holds_every_beam(seed: int):
    """A bitmap closed by a border of solid cells: no beam gets out, aimed at lattice points or not."""
    rng = np.random.default_rng(seed)
    solid = (rng.random((12, 12)) < 0.2).astype(np.uint8)
    solid[[0, -1]] = solid[:, [0, -1]] = 1
    solid[5:7, 5:7] = 0
    world = World(bounds=BOUNDS, grid=OccupancyGrid(solid=solid, resolution_m=0.5, origin=(-3.0, -3.0, 0.0)))
    lattice = np.stack(np.meshgrid(*[np.linspace(-3.0, 3.0, 13)] * 2), axis=-1).reshape(-1, 2)
    for pose in ((0.0, 0.0, 0.0), (0.25, -0.25, 0.0), (*rng.uniform(-0.45, 0.45, 2), 0.3)):
        away = lattice[np.hypot(*(lattice - pose[:2]).T) > 1e-9]
        assert np.all(scan(world, pose, towards(pose, away), max_range_m=50.0) < 3.0 * math.sqrt(2.0) + 1.0)
