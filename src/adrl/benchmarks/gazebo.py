"""Control steps a second of robots in Gazebo."""

import os
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.integrations.gazebo import Gazebo
from adrl.processes import bind_to_core, usable_cores
from adrl.worlds import SCENARIOS, load_robot, task_set


def bench_gazebo(
    robot: str, *, num_envs: int = 1, physics_step_s: float = 0.004, steps: int = 500, rounds: int = 5
) -> dict[str, Any]:
    """Drive circles on `complex`, observations and rewards included, Gazebo and this process on one core.

    steps_per_second counts every robot's steps by the clock; steps_per_cpu_second by the time that both processes
    computed, which is what a core of their own would bring on a busy machine. Raises MissingExtra, ConfigError.
    """
    for name, value in (("steps", steps), ("rounds", rounds)):
        if value < 1:
            raise ConfigError(f"{name} is {value}; give 1 or more")
    config = load_robot(robot)
    tasks = task_set(SCENARIOS["complex"], config, "test", num_envs)
    allowed = usable_cores()
    bind_to_core(allowed[-1])  # a process that is started inherits it
    try:
        with Gazebo(config, num_envs, physics_step_s=physics_step_s) as gazebo:
            sim = NavSim(num_envs, config, body=gazebo)
            # Slow circles: contact costs more than driving, and says nothing of it.
            actions = np.tile(np.array([[-0.9, 1.0]], dtype=np.float32), (num_envs, 1))
            by_clock, by_cpu = [], []
            for _ in range(rounds):
                seeds, rng = np.zeros(num_envs, np.uint64), np.random.default_rng(0)
                sim.reset(np.arange(num_envs), tasks, seeds, rng)
                began_s, began_cpu_s = time.perf_counter(), _cpu_s(gazebo)
                for _ in range(steps):
                    sim.observe()
                    sim.step(actions)
                by_clock.append(num_envs * steps / (time.perf_counter() - began_s))
                by_cpu.append(num_envs * steps / (_cpu_s(gazebo) - began_cpu_s))
    finally:
        os.sched_setaffinity(0, allowed)
    return {
        "robot": config.name,
        "envs": num_envs,
        "physics_step_s": physics_step_s,
        "beams": config.lidar.num_beams,
        "steps_per_second": round(statistics.median(by_clock), 1),
        "steps_per_cpu_second": round(statistics.median(by_cpu), 1),
    }


def _cpu_s(gazebo: Gazebo) -> float:
    """Seconds that Gazebo and this process have computed."""
    fields = Path(f"/proc/{gazebo.process_id}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") + time.process_time()
