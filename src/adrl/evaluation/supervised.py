"""A policy as it runs on a robot: behind the runtime's supervisor, which has the last word on every command."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.messages import Odometry, Reason, Scan
from adrl.deploy.navigator import Navigator
from adrl.deploy.policies import ResolvedPolicy
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.observation import to_action
from adrl.types import LidarConfig, RobotConfig, Task

F32 = NDArray[np.float32]

NEVER_M = 0.01
"""Who has arrived is the simulator's to say: the runtime, which goes by its own odometry, drives on until then."""


class Supervised:
    """A navigator with its supervisor on each robot of a simulator, one step of the runtime a control period."""

    def __init__(self, policy: ResolvedPolicy, robot: RobotConfig, guidance: str) -> None:
        """Raises ConfigError for a policy that does not run on robots."""
        if policy.knows_the_world:
            raise ConfigError(f"{policy.name} drives in simulators only, without a supervisor; leave it out")
        self.name = policy.name
        self.reasons: list[tuple[Reason, ...]] = []
        """Of each robot's last command: why it is not what the policy asked for."""
        self._policy, self._robot, self._guidance = policy, robot, guidance
        self._navigators: dict[int, Navigator] = {}
        self._step = 0

    def reset(self, rows: NDArray[np.intp]) -> None:
        """All robots are at the starts of their tasks."""
        self._navigators.clear()
        self.reasons = [()] * len(rows)
        self._step = 0

    def act_in(self, sim: NavSim) -> F32:
        """(N, 2) actions: what the bases are sent."""
        twists = np.zeros((sim.num_envs, 2))
        now_s = self._step * self._robot.control_period_s
        for i in np.flatnonzero(sim.b["active"]).tolist():
            task = sim.tasks[i]
            assert task is not None
            navigator = self._navigators.get(i) or self._navigators.setdefault(i, self._sent_to(task))
            x, y, yaw = sim.b["pose"][i].tolist()
            scan, odometry = as_scan(sim.b["ranges"][i], self._robot.lidar, now_s), as_odometry(sim, i, now_s)
            command = navigator.step(scan, odometry, now_s, map_pose=(x, y, yaw))
            twists[i], self.reasons[i] = command.twist, command.reasons
        self._step += 1
        return to_action(twists, self._robot)

    def _sent_to(self, task: Task) -> Navigator:
        navigator = Navigator(
            self._policy,
            robot=self._robot,
            guidance=self._guidance,
            world=task.world if self._guidance == "map" else None,
            goal_tolerance_m=NEVER_M,
        )
        navigator.set_goal(task.goal)
        return navigator


def as_scan(ranges: F32, lidar: LidarConfig, stamp_s: float) -> Scan:
    """What a driver publishes of the simulated LiDAR."""
    return Scan(
        ranges=ranges.astype(np.float64),
        angle_min_rad=lidar.angle_min_rad,
        angle_increment_rad=lidar.angle_increment_rad,
        range_max_m=lidar.max_range_m,
        stamp_s=stamp_s,
    )


def as_odometry(sim: NavSim, i: int, stamp_s: float) -> Odometry:
    """The simulated robot's own reckoning."""
    (x, y, yaw), (v, w) = sim.b["odometry"][i].tolist(), sim.b["twist"][i].tolist()
    return Odometry(pose=(x, y, yaw), twist=(v, w), stamp_s=stamp_s)


def spells(reasons: Sequence[tuple[str, ...]]) -> list[tuple[int, list[str]]]:
    """The steps at which the reasons change, the first among them, with what they are from there on."""
    changes = [i for i in range(len(reasons)) if i == 0 or reasons[i] != reasons[i - 1]]
    return [(i, list(reasons[i])) for i in changes]


def steps_of(changes: Sequence[tuple[int, list[str]]], steps: int) -> tuple[tuple[str, ...], ...]:
    """What spells() shortened. Raises ValueError."""
    begins = [first for first, _ in changes]
    if begins != sorted(set(begins)) or begins[:1] != [0][:steps] or begins[-1:] > [steps - 1]:
        raise ValueError(f"reasons of an episode of {steps} steps begin at {begins}")
    ends = [*begins[1:], steps]
    return tuple(
        tuple(words) for (first, words), end in zip(changes, ends, strict=True) for _ in range(first, end)
    )
