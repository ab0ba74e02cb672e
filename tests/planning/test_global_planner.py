"""Global plans: free of collision, no longer than they must be, and refused with the right reason."""

import math
import re
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.errors import ConfigError, GoalOccupied, NoPath, PlanningError, StartOccupied
from adrl.planning.global_planner import inscribed_radius_m, length_m, nearest_free, plan
from adrl.planning.grid import FreeSpace, clearance_limit_m, free_space, planning_grid
from adrl.types import Array, OccupancyGrid, RobotConfig, World
from adrl.worlds import ROBOTS
from adrl.worlds.shapes import box, enclosure

DIFFBOT, JACKAL = ROBOTS["diffbot"], ROBOTS["jackal"]
BOUNDS = (0.0, 0.0, 6.0, 5.0)
EMPTY = World(bounds=BOUNDS, segments=enclosure(BOUNDS))
CIRCLES = st.lists(
    st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 5.0), st.floats(0.1, 0.8)), min_size=0, max_size=12
)
PLACE = st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 5.0))


def room(circles: list[tuple[float, float, float]], **more: object) -> World:
    return World(bounds=BOUNDS, circles=np.array(circles).reshape(-1, 3), segments=enclosure(BOUNDS), **more)  # type: ignore[arg-type]


def wall_with_gap(width_m: float) -> World:
    """A wall 2 m thick across the room at x = 2 to 4, with a corridor of this width along y = 2.5."""
    half = 0.5 * width_m
    upper, lower = 0.5 * (5.0 + 2.5 + half), 0.5 * (2.5 - half)
    return World(
        bounds=BOUNDS,
        polygons=(box(3.0, upper, 2.0, 2.5 - half), box(3.0, lower, 2.0, 2.5 - half)),
        segments=enclosure(BOUNDS),
    )


def disc_clearance(world: World, path: Array, radius_m: float) -> float:
    """Least distance from obstacles of a disc that slides along the path."""
    t = np.linspace(0.0, 1.0, 200)[:, None]
    points = np.concatenate([a + t * (b - a) for a, b in pairwise(path)])
    poses = np.column_stack([points, np.zeros(len(points))])
    return float(_core.clearance(world.native, poses, radius_m, np.empty((0, 2)), 2.0).min())


