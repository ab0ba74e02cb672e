"""Ray casting against its twin, obstacle kind by kind and all together."""

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
from core.arenas import BOUNDS, box, coordinates, grids, polygons, poses, random_world, turn_of, worlds
from core.arenas import circles as circle_rows
from core.arenas import discs as disc_rows
from core.arenas import segments as segment_rows
from core.twins import Pose

RANGE_M = 6.0
TOLERANCE_M = 3e-6
"""Ranges are single precision numbers of up to 6 m."""
BEAMS = turn_of(16)
times = st.floats(0.0, 20.0)


def scan(
    world: World, pose: Pose, angles: Array = BEAMS, time_s: float = 0.0, max_range_m: float = RANGE_M
) -> Array:
    """(K,) ranges of the kernel."""
    return _core.raycast(world.native, np.array([pose]), angles, max_range_m, time_s)[0].astype(np.float64)


def assert_scan_is_the_twins(world: World, pose: Pose, angles: Array = BEAMS, time_s: float = 0.0) -> None:
    """A beam that grazes an edge may go either way: then it agrees with a neighbour."""
    ranges = scan(world, pose, angles, time_s)
    for beam, measured in zip(angles, ranges, strict=True):
        expected = twins.ray(world, pose[:2], pose[2] + beam, RANGE_M, time_s)
        if abs(measured - expected) > TOLERANCE_M:
            near = [
                twins.ray(world, pose[:2], pose[2] + beam + nudge, RANGE_M, time_s) for nudge in (-1e-8, 1e-8)
            ]
            low, high = min(expected, *near), max(expected, *near)
            assert low - 1e-4 <= measured <= high + 1e-4, (
                f"beam {beam}: {measured}, twin {expected}, near {near}"
            )


def assume_clear_of_edges(world: World, pose: Pose, time_s: float = 0.0) -> None:
    """On the very edge of an obstacle, rounding decides whether a sensor is inside."""
    circles, shapes = twins.shapes(world, time_s)
    gaps = [math.dist(pose[:2], circle[:2]) - circle[2] for circle in circles]
    gaps += [twins.point_to_segment(pose[:2], a, b) for corners in shapes for a, b in twins.edges(corners)]
    assume(all(abs(gap) > 1e-6 for gap in gaps))


@given(circle_rows, poses)
def test_circles(circles: Array, pose: Pose):
    world = World(bounds=BOUNDS, circles=circles)
    assume_clear_of_edges(world, pose)
    assert_scan_is_the_twins(world, pose)


@given(st.lists(polygons, max_size=5), poses)
def test_polygons(corners: list[Array], pose: Pose):
    world = World(bounds=BOUNDS, polygons=tuple(corners))
    assume_clear_of_edges(world, pose)
    assert_scan_is_the_twins(world, pose)


@given(segment_rows, poses)
def test_segments(segments: Array, pose: Pose):
    world = World(bounds=BOUNDS, segments=segments)
    assume_clear_of_edges(world, pose)
    assert_scan_is_the_twins(world, pose)


@given(disc_rows, poses, times)
def test_moving_discs(discs: Array, pose: Pose, time_s: float):
    world = World(bounds=BOUNDS, discs=discs)
    assume_clear_of_edges(world, pose, time_s)
    assert_scan_is_the_twins(world, pose, time_s=time_s)


@settings(max_examples=70)
@given(grids(), poses)
def test_bitmaps_at_any_origin_and_yaw(grid: OccupancyGrid, pose: Pose):
    world = World(bounds=BOUNDS, grid=grid)
    assume_clear_of_edges(world, pose)
    assert_scan_is_the_twins(world, pose)


@settings(max_examples=50)
@given(worlds(), poses, times)
def test_worlds_of_all_kinds(world: World, pose: Pose, time_s: float):
    assume_clear_of_edges(world, pose, time_s)
    assert_scan_is_the_twins(world, pose, time_s=time_s)


def test_hundreds_of_obstacles_in_more_than_one_chunk():
    world = random_world(np.random.default_rng(4), count=130)
    world = replace(world, discs=world.discs[:64])
    for x, y in ((0.0, 0.0), (3.9, -3.9), (7.0, 1.0)):
        assert_scan_is_the_twins(world, (x, y, 0.4), BEAMS + 0.01)


