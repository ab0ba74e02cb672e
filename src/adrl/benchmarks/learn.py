"""Gradient updates a second of the learner on one core: sampling, reward, twin critics, actor, targets."""

import os
import statistics
from typing import Any

import numpy as np

from adrl.benchmarks.timing import rate_per_second, require_rounds
from adrl.errors import ConfigError

OBSERVATION_SIZE = 44
NUM_ENVS = 64
ROWS = 200


def bench_learn(*, width: int = 128, seconds: float = 5.0, rounds: int = 3) -> dict[str, Any]:
    """Median updates a second over the rounds, on one core and on data drawn at random."""
    if width < 1:
        raise ConfigError(f"width is {width}; give 1 or more")
    require_rounds(rounds, seconds)
    # JAX sizes its thread pool by the cores it finds when it is first imported.
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    from adrl.agents.config import Td3Config, TrainConfig
    from adrl.agents.learner import Learner
    from adrl.imitation import Demonstrations
    from adrl.imitation.schedule import ScheduleConfig

    rng = np.random.default_rng(0)
    config = TrainConfig(
        steps=1,
        pretrain_updates=0,
        td3=Td3Config(widths=(width, width)),
        schedule=ScheduleConfig(driver="clock"),  # needs no probe
    )
    columns = _columns(rng, 4096)
    demonstrations = Demonstrations(**columns, expert_action=columns["action"])
    learner = Learner(config, NUM_ENVS, OBSERVATION_SIZE, demonstrations, None, rng)
    for _ in range(ROWS):
        row = _columns(rng, NUM_ENVS)
        row["terms"] = row.pop("reward_terms")
        learner.replay.add(**row, maturity=0.0)

    def update() -> int:
        for _ in range(10):
            learner.update()
        np.asarray(learner.state.actor)  # waits
        return 10 * config.updates_per_iteration

    update()
    rates = [rate_per_second(update, seconds) for _ in range(rounds)]
    return {
        "schema_version": 1,
        "updates_per_second": statistics.median(rates),
        "updates_per_second_rounds": rates,
        "width": width,
        "batch_size": config.td3.batch_size,
        "observation_size": OBSERVATION_SIZE,
    }


def _columns(rng: np.random.Generator, count: int) -> dict[str, Any]:
    terminated = rng.random(count) < 0.01
    terminated[-1] = True
    return {
        "observation": rng.standard_normal((count, OBSERVATION_SIZE), dtype=np.float32),
        "action": rng.uniform(-1.0, 1.0, (count, 2)).astype(np.float32),
        "reward_terms": rng.standard_normal((count, 6), dtype=np.float32),
        "features": rng.uniform(0.0, 1.0, (count, 3)).astype(np.float32),
        "next_observation": rng.standard_normal((count, OBSERVATION_SIZE), dtype=np.float32),
        "terminated": terminated,
        "truncated": np.zeros(count, dtype=bool),
    }
