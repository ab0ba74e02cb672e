"""One learner in a process of its own on a core of its own: python -m adrl.benchmarks.learn_worker CORE WHAT WIDTH.

For each line of standard input, a number of seconds, it works for so long and answers with a line of JSON: rate, units
a second; core_share, the part of that time in which the core was ours; core_rate, units a second of the core's time.
The end of the input ends it.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from adrl.processes import bind_to_core

OBSERVATION_SIZE = 44
NUM_ENVS = 64
ROWS = 200
"""Steps of all environments in the replay: enough that its rows do not fit in a core's own cache."""
MATRIX = 256
UPDATES = 40
"""Updates between two looks at the clock."""

Work = Callable[[], int]


def main() -> int:
    """Answer until the input ends."""
    core, what, width = int(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    bind_to_core(core)
    from adrl.benchmarks.timing import rate_per_second

    work = {"adrl": _adrl, "td3": _td3, "sb3-td3": _sb3, "matmul": _matmul}[what](width)
    for _ in range(2):
        work()
    _answer({"ready": True})
    for line in sys.stdin:
        wall, cpu = time.perf_counter(), time.process_time()
        rate = rate_per_second(work, float(line))
        share = (time.process_time() - cpu) / (time.perf_counter() - wall)
        _answer({"rate": rate, "core_share": share, "core_rate": rate / share})
    return 0


def _answer(content: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


def _matmul(_: int) -> Work:
    """Floating-point operations of products of 256 x 256 matrices: the core's peak, as far as a BLAS reaches it."""
    import numpy as np

    a, b = np.random.default_rng(0).standard_normal((2, MATRIX, MATRIX), dtype=np.float32)
    out = np.empty_like(a)

    def work() -> int:
        for _ in range(100):
            np.matmul(a, b, out=out)
        return 100 * 2 * MATRIX**3

    return work


def _adrl(width: int) -> Work:
    """Updates of our learner as training makes them: sampling, reward, twin critics, actor, cloning, targets."""
    return _ours(width, "adrl")


def _td3(width: int) -> Work:
    """The same without demonstrations: the peer's algorithm."""
    return _ours(width, "td3")


def _ours(width: int, method: str) -> Work:
    import numpy as np

    from adrl.agents.config import Td3Config, TrainConfig
    from adrl.agents.learner import Learner
    from adrl.agents.methods import method_config
    from adrl.imitation import Demonstrations
    from adrl.imitation.schedule import ScheduleConfig
    from adrl.observation import ObservationEncoder
    from adrl.worlds import ROBOTS

    rng = np.random.default_rng(0)
    # The clock needs no probe; an update costs the same whatever S follows.
    clock = ScheduleConfig(driver="clock")
    config = TrainConfig(steps=1, td3=Td3Config(widths=(width, width)), schedule=clock)
    config = replace(method_config(method, config), pretrain_updates=0)
    columns = _columns(4096)
    demonstrations = Demonstrations(**columns, expert_action=columns["action"])
    mirror = ObservationEncoder(ROBOTS["diffbot"]).mirror
    learner = Learner(config, NUM_ENVS, OBSERVATION_SIZE, demonstrations, None, rng, mirror)
    for row in range(ROWS):
        step = _columns(NUM_ENVS, seed=row)
        step["terms"] = step.pop("reward_terms")
        learner.replay.add(**step, maturity=0.0, periods=np.ones(NUM_ENVS))

    def work() -> int:
        for _ in range(UPDATES // config.updates_per_iteration):
            learner.update()
        np.asarray(learner.state.actor)  # waits
        return UPDATES

    return work


def _sb3(width: int) -> Work:
    """Updates of Stable-Baselines3's TD3 as adrl compare trains it, sampling included."""
    from stable_baselines3.common.logger import Logger

    from adrl.agents.config import Td3Config, TrainConfig
    from adrl.baselines.sb3 import make_model
    from adrl.envs import NavVectorEnv

    config = TrainConfig(steps=1, td3=Td3Config(widths=(width, width)))
    env = NavVectorEnv(NUM_ENVS, scenario="clutter", task_pool=1)
    assert env.sim.encoder.size == OBSERVATION_SIZE
    model: Any = make_model("TD3", env, config)
    model.set_logger(Logger(None, []))
    infos = [{} for _ in range(NUM_ENVS)]
    for row in range(ROWS):
        step = _columns(NUM_ENVS, seed=row)
        rewards = step["reward_terms"].sum(axis=1)
        observations = step["observation"], step["next_observation"]
        model.replay_buffer.add(*observations, step["action"], rewards, step["terminated"], infos)
    steps = config.updates_per_iteration

    def work() -> int:
        for _ in range(UPDATES // steps):
            model.train(gradient_steps=steps, batch_size=config.td3.batch_size)
        return UPDATES

    return work


def _columns(count: int, seed: int = 0) -> dict[str, Any]:
    import numpy as np

    rng = np.random.default_rng(seed)
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


if __name__ == "__main__":
    sys.exit(main())
