"""What the scenario of rooms promises beyond the contract of every scenario."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from adrl import _core
from adrl.errors import TaskError
from adrl.planning.grid import clearance_limit_m, free_space, planning_grid
from adrl.types import RobotConfig, Task
from adrl.worlds import ROBOTS
from adrl.worlds.rooms import Door, FloorPlan, Rooms
from adrl.worlds.tasks import task_space

ROOMS = Rooms()
EVERY_ROBOT = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
seeds = st.integers(0, 2**32 - 1)
radii = st.floats(0.05, 0.6)


def tasks_with_plans(robot: RobotConfig, count: int) -> list[tuple[Task, FloorPlan]]:
    """Tasks in the first world their generator drew, with its floor plan."""
    found = []
    for seed in range(2 * count):
        task = ROOMS.task(np.random.default_rng(seed), robot)
        first = ROOMS.generate(np.random.default_rng(seed), robot)
        if len(first.polygons) == len(task.world.polygons) and all(
            map(np.array_equal, first.polygons, task.world.polygons)
        ):
            found.append((task, ROOMS.floor_plan(np.random.default_rng(seed), robot)))
    assert len(found) >= count
    return found[:count]


def room_at(plan: FloorPlan, point: tuple[float, float]) -> int:
    """Index of the one room that holds the point."""
    x, y = point
    (index,) = [i for i, (a, b, c, d) in enumerate(plan.rooms) if a < x < c and b < y < d]
    return index


def joined(plan: FloorPlan, door: Door) -> tuple[int, int]:
    """The rooms to both sides of a door."""
    x, y, _ = door.disc
    step = (1e-3, 0.0) if door.axis == 0 else (0.0, 1e-3)
    return room_at(plan, (x - step[0], y - step[1])), room_at(plan, (x + step[0], y + step[1]))


def groups(plan: FloorPlan, doors: tuple[Door, ...]) -> int:
    """Number of groups of rooms that doors do not join."""
    joins = np.zeros((len(plan.rooms), len(plan.rooms)))
    for door in doors:
        joins[joined(plan, door)] = 1.0
    reach = np.linalg.matrix_power(np.eye(len(joins)) + joins + joins.T, len(joins)) > 0.0
    return len(np.unique(reach, axis=0))


@given(seeds, radii)
def test_rooms_tile_the_building(seed: int, radius_m: float) -> None:
    robot = RobotConfig(radius_m=radius_m)
    plan = ROOMS.floor_plan(np.random.default_rng(seed), robot)
    sides = np.array([(c - a, d - b) for a, b, c, d in plan.rooms])
    assert sides.prod(axis=1).sum() == pytest.approx(14.0**2)
    assert sides.min() >= 2.4
    assert sides.max() <= max(5.0, 2.0 * (2.0 * radius_m + 1.0))
    for point in np.random.default_rng(seed).uniform(0.0, 14.0, (20, 2)):
        room_at(plan, tuple(point))
    assert len(plan.walls) == len(plan.rooms) - 1  # each parts one room in two


@given(seeds, radii)
def test_doors_make_a_tree_of_the_rooms(seed: int, radius_m: float) -> None:
    """All rooms are connected, and where no door is spare, any one of them walled up parts them."""
    robot = RobotConfig(radius_m=radius_m)
    plan = Rooms(extra_doors=0.0).floor_plan(np.random.default_rng(seed), robot)
    assert len(plan.doors) == len(plan.rooms) - 1
    assert groups(plan, plan.doors) == 1
    for i in range(len(plan.doors)):
        assert groups(plan, plan.doors[:i] + plan.doors[i + 1 :]) == 2
    looped = Rooms(extra_doors=1.0).floor_plan(np.random.default_rng(seed), robot)
    assert len(looped.doors) > len(plan.doors)
    assert groups(looped, looped.doors) == 1


@given(seeds, radii)
def test_doors_let_the_robot_through_and_lie_in_one_wall(seed: int, radius_m: float) -> None:
    plan = ROOMS.floor_plan(np.random.default_rng(seed), RobotConfig(radius_m=radius_m))
    need_m = 2.0 * radius_m + 0.2
    for door in plan.doors:
        assert max(0.8, need_m) <= door.width_m <= max(1.1, need_m + 0.1)
        (wall,) = [w for w in plan.walls if (w.axis, w.at_m) == (door.axis, door.at_m)]
        for end in (wall.low_m, wall.high_m):
            assert abs(door.middle_m - end) > 0.5 * (door.width_m + plan.thickness_m)
        # No other wall ends in the opening.
        for other in plan.walls:
            if other.axis != wall.axis and wall.at_m in (other.low_m, other.high_m):
                assert abs(other.at_m - door.middle_m) > 0.5 * (door.width_m + plan.thickness_m)


@EVERY_ROBOT
def test_the_robot_gets_everywhere(robot: RobotConfig) -> None:
    """Around all furniture and through all doors; walled up, the doors part the building into its rooms."""
    for task, plan in tasks_with_plans(robot, 4):
        space = free_space(planning_grid(task.world, clearance_limit_m(robot)), robot)
        regions = task_space(space).regions
        cells = np.bincount(regions[regions > 0])
        assert cells.max() >= 0.995 * cells.sum()
        blocked = space.blocked.copy()
        for door in plan.doors:
            x, y, reach = door.disc
            rows, columns = np.indices(blocked.shape)
            centres = space.grid.centre(np.stack([rows, columns], axis=-1))
            across, along = (centres - (x, y))[..., :: 1 if door.axis == 0 else -1].transpose(2, 0, 1)
            blocked[(np.abs(across) < 0.1) & (np.abs(along) < reach)] = 1
        labels = ndimage.label(blocked == 0)[0]  # type: ignore[index]
        assert len(np.unique(labels[blocked == 0])) >= len(plan.rooms)


@EVERY_ROBOT
def test_start_and_goal_are_rooms_apart(robot: RobotConfig) -> None:
    detours = []
    for task, plan in tasks_with_plans(robot, 14):
        straight_m = math.dist(task.start[:2], task.goal)
        assert 8.0 <= task.shortest_m <= 20.0
        assert straight_m >= 3.0
        assert room_at(plan, task.start[:2]) != room_at(plan, task.goal)
        detours.append(task.shortest_m / straight_m)
    assert np.median(detours) > 1.2


def test_rooms_are_furnished() -> None:
    """More than a piece of furniture a room, on average; none stands in a door."""
    pieces, rooms = 0, 0
    for task, plan in tasks_with_plans(ROBOTS["diffbot"], 6):
        walls = sum(len(plan.pieces(wall)) for wall in plan.walls)
        pieces += len(task.world.polygons) + len(task.world.circles) - walls
        rooms += len(plan.rooms)
        middles = np.array([(*door.disc[:2], 0.0) for door in plan.doors])
        clear = _core.clearance(task.world.native, middles, 0.0, np.empty((0, 2)), 5.0)
        np.testing.assert_allclose(clear, [0.5 * door.width_m for door in plan.doors], atol=1e-6)
    assert pieces > rooms


def test_a_robot_wider_than_any_room_is_refused() -> None:
    with pytest.raises(TaskError, match=r"'rooms'.*'giant'"):
        ROOMS.task(np.random.default_rng(0), RobotConfig(name="giant", radius_m=4.0))
