"""Routes on windows of log-odds, beside Dijkstra on the same costs."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from adrl import _core
from core.replan_twins import GUEST, MOVES, UNIT, WALL, Cell, Costs, Grid, dijkstra

SIDE = 18
FORMS = pytest.mark.parametrize("headings", [False, True])
cells = st.tuples(st.integers(0, SIDE - 1), st.integers(0, SIDE - 1))
inner = st.tuples(st.integers(1, SIDE - 2), st.integers(1, SIDE - 2))
windows = st.tuples(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.02, 0.06, 0.15]))
costs_drawn = st.builds(
    Costs,
    inflation_m=st.sampled_from([0.03, 0.05, 0.1]),
    # Near the most, but no round number: the two would round the cost of a cell apart.
    weight=st.sampled_from([0.0, 0.5, 2.0, 0.997 * _core.MAX_DENSITY_WEIGHT]),
    turn_m=st.sampled_from([0.0, 0.03, 0.2, _core.MAX_TURN_COST_M]),
    near_goal_m=st.sampled_from([0.2, 0.6]),
)


def solid_cells(window: tuple[int, float], side: int = SIDE) -> NDArray[np.bool_]:
    seed, density = window
    return np.random.default_rng(seed).random((side, side)) < density


def log_odds(solid: NDArray[np.bool_]) -> NDArray[np.int8]:
    return np.where(solid, WALL, 0).astype(np.int8)


def native_costs(costs: Costs) -> _core.RouteCosts:
    native = _core.RouteCosts()
    for field in dataclasses.fields(costs):
        if field.name != "resolution_m":
            setattr(native, field.name, getattr(costs, field.name))
    return native


def planner(costs: Costs, side: int = SIDE) -> _core.RoutePlanner:
    return _core.RoutePlanner(side, side, costs.resolution_m, native_costs(costs))


@FORMS
@settings(max_examples=25, deadline=None)
@given(window=windows, start=cells, goal=cells, heading=st.floats(-7.0, 7.0), costs=costs_drawn)
def test_cost_is_dijkstras(
    headings: bool, window: tuple[int, float], start: Cell, goal: Cell, heading: float, costs: Costs
) -> None:
    costs = dataclasses.replace(costs, headings=headings)
    solid = solid_cells(window)
    route, cost, reached = planner(costs).plan(log_odds(solid), start, goal, heading)
    end: Cell = tuple(route[-1])  # pyright: ignore
    reachable = dijkstra(Grid(solid, costs, start, goal), start, heading)
    nearest = min(math.dist(cell, goal) for cell in reachable)
    border = [cell for cell in reachable if {0, SIDE - 1} & set(cell)]
    leaves = bool(border) and nearest * costs.resolution_m > 0.3
    if leaves:
        assert end in border  # the way to the goal may lie beyond the window
    else:
        assert math.dist(end, goal) == pytest.approx(nearest)
    assert reached == (goal in reachable) == (end == goal)
    truth = dijkstra(Grid(solid, costs, start, goal if leaves else end), start, heading)
    assert cost == pytest.approx(truth[end] * costs.resolution_m / UNIT)


@FORMS
def test_route_is_connected_and_free(headings: bool) -> None:
    costs = Costs(headings=headings)
    solid = solid_cells((7, 0.05), 40)
    route, _, _ = planner(costs, 40).plan(log_odds(solid), (3, 3), (36, 35), 0.5)
    grid = Grid(solid, costs, (3, 3), (36, 35))
    assert tuple(route[0]) == (3, 3)
    assert all(tuple(step) in MOVES for step in np.diff(route, axis=0))
    assert all(grid.is_free((int(r), int(c))) for r, c in route)


@settings(max_examples=30, deadline=None)
@given(window=windows, extra=cells, goal=cells)
def test_one_more_obstacle_never_frees_a_cell(window: tuple[int, float], extra: Cell, goal: Cell) -> None:
    """No route gets cheaper, and no goal comes into reach. Near the start other rules hold: it must be left."""
    start = (SIDE // 2, SIDE // 2)
    if math.dist(extra, start) < 6.0:
        return
    solid = solid_cells(window)
    more = solid.copy()
    more[extra] = True
    plan = planner(Costs()).plan
    _, cost, reached = plan(log_odds(solid), start, goal)
    _, cost_more, reached_more = plan(log_odds(more), start, goal)
    assert reached or not reached_more
    assert not reached_more or cost_more >= cost


def test_more_turning_cost_never_makes_a_route_turn_more() -> None:
    solid = solid_cells((5, 0.03), 60)
    turned = []
    for turn_m in (0.0, 0.1, 0.5):
        costs = Costs(headings=True, turn_m=turn_m, k_turn=0.0)
        route, _, reached = planner(costs, 60).plan(log_odds(solid), (4, 4), (50, 55), 0.0)
        assert reached
        steps = [MOVES.index((int(r), int(c))) for r, c in np.diff(route, axis=0)]
        turned.append(sum(min((b - a) % 8, (a - b) % 8) for a, b in zip([0, *steps], steps, strict=False)))
    assert turned == sorted(turned, reverse=True)


@FORMS
def test_a_goal_outside_of_the_window_is_left_for_through_the_gap(headings: bool) -> None:
    """Shut in but for one gap in the east wall, with the goal far to the east: the route ends at that border."""
    solid = np.zeros((40, 40), dtype=bool)
    solid[[0, 39], :31] = solid[:, [0, 30]] = True
    solid[4:12, 30] = False
    route, _, reached = planner(Costs(headings=headings), 40).plan(log_odds(solid), (30, 5), (30, 90), 0.0)
    assert not reached
    assert route[-1, 1] == 39
    assert 4 <= route[np.argmax(route[:, 1] == 30), 0] < 12


@FORMS
def test_a_robot_too_near_to_a_wall_may_leave(headings: bool) -> None:
    solid = np.zeros((40, 40), dtype=bool)
    solid[:, 0] = True
    _, _, reached = planner(Costs(inflation_m=0.25, headings=headings), 40).plan(
        log_odds(solid), (20, 2), (20, 30), 3.1
    )
    assert reached


@FORMS
@settings(max_examples=40, deadline=None)
@given(window=windows, came=st.floats(0.0, 1.0), start=inner, goal=inner)
def test_only_walls_stop_who_has_no_way_out(
    headings: bool, window: tuple[int, float], came: float, start: Cell, goal: Cell
) -> None:
    """The route is then that among walls alone; where they shut the goal off too, that among all that is solid."""
    walls = solid_cells(window)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    rng = np.random.default_rng(window[0] + 1)
    guests = (rng.random(walls.shape) < 0.3 * came) & ~walls
    both = np.where(guests, rng.integers(1, WALL, walls.shape), log_odds(walls)).astype(np.int8)
    plan = planner(Costs(headings=headings)).plan
    here, among_walls, among_all = (
        plan(cells, start, goal, 0.5) for cells in (both, log_odds(walls), log_odds(walls | guests))
    )

    def arrives(route: NDArray[np.int32]) -> bool:
        return math.dist(route[-1], goal) * Costs().resolution_m <= 0.3

    expected = among_walls if arrives(among_walls[0]) and not arrives(among_all[0]) else among_all
    np.testing.assert_array_equal(here[0], expected[0])
    assert here[1:] == expected[1:]


@FORMS
def test_who_stands_in_the_only_door_has_not_walled_it_up(headings: bool) -> None:
    solid = np.zeros((60, 60), dtype=bool)
    solid[[0, -1]] = solid[:, [0, -1]] = solid[:, 30] = True
    door, plan = slice(24, 36), planner(Costs(headings=headings), 60).plan
    for in_the_door, reached in ((GUEST, True), (WALL, False)):
        cells = log_odds(solid)
        cells[door, 30] = in_the_door
        assert plan(cells, (10, 10), (10, 50), 0.0)[2] == reached
    cells[door, 30], cells[0, 4:26] = GUEST, 0
    route, _, reached = plan(cells, (10, 10), (10, 50), 0.0)
    assert not reached
    assert route[-1, 0] == 0, "the way out of the window is open"


def test_the_same_planner_forgets_its_last_window() -> None:
    one, fresh = planner(Costs()), planner(Costs())
    first, second = log_odds(solid_cells((1, 0.06))), log_odds(solid_cells((2, 0.06)))
    one.plan(first, (0, 0), (17, 17))
    np.testing.assert_array_equal(
        one.plan(second, (0, 0), (17, 17))[0], fresh.plan(second, (0, 0), (17, 17))[0]
    )


@pytest.mark.parametrize(
    ("inflation_m", "fits"), [(8.9, True), (9.0, False), (math.nan, False), (-0.1, False)]
)
def test_clearance_that_cannot_be_measured_is_refused(inflation_m: float, fits: bool) -> None:
    """181 cells of 0.05 m are 9.05 m, of which 0.15 m are comfort."""
    costs = Costs(inflation_m=inflation_m, comfort_m=0.15, resolution_m=0.05)
    if fits:
        planner(costs)
        return
    with pytest.raises(ValueError, match="inflation_m"):
        planner(costs)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("weight", 1.1 * _core.MAX_DENSITY_WEIGHT),
        ("weight", math.nan),
        ("turn_m", 1.1 * _core.MAX_TURN_COST_M),
        ("turn_m", -0.1),
        ("k_obstacle", 1.1),
        ("k_goal", -0.1),
        ("k_turn", math.nan),
        ("near_goal_m", 0.0),
    ],
)
def test_costs_that_the_search_cannot_hold_are_refused(name: str, bad: float) -> None:
    """The cost of a cell is a number of 16 bits: beyond it dense places would be cheap again."""
    with pytest.raises(ValueError, match=name):
        planner(dataclasses.replace(Costs(), **{name: bad}))
