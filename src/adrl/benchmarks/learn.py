"""Gradient updates a second of the learner on one core, beside Stable-Baselines3's TD3 and the core's own peak."""

import json
import statistics
from collections.abc import Sequence
from contextlib import ExitStack
from importlib import metadata
from itertools import pairwise
from typing import Any

from adrl import processes
from adrl.agents.config import Td3Config
from adrl.baselines import require_sb3
from adrl.benchmarks.learn_worker import OBSERVATION_SIZE
from adrl.benchmarks.timing import require_rounds
from adrl.errors import AdrlError, ConfigError, MissingExtra


def bench_learn(
    *, widths: Sequence[int] = (128, 256), seconds: float = 2.0, rounds: int = 5
) -> dict[str, Any]:
    """Medians over the rounds, each learner in a process of its own, on data drawn at random.

    Ours, the peer's and the matrix product take turns on one core; then one learner of the first width on that core and
    two side by side on two cores take turns. core_share below 1 says that something else ran on the core.
    """
    if not widths or min(widths) < 1:
        raise ConfigError(f"widths is {list(widths)}; give one or more positive widths")
    require_rounds(rounds, seconds)
    cores = processes.usable_cores()
    with ExitStack() as stack:

        def start(what: str, width: int, core: int = cores[0]) -> _Worker:
            worker = _Worker(what, width, core)
            stack.callback(worker.close)
            return worker

        peak = start("matmul", 0)
        ours = [start("adrl", width) for width in widths]
        peers = [start("sb3-td3", width) for width in widths] if _sb3_is_there() else []
        second = start("adrl", widths[0], cores[1]) if len(cores) > 1 else None
        everyone = [peak, *(worker for pair in zip(ours, peers or ours, strict=True) for worker in pair)]
        for _ in range(rounds):
            for worker in dict.fromkeys(everyone):
                worker.go(seconds)
                worker.take()
        two = None if second is None else _two_learners(ours[0], second, widths[0], seconds, rounds)
        results = [
            _width_results(width, mine, peers[i] if peers else None, peak)
            for i, (width, mine) in enumerate(zip(widths, ours, strict=True))
        ]
    return {
        "schema_version": 2,
        "batch_size": Td3Config().batch_size,
        "observation_size": OBSERVATION_SIZE,
        "matmul_gflops": statistics.median(peak.rates) / 1e9,
        "widths": results,
        "two_learners": two,
    }


def flops_per_update(width: int, observation_size: int = OBSERVATION_SIZE) -> float:
    """Floating-point operations in the matrix products of one update; all else is counted as none.

    A product of (B, i) and (i, o) is 2 B i o. Forward F is their sum over a network's layers; backward is F for the
    weights, and F for the inputs without that of the first layer where nothing asks for it, F - F1.

        critic update     F_a + 2 F_c             target actor, target critics
                          2 F_c + 2 (2 F_c - F1_c)    twin critics, forward and backward
        actor update      F_a + F_c + F_c         actor, first critic, its inputs
        (one of delay)    2 F_a - F1_a            the actor's weights
                          3 F_a - F1_a            cloning, for its own batch
    """
    config = Td3Config(widths=(width, width))

    def forward(sizes: tuple[int, ...], rows: int) -> tuple[float, float]:
        products = [2.0 * rows * i * o for i, o in pairwise(sizes)]
        return sum(products), products[0]

    actor_sizes, critic_sizes = (
        (observation_size, *config.widths, 2),
        (observation_size + 2, *config.widths, 1),
    )
    actor, actor_first = forward(actor_sizes, config.batch_size)
    critic, critic_first = forward(critic_sizes, config.batch_size)
    cloning, cloning_first = forward(actor_sizes, config.bc_batch_size)
    critic_update = actor + 2.0 * critic + 2.0 * critic + 2.0 * (2.0 * critic - critic_first)
    actor_update = actor + 2.0 * critic + 2.0 * actor - actor_first + 3.0 * cloning - cloning_first
    return critic_update + actor_update / config.policy_delay


class _Worker:
    """A process of adrl.benchmarks.learn_worker and the rates it measured."""

    def __init__(self, what: str, width: int, core: int) -> None:
        arguments = (str(core), what, str(width))
        self._what = what
        self._process = processes.start_module("adrl.benchmarks.learn_worker", *arguments, stdout=-1)
        self._answer()  # it is ready, so no two of them compile at once
        self.rates: list[float] = []
        self.core_shares: list[float] = []

    def go(self, seconds: float) -> None:
        """Start a round."""
        processes.send(self._process, str(seconds).encode())

    def take(self) -> float:
        """Wait for the round's end; its rate."""
        answer = self._answer()
        self.rates.append(answer["rate"])
        self.core_shares.append(answer["core_share"])
        return answer["rate"]

    def close(self) -> None:
        """End the process."""
        processes.close(self._process)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise AdrlError(f"the measurement of {self._what} ended early; its error stands above")
        return json.loads(line)


def _two_learners(
    first: _Worker, second: _Worker, width: int, seconds: float, rounds: int
) -> dict[str, Any]:
    """One learner alone and two at once, in turns: what a second core brings to a comparison."""
    alone, together = [], []
    for _ in range(rounds):
        first.go(seconds)
        alone.append(first.take())
        for worker in (first, second):
            worker.go(seconds)
        together.append(first.take() + second.take())
    one, two = statistics.median(alone), statistics.median(together)
    return {"width": width, "one": one, "two": two, "ratio": two / one}


def _width_results(width: int, ours: _Worker, peer: _Worker | None, peak: _Worker) -> dict[str, Any]:
    rate, flops = statistics.median(ours.rates), flops_per_update(width)
    return {
        "width": width,
        **_rates(ours),
        "flops_per_update": flops,
        "gflops": rate * flops / 1e9,
        "peak_share": rate * flops / statistics.median(peak.rates),
        "peer": None if peer is None else _about_sb3() | _rates(peer),
        "ratio": None if peer is None else rate / statistics.median(peer.rates),
    }


def _rates(worker: _Worker) -> dict[str, Any]:
    return {
        "updates_per_second": statistics.median(worker.rates),
        "updates_per_second_rounds": list(worker.rates),
        "core_share": statistics.median(worker.core_shares),
    }


def _about_sb3() -> dict[str, str]:
    versions = {name: metadata.version(name) for name in ("stable-baselines3", "torch")}
    return {"name": "sb3-td3", "version": versions["stable-baselines3"], "torch": versions["torch"]}


def _sb3_is_there() -> bool:
    try:
        require_sb3()
    except MissingExtra:
        return False
    return True
