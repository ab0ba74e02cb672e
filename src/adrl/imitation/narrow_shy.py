"""Ways through no gap narrower than a width, and the planner along them."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError
from adrl.imitation.episode_starts import EpisodeStarts
from adrl.planning.global_planner import Cell, grid_path, inscribed_radius_m, nearest_free, shorten
from adrl.planning.grid import MAX_RESOLUTION_M, FreeSpace, free_space, inflation_m, planning_grid
from adrl.planning.local_control import LocalControl, near_config
from adrl.planning.path_guide import sim_config
from adrl.types import Array, RobotConfig, Task

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv

NEAR_M = 0.3
"""Where so much of a way that does not reach the goal is left, the robot has come as far as it dares."""
WRITTEN = (
    "memory",
    "waypoint",
    "route_left",
    "reached",
    "collided",
    "clearance",
    "least_clearance",
    "path_ahead",
)
"""Arrays of the simulator in which following a path leaves what it knows."""


class ShyPaths:
    """Leads every robot of an environment along a shy way of its own; poses and twists are the environment's."""

    def __init__(self, env: "NavVectorEnv", width_m: float) -> None:
        """Raises ConfigError for a robot as wide as that, for a car, and for robots of several kinds."""
        if len(env.kinds) > 1:
            raise ConfigError(
                f"expert narrow-shy drives one robot with one guidance, and these are {len(env.kinds)} kinds; give "
                "another expert"
            )
        robot, sim = env.robot, env.sim
        if robot.is_car:
            raise ConfigError(
                f"expert narrow-shy: its ways have corners, which robot {robot.name!r} with min_turning_radius_m "
                f"{robot.min_turning_radius_m:g} cannot drive; give another expert"
            )
        own_m = 2.0 * inscribed_radius_m(robot)
        if width_m <= own_m:
            raise ConfigError(
                f"expert narrow-shy:{width_m:g}: robot {robot.name!r} is {own_m:.2f} m wide and fits through no gap of "
                f"{width_m:g} m anyway; give narrow-shy:NUMBER with more"
            )
        self._env, self._width_m = env, width_m
        self._b = sim.b | {name: sim.b[name].copy() for name in WRITTEN if name in sim.b}
        # A way round an obstacle, half the width off it, is longer than this: the point to head for is never seen
        # through a gap that the way goes round. MPPI's samples would cut through one all the same.
        config = near_config("pursuit" if env.expert == "mppi" else env.expert, robot, width_m)
        self.control = LocalControl(env.num_envs, robot, config, num_threads=sim.num_threads)
        self._guide = _core.BatchSim(
            env.num_envs, sim.num_threads, [(robot.native, sim_config(robot, "goal"))], self._b
        )
        self._ways: dict[int, Array] = {}
        self._ends_at_goal = np.ones(env.num_envs, dtype=bool)
        self.at_end = np.zeros(env.num_envs, dtype=bool)
        """(N,) robots that have come as far as they dare, short of the goal."""
        self._starts = EpisodeStarts(env)

    def commands(self, asked: NDArray[np.bool_]) -> Array:
        """(N, 2) speed and yaw rate in the current states; none for those at_end, and for those not asked (N,)."""
        env, pose = self._env, self._b["pose"]
        begun = self._starts.rows()
        for i in begun:
            self._begin(int(i))
        self.control.restart(begun)
        self._guide.follow(pose)
        out = np.zeros((env.num_envs, 2))
        self._guide.plan(asked.view(np.uint8), self.control.native, out)
        self.at_end = ~self._ends_at_goal & (self._b["route_left"] < NEAR_M)
        out[self.at_end] = 0.0
        return out

    def _begin(self, i: int) -> None:
        number = int(self._env.task_index[i])
        task = self._env.task(number)
        if number not in self._ways:
            self._ways[number] = shy_way(task, self._env.robot, self._width_m)
        way = self._ways[number]
        self._ends_at_goal[i] = math.dist(way[-1], task.goal) < 1e-9
        native = replace(task, path=way).native
        self._guide.set_task(i, native)
        self._b["memory"][i] = 0.0
        self._b["memory"][i, 0] = _arc_length_at(way, self._b["pose"][i, :2])


def shy_way(task: Task, robot: RobotConfig, width_m: float) -> Array:
    """(P, 2) shortest way from the task's start through no gap narrower than width_m, moving discs left out.

    To the goal, or to where it comes nearest to it. Start and goal may be close to an obstacle: it is enough that a
    free disc of that width holds them. A start in a narrower place is the whole way.
    """
    radius_m = max(0.5 * width_m, robot.circumscribed_radius_m)  # no less than the planner keeps
    limit_m = inflation_m(radius_m, MAX_RESOLUTION_M)
    space = free_space(planning_grid(task.world, limit_m), robot, radius_m)
    start = _nearest_within(space, task.start[:2], radius_m)
    if start is None:
        return np.array([task.start[:2]])
    end = _nearest_reachable(space, start, task.goal)
    way = shorten(space, grid_path(space, start, end))
    at_goal = [task.goal] if math.dist(space.grid.centre(end), task.goal) <= radius_m else []
    points = np.array([task.start[:2], *way, *at_goal])
    return points[np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-9])]


def _nearest_within(space: FreeSpace, point: tuple[float, float], radius_m: float) -> Cell | None:
    """The free cell nearest to a point, if its free disc holds the point."""
    cell = nearest_free(space, point)
    near = cell is not None and math.dist(space.grid.centre(cell), point) <= radius_m
    return cell if near else None


def _nearest_reachable(space: FreeSpace, start: Cell, goal: tuple[float, float]) -> Cell:
    """Of the cells that a way from start reaches, the one nearest to the goal."""
    from scipy import ndimage

    regions = np.empty(space.blocked.shape, dtype=np.int32)
    ndimage.label(
        space.blocked == 0, output=regions
    )  # four neighbours: A* moves diagonally only between free ones
    cells: NDArray[np.intp] = np.argwhere(regions == regions[start])
    row, column = cells[np.argmin(((space.grid.centre(cells) - goal) ** 2).sum(axis=1))]
    return int(row), int(column)


def _arc_length_at(way: Array, point: Array) -> float:
    """Metres along a polyline (P, 2) to its point nearest to a point (2,)."""
    if len(way) == 1:
        return 0.0
    legs = np.diff(way, axis=0)
    lengths = np.hypot(*legs.T)
    share = np.clip(((point - way[:-1]) * legs).sum(axis=1) / lengths**2, 0.0, 1.0)
    nearest = np.argmin(np.hypot(*(way[:-1] + share[:, None] * legs - point).T))
    return float(lengths[:nearest].sum() + share[nearest] * lengths[nearest])
