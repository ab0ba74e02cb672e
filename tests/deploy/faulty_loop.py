"""The closed loop of test_faults.py: simulator -> faulty channel -> runtime with supervisor -> base -> simulator."""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from adrl.deploy import Command, MlpPolicy, Navigator, Odometry, Scan
from adrl.envs import NavSim
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.types import RobotConfig, Task
from adrl.worlds import ROBOTS, get_scenario, task_set
from deploy.recorded import a_policy

PERIODS = 2
"""Allowed between a fault and the command to stand still; of the base's watchdog, too."""
FAULT = range(20, 45)
"""Steps during which something is wrong: under way, at speed."""
N = 4

Channel = Callable[[int, int, Scan], Scan | None]
"""What arrives at robot i in step k: of the scan taken then, or of older ones."""


class Loop:
    """N robots, each with a navigator of its own; what their bases do, and what hits what."""

    def __init__(
        self,
        tasks: Sequence[Task],
        robot: RobotConfig,
        guidance: str = "map",
        policy: MlpPolicy | None = None,
    ) -> None:
        """policy: the shipped one when None."""
        self.robot, self.guidance = robot, guidance
        self.policy = policy or a_policy(robot)
        self.sim = NavSim(len(tasks), robot, guidance=guidance, maturity=self.policy.config.maturity)
        everyone = np.arange(len(tasks))
        self.sim.reset(everyone, tasks, everyone.astype(np.uint64), np.random.default_rng(0))
        self.tasks = tasks
        self.navigators = [self.navigator(task) for task in tasks]
        for navigator, task in zip(self.navigators, tasks, strict=True):
            navigator.set_goal(task.goal)
        self.age = np.full(len(tasks), 99)
        """Periods since each base was told anything."""
        self.speeds: list[np.ndarray] = []
        self.told: list[np.ndarray] = []
        self.commands: list[Command | None] = [None] * len(tasks)
        self.arrived = np.zeros(len(tasks), dtype=bool)
        self.hit = np.zeros(len(tasks), dtype=bool)
        self.step = 0

    def navigator(self, task: Task) -> Navigator:
        world = task.world if self.guidance == "map" else None
        return Navigator(self.policy, guidance=self.guidance, world=world)

    def run(
        self,
        steps: int,
        channel: Channel = lambda k, i, scan: scan,
        *,
        odometry: Callable[[int, int, Odometry], Odometry | None] = lambda k, i, message: message,
        clock: Callable[[float], float] = lambda time_s: time_s,
        node: Callable[[int], bool] = lambda k: True,
    ) -> None:
        """So many periods; `node` tells whether the nodes run."""
        b, period_s = self.sim.b, self.robot.control_period_s
        for k in range(self.step, self.step + steps):
            stamp_s = k * period_s
            self.age += 1
            for i in np.flatnonzero(b["active"]).tolist():
                scan = channel(k, i, as_scan(b["ranges"][i], self.robot.lidar, clock(stamp_s)))
                message = odometry(k, i, as_odometry(self.sim, i, clock(stamp_s)))
                if node(k):
                    self._command(i, self.navigators[i].step(scan, message, clock(stamp_s)))
                if self.age[i] >= PERIODS:  # the base's own watchdog
                    b["command"][i] = 0.0
            self.told.append(b["command"].copy())
            self.sim.native.step()
            self.speeds.append(b["twist"].copy())
            self.hit |= b["collided"] > 0
            b["active"][self.hit | self.arrived] = 0
        self.step += steps

    def _command(self, i: int, command: Command) -> None:
        self.commands[i] = command
        self.sim.b["command"][i] = command.twist
        self.age[i] = 0
        self.arrived[i] |= command.status == "reached"

    def drove_on(self, steps: range) -> bool:
        """Each robot was told to move in most of the steps."""
        moving = np.array(self.told)[list(steps)].any(axis=2)
        return bool((moving.mean(axis=0) > 0.8).all())

    def told_to_stand(self, steps: range) -> bool:
        return not np.array(self.told)[list(steps)].any()

    def standing(self, steps: range) -> bool:
        return bool(np.abs(np.array(self.speeds)[list(steps)]).max() < 0.01)


@cache
def courses(robot_name: str) -> tuple[Task, ...]:
    return tuple(task_set(get_scenario("clutter"), ROBOTS[robot_name], "test", N))


def loop(robot_name: str = "diffbot") -> Loop:
    return Loop(courses(robot_name), ROBOTS[robot_name])


def braking_periods(robot: RobotConfig) -> int:
    """That the robot needs to come to rest from full speed, its lag included."""
    slowing_s = robot.max_speed_mps / robot.max_acceleration_mps2
    turning_s = robot.max_yaw_rate_radps / robot.max_yaw_acceleration_radps2
    return math.ceil((max(slowing_s, turning_s) + 5.0 * robot.lag_s) / robot.control_period_s)


def outlasts(run: Loop, fault: range = FAULT) -> None:
    """Told to stand within two periods, standing after braking, unharmed; and at the goal when all is well again."""
    assert run.drove_on(range(FAULT.start)), "under way before the fault"
    assert run.told_to_stand(range(fault.start + PERIODS, fault.stop))
    assert run.standing(range(fault.start + PERIODS + braking_periods(run.robot), fault.stop))
    arrives(run)


def arrives(run: Loop) -> None:
    """Unharmed, and at the goal in the end."""
    run.run(500)
    assert not run.hit.any()
    assert run.arrived.all()
