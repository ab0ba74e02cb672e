"""An environment whose episodes are also written to a bag, and bags drawn by hand."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from adrl.bags import BagWriter
from adrl.envs import NavVectorEnv
from adrl.evaluation.bag_recorder import BagRecorder
from adrl.imitation import Demonstrations, collect
from adrl.observation import EncoderConfig
from adrl.types import RobotConfig


def collect_into_bag(
    path: Path, robot: RobotConfig, encoder: EncoderConfig | None, steps: int
) -> Demonstrations:
    """What `collect` records of one robot, whose drives are in the bag as well."""
    env = NavVectorEnv(1, robot=robot, encoder=encoder, task_pool=16)
    with BagWriter(path, robot) as writer:
        recorder = BagRecorder(writer)
        _watch(env, recorder)
        data = collect(env, steps, seed=5)
        recorder.end(np.ones((3, 1), bool))
    return data


def _watch(env: NavVectorEnv, recorder: BagRecorder) -> None:
    reset, step, begun = env.sim.reset, env.sim.step, False

    def watched_reset(*arguments: Any, **named: Any) -> None:
        nonlocal begun
        if begun:
            recorder.end(np.ones((3, 1), bool))
        reset(*arguments, **named)
        recorder.begin(env.sim, np.zeros(1, np.int64))
        begun = True

    def watched_step(actions: Any) -> Any:
        outcome = step(actions)
        recorder.add(env.sim, np.ones(1, bool), outcome)
        return outcome

    env.sim.reset, env.sim.step = watched_reset, watched_step  # pyright: ignore[reportAttributeAccessIssue]


Leg = tuple[float, float, float]
"""Seconds, speed in m/s, yaw rate in rad/s."""


def drive_by_hand(
    path: Path,
    legs: Iterable[Leg],
    robot: RobotConfig,
    *,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goals: dict[float, tuple[float, float]] | None = None,
    frame: str = "odom",
    scan_every: int = 1,
    wall: Callable[[float, float], float] | None = None,
    skip: Iterable[str] = (),
) -> None:
    """A bag of a robot that does at once what it is told, in a world with nothing in it.

    origin: where it starts. goals: seconds -> place, both from the start. scan_every: periods between scans.
    wall: (seconds, angle) -> range; free when None. skip: topics that are left out.
    """
    dt, lidar = robot.control_period_s, robot.lidar
    told = [(v, w) for seconds, v, w in legs for _ in range(round(seconds / dt))]
    x, y, yaw = origin
    c, s = np.cos(yaw), np.sin(yaw)
    waiting = dict(goals or {})
    with BagWriter(path, robot) as bag:
        for k, (v, w) in enumerate([*told, (0.0, 0.0)]):
            now = 5.0 + k * dt
            for due in [due for due in waiting if due <= k * dt + 1e-9]:
                gx, gy = waiting.pop(due)
                bag.goal(now, (origin[0] + c * gx - s * gy, origin[1] + s * gx + c * gy), frame)
            if "/odom" not in skip:
                bag.odometry(now, (x, y, yaw), told[k - 1] if k > 0 else (0.0, 0.0))
            if k % scan_every == 0 and "/scan" not in skip:
                seen = [math.inf if wall is None else wall(k * dt, a) for a in lidar.angles_rad]
                bag.scan(now, np.array(seen))
            if "/cmd_vel" not in skip:
                bag.command(now, (v, w))
            x, y, yaw = x + v * dt * np.cos(yaw), y + v * dt * np.sin(yaw), yaw + w * dt
