"""What it costs that the robots of a batch differ: many kinds side by side against the same robots a kind a batch."""

import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from adrl.benchmarks.sim import bench_task
from adrl.benchmarks.timing import rate_per_second
from adrl.envs import Kind, NavSim
from adrl.errors import ConfigError
from adrl.types import RobotConfig
from adrl.worlds import FAMILIES

WORLDS = 32


def bench_mixed(
    *,
    num_robots: int,
    num_envs: int,
    num_threads: int = 0,
    num_beams: int = 180,
    num_obstacles: int = 40,
    seconds: float = 1.0,
    rounds: int = 5,
) -> dict[str, Any]:
    """Steps a second of num_envs robots of num_robots kinds, and what each kind does in a batch of its own, the mean.

    Medians over the rounds, in each of which both take turns. Robots are the first of family `any`, all with as many
    beams, so that the work is the same and only the mixing differs. simulator: motion, collision, noisy scan and
    guidance; environment: the observations, reward terms and features too. Raises ConfigError for no robots.
    """
    if num_robots < 1:
        raise ConfigError(f"robots is {num_robots}; give 1 or more")
    robots = [FAMILIES["any"].draw("train", number) for number in range(num_robots)]
    robots = [replace(robot, lidar=replace(robot.lidar, num_beams=num_beams)) for robot in robots]
    rng = np.random.default_rng(0)
    worlds = [bench_task(rng, num_obstacles) for _ in range(WORLDS)]

    def batch(kinds: Sequence[RobotConfig]) -> NavSim:
        sim, rows = (
            NavSim(num_envs, [Kind(robot=robot) for robot in kinds], num_threads=num_threads),
            np.arange(num_envs),
        )
        tasks = [worlds[i % WORLDS] for i in rows]
        sim.reset(rows, tasks, rows.astype(np.uint64), np.random.default_rng(0), kinds=rows % len(kinds))
        return sim

    together, alone = batch(robots), [batch([robot]) for robot in robots]
    actions = rng.uniform(-1.0, 1.0, (num_envs, 2)).astype(np.float32)

    def simulate(sim: NavSim) -> int:
        sim.native.step()
        sim.native.reset(sim.b["collided"])
        return num_envs

    def environ(sim: NavSim) -> int:
        sim.step(actions)
        sim.observe()
        sim.native.reset(sim.b["collided"])
        return num_envs

    results: dict[str, Any] = {"robots": num_robots}
    for name, step in (("environment", environ), ("simulator", simulate)):
        for sim in (together, *alone):
            step(sim)
        mixed, single = [], []
        for _ in range(rounds):
            mixed.append(rate_per_second(lambda step=step: step(together), seconds))
            share = seconds / num_robots
            each = [rate_per_second(lambda step=step, sim=sim: step(sim), share) for sim in alone]
            single.append(statistics.harmonic_mean(each))
        results[name] = {
            "steps_per_second": statistics.median(mixed),
            "one_kind_steps_per_second": statistics.median(single),
            "ratio": statistics.median(ours / theirs for ours, theirs in zip(mixed, single, strict=True)),
        }
    return results
