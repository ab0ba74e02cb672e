"""The planning grid: what it measures, where it ends, and what it leaves free."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.errors import PlanningError
from adrl.planning.grid import MARGIN_M, clearance_limit_m, free_space, inflation_m, planning_grid
from adrl.types import OccupancyGrid, RobotConfig, World
from adrl.worlds import ROBOTS
from adrl.worlds.shapes import box, enclosure

COORDINATE = st.floats(-20.0, 20.0)


def bitmap_world(
    origin: tuple[float, float, float], resolution: float, shape: tuple[int, int], seed: int
) -> World:
    rng = np.random.default_rng(seed)
    seen = rng.random(shape) < 0.5
    grid = OccupancyGrid(
        solid=(rng.random(shape) < 0.02).astype(np.uint8),
        resolution_m=resolution,
        origin=origin,
        observed_free=seen,
    )
    reach = math.hypot(*shape) * resolution
    x, y, _ = origin
    return World(bounds=(x - reach, y - reach, x + reach, y + reach), grid=grid)


@given(x=COORDINATE, y=COORDINATE, rows=st.integers(0, 200), columns=st.integers(0, 100))
def test_a_cells_centre_lies_in_that_cell(x: float, y: float, rows: int, columns: int) -> None:
    grid = planning_grid(World(bounds=(x, y, x + 7.0, y + 11.0), circles=np.array([(x, y, 1.0)])), 0.5)
    assert grid.cell(grid.centre((rows, columns))).tolist() == [rows, columns]


def test_clearances_are_those_of_the_core_at_the_centres() -> None:
    world = World(
        bounds=(-1.0, 0.0, 4.0, 3.0),
        circles=np.array([(0.5, 1.0, 0.3)]),
        polygons=(box(2.5, 1.5, 1.0, 0.4, 0.7),),
        segments=enclosure((-1.0, 0.0, 4.0, 3.0)),
    )
    grid = planning_grid(world, 0.8)
    assert grid.bounds == pytest.approx(world.bounds)
    assert grid.clearance_m.shape == (60, 100)
    cells = np.argwhere(grid.inside)
    poses = np.column_stack([grid.centre(cells), np.zeros(len(cells))])
    exact = np.clip(_core.clearance(world.native, poses, 1e-9, np.empty((0, 2)), 0.8), 0.0, 0.8)
    np.testing.assert_allclose(grid.clearance_m[tuple(cells.T)], exact, atol=1e-5)


@given(
    origin=st.tuples(COORDINATE, COORDINATE, st.floats(-4.0, 4.0)),
    resolution=st.floats(0.05, 0.3),
    seed=st.integers(0, 99),
)
def test_a_turned_map_is_sampled_where_it_lies(
    origin: tuple[float, float, float], resolution: float, seed: int
) -> None:
    """Against a twin that walks the map's cells and asks which planning cell lies where."""
    shape = (15, 21)
    world = bitmap_world(origin, resolution, shape, seed)
    assert world.grid is not None
    assert world.grid.observed_free is not None
    grid = planning_grid(world, 0.5)
    c, s = math.cos(origin[2]), math.sin(origin[2])
    for row, column in np.random.default_rng(seed).integers(0, grid.inside.shape, (50, 2)):
        x, y = grid.centre((row, column)) - origin[:2]
        i, j = (c * y - s * x) / resolution, (c * x + s * y) / resolution
        if min(abs(i - round(i)), abs(j - round(j))) < 1e-6:
            continue  # on the border of two cells
        on_map = 0 <= i < shape[0] and 0 <= j < shape[1]
        assert grid.inside[row, column] == on_map
        assert grid.task_cells[row, column] == (on_map and world.grid.observed_free[int(i), int(j)])


@pytest.mark.parametrize(("own", "used"), [(0.01, 0.05), (0.05, 0.05), (0.07, 0.07), (0.1, 0.1), (0.5, 0.1)])
def test_a_map_keeps_its_resolution_within_limits(own: float, used: float) -> None:
    assert planning_grid(bitmap_world((0.0, 0.0, 0.0), own, (20, 20), 0), 0.5).resolution_m == used


def test_large_worlds_take_larger_cells_and_huge_ones_are_refused() -> None:
    def open_square(side: float) -> World:
        return World(bounds=(0.0, 0.0, side, side), circles=np.array([(5.0, 5.0, 1.0)]))

    grid = planning_grid(open_square(200.0), 0.5)
    assert grid.resolution_m == pytest.approx(0.1)
    with pytest.raises(PlanningError, match="cut it into parts"):
        planning_grid(open_square(600.0), 0.5)


def test_the_grid_grows_about_points_beyond_the_bounds() -> None:
    world = World(bounds=(0.0, 0.0, 4.0, 4.0), circles=np.array([(2.0, 2.0, 0.5)]))
    assert planning_grid(world, 0.5, include=[(1.0, 1.0)]).bounds == pytest.approx((0.0, 0.0, 4.0, 4.0))
    grown = planning_grid(world, 0.5, include=[(1.0, 7.0), (-3.0, 1.0)])
    assert grown.bounds == pytest.approx((-4.0, 0.0, 4.0, 8.0))


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.25])
def test_free_cells_leave_room_in_all_their_corners(robot: RobotConfig, resolution: float) -> None:
    inflation = inflation_m(robot.circumscribed_radius_m, resolution)
    assert inflation >= robot.circumscribed_radius_m + max(MARGIN_M, resolution * math.sqrt(0.5))
    assert inflation <= clearance_limit_m(robot)


def test_a_grid_whose_clearances_end_too_soon_is_a_fault() -> None:
    grid = planning_grid(World(bounds=(0.0, 0.0, 4.0, 4.0), circles=np.array([(2.0, 2.0, 0.5)])), 0.2)
    with pytest.raises(ValueError, match=r"end at 0\.2 m"):
        free_space(grid, ROBOTS["diffbot"])
