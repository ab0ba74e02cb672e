"""A simulated robot that follows paths of another planner, told of its place by transforms."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from adrl.deploy import Navigator, Pose
from adrl.deploy.driver import Driver, Report
from adrl.evaluation.supervised import as_scan
from adrl.geometry import compose, inverse, quaternion_of
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.types import Array, RobotConfig, World
from adrl.worlds import ROBOTS, single_task

ROBOT = ROBOTS["diffbot"]


class PathDrive:
    """The robot's odometry begins at its start; localisation is of the map."""

    def __init__(self, world: World, start: Pose, robot: RobotConfig = ROBOT, **options: float) -> None:
        task = dataclasses.replace(
            single_task(World(bounds=(-50, -50, 50, 50)), start, (9.0, 9.0), robot), world=world
        )
        self.base = SimulatedRobot(task, robot)
        self.driver = Driver(Navigator("diffbot", robot=robot, guidance="path", **options), localisation="tf")  # pyright: ignore
        self.reports: list[Report] = []
        self.places: list[Pose] = []

    def run(self, poses: Callable[[Pose], Pose] = lambda pose: pose, hz: float = 10.0) -> Iterator[Report]:
        """Control periods, for ever. poses: what localisation makes of the true one, hz times a second."""
        base, period_s = self.base, self.base.robot.control_period_s
        told_s = -1.0
        while True:
            now_s = base.time_s
            self.driver.take_odometry(base.odometry)
            while told_s + 1.0 / hz <= now_s + 1e-9 or told_s < 0.0:
                told_s = now_s if told_s < 0.0 else told_s + 1.0 / hz
                x, y, yaw = compose(poses(base.pose), inverse(base.odometry.pose))
                self.driver.frames.take("map", "odom", told_s, (x, y, 0.0), quaternion_of(yaw))
            report = self.driver.take_scan(
                as_scan(base.ranges.astype(np.float32), base.robot.lidar, now_s), now_s
            ) or self.driver.tick(now_s + 0.5 * period_s)
            assert report is not None
            self.reports.append(report)
            self.places.append(base.pose)
            if report.send:
                base.command(report.command.twist)
            yield report
            base.advance()

    def follow(
        self, path: Array, yaw_rad: float | None = None, steps: int = 900, frame: str = "map", **told: object
    ) -> Report:
        """Until it has ended."""
        driving = self.run(**told)  # pyright: ignore
        next(driving)
        x, y = path[-1].tolist()
        self.driver.set_goal((x, y), frame, path=path, yaw_rad=yaw_rad)
        for _ in range(steps):
            if (report := next(driving)).outcome:
                return report
        raise AssertionError(f"still {self.reports[-1].command.status} after {steps} periods")

    def off_m(self, path: Array) -> float:
        """The most that the robot has been beside a path."""
        fine = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])
        return max(
            math.dist(place[:2], min(fine.tolist(), key=lambda p: math.dist(p, place[:2])))
            for place in self.places
        )
