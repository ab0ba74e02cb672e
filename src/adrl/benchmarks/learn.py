"""Gradient updates a second of the learner on one core, beside Stable-Baselines3's TD3 and the core's own peak."""

import json
import statistics
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from importlib import metadata
from itertools import pairwise
from typing import Any

from adrl import extras, processes
from adrl.agents.config import Td3Config
from adrl.benchmarks.learn_worker import OBSERVATION_SIZE
from adrl.benchmarks.timing import require_rounds
from adrl.errors import AdrlError, ConfigError

PEER = "sb3-td3"


def bench_learn(
    *, widths: Sequence[int] = (128, 256), seconds: float = 2.0, rounds: int = 5
) -> dict[str, Any]:
    """Medians over the rounds, each learner in a process of its own, on data drawn at random.

    Our two learners, the peer's and the matrix product take turns on one core; then one learner of the first width on
    that core and two side by side on two cores take turns. core_share below 1 says that something else ran on the core;
    rates for a core-second leave that out.
    """
    if not widths or min(widths) < 1:
        raise ConfigError(f"widths is {list(widths)}; give one or more positive widths")
    require_rounds(rounds, seconds)
    extras.require("train", "adrl bench learn")
    cores = processes.usable_cores()
    kinds = ("adrl", "td3", PEER) if extras.installed("baselines") else ("adrl", "td3")
    with ExitStack() as stack:

        def start(what: str, width: int, core: int = cores[0]) -> _Worker:
            worker = _Worker(what, width, core)
            stack.callback(worker.close)
            return worker

        peak = start("matmul", 0)
        learners = {(width, kind): start(kind, width) for width in widths for kind in kinds}
        taken = _in_turns([[peak], *([worker] for worker in learners.values())], seconds, rounds)
        gflops = statistics.median(answers[0]["core_rate"] for answers in taken[0]) / 1e9
        rates = {key: _rates([answers[0] for answers in taken[i]]) for i, key in enumerate(learners, start=1)}
        two = None
        if len(cores) > 1:
            first = learners[widths[0], "adrl"]
            second = start("adrl", widths[0], cores[1])
            two = _two_learners(widths[0], _in_turns([[first], [first, second]], seconds, rounds))
    return {
        "schema_version": 2,
        "batch_size": Td3Config().batch_size,
        "observation_size": OBSERVATION_SIZE,
        "matmul_gflops": gflops,
        "peer": _about_sb3() if PEER in kinds else None,
        "widths": [
            _width_results(width, {kind: rates[width, kind] for kind in kinds}, gflops) for width in widths
        ],
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
    """A process of adrl.benchmarks.learn_worker."""

    def __init__(self, what: str, width: int, core: int) -> None:
        arguments = (str(core), what, str(width))
        self._what = what
        self._process = processes.start_module(
            "adrl.benchmarks.learn_worker", *arguments, stdout=subprocess.PIPE
        )
        self.take()  # it is ready, so no two of them compile at once

    def go(self, seconds: float) -> None:
        """Start a round."""
        processes.send(self._process, str(seconds).encode())

    def take(self) -> dict[str, float]:
        """Wait for the round's end: rate, core_rate and core_share."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise AdrlError(f"the measurement of {self._what} ended early; its error stands above")
        return json.loads(line)

    def close(self) -> None:
        """End the process."""
        processes.close(self._process)


def _in_turns(
    teams: Sequence[Sequence[_Worker]], seconds: float, rounds: int
) -> list[list[list[dict[str, float]]]]:
    """Each round the teams work one after the other, the workers of a team at once. Answers: team, round, worker."""
    taken: list[list[list[dict[str, float]]]] = [[] for _ in teams]
    for _ in range(rounds):
        for team, answers in zip(teams, taken, strict=True):
            for worker in team:
                worker.go(seconds)
            answers.append([worker.take() for worker in team])
    return taken


def _two_learners(width: int, taken: list[list[list[dict[str, float]]]]) -> dict[str, Any]:
    """One learner alone and two at once: what a second core brings to a comparison."""
    one, two = (statistics.median(sum(a["rate"] for a in answers) for answers in team) for team in taken)
    return {"width": width, "one": one, "two": two, "ratio": two / one}


def _width_results(width: int, rates: dict[str, dict[str, Any]], peak_gflops: float) -> dict[str, Any]:
    """ratio: our learner's updates a second against the peer's; of td3, the same algorithm as the peer's."""
    flops, ours, peer = flops_per_update(width), rates["adrl"], rates.get(PEER)
    gflops = ours["updates_per_core_second"] * flops / 1e9
    results = {
        "width": width,
        "flops_per_update": flops,
        "gflops": gflops,
        "peak_share": gflops / peak_gflops,
    }
    for name, key in (("ratio", "updates_per_second"), ("ratio_per_core_second", "updates_per_core_second")):
        results[name] = None if peer is None else ours[key] / peer[key]
        results[f"{name}_td3"] = None if peer is None else rates["td3"][key] / peer[key]
    return results | rates


def _rates(answers: Sequence[dict[str, float]]) -> dict[str, Any]:
    return {
        "updates_per_second": statistics.median(answer["rate"] for answer in answers),
        "updates_per_core_second": statistics.median(answer["core_rate"] for answer in answers),
        "core_share": statistics.median(answer["core_share"] for answer in answers),
        "updates_per_second_rounds": [answer["rate"] for answer in answers],
    }


def _about_sb3() -> dict[str, str]:
    versions = {name: metadata.version(name) for name in ("stable-baselines3", "torch")}
    return {"name": PEER, "version": versions["stable-baselines3"], "torch": versions["torch"]}
