"""Episodes as a ROS bag: each as the robot would have recorded it, one after another."""

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from adrl.bags import BagWriter
from adrl.bags.writer import MAP, ODOM
from adrl.envs.nav_sim import NavSim
from adrl.envs.steps import Outcome
from adrl.evaluation.traces import PathLog, StepLog
from adrl.types import Array, Task

START_S = 1.0
"""Time of the first message: simulated time, as Gazebo's, for equal runs to give equal bags."""
PAUSE_S, PAUSE_PERIODS = 2.0, 10
"""Between two episodes nothing is recorded for this time, or for so many control periods if that is longer."""


class BagRecorder:
    """Watches a rollout, and writes the episodes of the tasks asked for.

    At each control period: scan and odometry, then the command that the robot answers them with. A goal begins an
    episode; a stop ends it. Goals and plans are in the frame that the policy is given them in: map with guidance
    `map`, else odom. `/plan` is the A* path there, and each that a standing car is given later; with
    `replan` each new way over a waypoint.
    """

    reward = None

    def __init__(self, writer: BagWriter, tasks: Collection[int] | None = None) -> None:
        """tasks: numbers in their split; all when None."""
        self._writer = writer
        self._wanted = None if tasks is None else np.array(sorted(tasks), np.int64)
        self._period_s, self._guidance = 0.1, "goal"
        self._now = 0
        self._chosen: NDArray[np.bool_] = np.empty(0, bool)
        self._tasks: list[Task | None] = []
        self._states, self._steps = StepLog(), StepLog()

    def begin(self, sim: NavSim, numbers: NDArray[np.int64]) -> None:
        """Robots of the simulator stand at the starts of the tasks with these numbers in their split."""
        self._period_s, self._guidance = sim.robot.control_period_s, sim.guidance
        self._tasks = list(sim.tasks)
        self._chosen = np.full(len(numbers), True) if self._wanted is None else np.isin(numbers, self._wanted)
        self._states, self._steps, self._paths = StepLog(), StepLog(), PathLog(sim)
        self._add_state(sim, np.flatnonzero(self._chosen))

    def add(self, sim: NavSim, active: NDArray[np.bool_], outcome: Outcome) -> None:
        """One step of the robots that were driving, (N,) active."""
        rows = np.flatnonzero(active & self._chosen)
        self._steps.add(rows, command=sim.b["command"])
        self._paths.add(sim)
        self._add_state(sim, rows)

    def end(self, ending: NDArray[np.bool_]) -> None:
        """Write the episodes of these robots."""
        robots = np.flatnonzero(self._chosen).tolist()
        for robot, states, steps in zip(robots, self._states.of(robots), self._steps.of(robots), strict=True):
            task = self._tasks[robot]
            assert task is not None
            paths = {0: task.path} | dict(self._paths.of(robot))
            self._write(task, paths, states, steps.get("command", np.empty((0, 2))))

    def _add_state(self, sim: NavSim, rows: NDArray[np.intp]) -> None:
        b = sim.b
        names = ("pose", "odometry", "twist", "ranges", "waypoint")
        self._states.add(rows, **{name: b[name] for name in names})

    def _write(
        self, task: Task, paths: Mapping[int, Array], states: dict[str, Array], commands: Array
    ) -> None:
        write, frame = self._writer, MAP if self._guidance == "map" else ODOM
        told = np.concatenate([commands, np.zeros((1, 2))])
        waypoints = states["waypoint"]
        for k, odometry in enumerate(states["odometry"]):
            # Periods are counted, not added up: the times of an hour are as exact as those of a second.
            time_s = START_S + (self._now + k) * self._period_s
            if k == 0:
                write.goal(time_s, task.goal, frame)
            if k in paths and frame == MAP:
                write.plan(time_s, paths[k], frame)
            if self._guidance == "replan" and (k == 0 or not np.array_equal(waypoints[k], waypoints[k - 1])):
                write.plan(time_s, np.array([odometry[:2], waypoints[k], task.goal]), frame)
            write.transforms(time_s, states["pose"][k], odometry)
            write.odometry(time_s, odometry, states["twist"][k])
            write.scan(time_s, states["ranges"][k])
            write.command(time_s, told[k])
        self._now += len(told) + max(PAUSE_PERIODS, round(PAUSE_S / self._period_s))
