"""A* and a local controller: on the true map, or on a map of the robot's own."""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from adrl.envs import NavSim
from adrl.observation import to_action
from adrl.planning.own_map import OWN_MAP, OwnMapDriver
from adrl.types import RobotConfig


class ClassicalPolicy:
    """With guidance `map` it follows the path planned on the true map when the task was made, and sees true obstacles.

    With `replan` it knows the robot's scans and odometry alone: it maps, plans and drives on what it has seen.
    """

    name: ClassVar[str]
    controller: ClassVar[Callable[[RobotConfig], Any]]
    """Constants of the local controller for a robot."""
    foresee: ClassVar[bool] = True
    """With the true map, moving discs are where they will be; otherwise they stand where they are."""
    guidance = "map"
    guidances: tuple[str, ...] = ("map", "replan")
    plans_itself = True
    training_worlds: tuple[str, ...] = ()

    def __init__(self) -> None:
        self._sim: NavSim | None = None
        self._starting: NDArray[np.intp] = np.zeros(0, np.intp)

    @property
    def method(self) -> str:
        """As its name."""
        return self.name

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Episodes of robots `rows` (M,) begin."""
        self._starting = np.union1d(self._starting, rows)

    def act_in(self, sim: NavSim) -> NDArray[np.float32]:
        """(N, 2) actions in the simulator's current state."""
        if sim is not self._sim:
            self._sim, self._starting = sim, np.arange(sim.num_envs)
            threads = sim.num_threads
            self._control = sim.local_control(type(self).controller, foresee=self.foresee)
            if sim.guidance == "replan":
                self._driver = OwnMapDriver(
                    sim.num_envs,
                    [kind.robot for kind in sim.kinds],
                    self._control,
                    OWN_MAP,
                    num_threads=threads,
                    kind=sim.b["kind"],
                )
        # A robot without a task has nowhere to go yet, and begins when it has one.
        has_task = np.array([sim.tasks[i] is not None for i in self._starting], dtype=bool)
        rows, self._starting = self._starting[has_task], self._starting[~has_task]
        if sim.guidance != "replan":
            self._control.restart(rows)
            return sim.planned_actions(self._control)
        b = sim.b
        if len(rows) > 0:
            goals = np.array([task.goal for task in (sim.tasks[i] for i in rows) if task is not None])
            self._driver.restart(rows, goals.reshape(-1, 2), b["odometry"][rows])
        commands = self._driver.commands(b["ranges"], b["odometry"], b["twist"], b["active"].astype(bool))
        return to_action(commands, sim.rows.robot)


class WithoutForesight(ClassicalPolicy):
    """Takes moving discs to stand still. On maps of their own all planners do, so this one drives with `map` alone."""

    foresee = False
    guidances = ("map",)
