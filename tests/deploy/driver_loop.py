"""Simulated robot and driver in one loop, as their nodes join them."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from adrl.deploy import Navigator, Odometry, Pose, Scan
from adrl.deploy.driver import Driver, Report
from adrl.evaluation.supervised import as_scan
from adrl.geometry import compose, inverse
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.types import RobotConfig, Task, World
from adrl.worlds import ROBOTS, single_task
from deploy.recorded import a_policy
from env_tasks import room

ROBOT = ROBOTS["diffbot"]
PERIOD_S = ROBOT.control_period_s
START: Pose = (-2.0, 0.5, 0.7)


def a_task(world: World | None = None) -> Task:
    task = single_task(room(), START, (3.0, -1.0), ROBOT)
    return dataclasses.replace(task, world=world or room())


class Loop:
    """Simulated robot and driver, as their nodes would join them; the robot's odom begins at its start."""

    def __init__(
        self,
        guidance: str = "goal",
        world: World | None = None,
        robot: RobotConfig = ROBOT,
        known: World | None = None,
        **options: str,
    ) -> None:
        """known: the map of guidance map."""
        self.base = SimulatedRobot(a_task(world), robot)
        known = (known or room()) if guidance == "map" else None
        navigator = Navigator(a_policy(robot), guidance=guidance, world=known)
        self.driver = Driver(navigator, **options)  # pyright: ignore
        self.reports: list[Report] = []
        self.told: list[tuple[float, float]] = []
        self.clock_s = 0.0
        """By how much all clocks are wrong."""
        self.speeds: list[float] = []

    def run(
        self,
        steps: int,
        *,
        scan: Callable[[Scan], Scan | None] = lambda scan: scan,
        odometry: Callable[[Odometry], Odometry | None] = lambda odometry: odometry,
        localised: bool = False,
        poses: Callable[[Pose], list[Pose]] = lambda pose: [pose],
    ) -> "Loop":
        """So many control periods, with a tick at each quarter. poses: what localisation makes of the true one."""
        for _ in range(steps):
            base, now_s = self.base, self.base.time_s + self.clock_s
            heard = odometry(dataclasses.replace(base.odometry, stamp_s=now_s))
            if heard is not None:
                self.driver.take_odometry(heard)
            for pose in poses(base.pose) if localised else []:
                self.driver.take_pose(pose, "map", now_s)
            if (seen := scan(as_scan(base.ranges.astype(np.float32), ROBOT.lidar, now_s))) is not None:
                self._obey(self.driver.take_scan(seen, now_s))
            for quarter in (1, 2, 3):
                self._obey(self.driver.tick(now_s + 0.25 * quarter * PERIOD_S))
            self.told.append(self.reports[-1].command.twist if self.reports else (0.0, 0.0))
            base.advance()
            self.speeds.append(abs(base.odometry.twist[0]) + abs(base.odometry.twist[1]))
        return self

    def _obey(self, report: Report | None) -> None:
        if report is None:
            return
        self.reports.append(report)
        if report.send:
            self.base.command(report.command.twist)

    def until_ended(self, steps: int = 400, **channel: object) -> Report:
        for _ in range(steps):
            self.run(1, **channel)  # pyright: ignore
            if self.reports[-1].outcome:
                return self.reports[-1]
        raise AssertionError(f"still {self.reports[-1].command.status} after {steps} periods")

    def distance_m(self, on_map: tuple[float, float]) -> float:
        return math.dist(self.base.pose[:2], on_map)


def in_odom(on_map: tuple[float, float]) -> tuple[float, float]:
    return compose(inverse(START), (*on_map, 0.0))[:2]
