"""Intervals for what evaluation measured. Everything is seeded: equal numbers in, equal numbers out.

Three questions, three units. How good is this policy: the episode is the unit (`wilson_interval`,
`bootstrap_mean`, `paired_difference`, `paired_rate_difference`). How good on the robots of a family: the robot is
(`clustered_rate`, `worst_decile`). How good is this method: the training seed is the
unit (`seed_mean`, `seed_iqm`, `probability_of_improvement`), after Agarwal et al. 2021, "Deep RL at the edge of the
statistical precipice".
"""

import math
from collections.abc import Callable, Sequence
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


def finite(value: float | None) -> float | None:
    """None for NaN and infinity, which JSON does not have."""
    return None if value is None or not math.isfinite(value) else float(value)


def entry(name: str, interval: Interval | None) -> dict[str, float | None]:
    """An interval as a row has it: the estimate under its name, its ends under NAME_low and NAME_high."""
    values = (None, None, None) if interval is None else interval
    return {name + end: finite(value) for end, value in zip(("", "_low", "_high"), values, strict=True)}


def wilson_interval(successes: int, trials: int, *, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a rate (Wilson 1927). Undefined for 0 trials.

    Unlike the normal one it stays in [0, 1] and keeps its coverage near 0 and 1, where success rates are.
    """
    _check_confidence(confidence)
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials; give 0 <= successes <= trials")
    if trials == 0:
        return UNDEFINED
    from scipy.stats import binomtest

    rate = successes / trials
    ends = binomtest(int(successes), int(trials)).proportion_ci(confidence, method="wilson")
    # At rate 0 and 1 one end equals the rate but for rounding.
    return Interval(rate, min(rate, float(ends.low)), max(rate, float(ends.high)))


def bootstrap_mean(
    samples: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Percentile bootstrap of the mean of samples (E,). No samples: undefined; one sample: no ends."""
    values = _column(samples)
    return _bootstrap([values], _mean, confidence, resamples, seed)


def clustered_rate(successes: ArrayLike, trials: ArrayLike, *, confidence: float = 0.95) -> Interval:
    """Rate over all trials of clusters, successes (R,) of trials (R,) each: robots that drove some tasks each.

    Wilson's interval for the number of independent trials that would vary as much as the clusters' rates do (Dean and
    Pagano 2015), at least as many as there are clusters, at most as many as trials. In what they vary by, one more
    cluster counts that does half of its trials: clusters that all succeed do not tell that all would. Undefined for
    none.
    """
    _check_confidence(confidence)
    k, n = _column(successes), _column(trials)
    if k.shape != n.shape or (n <= 0.0).any() or (k < 0.0).any() or (k > n).any():
        raise ValueError("give as many trials as successes, 1 or more, and no more successes than trials")
    if not k.size:
        return UNDEFINED
    rate, clusters, total = float(k.sum() / n.sum()), len(k), float(n.sum())
    known, size = np.append(k, 0.5 * n.mean()), np.append(n, n.mean())
    share = known.sum() / size.sum()
    # Variance of a ratio of sums over clusters.
    spread = float(((known - share * size) ** 2).sum()) * len(size) / clusters / float(size.sum()) ** 2
    chance = rate * (1.0 - rate)
    effective = total if spread == 0.0 else float(share * (1.0 - share)) / spread
    effective = min(max(effective, float(clusters)), total)
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    middle, scale = rate + z**2 / (2.0 * effective), 1.0 + z**2 / effective
    half = z * math.sqrt(chance / effective + z**2 / (4.0 * effective**2))
    return Interval(
        rate, min(rate, max(0.0, (middle - half) / scale)), max(rate, min(1.0, (middle + half) / scale))
    )


def worst_decile(
    samples: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """What nine tenths of samples (R,) reach at least, the greater being the better, with a percentile bootstrap; of
    ten samples and fewer the least."""
    values = _column(samples)
    return _bootstrap([values], _decile, confidence, resamples, seed)


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


def paired_p_value(ours: ArrayLike, theirs: ArrayLike, *, resamples: int = RESAMPLES, seed: int = 0) -> float:
    """Two-sided p-value of no difference between ours and theirs (E,), row i of both a pair: a sign-flip test.

    Each pair is turned round or not, all ways where they are fewer than `resamples` and a random part of them
    otherwise: the share of the ways whose mean difference is as far from 0. NaN without pairs.
    """
    x, y = _column(ours), _column(theirs)
    if x.shape != y.shape:
        raise ValueError(f"pairs need equal lengths, got {len(x)} and {len(y)}")
    if len(x) < 2:
        return 1.0 if len(x) else math.nan  # both ways of one pair are as far
    from scipy.stats import permutation_test

    result = permutation_test(
        (x - y,),
        lambda differences, axis: differences.mean(axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=resamples,
        batch=max(1, _BLOCK_NUMBERS // len(x)),
        rng=np.random.default_rng(seed),
    )
    return float(result.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values of one family of tests after Holm's correction (1979): its chance of any false finding is kept."""
    from statsmodels.stats.multitest import multipletests

    if not len(p_values):
        return []
    _, corrected, *_ = multipletests(p_values, method="holm")
    return np.asarray(corrected, dtype=np.float64).tolist()


def seed_mean(
    scores: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Mean over training seeds and scenarios of scores (M seeds,) or (M seeds, K scenarios).

    Stratified percentile bootstrap: seeds are resampled within each scenario, as every score is a training of
    its own. Where one training was scored in several scenarios, average its row first and give (M,): scores
    of one training rise and fall together, and taking them apart makes the interval too narrow. One seed: no
    ends.
    """
    return _bootstrap(list(_seeds(scores).T), _mean, confidence, resamples, seed)


def seed_iqm(
    scores: ArrayLike, *, confidence: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> Interval:
    """Interquartile mean over seeds and scenarios, (M,) or (M, K), with a stratified bootstrap interval.

    The mean of all scores but the floor(n/4) smallest and largest (Agarwal et al. 2021).
    """
    return _bootstrap(list(_seeds(scores).T), _iqm, confidence, resamples, seed)


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
    return _bootstrap([*x.T, *y.T], _share_of_wins, confidence, resamples, seed)


def _bootstrap(
    strata: Sequence[Array],
    statistic: Callable[..., Array],
    confidence: float,
    resamples: int,
    seed: int,
) -> Interval:
    """Percentile bootstrap of statistic(*strata, axis), each stratum (n,) resampled within itself."""
    _check_confidence(confidence)
    if any(not stratum.size for stratum in strata) or not strata:
        return UNDEFINED
    estimate = float(statistic(*strata, axis=-1))
    if min(map(len, strata)) < 2:
        return Interval(estimate, math.nan, math.nan)
    from scipy.stats import bootstrap

    ends = bootstrap(
        tuple(strata),
        statistic,
        n_resamples=resamples,
        batch=max(1, _BLOCK_NUMBERS // sum(map(len, strata))),
        vectorized=True,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    # Rounding or skew may leave the estimate outside.
    return Interval(estimate, min(float(ends.low), estimate), max(float(ends.high), estimate))


def _mean(*strata: Array, axis: int) -> Array:
    """Over all numbers of all strata."""
    return np.concatenate(strata, axis=axis).mean(axis=axis)


def _decile(*strata: Array, axis: int) -> Array:
    return np.quantile(np.concatenate(strata, axis=axis), 0.1, axis=axis, method="lower")


def _iqm(*strata: Array, axis: int) -> Array:
    """Over all numbers of all strata."""
    from scipy.stats import trim_mean

    return trim_mean(np.concatenate(strata, axis=axis), 0.25, axis=axis)


def _share_of_wins(*strata: Array, axis: int) -> Array:
    """Of the pairs of ours, the first half of the strata, and theirs, the second; ties count half. axis is the last."""
    scenarios = len(strata) // 2
    wins = [
        0.5 * (np.sign(x[..., :, None] - y[..., None, :]) + 1.0).mean(axis=(axis, axis - 1))
        for x, y in zip(strata[:scenarios], strata[scenarios:], strict=True)
    ]
    return np.mean(wins, axis=0)


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
