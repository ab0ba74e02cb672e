"""A* on the inflated grid, and the shortened path in metres; for cars a path that they can drive."""

import math

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError, GoalOccupied, NoPath, PlanningError, StartOccupied
from adrl.planning.car_path import car_path
from adrl.planning.grid import FreeSpace, clearance_limit_m, free_space, planning_grid
from adrl.types import Array, RobotConfig, World

Cell = tuple[int, int]
"""(row, column)."""


def plan(
    world: World,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    robot: RobotConfig,
    space: FreeSpace | None = None,
) -> Array:
    """(P, 2) shortest path for the robot from start (x, y, yaw) to goal (x, y), ends included.

    The robot is taken for its circumscribed disc. An oblong one that finds no way so is taken for its
    inscribed disc: where it passes, the robot fits through lengthwise. space, when it is at hand, is the
    world's free space for this robot, and the only one tried. Moving discs are ignored, except one that
    stands on the start. A start that is free of collision but nearer to an obstacle than paths are is led to
    the nearest free cell first. The path of a car is one that it can drive from its heading: see car_path.
    Raises ConfigError for numbers that are not finite, StartOccupied, GoalOccupied, and NoPath.
    """
    for name, point in (("start", start), ("goal", goal)):
        if not all(math.isfinite(number) for number in point):
            raise ConfigError(f"{name} {point} is not finite; give metres and radians")
    if space is not None:
        return _plan_in(space, world, start, goal, robot)
    grid = planning_grid(world, clearance_limit_m(robot), include=_outside_allowed(world, start, goal))
    inscribed_m = inscribed_radius_m(robot)
    if robot.is_car:  # car_path asks for the footprint itself
        return _plan_in(free_space(grid, robot, inscribed_m), world, start, goal, robot)
    try:
        return _plan_in(free_space(grid, robot), world, start, goal, robot)
    except PlanningError:
        if not 0.0 < inscribed_m < robot.circumscribed_radius_m:
            raise
    return _plan_in(free_space(grid, robot, inscribed_m), world, start, goal, robot)


def _plan_in(
    space: FreeSpace,
    world: World,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    robot: RobotConfig,
) -> Array:
    goal_cell = _check_goal(space, goal, robot)
    start_cell = _check_start(space, world, start, robot)
    if robot.is_car:
        path = car_path(space.grid, start, goal, robot)
        if path is None:
            raise NoPath(
                f"goal {_place(goal)} cannot be reached from {_place(start)} at {math.degrees(start[2]):.0f} degrees: "
                f"robot {robot.name!r} finds no room for curves of min_turning_radius_m {robot.min_turning_radius_m:g}"
                f"{'' if robot.min_speed_mps < 0.0 else ', and it cannot back'}; move the goal or widen a passage"
            )
        return path
    cells = grid_path(space, start_cell, goal_cell)
    if len(cells) == 0:
        raise NoPath(
            f"goal {_place(goal)} cannot be reached from {_place(start)}: every way is narrower than the "
            f"{2 * space.inflation_m:.2f} m that robot {robot.name!r} needs; move the goal or widen a passage"
        )
    ends = np.array([start[:2], *shorten(space, cells), goal])
    return ends[np.concatenate([[True], np.hypot(*np.diff(ends, axis=0).T) > 1e-9])]


def grid_path(space: FreeSpace, start: Cell, goal: Cell) -> NDArray[np.int32]:
    """(P, 2) cells (row, column) of the shortest octile path between two cells; (0, 2) when there is none."""
    return _core.astar(space.blocked, start, goal)[0]


def shorten(space: FreeSpace, cells: NDArray[np.int32]) -> Array:
    """(P, 2) cells -> (Q, 2) corners x, y of the path pulled taut, in metres."""
    return space.grid.centre(_core.shorten_path(space.blocked, cells))


def length_m(path: Array) -> float:
    """Length of a polyline (P, 2)."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _outside_allowed(world: World, *points: tuple[float, ...]) -> list[tuple[float, float]]:
    """The points a grid should grow to. A map's does not grow: what it does not show is unknown."""
    return [] if world.grid is not None else [(point[0], point[1]) for point in points]


def _check_goal(space: FreeSpace, goal: tuple[float, float], robot: RobotConfig) -> Cell:
    cell = _cell(space, goal)
    if _is_free(space, cell):
        return cell
    why = _why(space, goal, cell, robot)
    raise GoalOccupied(f"goal {_place(goal)} {why}; {_nearest_free_text(space, goal)}")


def _check_start(
    space: FreeSpace, world: World, start: tuple[float, float, float], robot: RobotConfig
) -> Cell:
    cell = _cell(space, start[:2])
    radius_m = robot.radius_m or 0.0
    pose = np.array([start], dtype=np.float64)
    clearance = float(_core.clearance(world.native, pose, radius_m, robot.polygon, 1.0)[0])
    if clearance > 0.0:
        if _is_free(space, cell):
            return cell
        # The footprint's inner disc is free, so the straight way to a cell within it is free of obstacles.
        near = nearest_free(space, start[:2])
        reach_m = inscribed_radius_m(robot)
        if near is not None and math.dist(space.grid.centre(near), start[:2]) <= reach_m:
            return near
        why = _why(space, start[:2], cell, robot)
    else:
        why = f"is in collision: the footprint of robot {robot.name!r} overlaps an obstacle"
    raise StartOccupied(f"start {_place(start)} {why}; {_nearest_free_text(space, start[:2])}")


def nearest_free(space: FreeSpace, point: tuple[float, float]) -> Cell | None:
    """The free cell whose centre is nearest to a point (x, y), or None when no cell is free."""
    free = np.argwhere(space.blocked == 0)
    if len(free) == 0:
        return None
    offsets = space.grid.centre(free) - point
    row, column = free[np.argmin((offsets**2).sum(axis=1))]
    return int(row), int(column)


def _nearest_free_text(space: FreeSpace, point: tuple[float, float]) -> str:
    cell = nearest_free(space, point)
    if cell is None:
        return f"no place has the {space.inflation_m:.2f} m of clearance that the robot needs"
    return f"nearest free cell is {_place(space.grid.centre(cell))}"


def _why(space: FreeSpace, point: tuple[float, float], cell: Cell, robot: RobotConfig) -> str:
    if not space.grid.contains(point):
        return "is outside the map"
    clearance = float(space.grid.clearance_m[cell])
    if clearance <= 0.0:
        return "is inside an obstacle"
    needs = f"robot {robot.name!r} needs {space.inflation_m:.2f} m"
    return f"is about {clearance:.2f} m from an obstacle and {needs}"


def _is_free(space: FreeSpace, cell: Cell) -> bool:
    height, width = space.blocked.shape
    return 0 <= cell[0] < height and 0 <= cell[1] < width and space.blocked[cell] == 0


def _cell(space: FreeSpace, point: tuple[float, float]) -> Cell:
    row, column = space.grid.cell(point)
    return int(row), int(column)


def inscribed_radius_m(robot: RobotConfig) -> float:
    """Radius of the largest disc about the origin inside the footprint; 0 when the origin is outside."""
    if robot.radius_m is not None:
        return robot.radius_m
    corners = robot.polygon
    edges = np.roll(corners, -1, axis=0) - corners
    # Distance from the origin to each edge's line, positive on the inside of a counter-clockwise polygon.
    crosses = corners[:, 0] * edges[:, 1] - corners[:, 1] * edges[:, 0]
    return max(0.0, float((crosses / np.hypot(*edges.T)).min()))


def _place(point: tuple[float, ...] | Array) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"
