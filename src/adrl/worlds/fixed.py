"""Scenarios in one given world: only start and goal are drawn."""

import logging

import numpy as np

from adrl.errors import TaskError
from adrl.planning.grid import PlanningGrid, clearance_limit_m, free_space, planning_grid
from adrl.types import GOAL_TOLERANCE_M, RobotConfig, Task, World
from adrl.worlds.inside import inside
from adrl.worlds.tasks import TaskSpace, draw_task, task_space

LOG = logging.getLogger("adrl.worlds")

PATH_M = (5.0, 30.0)
"""Least and greatest length of the shortest path, where the world allows."""
KEPT = 16
"""Robots of different size whose free space is kept."""
TINY_M = 0.1
"""Clearance below which a smaller robot is no advice."""


class FixedWorld:
    """Tasks in one world, which all of them share."""

    if_tiny = "take another world"
    """What to do where no robot fits."""

    def __init__(self, name: str, world: World, *, open_bounds: bool = False) -> None:
        """open_bounds: the bounds reach beyond what stands in the world; tasks lie inside of that, see inside()."""
        self.name = name
        self.world = world
        self.open_bounds = open_bounds
        # Clearances and regions are the dear part of a task; what matters of a robot is its radius.
        self._clearances: PlanningGrid | None = None
        self._prepared: dict[float, tuple[TaskSpace, tuple[float, float]]] = {}

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw start and goal with 5 to 30 m of path between them; in a small world with what it allows.

        Raises TaskError where the robot has no room.
        """
        key = robot.circumscribed_radius_m
        prepared = self._prepared.get(key)
        if prepared is None:
            prepared = self._prepared[key] = self._prepare(robot)
            for oldest in tuple(self._prepared)[:-KEPT]:  # the robots of a family are as many as one asks for
                self._prepared.pop(oldest, None)
        tasks, path_range_m = prepared
        try:
            return draw_task(self.world, tasks, rng, robot, path_range_m=path_range_m, tries=200)
        except TaskError as error:
            raise TaskError(f"{self.name}: {error}") from None

    def _grid(self, limit_m: float) -> PlanningGrid:
        """Clearances up to limit_m at least: the same for all robots."""
        known = self._clearances
        if known is None or known.limit_m < limit_m:
            known = self._clearances = planning_grid(self.world, limit_m)
        return known

    def _prepare(self, robot: RobotConfig) -> tuple[TaskSpace, tuple[float, float]]:
        """The task space and the range of path lengths it allows."""
        space = free_space(self._grid(clearance_limit_m(robot)), robot)
        tasks = task_space(space)
        if self.open_bounds:
            tasks, choice = inside(self.world, tasks)
            if choice:
                LOG.warning(f"{self.name}, robot {robot.name!r}: {choice}")
        widest = float(tasks.extents_m.max(initial=0.0))
        # A path is never shorter than the straight way, so half the widest extent is a length that exists.
        shortest = min(PATH_M[0], 0.5 * widest)
        if shortest < 2.0 * GOAL_TOLERANCE_M:
            most_m = float(space.grid.clearance_m[space.grid.task_cells].max(initial=0.0))
            if most_m < TINY_M:
                raise TaskError(
                    f"{self.name}: no place has more than {most_m:.2f} m of clearance; {self.if_tiny}"
                )
            raise TaskError(
                f"{self.name}: the widest region for tasks with the {space.inflation_m:.2f} m of clearance that robot "
                f"{robot.name!r} needs spans {widest:.2f} m; take a smaller robot or another world"
            )
        # Few paths are longer than twice the widest extent; asking for more only wastes tries.
        return tasks.reaching(shortest), (shortest, min(PATH_M[1], 2.0 * widest))
