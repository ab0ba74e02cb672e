"""How long one robot takes from a scan to a command: the policy alone, and the whole runtime with its supervisor."""

import time
from typing import Any

import numpy as np

from adrl.deploy import MlpPolicy, Navigator
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.observation import EncoderConfig, ObservationEncoder, in_robot_frame, to_twist
from adrl.observation.motion import ScanHistory
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.types import GUIDANCE, Task
from adrl.worlds import get_scenario, robot_from_fields, task_set

WARM_UP = 200
COURSES = 8
"""Tasks of `complex` that the runtime is timed on."""


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
    if encoder.history_steps > 0:
        history = ScanHistory(1, robot.lidar.num_beams, encoder.history_steps)
        history.begin(np.array([0]), scans[0], pose)
    durations = np.empty(steps)
    for k in range(-min(WARM_UP, steps), steps):
        begin = time.perf_counter()
        scan = scans[k % len(scans)]
        if history is not None:
            history.add(scan, pose)
        ahead = in_robot_frame(pose, goal)
        path = np.repeat(ahead[:, None], len(PATH_POINTS_M), axis=1)
        seen = encoder.encode(scan, ahead, twist, action, history, path)
        action = policy.act(seen)
        twist = to_twist(action, robot)
        if k >= 0:
            durations[k] = time.perf_counter() - begin
    return {
        "steps": steps,
        "p50_ms": 1e3 * float(np.median(durations)),
        "p99_ms": 1e3 * float(np.percentile(durations, 99)),
    }


def bench_runtime(policy: MlpPolicy, *, steps: int = 5000) -> dict[str, Any]:
    """Navigator.step with the supervisor, for each guidance, driving through `complex`. Times in ms.

    Everything from the scan message to the command is in it, replanning too; a route across a map is planned when the
    goal is set, in a step that counts as well. p99_cpu_ms: processor time, without the waits of a busy machine.
    """
    if steps < 1:
        raise ConfigError(f"steps is {steps}; give 1 or more")
    robot = robot_from_fields(policy.config.robot)
    tasks = task_set(get_scenario("complex"), robot, "validation", COURSES)
    results: dict[str, Any] = {"steps": steps}
    for guidance in GUIDANCE:
        wall, busy = np.array(_driving_seconds(policy, guidance, tasks, steps)).T
        results[guidance] = {
            "p50_ms": 1e3 * float(np.median(wall)),
            "p99_ms": 1e3 * float(np.percentile(wall, 99)),
            "p99_cpu_ms": 1e3 * float(np.percentile(busy, 99)),
        }
    return results


def _driving_seconds(
    policy: MlpPolicy, guidance: str, tasks: list[Task], steps: int
) -> list[tuple[float, float]]:
    """Wall clock and processor time of each step."""
    robot = robot_from_fields(policy.config.robot)
    encoder = EncoderConfig(**policy.config.encoder)
    sim = NavSim(1, robot, guidance="goal", encoder=encoder)
    period_s = robot.control_period_s
    durations: list[tuple[float, float]] = []
    for number in range(steps):  # tasks, until the steps are done
        task = tasks[number % len(tasks)]
        sim.reset(np.array([0]), [task], np.array([number], np.uint64), np.random.default_rng(number))
        world = task.world if guidance == "map" else None
        navigator = Navigator(policy, robot=robot, guidance=guidance, world=world)
        navigator.set_goal(task.goal)
        for k in range(round(task.time_limit_s / period_s)):
            now_s = k * period_s
            scan, odometry = as_scan(sim.b["ranges"][0], robot.lidar, now_s), as_odometry(sim, 0, now_s)
            begin, busy = time.perf_counter(), time.thread_time()
            command = navigator.step(scan, odometry, now_s)
            durations.append((time.perf_counter() - begin, time.thread_time() - busy))
            if len(durations) == steps:
                return durations
            sim.b["command"][0] = command.twist
            sim.native.step()
            if navigator.goal is None or sim.b["collided"][0]:
                break
    return durations
