"""Worlds as Gazebo models: written and read again, a LiDAR sees the same."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adrl import _core
from adrl.types import OccupancyGrid, World
from adrl.worlds import SCENARIOS, load_robot, load_sdf, task_set
from adrl.worlds.sdf_write import WALL_M, cover, models, save_sdf
from adrl.worlds.shapes import box, enclosure

TRIANGLE = np.array([(3.0, 3.0), (4.0, 3.2), (3.3, 4.1)])


def same_sight(one: World, other: World, tolerance_m: float) -> None:
    """Where a beam's end differs, it has passed within the tolerance of what the other one hit."""
    poses = np.column_stack([np.random.default_rng(0).uniform(0.5, 5.5, (60, 2)), np.zeros(60)])
    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    seen, seen_again = (_core.raycast(world.native, poses, angles, 20.0) for world in (one, other))
    for i, k in np.argwhere(np.abs(seen - seen_again) > 1e-3):
        nearer, blind = (seen, other) if seen[i, k] < seen_again[i, k] else (seen_again, one)
        end = poses[i, :2] + nearer[i, k] * np.array([np.cos(angles[k]), np.sin(angles[k])])
        distance = _core.clearance(blind.native, np.array([[*end, 0.0]]), 1e-6, np.empty((0, 2)), 1.0)
        assert float(np.ravel(distance)[0]) <= tolerance_m + 1e-3


@pytest.mark.parametrize("scenario", ["clutter", "complex", "rooms"])
def test_a_scenarios_world_is_read_back(tmp_path: Path, scenario: str) -> None:
    world = task_set(SCENARIOS[scenario], load_robot("diffbot"), "test", 1)[0].world
    save_sdf(tmp_path / "w.sdf", world)
    again = load_sdf(tmp_path / "w.sdf")
    np.testing.assert_array_equal(again.circles, world.circles)
    assert len(again.polygons) == len(world.polygons) + len(world.segments)
    same_sight(world, again, WALL_M)


def test_shapes_of_every_kind_and_a_turned_grid(tmp_path: Path) -> None:
    solid = np.random.default_rng(3).random((20, 20)) < 0.2
    grid = OccupancyGrid(solid=solid.astype(np.uint8), resolution_m=0.2, origin=(1.0, 0.5, 0.4))
    world = World(
        bounds=(0.0, 0.0, 6.0, 6.0),
        circles=np.array([(1.0, 1.0, 0.3)]),
        polygons=(TRIANGLE, box(5.0, 1.0, 0.8, 0.2, 0.7)),
        segments=enclosure((0.0, 0.0, 6.0, 6.0)),
        grid=grid,
    )
    save_sdf(tmp_path / "w.sdf", world)
    same_sight(world, load_sdf(tmp_path / "w.sdf"), WALL_M)


@given(arrays.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 1)))
@settings(max_examples=60)
def test_rectangles_cover_each_solid_cell_once_and_no_other(solid: np.ndarray) -> None:
    covered = np.zeros_like(solid)
    for column, row, width, height in cover(solid):
        covered[row : row + height, column : column + width] += 1
    np.testing.assert_array_equal(covered, solid)


def test_a_moving_disc_is_a_model_where_it_begins(tmp_path: Path) -> None:
    world = task_set(SCENARIOS["dynamic"], load_robot("diffbot"), "test", 1)[0].world
    assert len(world.discs)
    names = [model.get("name") for model in models(world, "_3")]
    assert names == ["obstacles_3", *(f"disc_3_{j}" for j in range(len(world.discs)))]
    save_sdf(tmp_path / "w.sdf", world)
    starts = load_sdf(tmp_path / "w.sdf").circles[len(world.circles) :, :2]
    np.testing.assert_allclose(starts, world.coordinates(0.0)[-len(world.discs) :], atol=1e-9)
