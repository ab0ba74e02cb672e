"""Tasks in given worlds: maps, Gazebo worlds, the user's own start and goal, and scenarios from outside."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.errors import ConfigError, GoalOccupied, NoPath, StartOccupied, TaskError, UnknownName
from adrl.planning.global_planner import length_m
from adrl.types import RobotConfig, Scenario, Task, World
from adrl.worlds import FAMILIES, ROBOTS, MapScenario, SdfScenario, load_map, single_task, task_set
from adrl.worlds.clutter import Clutter
from adrl.worlds.fixed import KEPT, FixedWorld
from adrl.worlds.shapes import box, cover, enclosure
from map_files import write_map

DIFFBOT = ROBOTS["diffbot"]
EVERY_ROBOT = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
ROOM = World(bounds=(0.0, 0.0, 8.0, 6.0), segments=enclosure((0.0, 0.0, 8.0, 6.0)))


def check_on_map(scenario: FixedWorld, robot: RobotConfig, tasks: list[Task]) -> None:
    """Start and goal lie on cells seen free, and the robot can turn on the spot all along the path."""
    grid = scenario.world.grid
    assert grid is not None
    assert grid.observed_free is not None
    for task in tasks:
        assert task.world is scenario.world
        for x, y in (task.start[:2], task.goal):
            row = int((y - grid.origin[1]) / grid.resolution_m)
            column = int((x - grid.origin[0]) / grid.resolution_m)
            assert grid.observed_free[row, column]
        poses = np.column_stack([task.path, np.zeros(len(task.path))])
        clearance = _core.clearance(
            task.world.native, poses, robot.circumscribed_radius_m, np.empty((0, 2)), 1.0
        )
        assert clearance.min() > 0.0


@EVERY_ROBOT
@pytest.mark.parametrize("name", ["willow/willow-full", "depot/depot"])
def test_large_maps_give_five_to_thirty_metres(maps: Path, name: str, robot: RobotConfig) -> None:
    scenario = MapScenario(maps / f"{name}.yaml")
    tasks = task_set(scenario, robot, "test", 30)
    assert all(5.0 <= task.shortest_m <= 30.0 for task in tasks)
    assert max(task.shortest_m for task in tasks) > 15.0
    check_on_map(scenario, robot, tasks)


@EVERY_ROBOT
def test_a_small_map_gives_what_it_can(maps: Path, robot: RobotConfig) -> None:
    scenario = MapScenario(maps / "turtlebot3_world" / "map.yaml")
    tasks = task_set(scenario, robot, "test", 30)
    assert all(task.shortest_m >= 1.0 for task in tasks)
    if robot.circumscribed_radius_m < 0.3:  # the Jackal fits between few of the pillars
        assert max(task.shortest_m for task in tasks) > 4.0
    check_on_map(scenario, robot, tasks)


def test_tasks_of_a_map_are_fixed_and_differ_between_splits(maps: Path) -> None:
    path = maps / "depot" / "depot.yaml"
    first, again = (task_set(MapScenario(path), DIFFBOT, "test", 5) for _ in range(2))
    assert [task.start + task.goal for task in first] == [task.start + task.goal for task in again]
    others = task_set(MapScenario(path), DIFFBOT, "train", 5)
    assert not {task.start for task in first} & {task.start for task in others}
    assert task_set(MapScenario(path), DIFFBOT, "test", 1, first=3)[0].start == first[3].start


@EVERY_ROBOT
def test_barn_worlds_give_tasks(barn: Path, robot: RobotConfig) -> None:
    scenario = SdfScenario(barn / "worlds" / "world_83.world")
    for task in task_set(scenario, robot, "train", 5):
        assert task.world is scenario.world
        assert 5.0 <= task.shortest_m <= 30.0


def test_a_map_too_narrow_for_the_robot_is_refused(tmp_path: Path) -> None:
    pixels = np.full((100, 100), 254)
    pixels[::8] = 0  # corridors of 0.35 m
    scenario = MapScenario(write_map(tmp_path, pixels))
    with pytest.raises(TaskError, match=r"map:map.*'diffbot'.*smaller robot"):
        task_set(scenario, DIFFBOT, "test", 1)
    small = RobotConfig(name="small", radius_m=0.05)
    assert len(task_set(scenario, small, "test", 3)) == 3


def test_a_small_room_in_a_wide_map_has_the_same_tasks_whoever_saved_it(tmp_path: Path) -> None:
    pixels = np.full((200, 200), 205)  # unknown
    pixels[60:142, 60:142] = 0
    pixels[61:141, 61:141] = 254  # 4 x 4 m
    first, again = (
        task_set(MapScenario(write_map(tmp_path, pixels, free_thresh=free)), DIFFBOT, "test", 10)
        for free in (0.196, 0.25)  # ROS 1, Nav2
    )
    assert [task.start + task.goal for task in first] == [task.start + task.goal for task in again]
    for task in first:
        assert ((task.path > 3.0) & (task.path < 7.0)).all()


def test_the_widest_region_is_that_of_the_cells_for_tasks(tmp_path: Path) -> None:
    pixels = np.full((200, 200), 206)  # free, and not surely so
    pixels[60:142, 60:142] = 0
    pixels[61:141, 61:141] = 254
    for task in task_set(MapScenario(write_map(tmp_path, pixels)), DIFFBOT, "test", 10):
        assert ((task.path > 3.0) & (task.path < 7.0)).all()


def test_tasks_of_a_yawed_map_lie_inside_it(tmp_path: Path) -> None:
    pixels = np.full((60, 120), 254)
    pixels[20:40, 50:60] = 0
    scenario = MapScenario(write_map(tmp_path, pixels, origin=[4.0, -3.0, 0.9], resolution=0.1))
    c, s = math.cos(0.9), math.sin(0.9)
    for task in task_set(scenario, DIFFBOT, "test", 20):
        local = (task.path - (4.0, -3.0)) @ np.array([(c, -s), (s, c)])
        assert ((local > 0.0) & (local < (12.0, 6.0))).all()
        assert not (
            (local[:, 0] > 4.8) & (local[:, 0] < 6.2) & (local[:, 1] > 1.8) & (local[:, 1] < 4.2)
        ).any()


@pytest.mark.parametrize("resolution", [0.01, 0.03, 0.2, 0.5])
def test_maps_of_any_resolution_give_tasks(tmp_path: Path, resolution: float) -> None:
    pixels = np.full((int(6 / resolution), int(9 / resolution)), 254)
    pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1] = 0, 0, 0, 0
    scenario = MapScenario(write_map(tmp_path, pixels, resolution=resolution))
    tasks = task_set(scenario, DIFFBOT, "test", 10)
    check_on_map(scenario, DIFFBOT, tasks)
    assert max(task.shortest_m for task in tasks) > 5.0


def test_a_robot_too_large_for_a_scenario_is_told_so() -> None:
    giant = RobotConfig(name="giant", radius_m=4.0)
    with pytest.raises(TaskError, match=r"'clutter'.*'giant'"):
        task_set(Clutter(), giant, "train", 1)


def test_a_task_set_needs_a_known_split_and_whole_numbers() -> None:
    with pytest.raises(UnknownName, match="did you mean 'train'"):
        task_set(Clutter(), DIFFBOT, "trian", 1)
    with pytest.raises(ConfigError, match="first -1"):
        task_set(Clutter(), DIFFBOT, "train", 1, first=-1)


class Hall:
    """A scenario as a user would write it: any object with a name and task()."""

    name = "hall"

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        return single_task(ROOM, (1.0, float(rng.uniform(1.0, 5.0)), 0.0), (7.0, 3.0), robot)


def test_a_scenario_from_outside_works_like_ours() -> None:
    hall: Scenario = Hall()
    tasks = task_set(hall, DIFFBOT, "train", 3)
    assert len({task.start for task in tasks}) == 3
    assert tasks[1].start == task_set(hall, DIFFBOT, "train", 1, first=1)[0].start


def test_a_single_task_takes_start_and_goal_as_given() -> None:
    task = single_task(ROOM, (1.03, 2.02, 0.5), (6.51, 4.44), DIFFBOT, goal_tolerance_m=0.2)
    assert (task.start, task.goal, task.goal_tolerance_m) == ((1.03, 2.02, 0.5), (6.51, 4.44), 0.2)
    assert task.shortest_m == length_m(task.path)
    assert math.dist((1.03, 2.02), (6.51, 4.44)) <= task.shortest_m <= 6.2


def test_a_single_task_is_refused_with_a_reason(tmp_path: Path) -> None:
    with pytest.raises(TaskError, match="move it away"):
        single_task(ROOM, (1.0, 1.0, 0.0), (1.1, 1.0), DIFFBOT)
    with pytest.raises(GoalOccupied):
        single_task(ROOM, (1.0, 1.0, 0.0), (7.99, 3.0), DIFFBOT)
    with pytest.raises(StartOccupied):
        single_task(ROOM, (0.1, 1.0, 0.0), (7.0, 3.0), DIFFBOT)
    pixels = np.full((60, 60), 254)
    pixels[:, 30] = 0
    world = load_map(write_map(tmp_path, pixels))
    with pytest.raises(NoPath):
        single_task(world, (0.5, 1.5, 0.0), (2.5, 1.5), DIFFBOT)


@given(
    length=st.floats(0.05, 5.0),
    width=st.floats(0.05, 5.0),
    yaw=st.floats(-4.0, 4.0),
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
)
def test_a_box_has_its_sides_and_discs_that_hold_it(
    length: float, width: float, yaw: float, x: float, y: float
) -> None:
    corners = box(x, y, length, width, yaw)
    edges = np.roll(corners, -1, axis=0) - corners
    np.testing.assert_allclose(np.hypot(*edges.T), [length, width, length, width])
    assert (edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1) > 0.0).all()
    discs = cover(x, y, length, width, yaw)
    inside = (np.random.default_rng(0).random((200, 2)) - 0.5) * (length, width)
    c, s = math.cos(yaw), math.sin(yaw)
    points = np.concatenate([corners, inside @ np.array([(c, s), (-s, c)]) + (x, y)])
    apart = np.linalg.norm(points[:, None] - discs[:, :2], axis=-1)
    assert (apart <= discs[:, 2] + 1e-9).any(axis=1).all()


def test_tasks_of_a_robot_are_the_same_whoever_came_before(maps: Path):
    """A map is prepared once: its clearances for all robots, its free space for the last ones."""
    robots = [FAMILIES["any"].draw("test", number) for number in range(KEPT + 4)]
    shared = MapScenario(maps / "turtlebot3_world" / "map.yaml")
    for robot in (*robots, robots[0]):
        try:
            expected = task_set(MapScenario(maps / "turtlebot3_world" / "map.yaml"), robot, "test", 2)
        except TaskError:
            with pytest.raises(TaskError):
                task_set(shared, robot, "test", 2)
            continue
        for task, known in zip(task_set(shared, robot, "test", 2), expected, strict=True):
            assert (task.start, task.goal, task.shortest_m) == (known.start, known.goal, known.shortest_m)
    assert len(shared._prepared) <= KEPT
