"""Where in the replay's ring episodes failed, so that batches can hold more of the steps that led there.

A policy that nearly always arrives hardly sees a crash any more; without them it forgets how near is too near.
"""

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

FAILURE_STEPS = 10
"""A window drawn for a failure starts in one of so many steps, the failing one the last."""


class Failures:
    """(step, environment) of each failure, oldest first. Steps count from the start of the run."""

    def __init__(self) -> None:
        self._pairs: Index = np.empty((256, 2), np.int64)
        self._first = self._end = 0

    def __len__(self) -> int:
        return self._end - self._first

    def add(self, step: int, failed: Mask) -> None:
        """Remember the environments (N,) that failed in a step later than all before."""
        envs = np.flatnonzero(failed)
        if self._end + len(envs) > len(self._pairs):
            room = np.empty((2 * len(self) + 2 * len(envs) + 256, 2), np.int64)
            room[: len(self)] = self._pairs[self._first : self._end]
            self._pairs, self._first, self._end = room, 0, len(self)
        new = self._pairs[self._end : self._end + len(envs)]
        new[:, 0], new[:, 1] = step, envs
        self._end += len(envs)

    def forget_before(self, step: int) -> None:
        """Drop the failures of steps that the ring no longer holds."""
        kept = self._pairs[self._first : self._end, 0]
        self._first += int(np.searchsorted(kept, step))

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Index, Index]:
        """(count,) steps and environments of failures drawn uniformly; there must be one."""
        pairs = self._pairs[self._first + rng.integers(len(self), size=count)]
        return pairs[:, 0], pairs[:, 1]
