"""How soon a training run is good enough, from its evaluations during training, and how soon its critic is steady."""

import math

import numpy as np
from numpy.typing import ArrayLike

LEVEL = 0.9
"""Success that counts as good enough."""
SUCCESSIVE = 2
"""Evaluations in a row that must reach it: one alone may be luck."""

STEADY_SHARE = 0.2
"""Last part of a run whose mean is the steady level of a curve."""
STEADY_BAND = 0.1
"""Half the width of the band about that level, as a share of the smoothed curve's range."""
STEADY_ROWS = 5
"""Rows of the trailing mean that smooths the curve."""


def steady_from(x: ArrayLike, curve: ArrayLike) -> float:
    """x at which a curve enters its steady state: from there on it never leaves the band about its steady level.

    x, curve: (rows,) in their order; rows whose curve is NaN are left out. The curve is smoothed by a trailing mean of
    STEADY_ROWS, its level is the mean of the last STEADY_SHARE of its rows, the band STEADY_BAND of its range to either
    side. Infinite where even the last row is outside, NaN with fewer than STEADY_ROWS rows.
    """
    place, values = np.asarray(x, dtype=np.float64), np.asarray(curve, dtype=np.float64)
    if place.shape != values.shape or place.ndim != 1:
        raise ValueError(f"x {place.shape} and curve {values.shape} are not two columns of equal length")
    known = np.isfinite(values)
    place, values = place[known], values[known]
    if len(values) < STEADY_ROWS:
        return math.nan
    smooth = np.convolve(values, np.full(STEADY_ROWS, 1.0 / STEADY_ROWS), mode="valid")
    place = place[STEADY_ROWS - 1 :]
    level = steady_level(values)
    outside = np.flatnonzero(np.abs(smooth - level) > STEADY_BAND * np.ptp(smooth) + 1e-9 * abs(level))
    first = 0 if not len(outside) else int(outside[-1]) + 1
    return float(place[first]) if first < len(place) else math.inf


def steady_level(curve: ArrayLike) -> float:
    """Mean of the last STEADY_SHARE of the rows of a curve; NaN without rows."""
    values = np.asarray(curve, dtype=np.float64)
    values = values[np.isfinite(values)]
    return float(values[-max(1, round(STEADY_SHARE * len(values))) :].mean()) if len(values) else math.nan


def seconds_to_level(
    wall_s: ArrayLike, success: ArrayLike, *, level: float = LEVEL, successive: int = SUCCESSIVE
) -> float:
    """Wall clock in s of the last of the first `successive` evaluations in a row with success >= level.

    wall_s, success: (rows,) of metrics.jsonl in their order; rows whose success is NaN were no evaluations. In place of
    wall_s any other column that grows, such as env_steps. Infinite where that never happens, NaN where there was no
    evaluation.
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
