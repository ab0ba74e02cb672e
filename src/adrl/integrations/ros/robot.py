"""A simulator as one robot: scans and odometry of its own frame, a base with a watchdog, a count of collisions."""

import contextlib
import dataclasses
import logging
from collections.abc import Iterator

import numpy as np

from adrl import _core
from adrl.deploy import Odometry, Pose, Twist
from adrl.envs import NavSim
from adrl.envs.nav_sim import Body
from adrl.errors import ConfigError
from adrl.geometry import compose, inverse
from adrl.integrations.ros.config import SimConfig
from adrl.integrations.ros.obstacles import nearest_obstacle
from adrl.simulators import find_simulator
from adrl.types import Array, RobotConfig, Task
from adrl.worlds import load_robot, task_set

LOG = logging.getLogger("adrl.sim")

WATCHDOG_PERIODS = 2
"""Control periods without a command after which the base stops."""
NOWHERE = (1e6, 1e6)
"""The simulator's task has no end: goals are the driver's affair."""


class SimulatedRobot:
    """Starts where its task does. After a collision it is put back there."""

    def __init__(self, task: Task, robot: RobotConfig, seed: int = 0, body: Body | None = None) -> None:
        """body: moves and senses the robot instead of our simulator."""
        path = np.array([task.start[:2], NOWHERE])
        self.robot = robot
        self.collisions = 0
        self.steps = 0
        """Control periods since the beginning."""
        self._task = dataclasses.replace(task, goal=NOWHERE, path=path, time_limit_s=1e12)
        self._sim = NavSim(1, robot, body=body)
        self._seed = seed
        self._unheard = 0
        self._restart()

    @classmethod
    @contextlib.contextmanager
    def of(cls, config: SimConfig) -> Iterator["SimulatedRobot"]:
        """For as long as the context lasts, as a Gazebo has to be ended. Raises AdrlError."""
        robot = load_robot(config.robot)
        task = task_set(config.load(), robot, "test", 1, first=config.task)[0]
        if config.start is not None:
            task = _from(task, config.start, robot)
        simulator = find_simulator(config.simulator)
        with contextlib.nullcontext() if simulator is None else simulator(robot, seed=config.seed) as body:
            yield cls(task, robot, config.seed, body)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.steps * self.robot.control_period_s

    @property
    def ranges(self) -> Array:
        """(K,) of the LiDAR, m."""
        return self._sim.b["ranges"][0]

    @property
    def pose(self) -> Pose:
        """On the map."""
        x, y, yaw = self._sim.b["pose"][0].tolist()
        return x, y, yaw

    @property
    def odometry(self) -> Odometry:
        """In a frame whose origin is the start."""
        x, y, yaw = self._sim.b["odometry"][0].tolist()
        v, w = self._sim.b["twist"][0].tolist()
        pose = compose(inverse(self._task.start), (x, y, yaw))
        return Odometry(pose=pose, twist=(v, w), stamp_s=self.time_s)

    def command(self, twist: Twist) -> None:
        """What the base is to do from now on."""
        self._sim.b["command"][0] = twist if np.isfinite(twist).all() else 0.0
        self._unheard = 0

    def advance(self) -> None:
        """One control period."""
        self._unheard += 1
        if self._unheard > WATCHDOG_PERIODS:
            self._sim.b["command"][0] = 0.0
        if self._sim.body is None:
            self._sim.native.step()
        else:
            self._sim.body.step(self._sim.b)
        self.steps += 1
        if self._sim.b["collided"][0]:
            self.collisions += 1
            x, y, _ = self.pose
            LOG.warning(
                "collision %d: at (%.2f, %.2f) it hit %s; it is put back to its start (%.2f, %.2f, %.2f)",
                *(
                    self.collisions,
                    x,
                    y,
                    nearest_obstacle(self._task.world, (x, y), float(self._sim.b["time"][0])),
                ),
                *self._task.start,
            )
            self._seed += 1
            self._restart()

    def _restart(self) -> None:
        seeds = np.array([self._seed], np.uint64)
        self._sim.reset(np.array([0]), [self._task], seeds, np.random.default_rng(self._seed))
        self._sim.b["command"][0] = 0.0


def _from(task: Task, start: Pose, robot: RobotConfig) -> Task:
    """The task with another start. Raises ConfigError for one where the robot cannot be."""
    if not np.isfinite(start).all():
        raise ConfigError(f"start is {start}; give x, y and yaw, in metres and radians")
    pose = np.array([start])
    clearance = _core.clearance(task.world.native, pose, robot.radius_m or 0.0, robot.polygon, 1.0)
    if clearance[0] <= 0.0:
        hit = nearest_obstacle(task.world, start[:2], 0.0)
        raise ConfigError(
            f"start {start} is in collision: robot {robot.name!r} would overlap {hit}; move it away"
        )
    return dataclasses.replace(task, start=start)