def connected(space: FreeSpace, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Slow twin: flood the free cells from a's cell."""
    start, goal = (tuple(space.grid.cell(p).tolist()) for p in (a, b))
    seen, queue = {start}, deque([start])
    while queue:
        row, column = queue.popleft()
        for cell in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            inside = 0 <= cell[0] < space.blocked.shape[0] and 0 <= cell[1] < space.blocked.shape[1]
            if inside and not space.blocked[cell] and cell not in seen:
                seen.add(cell)
                queue.append(cell)
    return goal in seen


@given(circles=CIRCLES, start=PLACE, goal=PLACE, robot=st.sampled_from(list(ROBOTS.values())))
def test_a_plan_is_free_of_collision_and_a_refusal_is_right(
    circles: list[tuple[float, float, float]],
    start: tuple[float, float],
    goal: tuple[float, float],
    robot: RobotConfig,
) -> None:
    world = room(circles)
    grid = planning_grid(world, clearance_limit_m(robot), include=[start, goal])
    space = free_space(grid, robot)
    inscribed_m = inscribed_radius_m(robot)
    pose = np.array([(*start, 0.3)])
    room_at_start = _core.clearance(world.native, pose, robot.radius_m or 0.0, robot.polygon, 1.0)[0]
    try:
        path = plan(world, (*start, 0.3), goal, robot)
    except StartOccupied:
        assert space.blocked[tuple(grid.cell(start))]
    except GoalOccupied:
        assert space.blocked[tuple(grid.cell(goal))]
    except NoPath:
        start_cell_free = not space.blocked[tuple(grid.cell(start))]
        assert not (start_cell_free and connected(space, start, goal))
    else:
        assert room_at_start > 0.0
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == goal
        assert length_m(path) >= math.dist(start, goal) - 1e-9
        # A start nearer to an obstacle than paths are may be left along the wall it stands at.
        assert disc_clearance(world, path[1:] if len(path) > 2 else path, inscribed_m) > -1e-6


@given(start=PLACE, goal=PLACE)
def test_without_obstacles_the_plan_is_the_straight_line(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    world = World(bounds=(-2.0, -2.0, 9.0, 9.0), circles=np.array([(-1.5, -1.5, 0.1)]))
    path = plan(world, (*start, 0.0), goal, DIFFBOT)
    # Its ends are joined to the centres of their cells.
    assert length_m(path) <= math.dist(start, goal) + 2.0 * 0.05 * math.sqrt(2.0)


@given(move=st.tuples(st.integers(-200, 200), st.integers(-200, 200)))
def test_moving_the_world_moves_the_plan(move: tuple[int, int]) -> None:
    circles = np.array([(2.0, 2.0, 0.6), (3.2, 3.4, 0.5), (4.0, 1.5, 0.7)])
    shift = np.array(move) * 0.25
    bounds = tuple((np.array(BOUNDS).reshape(2, 2) + shift).ravel().tolist())
    here = plan(room([tuple(c) for c in circles]), (0.52, 0.52, 0.0), (5.52, 4.52), DIFFBOT)
    world = World(bounds=bounds, circles=np.add(circles, (*shift, 0.0)), segments=enclosure(bounds))  # type: ignore[arg-type]
    start, goal = np.array([0.52, 0.52]) + shift, np.array([5.52, 4.52]) + shift
    there = plan(world, (*start, 0.0), (goal[0], goal[1]), DIFFBOT)
    # Ties between equal paths may fall the other way.
    assert length_m(there) == pytest.approx(length_m(here), abs=0.05)


def test_the_nearest_free_cell_is_the_nearest() -> None:
    world = room([(3.0, 2.5, 1.0)])
    space = free_space(planning_grid(world, clearance_limit_m(DIFFBOT)), DIFFBOT)
    for point in ((3.1, 2.6), (0.0, 0.0), (2.2, 3.0)):
        found = nearest_free(space, point)
        assert found is not None
        assert not space.blocked[found]
        distances = [math.dist(space.grid.centre(cell), point) for cell in np.argwhere(space.blocked == 0)]
        assert math.dist(space.grid.centre(found), point) == pytest.approx(min(distances))


def named_cell(message: str) -> tuple[float, float]:
    match = re.search(r"nearest free cell is \((-?[\d.]+), (-?[\d.]+)\)", message)
    assert match, message
    return float(match[1]), float(match[2])


@pytest.mark.parametrize(
    ("goal", "says"),
    [
        ((3.0, 2.5), "goal (3.00, 2.50) is inside an obstacle"),
        ((3.01, 3.19), "m from an obstacle and robot 'diffbot' needs 0.25 m"),
    ],
)
def test_an_occupied_goal_is_refused_and_the_cell_it_names_works(
    goal: tuple[float, float], says: str
) -> None:
    world = room([(3.0, 2.5, 0.5)])
    with pytest.raises(GoalOccupied) as caught:
        plan(world, (1.0, 1.0, 0.0), goal, DIFFBOT)
    assert says in str(caught.value)
    nearest = named_cell(str(caught.value))
    assert length_m(plan(world, (1.0, 1.0, 0.0), nearest, DIFFBOT)) > 0.0


def test_a_start_in_collision_is_refused_and_the_cell_it_names_works() -> None:
    world = room([(3.0, 2.5, 0.5)])
    with pytest.raises(StartOccupied, match="overlaps an obstacle") as caught:
        plan(world, (3.0, 3.15, 0.0), (1.0, 1.0), DIFFBOT)
    assert len(plan(world, (*named_cell(str(caught.value)), 0.0), (1.0, 1.0), DIFFBOT)) >= 2


def test_a_start_beside_a_wall_but_free_is_left() -> None:
    path = plan(EMPTY, (0.21, 2.5, 0.0), (5.0, 2.5), DIFFBOT)
    assert tuple(path[0]) == (0.21, 2.5)
    assert disc_clearance(EMPTY, path, DIFFBOT.radius_m or 0.0) > 0.0
    # The Jackal stands along the wall where it could not turn.
    assert tuple(plan(EMPTY, (3.0, 0.22, 0.0), (5.0, 2.5), JACKAL)[0]) == (3.0, 0.22)
    with pytest.raises(StartOccupied, match="'jackal' overlaps"):
        plan(EMPTY, (3.0, 0.22, 1.57), (5.0, 2.5), JACKAL)


def test_a_disc_on_the_start_is_in_the_way_and_others_are_not() -> None:
    on_start = np.array([(1.0, 1.0, 4.0, 4.0, 0.3, 0.2, 0.0, math.inf)])
    with pytest.raises(StartOccupied):
        plan(room([], discs=on_start), (1.0, 1.0, 0.0), (5.0, 4.0), DIFFBOT)
    far = plan(room([], discs=on_start), (1.0, 4.0, 0.0), (5.0, 4.0), DIFFBOT)
    assert length_m(far) == pytest.approx(4.0, abs=0.15)


def test_an_oblong_robot_passes_lengthwise_where_its_circle_does_not() -> None:
    corridor = wall_with_gap(0.6)
    path = plan(corridor, (1.0, 2.5, 0.0), (5.0, 2.5), JACKAL)
    headings = np.arctan2(*np.diff(path, axis=0).T[::-1])
    middles = 0.5 * (path[1:] + path[:-1])
    poses = np.column_stack([middles, headings])
    assert _core.clearance(corridor.native, poses, 0.0, JACKAL.polygon, 1.0).min() > 0.0
    round_robot = RobotConfig(name="round", radius_m=JACKAL.circumscribed_radius_m)
    with pytest.raises(NoPath, match=r"narrower than the 0\.77 m that robot 'round' needs"):
        plan(corridor, (1.0, 2.5, 0.0), (5.0, 2.5), round_robot)
    with pytest.raises(NoPath, match="'jackal'"):
        plan(wall_with_gap(0.4), (1.0, 2.5, 0.0), (5.0, 2.5), JACKAL)


def test_the_inscribed_disc_touches_the_nearest_edge() -> None:
    assert inscribed_radius_m(JACKAL) == pytest.approx(0.215)
    assert inscribed_radius_m(DIFFBOT) == 0.2
    ahead = RobotConfig(name="ahead", radius_m=None, footprint_m=((1.0, -0.2), (2.0, 0.0), (1.0, 0.2)))
    assert inscribed_radius_m(ahead) == 0.0


def test_a_goal_beyond_the_bounds_of_an_open_world_is_reached() -> None:
    world = World(bounds=BOUNDS, circles=np.array([(3.0, 2.5, 1.0)]))
    assert plan(world, (1.0, 2.5, 0.0), (9.0, 2.5), DIFFBOT)[-1].tolist() == [9.0, 2.5]


def test_a_map_ends_at_its_edge() -> None:
    grid = OccupancyGrid(solid=np.zeros((60, 60), dtype=np.uint8), resolution_m=0.05)
    world = World(bounds=(0.0, 0.0, 3.0, 3.0), grid=grid)
    with pytest.raises(GoalOccupied, match="outside the map"):
        plan(world, (1.0, 1.0, 0.0), (5.0, 1.0), DIFFBOT)
    with pytest.raises(StartOccupied, match="outside the map"):
        plan(world, (-1.0, 1.0, 0.0), (2.0, 1.0), DIFFBOT)


def test_a_world_without_room_says_so() -> None:
    with pytest.raises(PlanningError, match="no place has"):
        plan(EMPTY, (1.0, 1.0, 0.0), (5.0, 4.0), RobotConfig(name="vast", radius_m=4.0))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_not_finite_are_refused(bad: float) -> None:
    for start, goal in (
        ((bad, 1.0, 0.0), (2.0, 2.0)),
        ((1.0, 1.0, bad), (2.0, 2.0)),
        ((1.0, 1.0, 0.0), (2.0, bad)),
    ):
        with pytest.raises(ConfigError, match="not finite"):
            plan(EMPTY, start, goal, DIFFBOT)


def test_free_space_at_hand_is_used() -> None:
    space = free_space(planning_grid(EMPTY, clearance_limit_m(DIFFBOT)), DIFFBOT)
    space.blocked[:, 60] = 1
    with pytest.raises(NoPath):
        plan(EMPTY, (1.0, 1.0, 0.0), (5.0, 1.0), DIFFBOT, space=space)
