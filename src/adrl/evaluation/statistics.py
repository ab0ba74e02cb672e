"""Intervals for what evaluation measured. Everything is seeded: equal numbers in, equal numbers out.

Two questions, two units. How good is this policy: the episode is the unit (`wilson_interval`,
`bootstrap_mean`, `paired_difference`, `paired_rate_difference`). How good is this method: the training seed is the
unit (`seed_mean`, `seed_iqm`, `probability_of_improvement`), after Agarwal et al. 2021, "Deep RL at the edge of the
statistical precipice".
"""

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

RESAMPLES = 10_000
"""Bootstrap resamples: the ends of a 95 % interval then vary with the seed by about 0.6 % of its width."""
_BLOCK_NUMBERS = 2_000_000
"""Numbers drawn at once: bounds the memory at about 16 MB."""


class Interval(NamedTuple):
    """An estimate and the ends of its confidence interval. NaN where undefined."""

    estimate: float
    low: float
    high: float


UNDEFINED = Interval(math.nan, math.nan, math.nan)


def wilson_interval(successes: int, trials: int, *, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a rate (Wilson 1927). Undefined for 0 trials.

    centre +- half = (p + z^2/2n +- z sqrt(p (1-p)/n + z^2/4n^2)) / (1 + z^2/n),  p = successes / n. Unlike
    the normal one it stays in [0, 1] and keeps its coverage near 0 and 1, where success rates are.
    """
    _check_confidence(confidence)
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials; give 0 <= successes <= trials")
    if trials == 0:
        return UNDEFINED
    rate = successes / trials
    z_squared = NormalDist().inv_cdf(0.5 + 0.5 * confidence) ** 2
    shrink = 1.0 + z_squared / trials
    centre = (rate + 0.5 * z_squared / trials) / shrink
    half = math.sqrt(z_squared * (rate * (1.0 - rate) / trials + 0.25 * z_squared / trials**2)) / shrink
    # At rate 0 and 1 one end equals the rate but for rounding.
    return Interval(rate, max(0.0, min(rate, centre - half)), min(1.0, max(rate, centre + half)))


def bootstrap_mean(
    samples: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Percentile bootstrap of the mean of samples (E,). No samples: undefined; one sample: no ends."""
    values = _column(samples)
    return _bootstrap(values[:, None], _mean, confidence, resamples, seed)


def paired_difference(
    ours: ArrayLike, theirs: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Mean of ours - theirs (E,), row i of both on the same task: tasks are resampled, pairs stay together.

    Tasks that are hard for both policies cancel, so this is narrower than two intervals side by side. Its
    ends meet when no pair differs, which says that the tasks told nothing apart, not that the policies are
    equal.
    """
    x, y = _column(ours), _column(theirs)
    if x.shape != y.shape:
        raise ValueError(f"pairs need equal lengths, got {len(x)} and {len(y)}")
    return bootstrap_mean(x - y, confidence=confidence, resamples=resamples, seed=seed)


def paired_rate_difference(ours: ArrayLike, theirs: ArrayLike, *, confidence: float = 0.95) -> Interval:
    """Rate of ours less that of theirs, both (E,) of 0 and 1, row i on the same task: Tango's score interval.

    Tango 1998, "Equivalence test and confidence interval for the difference in proportions for the paired-sample
    design". With b tasks that only ours, c that only theirs did, it holds every difference d of the rates with

        (b - c - n d)^2 <= z^2 n (2 q + d (1 - d)),

    q being the likeliest chance of c's kind of task under d. Unlike a bootstrap it keeps its coverage where few pairs
    differ: with none of n its ends are +-z^2 / (n + z^2). Undefined without tasks.
    """
    _check_confidence(confidence)
    x, y = _column(ours), _column(theirs)
    if x.shape != y.shape:
        raise ValueError(f"pairs need equal lengths, got {len(x)} and {len(y)}")
    if not (np.isin(x, (0.0, 1.0)).all() and np.isin(y, (0.0, 1.0)).all()):
        raise ValueError("rates are of samples that are 0 or 1")
    n, b, c = len(x), int((x > y).sum()), int((y > x).sum())
    if n == 0:
        return UNDEFINED
    z_squared = NormalDist().inv_cdf(0.5 + 0.5 * confidence) ** 2
    # The lower end is the upper one of theirs - ours.
    return Interval((b - c) / n, -_tango_upper(c, b, n, z_squared), _tango_upper(b, c, n, z_squared))


def _tango_upper(b: int, c: int, n: int, z_squared: float) -> float:
    """The greatest difference that the score test does not reject, by bisection."""
    low, high = (b - c) / n, 1.0
    for _ in range(60):
        d = 0.5 * (low + high)
        # The positive root of 2 n q^2 + half q + end = 0.
        half, end = -b - c + (2 * n - b + c) * d, -c * d * (1.0 - d)
        q = (math.sqrt(half**2 - 8.0 * n * end) - half) / (4.0 * n)
        if (b - c - n * d) ** 2 <= z_squared * n * (2.0 * q + d * (1.0 - d)):
            low = d
        else:
            high = d
    return low


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean of all scores but the floor(n/4) smallest and largest: the IQM of Agarwal et al. 2021.

    With fewer than four scores nothing is cut and it is the mean. NaN for no scores.
    """
    values = np.asarray(scores, dtype=np.float64).reshape(1, -1)
    return float(_iqm(values)[0]) if values.size else math.nan


def seed_mean(
    scores: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Mean over training seeds and scenarios of scores (M seeds,) or (M seeds, K scenarios).

    Stratified percentile bootstrap: seeds are resampled within each scenario, as every score is a training of
    its own. Where one training was scored in several scenarios, average its row first and give (M,): scores
    of one training rise and fall together, and taking them apart makes the interval too narrow. One seed: no
    ends.
    """
    return _bootstrap(_seeds(scores), _mean, confidence, resamples, seed)


def seed_iqm(
    scores: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Interquartile mean over seeds and scenarios, (M,) or (M, K), with a stratified bootstrap interval."""
    return _bootstrap(_seeds(scores), _iqm, confidence, resamples, seed)


def probability_of_improvement(
    ours: ArrayLike, theirs: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """P(X > Y): the chance that a random seed of ours beats one of theirs; ties count half.

    ours (M,) or (M, K), theirs (N,) or (N, K): the scores of M and N training seeds in K scenarios, which are
    averaged over. Mann-Whitney's U / (M N) with a stratified bootstrap interval, seeds of both methods
    resampled. One seed of either: no ends.
    """
    _check_confidence(confidence)
    x, y = _seeds(ours), _seeds(theirs)
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"methods were run in {x.shape[1]} and {y.shape[1]} scenarios; give the same ones")
    if not (x.size and y.size):
        return UNDEFINED
    # (M, 1, K) against (1, N, K) -> (M, N, K)
    wins = 0.5 * (np.sign(x[:, None] - y[None]) + 1.0)
    estimate = float(wins.mean())
    if min(len(x), len(y)) < 2:
        return Interval(estimate, math.nan, math.nan)
    rng = np.random.default_rng(seed)
    replicates = np.zeros(resamples)
    for scenario in range(x.shape[1]):
        # How often each seed was drawn, (R, M) and (R, N): the mean over pairs is bilinear in these.
        drawn_x = rng.multinomial(len(x), np.full(len(x), 1.0 / len(x)), size=resamples)
        drawn_y = rng.multinomial(len(y), np.full(len(y), 1.0 / len(y)), size=resamples)
        replicates += ((drawn_x @ wins[:, :, scenario]) * drawn_y).sum(axis=1)
    return _percentiles(estimate, replicates / wins.size, confidence)


def _bootstrap(
    scores: Array, statistic: Callable[[Array], Array], confidence: float, resamples: int, seed: int
) -> Interval:
    """Percentile bootstrap of a statistic (R, M * K) -> (R,); seeds of scores (M, K) drawn per scenario."""
    _check_confidence(confidence)
    if scores.size == 0:
        return UNDEFINED
    estimate = float(statistic(scores.reshape(1, -1))[0])
    if len(scores) < 2:
        return Interval(estimate, math.nan, math.nan)
    rng = np.random.default_rng(seed)
    block = max(1, _BLOCK_NUMBERS // scores.size)
    replicates = np.empty(resamples)
    for first in range(0, resamples, block):
        count = min(block, resamples - first)
        rows = rng.integers(0, len(scores), size=(count, *scores.shape))
        drawn = scores.take(rows * scores.shape[1] + np.arange(scores.shape[1]))  # (count, M, K)
        replicates[first : first + count] = statistic(drawn.reshape(count, -1))
    return _percentiles(estimate, replicates, confidence)


def _percentiles(estimate: float, replicates: Array, confidence: float) -> Interval:
    """The central share of the replicates, widened where rounding or skew leave the estimate outside."""
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(replicates, (tail, 1.0 - tail))
    return Interval(estimate, min(float(low), estimate), max(float(high), estimate))


def _mean(values: Array) -> Array:
    """(R, n) -> (R,)."""
    return values.mean(axis=1)


def _iqm(values: Array) -> Array:
    """(R, n) -> (R,)."""
    cut = values.shape[1] // 4
    return np.sort(values, axis=1)[:, cut : values.shape[1] - cut].mean(axis=1)


def _column(samples: ArrayLike) -> Array:
    values = np.asarray(samples, dtype=np.float64)
    if values.ndim != 1:
        raise ValueError(f"samples have shape {values.shape}; expected (E,)")
    return _finite(values)


def _seeds(scores: ArrayLike) -> Array:
    values = np.asarray(scores, dtype=np.float64)
    if values.ndim not in (1, 2):
        raise ValueError(f"scores have shape {values.shape}; expected (seeds,) or (seeds, scenarios)")
    return _finite(values[:, None] if values.ndim == 1 else values)


def _finite(values: Array) -> Array:
    if not np.isfinite(values).all():
        raise ValueError("a number is not finite; leave undefined episodes out first")
    return values


def _check_confidence(confidence: float) -> None:
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence is {confidence}; give a share between 0 and 1, such as 0.95")