def test_more_than_64_moving_discs_are_refused():
    with pytest.raises(ValueError, match="64"):
        replace(random_world(np.random.default_rng(0), count=65)).native  # noqa: B018


def test_nothing_there_reads_the_greatest_range():
    assert_array_equal(scan(World(bounds=BOUNDS), (0.0, 0.0, 0.0)), RANGE_M)


def test_a_wall_at_three_metres_by_hand():
    world = World(bounds=BOUNDS, segments=np.array([[3.0, -9.0, 3.0, 9.0]]))
    angles = np.array([0.0, math.pi / 3, -math.pi / 3, math.pi / 2, math.pi])
    assert_allclose(scan(world, (0.0, 0.0, 0.0), angles), [3.0, 6.0, 6.0, 6.0, 6.0], rtol=1e-6)
    assert_allclose(
        scan(world, (0.0, 0.0, 0.0), angles, max_range_m=8.0)[:4], [3.0, 6.0, 6.0, 8.0], rtol=1e-6
    )
    assert_allclose(scan(world, (5.0, 0.0, math.pi), angles[:2]), [2.0, 4.0], rtol=1e-6)


@pytest.mark.parametrize(
    "world",
    [
        World(bounds=BOUNDS, circles=np.array([[0.2, 0.1, 0.5]])),
        World(bounds=BOUNDS, polygons=(box(0.2, 0.1, 0.5, 0.5, 0.3),)),
        World(bounds=BOUNDS, discs=np.array([[0.2, 0.1, 2.0, 2.0, 0.5, 0.0, 0.0, 0.0]])),
        World(
            bounds=BOUNDS,
            grid=OccupancyGrid(solid=np.ones((9, 9), np.uint8), resolution_m=0.1, origin=(-0.4, -0.4, 0)),
        ),
    ],
    ids=["circle", "polygon", "disc", "bitmap"],
)
def test_a_sensor_inside_an_obstacle_reads_zero(world: World):
    around = replace(
        world, segments=np.array([[-1.0, -1.0, 1.0, -1.0]]), circles=np.vstack([[2, 2, 1], world.circles])
    )
    assert_array_equal(scan(around, (0.0, 0.0, 0.0)), 0.0)
    assert_array_equal(scan(around, (0.0, 0.0, 0.0), np.array([0.3])), 0.0)


@settings(max_examples=40)
@given(worlds(), st.lists(poses, min_size=1, max_size=4), st.integers(0, 9))
def test_every_pose_and_beam_is_alone(world: World, sensors: list[Pose], count: int):
    angles = np.linspace(-2.0, 1.5, count)
    together = _core.raycast(world.native, np.array(sensors), angles, RANGE_M)
    assert together.shape == (len(sensors), count)
    assert together.dtype == np.float32
    for row, pose in zip(together, sensors, strict=True):
        alone = [
            _core.raycast(world.native, np.array([pose]), angles[k : k + 1], RANGE_M)[0, 0]
            for k in range(count)
        ]
        assert_array_equal(row, np.array(alone, dtype=np.float32))


@given(coordinates, coordinates)
def test_no_sensor_is_no_scan(x: float, y: float):
    world = World(bounds=BOUNDS, circles=np.array([[x, y, 0.3]]))
    assert _core.raycast(world.native, np.empty((0, 3)), BEAMS, RANGE_M).shape == (0, len(BEAMS))


def test_arrays_of_the_wrong_kind_are_refused():
    native = World(bounds=BOUNDS).native
    good = np.zeros((4, 3))
    for poses_in, angles in (
        (np.zeros((4, 2)), BEAMS),
        (np.zeros((4, 3), np.float32), BEAMS),
        (np.zeros((4, 6))[:, ::2], BEAMS),
        (good, BEAMS.astype(np.float32)),
        (good, np.zeros((2, 2))),
        (good.tolist(), BEAMS),
    ):
        with pytest.raises(TypeError):
            _core.raycast(native, poses_in, angles, RANGE_M)  # pyright: ignore[reportArgumentType]
