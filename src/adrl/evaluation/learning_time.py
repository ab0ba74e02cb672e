"""How soon a training run is good enough, from its evaluations during training."""

import math

import numpy as np
from numpy.typing import ArrayLike

LEVEL = 0.9
"""Success that counts as good enough."""
SUCCESSIVE = 2
"""Evaluations in a row that must reach it: one alone may be luck."""


def seconds_to_level(
    wall_s: ArrayLike, success: ArrayLike, *, level: float = LEVEL, successive: int = SUCCESSIVE
) -> float:
    """Wall clock in s of the last of the first `successive` evaluations in a row with success >= level.

    wall_s, success: (rows,) of metrics.jsonl in their order; rows whose success is NaN were no evaluations. Infinite
    where that never happens, NaN where there was no evaluation.
    """
    clock, rate = np.asarray(wall_s, dtype=np.float64), np.asarray(success, dtype=np.float64)
    if clock.shape != rate.shape or clock.ndim != 1:
        raise ValueError(f"wall_s {clock.shape} and success {rate.shape} are not two columns of equal length")
    evaluated = np.isfinite(rate)
    if not evaluated.any():
        return math.nan
    run = 0
    for seconds, reached in zip(clock[evaluated], rate[evaluated] >= level, strict=True):
        run = run + 1 if reached else 0
        if run == successive:
            return float(seconds)
    return math.inf


def median_seconds_to_level(per_seed: ArrayLike) -> float:
    """Median over training seeds of seconds_to_level, (seeds,); a seed that never gets there counts as infinite.

    NaN where a seed was never evaluated, or without seeds.
    """
    seconds = np.sort(np.asarray(per_seed, dtype=np.float64))
    if not len(seconds) or np.isnan(seconds).any():
        return math.nan
    # Not np.median: interpolating between two infinities must not give NaN.
    low, high = seconds[(len(seconds) - 1) // 2], seconds[len(seconds) // 2]
    return float(low if low == high else 0.5 * (low + high))
