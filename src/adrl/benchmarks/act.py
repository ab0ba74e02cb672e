"""How long one robot's policy takes from a scan to a command."""

import time
from typing import Any

import numpy as np

from adrl.deploy.policy import MlpPolicy
from adrl.errors import ConfigError
from adrl.motion import ScanHistory
from adrl.observation import EncoderConfig, ObservationEncoder, in_robot_frame, to_twist
from adrl.worlds import robot_from_fields

WARM_UP = 200


def bench_act(policy: MlpPolicy, *, steps: int = 5000) -> dict[str, Any]:
    """Goal into the robot's frame, encoding, network and command, for one robot at a time. Times in ms."""
    if steps < 1:
        raise ConfigError(f"steps is {steps}; give 1 or more")
    robot = robot_from_fields(policy.config.robot)
    encoder = ObservationEncoder(robot, EncoderConfig(**policy.config.encoder))
    rng = np.random.default_rng(0)
    scans = rng.uniform(0.2, robot.lidar.max_range_m, (16, 1, robot.lidar.num_beams)).astype(np.float32)
    pose, goal, twist = np.zeros((1, 3)), np.array([[3.0, 1.0]]), np.zeros((1, 2))
    action = np.zeros((1, 2), dtype=np.float32)
    history = None
    if encoder.config.history_steps > 0:
        history = ScanHistory(1, robot.lidar.num_beams, encoder.config.history_steps)
        history.begin(np.array([0]), scans[0], pose)
    durations = np.empty(steps)
    for k in range(-min(WARM_UP, steps), steps):
        begin = time.perf_counter()
        scan = scans[k % len(scans)]
        if history is not None:
            history.add(scan, pose)
        seen = encoder.encode(scan, in_robot_frame(pose, goal), twist, action, history)
        action = policy.act(seen)
        twist = to_twist(action, robot)
        if k >= 0:
            durations[k] = time.perf_counter() - begin
    return {
        "steps": steps,
        "p50_ms": 1e3 * float(np.median(durations)),
        "p99_ms": 1e3 * float(np.percentile(durations, 99)),
    }
