"""Tasks: drawn from a world, fixed sets of them, and one of the user's own."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, Self, runtime_checkable
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError, NoPath, TaskError, UnknownName
from adrl.planning.global_planner import Cell, grid_path, length_m, plan, shorten
from adrl.planning.grid import FreeSpace, clearance_limit_m, free_space, planning_grid
from adrl.types import GOAL_TOLERANCE_M, SPLITS, Array, RobotConfig, Scenario, Task, World

COARSE = 4
"""Cells to a side of the blocks on which path lengths are estimated."""
WORLDS = 50
"""Drawn for a task at most."""
Range = tuple[float, float]


class WorldGenerator(Protocol):
    """A scenario that draws a new world for every task."""

    @property
    def name(self) -> str: ...

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world for this robot."""
        ...


@runtime_checkable
class NumberedTasks(Protocol):
    """A scenario whose tasks are given, not drawn."""

    def numbered_task(self, split: str, index: int, robot: RobotConfig) -> Task:
        """Task `index` of a split."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class TaskSpace:
    """Where tasks may start and end, for one world and robot."""

    space: FreeSpace
    allowed: NDArray[np.bool_]
    """(H, W) those cells."""
    regions: NDArray[np.int32]
    """(H, W) number of the connected region, 0 where blocked."""
    coarse: NDArray[np.uint8]
    """(H / COARSE, W / COARSE) 1 where a whole block of cells is blocked."""

    @cached_property
    def cells(self) -> NDArray[np.intp]:
        """(C,) flat indices of the cells."""
        return np.flatnonzero(self.allowed)

    @property
    def extents_m(self) -> Array:
        """(R,) diagonals of the boxes about the cells of regions 1, 2, ...; 0 for a region without any."""
        from scipy import ndimage

        count = int(self.regions.max(initial=0))
        boxes = ndimage.find_objects(np.where(self.allowed, self.regions, 0), max_label=count)
        sides = [[axis.stop - axis.start for axis in box] if box else [0, 0] for box in boxes]
        return np.hypot(*np.array(sides, dtype=np.float64).reshape(-1, 2).T) * self.space.grid.resolution_m

    def on(self, ground: NDArray[np.bool_]) -> Self:
        """The same with tasks on these cells (H, W) only."""
        return replace(self, allowed=self.allowed & ground)

    def reaching(self, extent_m: float) -> Self:
        """The same with tasks in those regions only whose cells reach so far."""
        return self.on(np.concatenate([[False], self.extents_m >= extent_m])[self.regions])


def task_space(space: FreeSpace) -> TaskSpace:
    """Regions and cells of a free space."""
    # SciPy's import takes 0.4 s, and a list of scenarios should not.
    from scipy import ndimage

    # Four neighbours: A* moves diagonally only between two free ones.
    regions = np.empty(space.blocked.shape, dtype=np.int32)
    ndimage.label(space.blocked == 0, output=regions)
    allowed = space.grid.task_cells & (regions > 0)
    return TaskSpace(space=space, allowed=allowed, regions=regions, coarse=_coarse(space.blocked))


def draw_task(
    world: World,
    tasks: TaskSpace,
    rng: np.random.Generator,
    robot: RobotConfig,
    *,
    path_range_m: Range,
    straight_range_m: Range | None = None,
    tries: int = 50,
) -> Task:
    """Draw start and goal such that the shortest path is within path_range_m; a car's may be longer, from its heading.

    straight_range_m: straight distance of the pairs tried; a path that is too long is cut
    and is dropped when start and goal are then too near. None takes distances that suit path lengths drawn at
    random from path_range_m, and drops none.
    Raises TaskError, which says why, when no such pair turns up.
    """
    cells, regions, resolution_m = tasks.cells, tasks.regions.ravel(), tasks.space.grid.resolution_m
    if len(cells) == 0:
        raise TaskError(
            f"no place has the {tasks.space.inflation_m:.2f} m of clearance that robot {robot.name!r} needs; "
            "take a smaller robot or another world"
        )
    width = tasks.regions.shape[1]
    for _ in range(tries):
        starts, goals = cells[rng.integers(len(cells), size=(2, 64))]
        low, high = straight_range_m or _straight_range(rng, path_range_m)
        rows, columns = goals // width - starts // width, goals % width - starts % width
        straight = np.hypot(rows, columns) * resolution_m
        fitting = np.flatnonzero((regions[goals] == regions[starts]) & (straight >= low) & (straight <= high))
        if len(fitting) == 0:
            continue
        pair = _cell(starts[fitting[0]], width), _cell(goals[fitting[0]], width)
        path = _path_within(tasks, *pair, path_range_m, rng)
        if path is not None and (straight_range_m is None or math.dist(path[0], path[-1]) >= low):
            start = (float(path[0, 0]), float(path[0, 1]), float(rng.uniform(-math.pi, math.pi)))
            if robot.is_car:
                try:
                    path = plan(world, start, (float(path[-1, 0]), float(path[-1, 1])), robot, tasks.space)
                except NoPath:  # from that heading
                    continue
            return _task(world, start, path, robot)
    raise TaskError(
        f"no start and goal for robot {robot.name!r} with {path_range_m[0]:.1f} to {path_range_m[1]:.1f} m "
        f"of path between them in {tries} tries; take a smaller robot or another world"
    )


def draw_in_new_world(
    scenario: WorldGenerator,
    rng: np.random.Generator,
    robot: RobotConfig,
    *,
    path_range_m: Range,
    straight_range_m: Range,
    limit_m: float = 0.0,
) -> tuple[Task, FreeSpace]:
    """Draw worlds until one has a task in it, and return it with the free space of its world.

    limit_m: see planning_grid. Raises TaskError when no world has a task.
    """
    reason = ""
    for _ in range(WORLDS):
        world = scenario.generate(rng, robot)
        space = free_space(planning_grid(world, max(limit_m, clearance_limit_m(robot))), robot)
        try:
            task = draw_task(
                world,
                task_space(space),
                rng,
                robot,
                path_range_m=path_range_m,
                straight_range_m=straight_range_m,
                tries=24,
            )
        except TaskError as error:
            reason = str(error)
        else:
            return task, space
    raise TaskError(f"scenario {scenario.name!r}: none of {WORLDS} worlds had a task: {reason}")


def task_set(scenario: Scenario, robot: RobotConfig, split: str, count: int, first: int = 0) -> list[Task]:
    """Tasks first, ..., first + count - 1 of a split. Task i of a split is the same for ever and in any set.

    Splits are disjoint: each task has a random stream of its own, keyed by scenario name, split and i; NumberedTasks
    have splits of their own.
    Raises UnknownName for a split that is not in SPLITS, ConfigError for negative numbers, TaskError.
    """
    if split not in SPLITS:
        raise UnknownName("split", split, SPLITS)
    if count < 0 or first < 0:
        raise ConfigError(f"count is {count} and first {first}; give 0 or more")
    if isinstance(scenario, NumberedTasks):
        return [scenario.numbered_task(split, i, robot) for i in range(first, first + count)]
    entropy, key = crc32(scenario.name.encode()), SPLITS.index(split)
    seeds = (np.random.SeedSequence(entropy, spawn_key=(key, i)) for i in range(first, first + count))
    return [scenario.task(np.random.default_rng(seed), robot) for seed in seeds]


def single_task(
    world: World,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    robot: RobotConfig,
    goal_tolerance_m: float = GOAL_TOLERANCE_M,
) -> Task:
    """A task with the user's own start (x, y, yaw) and goal (x, y).

    Raises ConfigError, StartOccupied, GoalOccupied, NoPath, and TaskError when the goal is reached at the
    start.
    """
    path = plan(world, start, goal, robot)
    if math.dist(start[:2], goal) <= goal_tolerance_m:
        raise TaskError(f"goal {goal} is within {goal_tolerance_m} m of the start already; move it away")
    return replace(_task(world, start, path, robot), goal_tolerance_m=goal_tolerance_m)


def time_limit_s(shortest_m: float, robot: RobotConfig) -> float:
    """Ten seconds, and 2.5 times what the shortest path takes at full speed, or at one at which the robot can turn."""
    return 10.0 + 2.5 * shortest_m / robot.turn_limited_speed_mps


def _task(world: World, start: tuple[float, float, float], path: Array, robot: RobotConfig) -> Task:
    shortest_m = length_m(path)
    return Task(
        world=world,
        start=start,
        goal=(float(path[-1, 0]), float(path[-1, 1])),
        path=path,
        shortest_m=shortest_m,
        time_limit_s=time_limit_s(shortest_m, robot),
    )


def _coarse(blocked: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = blocked.shape
    padded = np.pad(blocked, ((0, -height % COARSE), (0, -width % COARSE)), constant_values=1)
    rows = padded.reshape(-1, COARSE, padded.shape[1]).min(axis=1)
    return np.ascontiguousarray(rows.reshape(len(rows), -1, COARSE).min(axis=2))


def _path_within(
    tasks: TaskSpace, start: Cell, goal: Cell, range_m: Range, rng: np.random.Generator
) -> Array | None:
    """(P, 2) path from start to goal, or, where too long, to a cell on the way; None when not in range."""
    if math.dist(start, goal) * tasks.space.grid.resolution_m < range_m[0]:
        # Most pairs whose path is too short are found out by an A* on a sixteenth of the cells.
        a, b = ((row // COARSE, column // COARSE) for row, column in (start, goal))
        _, blocks = _core.astar(tasks.coarse, a, b)
        # Octile paths are up to 8 % longer than taut ones.
        if blocks * COARSE * tasks.space.grid.resolution_m < 1.05 * range_m[0]:
            return None
    cells = grid_path(tasks.space, start, goal)
    path = shorten(tasks.space, cells)
    length = length_m(path)
    if length > range_m[1]:
        # Any part of a shortest path is a shortest path. Its length is drawn, so that not all are long.
        wanted = rng.uniform(*range_m)
        last = int(wanted / length * (len(cells) - 1))
        path = shorten(tasks.space, np.ascontiguousarray(cells[: last + 1]))
        length = length_m(path)
        if not tasks.allowed[tuple(cells[last])]:
            return None
    return path if range_m[0] <= length <= range_m[1] else None


def _straight_range(rng: np.random.Generator, path_range_m: Range) -> Range:
    """Straight distances that suit a path length drawn at random, so that long ones do not prevail."""
    target = rng.uniform(*path_range_m)
    return max(0.6 * target, GOAL_TOLERANCE_M), target


def _cell(index: np.intp, width: int) -> tuple[int, int]:
    return int(index // width), int(index % width)
