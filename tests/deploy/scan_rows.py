"""Random scans and what goes with them, for the exported policies."""

from dataclasses import dataclass

import numpy as np

from adrl import _core
from adrl.observation.motion import F32
from adrl.observation.path_ahead import PathAhead
from adrl.types import Array, RobotConfig
from env_tasks import room


@dataclass(frozen=True)
class ScanRows:
    """N robots; names as the inputs of the ONNX model."""

    ranges: F32
    goal: Array
    twist: Array
    last_action: F32
    past_ranges: F32
    pose: Array
    past_pose: Array
    path: Array
    """(N, 2 P)"""


def random_rows(robot: RobotConfig, n: int, seed: int) -> ScanRows:
    """Robots that have driven a little among pillars, some of which have been moved since."""
    rng = np.random.default_rng(seed)
    lidar = robot.lidar
    pillars = rng.uniform((-4, -4, 0.05), (4, 4, 0.4), (12, 3))
    later = pillars + np.where(
        np.arange(12)[:, None] % 3 == 0, rng.normal(0.0, 0.3, (12, 3)) * (1, 1, 0), 0.0
    )
    past_pose = np.column_stack([rng.uniform(-4, 4, (n, 2)), rng.uniform(-3.1, 3.1, n)])
    pose = past_pose + rng.normal(0.0, (0.2, 0.2, 0.3), (n, 3))
    mount = lidar.mount_x_m * np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2]), np.zeros(n)], axis=1)

    def scans(circles: Array, poses: Array) -> F32:
        return _core.raycast(
            room(12.0, circles=circles.tolist()).native, poses + mount, lidar.angles_rad, lidar.max_range_m
        )  # pyright: ignore

    return ScanRows(
        ranges=scans(later, pose),
        goal=rng.normal(0.0, 4.0, (n, 2)),
        twist=rng.uniform((0, -1), (1, 1), (n, 2)) * (robot.max_speed_mps, robot.max_yaw_rate_radps),
        last_action=rng.uniform(-1.0, 1.0, (n, 2)).astype(np.float32),
        past_ranges=scans(pillars, past_pose),
        pose=pose,
        past_pose=past_pose,
        path=np.random.default_rng((seed, 1)).normal(0.0, 2.0, (n, PathAhead.size)),
    )
