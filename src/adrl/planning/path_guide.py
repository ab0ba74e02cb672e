"""Guidance `map`: the A* path of a known map, and the point of it to head for."""

from functools import cached_property

import numpy as np

from adrl import _core
from adrl.errors import PlanningError
from adrl.planning.global_planner import inscribed_radius_m, plan
from adrl.planning.grid import FreeSpace, clearance_limit_m, free_space, planning_grid
from adrl.planning.local_control import local_lookahead_m
from adrl.types import Array, RobotConfig, World

LOOKAHEAD_M = 1.5
"""Distance along the path of the waypoint that guidance `map` gives to the policy."""


def sim_config(robot: RobotConfig, guidance: str) -> "_core.SimConfig":
    """How far ahead robots look along their paths, in the simulator and out of it."""
    config = _core.SimConfig()
    config.lookahead_m = LOOKAHEAD_M if guidance == "map" else 0.0
    config.waypoint_is_given = guidance == "replan"
    config.search_m = 2.0 * max(config.lookahead_m, local_lookahead_m(robot))
    return config


class MapGuide:
    """Leads one robot through a known world, to the same waypoints as the simulator's guidance `map`."""

    def __init__(self, world: World, robot: RobotConfig) -> None:
        self.world = world
        self.robot = robot
        self.path: Array = np.empty((0, 2))
        """(P, 2) from where the robot was when it got its goal, to the goal."""
        self._native: _core.PathGuide | None = None

    def set_goal(self, pose: tuple[float, float, float], goal: tuple[float, float]) -> None:
        """Plan from a pose (x, y, yaw) to a goal in the world. Raises StartOccupied, GoalOccupied and NoPath."""
        self.follow(self._plan(pose, goal))

    def follow(self, path: Array) -> None:
        """Take this path (P, 2) instead of one of A*."""
        self.path = np.ascontiguousarray(path, dtype=np.float64)
        config = sim_config(self.robot, "map")
        self._native = _core.PathGuide(self.world.native, self.robot.native, config, self.path)

    def waypoint(self, pose: tuple[float, float, float]) -> tuple[tuple[float, float], float]:
        """The point to head for, and the metres left along the path. Needs a goal."""
        assert self._native is not None
        return self._native.follow(pose[0], pose[1])

    @property
    def path_ahead(self) -> Array:
        """(P, 2) points of the path ahead of where the robot was when it was last led."""
        assert self._native is not None
        return self._native.ahead()

    def remaining(self, left_m: float) -> Array:
        """(Q, 2) the corners on the last left_m metres of the path."""
        steps = np.hypot(*np.diff(self.path, axis=0).T)
        to_end = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
        return self.path[to_end < left_m]

    def _plan(self, pose: tuple[float, float, float], goal: tuple[float, float]) -> Array:
        if self.world.grid is None:  # its grid may have to grow about start and goal
            return plan(self.world, pose, goal, self.robot)
        wide, *narrow = self._spaces
        try:
            return plan(self.world, pose, goal, self.robot, wide)
        except PlanningError:
            if not narrow:
                raise
        return plan(self.world, pose, goal, self.robot, narrow[0])

    @cached_property
    def _spaces(self) -> list[FreeSpace]:
        """A map's free space for the robot, and for one that passes lengthwise where it is oblong: see plan."""
        grid = planning_grid(self.world, clearance_limit_m(self.robot))
        inscribed_m = inscribed_radius_m(self.robot)
        oblong = 0.0 < inscribed_m < self.robot.circumscribed_radius_m
        radii = (inscribed_m,) if self.robot.is_car else (None, inscribed_m) if oblong else (None,)
        return [free_space(grid, self.robot, radius) for radius in radii]
