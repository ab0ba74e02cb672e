"""Which task each robot drives next, from streams of random numbers seeded as Gymnasium seeds environments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from adrl.errors import ConfigError

Generator = np.random.Generator
Seeds = int | Sequence[int | None] | None

FAILURE_GAIN = 0.3
"""Weight of a task's latest episode in its failure rate."""


@dataclass(frozen=True)
class Draw:
    """What M rows begin with."""

    task: NDArray[np.int64]
    """(M,) numbers in the pool."""
    noise_seed: NDArray[np.uint64]
    """(M,)"""
    params: Generator | list[Generator]
    """Draws the robots' parameters; a list has one a row."""


class TaskDraws:
    """Draws tasks of a pool of `size` for N rows.

    priority None: every row has a stream of its own, as a single environment has: row i of seed s draws what an
    environment alone draws with seed s + i. A number: one stream for all rows, and chances are 0.1 + priority * the
    task's failure rate over all rows.
    """

    def __init__(self, num_envs: int, size: int, priority: float | None) -> None:
        if priority is not None and not 0.0 <= priority <= 1000.0:
            raise ConfigError(f"task_priority is {priority}; give 0 to 1000")
        self._num_envs, self._size, self._priority = num_envs, size, priority
        count = num_envs if priority is None else 1
        self._streams: list[Generator | None] = [None] * count
        self._seeds: list[int] = [-1] * count
        # As if all had failed so far: a task that nobody has tried is worth a try.
        self._failure_rate = np.ones(size)

    @property
    def streams(self) -> tuple[Generator, ...]:
        """One a row, or the one of all; those that nothing has seeded yet are seeded with entropy now."""
        return tuple(self._stream(k) for k in range(len(self._streams)))

    @streams.setter
    def streams(self, value: Sequence[Generator]) -> None:
        if len(value) != len(self._streams):
            raise ConfigError(f"there are {len(self._streams)} random streams; {len(value)} were given")
        self._streams, self._seeds = list(value), [-1] * len(value)

    @property
    def seeds(self) -> tuple[int, ...]:
        """What each stream was seeded with; -1 for one that was put in its place."""
        _ = self.streams
        return tuple(self._seeds)

    def seed(self, seed: Seeds, rows: NDArray[np.intp]) -> None:
        """Begin the streams of rows anew. seed: s, of which row i takes s + i; or one a row, None to go on."""
        if self._priority is not None:
            if not isinstance(seed, int | np.integer):
                raise ConfigError("with task_priority all rows share one random stream; give one seed")
            self._failure_rate[:] = 1.0
            self._begin(0, int(seed))
            return
        each = (
            [seed + i for i in range(self._num_envs)]
            if isinstance(seed, int | np.integer)
            else list(seed or ())
        )
        if len(each) != self._num_envs:
            raise ConfigError(
                f"there are {len(each)} seeds for {self._num_envs} rows; give one each, or a number"
            )
        for i in rows:
            one = each[i]
            if one is not None:
                self._begin(i, int(one))

    def draw(self, rows: NDArray[np.intp]) -> Draw:
        """The next tasks of rows (M,)."""
        if self._priority is not None:
            rng = self._stream(0)
            return Draw(*self._from(rng, len(rows)), rng)
        own = [self._stream(i) for i in rows]
        tasks, seeds = zip(*(self._from(rng, 1) for rng in own), strict=True)
        return Draw(np.concatenate(tasks), np.concatenate(seeds), own)

    def learn(self, tasks: NDArray[np.int64], reached: NDArray[np.bool_]) -> None:
        """Tell how episodes ended, (M,) each: several rows may have driven the same task."""
        for task, arrived in zip(tasks, reached, strict=True):
            self._failure_rate[task] += FAILURE_GAIN * (float(not arrived) - self._failure_rate[task])

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes, as arrays."""
        words = np.array([_pack(rng) for rng in self.streams])
        return {
            "failure_rate": self._failure_rate.copy(),
            "rng": words if self._priority is None else words[0],
        }

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned."""
        self._failure_rate[:] = state["failure_rate"]
        for rng, words in zip(self.streams, state["rng"].reshape(-1, 6), strict=True):
            _unpack(rng, words)

    def _stream(self, k: int) -> Generator:
        rng = self._streams[k]
        return self._begin(k, None) if rng is None else rng

    def _begin(self, k: int, seed: int | None) -> Generator:
        rng, self._seeds[k] = seeding.np_random(seed)
        self._streams[k] = rng
        return rng

    def _from(self, rng: Generator, count: int) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
        if not self._priority:
            chosen = rng.integers(self._size, size=count)
        else:
            chance = 0.1 + self._priority * self._failure_rate
            chosen = rng.choice(self._size, size=count, p=chance / chance.sum())
        return chosen, rng.integers(2**63, size=count, dtype=np.uint64)


def _pack(rng: Generator) -> NDArray[np.uint64]:
    """(6,) the state of a PCG64 generator: two 128-bit numbers as halves, and the buffered 32 bits."""
    state = rng.bit_generator.state
    low = (1 << 64) - 1
    numbers = [state["state"]["state"], state["state"]["inc"]]
    words = [half for number in numbers for half in (number & low, number >> 64)]
    return np.array([*words, state["has_uint32"], state["uinteger"]], dtype=np.uint64)


def _unpack(rng: Generator, words: NDArray[np.uint64]) -> None:
    w = [int(x) for x in words]
    rng.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": w[0] | w[1] << 64, "inc": w[2] | w[3] << 64},
        "has_uint32": w[4],
        "uinteger": w[5],
    }
