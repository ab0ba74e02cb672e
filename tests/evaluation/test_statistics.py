"""Laws of the intervals: exact where they can be, by seeded simulation where they cannot."""

import itertools
import math

import numpy as np
import pytest
import scipy.optimize
import scipy.special
import scipy.stats
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose

from adrl.evaluation.statistics import (
    Interval,
    bootstrap_mean,
    clustered_rate,
    holm,
    paired_difference,
    paired_p_value,
    paired_rate_difference,
    probability_of_improvement,
    seed_iqm,
    seed_mean,
    wilson_interval,
    worst_decile,
)

FEW = 400
"""Resamples where a law holds for any number of them."""
NUMBERS = st.floats(-1e3, 1e3).map(lambda value: round(value, 6))
CONFIDENCES = st.sampled_from([0.5, 0.9, 0.95, 0.99])


def samples(low: int = 2, high: int = 30):
    return hnp.arrays(np.float64, st.integers(low, high), elements=NUMBERS)


def scores(seeds=(2, 12), scenarios=(1, 4)):
    return hnp.arrays(np.float64, st.tuples(st.integers(*seeds), st.integers(*scenarios)), elements=NUMBERS)


@st.composite
def counts(draw, most=2000):
    trials = draw(st.integers(1, most))
    return draw(st.integers(0, trials)), trials


def width(interval: Interval) -> float:
    return interval.high - interval.low


# --- Wilson ---------------------------------------------------------------------------------------


@given(counts(), CONFIDENCES)
def test_wilson_lies_in_0_to_1_holds_the_rate_and_is_never_a_point(count, confidence):
    interval = wilson_interval(*count, confidence=confidence)
    assert interval.estimate == count[0] / count[1]
    assert 0.0 <= interval.low <= interval.estimate <= interval.high <= 1.0
    assert width(interval) > 0.0


@given(counts(), CONFIDENCES)
def test_wilson_is_the_formula(count, confidence):
    """centre +- half = (p + z^2/2n +- z sqrt(p (1-p)/n + z^2/4n^2)) / (1 + z^2/n),  p = successes / n."""
    p, n = count[0] / count[1], count[1]
    z = scipy.stats.norm.ppf(0.5 + 0.5 * confidence)
    half = z * math.sqrt(p * (1.0 - p) / n + z**2 / (4.0 * n**2))
    ends = [(p + z**2 / (2.0 * n) + sign * half) / (1.0 + z**2 / n) for sign in (-1.0, 1.0)]
    assert wilson_interval(*count, confidence=confidence)[1:] == pytest.approx(tuple(ends), abs=1e-12)


@given(counts())
def test_wilson_of_failures_mirrors_that_of_successes(count):
    successes, trials = count
    ours, theirs = wilson_interval(successes, trials), wilson_interval(trials - successes, trials)
    assert (ours.low, ours.high) == pytest.approx((1.0 - theirs.high, 1.0 - theirs.low), abs=1e-12)


@given(counts(), st.integers(2, 20))
def test_wilson_shrinks_with_more_trials_and_with_less_confidence(count, factor):
    successes, trials = count
    assert width(wilson_interval(factor * successes, factor * trials)) < width(wilson_interval(*count))
    assert width(wilson_interval(*count, confidence=0.9)) < width(wilson_interval(*count))


@pytest.mark.parametrize("trials", [20, 100, 500])
def test_wilson_covers_as_often_as_it_says(trials):
    """Exact: the chance of the counts whose interval holds the rate, averaged over rates."""
    ends = np.array([wilson_interval(k, trials)[1:] for k in range(trials + 1)])
    rates = np.linspace(0.02, 0.98, 481)
    holds = (ends[:, :1] <= rates) & (rates <= ends[:, 1:])
    coverage = (scipy.stats.binom.pmf(np.arange(trials + 1)[:, None], trials, rates) * holds).sum(axis=0)
    assert coverage.mean() == pytest.approx(0.95, abs=0.01)
    assert coverage.min() > 0.83


def test_wilson_of_no_trials_is_undefined_and_of_wrong_counts_an_error():
    assert all(math.isnan(end) for end in wilson_interval(0, 0))
    for count in ((-1, 5), (6, 5)):
        with pytest.raises(ValueError, match="successes of"):
            wilson_interval(*count)
    for confidence in (0.0, 1.0, 95.0, math.nan):
        with pytest.raises(ValueError, match="confidence"):
            wilson_interval(1, 2, confidence=confidence)


# --- bootstrap over episodes ----------------------------------------------------------------------


@given(samples(), CONFIDENCES)
def test_bootstrap_holds_the_mean_and_stays_in_the_data(values, confidence):
    interval = bootstrap_mean(values, confidence=confidence, resamples=FEW)
    slack = 1e-9 * (1.0 + np.abs(values).max())
    assert interval.estimate == pytest.approx(values.mean(), abs=slack)
    assert interval.low <= interval.estimate <= interval.high
    assert values.min() - slack <= interval.low
    assert interval.high <= values.max() + slack


@given(samples(), st.floats(-5.0, 5.0), NUMBERS)
def test_bootstrap_moves_with_the_unit_and_the_origin(values, scale, offset):
    interval = bootstrap_mean(values, resamples=FEW)
    moved = bootstrap_mean(scale * values + offset, resamples=FEW)
    ends = sorted((scale * interval.low + offset, scale * interval.high + offset))
    assert (moved.low, moved.high) == pytest.approx(tuple(ends), abs=1e-6)


@given(NUMBERS, st.integers(2, 50))
def test_bootstrap_of_equal_numbers_is_a_point(value, count):
    assert bootstrap_mean(np.full(count, value), resamples=FEW) == pytest.approx((value,) * 3)


def test_bootstrap_shrinks_as_the_root_of_the_number_of_episodes():
    values = np.random.default_rng(0).normal(size=50)
    few, many = bootstrap_mean(values), bootstrap_mean(np.tile(values, 16))
    assert width(few) / width(many) == pytest.approx(4.0, rel=0.1)


def test_bootstrap_agrees_with_a_plain_resampling_loop():
    values = np.random.default_rng(1).gamma(2.0, size=60)
    rng = np.random.default_rng(2)
    means = [values[rng.integers(0, 60, 60)].mean() for _ in range(10_000)]
    ours = bootstrap_mean(values)
    assert ours[1:] == pytest.approx(tuple(np.quantile(means, (0.025, 0.975))), abs=0.04 * width(ours))


def test_bootstrap_covers_as_often_as_it_says():
    rng = np.random.default_rng(3)
    datasets = rng.exponential(size=(500, 80))  # skewed, of mean 1
    intervals = np.array([bootstrap_mean(d, resamples=500, seed=i)[1:] for i, d in enumerate(datasets)])
    coverage = np.mean((intervals[:, 0] <= 1.0) & (intervals[:, 1] >= 1.0))
    assert 0.90 <= coverage <= 0.97


def test_bootstrap_is_a_function_of_the_data_and_the_seed():
    values = np.random.default_rng(4).normal(size=3000)  # so many that they are drawn in several blocks
    assert bootstrap_mean(values, resamples=2000) == bootstrap_mean(values, resamples=2000)
    assert bootstrap_mean(values, resamples=2000) != bootstrap_mean(values, resamples=2000, seed=1)


def test_bootstrap_of_too_few_numbers_says_so():
    assert all(math.isnan(number) for number in bootstrap_mean([]))
    single = bootstrap_mean([0.4])
    assert single.estimate == 0.4
    assert math.isnan(single.low)
    assert math.isnan(single.high)


@pytest.mark.parametrize("values", [[1.0, math.nan], [math.inf, 1.0]])
def test_numbers_that_are_not_finite_are_refused(values):
    for interval in (bootstrap_mean, seed_mean, seed_iqm):
        with pytest.raises(ValueError, match="not finite"):
            interval(values)
    with pytest.raises(ValueError, match="not finite"):
        probability_of_improvement(values, [1.0, 2.0])


# --- paired ---------------------------------------------------------------------------------------


@given(samples(), st.integers(0, 100))
def test_swapping_the_policies_mirrors_the_difference(values, seed):
    other = np.random.default_rng(seed).permutation(values)
    ours = paired_difference(values, other, resamples=FEW)
    theirs = paired_difference(other, values, resamples=FEW)
    assert (ours.estimate, ours.low, ours.high) == pytest.approx(
        (-theirs.estimate, -theirs.high, -theirs.low), abs=1e-9
    )


@given(samples(), NUMBERS)
def test_a_constant_advantage_is_found_exactly_however_the_tasks_differ(values, advantage):
    difference = paired_difference(values + advantage, values, resamples=FEW)
    assert difference == pytest.approx((advantage,) * 3, abs=1e-6)


def test_pairing_is_narrower_than_two_intervals_when_tasks_are_shared():
    rng = np.random.default_rng(5)
    difficulty = rng.normal(scale=3.0, size=200)
    ours, theirs = difficulty + rng.normal(size=200), difficulty + rng.normal(size=200)
    assert width(paired_difference(ours, theirs)) < 0.6 * width(bootstrap_mean(ours))


def test_pairs_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match="equal lengths"):
        paired_difference([1.0, 2.0], [1.0])


def pairs(b: int, c: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """n tasks, of which only ours solved b and only theirs c; both solved half of the rest."""
    rows = np.arange(n)
    both = rows >= b + c + (n - b - c) // 2
    return (both | (rows < b)).astype(float), (both | ((rows >= b) & (rows < b + c))).astype(float)


@st.composite
def discordant(draw):
    n = draw(st.integers(2, 300))
    b = draw(st.integers(0, n))
    return b, draw(st.integers(0, n - b)), n


@given(discordant(), CONFIDENCES)
def test_the_score_of_a_paired_rate_is_just_not_rejected_at_its_ends(count, confidence):
    """With q found by trying all, not by the root."""
    b, c, n = count
    interval = paired_rate_difference(*pairs(*count), confidence=confidence)
    assert interval.estimate == pytest.approx((b - c) / n)
    assert -1.0 <= interval.low <= interval.estimate + 1e-9
    assert interval.estimate - 1e-9 <= interval.high <= 1.0
    z = scipy.stats.norm.ppf(0.5 + 0.5 * confidence)
    for d in (interval.low, interval.high):
        if abs(d) > 1.0 - 1e-6:
            continue

        def minus_log_likelihood(q: float, d: float = d) -> float:
            terms = scipy.special.xlogy((b, c, n - b - c), (q + d, q, 1.0 - 2.0 * q - d))
            return -terms.sum()

        bounds = (max(0.0, -d), 0.5 * (1.0 - d))
        found = scipy.optimize.minimize_scalar(
            minus_log_likelihood, bounds=bounds, method="bounded", options={"xatol": 1e-12}
        )
        score = (b - c - n * d) / math.sqrt(n * (2.0 * found.x + d * (1.0 - d)))
        assert abs(score) == pytest.approx(z, rel=2e-3)


@given(discordant(), CONFIDENCES)
def test_swapping_the_policies_mirrors_the_difference_of_rates(count, confidence):
    x, y = pairs(*count)
    ours, theirs = (paired_rate_difference(*p, confidence=confidence) for p in ((x, y), (y, x)))
    assert ours == pytest.approx((-theirs.estimate, -theirs.high, -theirs.low), abs=1e-12)


@pytest.mark.parametrize("n", [1, 8, 500])
def test_tasks_that_all_ended_alike_leave_a_difference_open(n):
    x, _ = pairs(0, 0, n)
    interval = paired_rate_difference(x, x)
    share = 1.959964**2 / (n + 1.959964**2)
    assert interval == pytest.approx((0.0, -share, share), abs=1e-6)


@pytest.mark.parametrize(("only_ours", "only_theirs"), [(0.01, 0.01), (0.05, 0.0), (0.2, 0.1), (0.02, 0.3)])
def test_a_paired_rate_keeps_its_coverage_where_few_pairs_differ(only_ours, only_theirs):
    """Exactly: over all counts of 40 tasks, by their chance."""
    n, covered = 40, 0.0
    chances = scipy.stats.multinomial(n, (only_ours, only_theirs, 1.0 - only_ours - only_theirs))
    for b in range(n + 1):
        for c in range(n + 1 - b):
            chance = chances.pmf((b, c, n - b - c))
            if chance > 1e-6:
                interval = paired_rate_difference(*pairs(b, c, n))
                covered += chance * (interval.low <= only_ours - only_theirs <= interval.high)
    assert covered > 0.93


def test_a_paired_rate_is_of_equally_many_zeros_and_ones():
    with pytest.raises(ValueError, match="equal lengths"):
        paired_rate_difference([1.0, 0.0], [1.0])
    with pytest.raises(ValueError, match="0 or 1"):
        paired_rate_difference([0.5], [1.0])
    assert math.isnan(paired_rate_difference([], []).low)


# --- training seeds -------------------------------------------------------------------------------


def iqm(values) -> float:
    return seed_iqm(values, resamples=FEW).estimate


@given(samples(1, 60))
def test_iqm_leaves_out_a_quarter_at_either_end(values):
    cut = len(values) // 4
    assert iqm(values) == pytest.approx(np.sort(values)[cut : len(values) - cut].mean(), abs=1e-9)


@given(samples(4, 40), st.floats(1e3, 1e9))
def test_one_outlier_cannot_carry_the_iqm_out_of_the_rest(values, outlier):
    assert values.min() - 1e-9 <= iqm(np.append(values, outlier)) <= values.max() + 1e-9


@given(scores(), CONFIDENCES)
def test_seed_intervals_hold_their_estimates(values, confidence):
    mean = seed_mean(values, confidence=confidence, resamples=FEW)
    middle = seed_iqm(values, confidence=confidence, resamples=FEW)
    assert mean.estimate == pytest.approx(values.mean(), abs=1e-9)
    assert middle.estimate == pytest.approx(iqm(values.ravel()), abs=1e-9)
    assert mean.low <= mean.estimate <= mean.high
    assert middle.low <= middle.estimate <= middle.high


@given(scores(scenarios=(1, 1)))
def test_one_scenario_is_the_plain_bootstrap_over_seeds(values):
    assert seed_mean(values, resamples=FEW) == bootstrap_mean(values[:, 0], resamples=FEW)
    assert seed_mean(values[:, 0], resamples=FEW) == seed_mean(values, resamples=FEW)


@given(hnp.arrays(np.float64, st.integers(2, 5), elements=NUMBERS), st.integers(2, 8))
def test_scenarios_are_strata_and_their_spread_is_no_uncertainty(per_scenario, seeds):
    """Seeds that agree leave nothing open, however far apart the scenarios are."""
    values = np.tile(per_scenario, (seeds, 1))
    assert seed_mean(values, resamples=FEW) == pytest.approx((per_scenario.mean(),) * 3, abs=1e-9)
    assert width(seed_iqm(values, resamples=FEW)) == pytest.approx(0.0, abs=1e-9)


def test_seeds_of_different_scenarios_are_drawn_apart():
    """Were whole rows drawn, scores that cancel in each row would leave no width."""
    values = np.arange(10.0)
    width_apart = width(seed_mean(np.column_stack([values, -values])))
    assert width_apart == pytest.approx(width(bootstrap_mean(values)) / math.sqrt(2.0), rel=0.1)


def test_one_seed_has_no_interval_and_the_number_of_scenarios_does_not_help():
    for interval in (seed_mean([[0.9, 0.5, 0.7]]), seed_iqm([0.7])):
        assert interval.estimate == pytest.approx(0.7)
        assert math.isnan(interval.low)
        assert math.isnan(interval.high)


def test_seed_intervals_narrow_with_more_seeds():
    values = np.random.default_rng(6).normal(size=(40, 2))
    assert width(seed_mean(values)) < width(seed_mean(values[:10]))
    assert width(seed_iqm(values)) < width(seed_iqm(values[:10]))


@given(st.data(), st.integers(1, 3))
def test_chances_of_both_sides_sum_to_one_ties_counting_half(data, scenarios):
    small = st.integers(0, 3).map(float)  # so that ties are common
    x = data.draw(hnp.arrays(np.float64, st.tuples(st.integers(1, 8), st.just(scenarios)), elements=small))
    y = data.draw(hnp.arrays(np.float64, st.tuples(st.integers(1, 8), st.just(scenarios)), elements=small))
    ours = probability_of_improvement(x, y, resamples=FEW)
    theirs = probability_of_improvement(y, x, resamples=FEW)
    assert ours.estimate + theirs.estimate == pytest.approx(1.0)
    twin = [
        sum((a > b) + 0.5 * (a == b) for a in x[:, k] for b in y[:, k]) / (len(x) * len(y))
        for k in range(scenarios)
    ]
    assert ours.estimate == pytest.approx(sum(twin) / scenarios)


@given(scores(), scores())
def test_the_chance_of_improvement_lies_in_its_interval_and_in_0_to_1(x, y):
    assume(x.shape[1] == y.shape[1])
    interval = probability_of_improvement(x, y, resamples=FEW)
    assert -1e-12 <= interval.low <= interval.estimate <= interval.high <= 1.0 + 1e-12
    squashed = probability_of_improvement(np.arctan(x / 100.0), np.arctan(y / 100.0), resamples=FEW)
    assert squashed == pytest.approx(interval), "only the order of the scores counts"


@given(scores())
def test_equal_methods_are_even_and_a_dominant_one_always_wins(values):
    assert probability_of_improvement(values, values, resamples=FEW).estimate == pytest.approx(0.5)
    above = values + 3e3
    assert probability_of_improvement(above, values, resamples=FEW) == pytest.approx((1.0,) * 3)


def test_the_interval_of_improvement_agrees_with_a_plain_resampling_loop():
    rng = np.random.default_rng(7)
    x, y = rng.normal(0.5, 1.0, size=(10, 2)), rng.normal(size=(8, 2))
    replicates = []
    for _ in range(4000):
        wins = [
            np.mean(x[rng.integers(0, 10, 10), k][:, None] > y[rng.integers(0, 8, 8), k][None])
            for k in range(2)
        ]
        replicates.append(np.mean(wins))
    ours = probability_of_improvement(x, y)
    assert ours[1:] == pytest.approx(tuple(np.quantile(replicates, (0.025, 0.975))), abs=0.02)


def test_one_seed_of_either_method_gives_no_interval():
    interval = probability_of_improvement([0.9], [0.5, 0.95])
    assert interval.estimate == 0.5
    assert math.isnan(interval.low)
    assert math.isnan(interval.high)


def test_methods_run_in_different_scenarios_are_not_compared():
    with pytest.raises(ValueError, match="same ones"):
        probability_of_improvement(np.zeros((3, 2)), np.zeros((3, 1)))


def test_the_correction_is_holms() -> None:
    """Smallest first times 3, 2, 1, never falling, at most 1."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm([0.2]) == pytest.approx([0.2])
    assert holm([]) == []


def test_flipped_signs_by_hand() -> None:
    """Of 16 ways to sign 1, 2, 3, 4 two have a mean as far from 0 as all plus."""
    assert paired_p_value([1, 2, 3, 4], [0, 0, 0, 0]) == pytest.approx(2 / 16)
    # 1 - 2 + 3 + 4 = 6: as far are 10, 8, 6 and their negatives.
    assert paired_p_value([1, 0, 3, 4], [0, 2, 0, 0]) == pytest.approx(6 / 16)
    assert paired_p_value([5, 5], [5, 5]) == 1.0
    assert np.isnan(paired_p_value([], []))


@given(hnp.arrays(np.float64, st.integers(1, 9), elements=st.integers(-20, 20).map(float)))
def test_a_p_value_is_the_share_of_all_signs(difference: np.ndarray) -> None:
    means = [np.mean(difference * signs) for signs in itertools.product((-1, 1), repeat=len(difference))]
    expected = np.mean(np.abs(means) >= abs(difference.mean()) - 1e-9)
    assert paired_p_value(difference, np.zeros_like(difference)) == pytest.approx(expected)


@given(st.lists(st.booleans(), min_size=2, max_size=60))
def test_clusters_of_one_trial_each_have_wilsons_interval(flags: list[bool]):
    told = clustered_rate(np.array(flags), np.ones(len(flags)))
    assert told.estimate == np.mean(flags)
    assert_allclose(told, wilson_interval(sum(flags), len(flags)), atol=1e-12)


@given(st.lists(st.integers(0, 20), min_size=2, max_size=40))
def test_a_clustered_interval_holds_the_rate_and_is_between_those_of_trials_and_of_clusters(
    successes: list[int],
):
    told = clustered_rate(np.array(successes), np.full(len(successes), 20))
    trials = wilson_interval(sum(successes), 20 * len(successes))
    assert 0.0 <= told.low <= told.estimate <= told.high <= 1.0
    assert told.high - told.low >= trials.high - trials.low - 1e-12
    apart = clustered_rate(np.repeat([0, 20], len(successes)), np.full(2 * len(successes), 20))
    alike = clustered_rate(np.repeat([10, 10], len(successes)), np.full(2 * len(successes), 20))
    assert apart.high - apart.low >= alike.high - alike.low


def test_a_clustered_interval_covers_as_often_as_it_says_where_clusters_differ():
    """Where Wilson's of all trials does not: rates of clusters drawn from a beta distribution about 0.9."""
    rng = np.random.default_rng(0)
    covered, naive = 0, 0
    for _ in range(400):
        k = rng.binomial(20, rng.beta(4.5, 0.5, size=50))
        told, of_trials = clustered_rate(k, np.full(50, 20)), wilson_interval(int(k.sum()), 1000)
        covered += told.low <= 0.9 <= told.high
        naive += of_trials.low <= 0.9 <= of_trials.high
    assert covered / 400 > 0.92
    assert naive / 400 < 0.85


def test_the_first_failure_moves_the_lower_end_little():
    """Clusters that all succeed do not tell that all would."""
    ends = [clustered_rate(np.repeat([20, 19], [50 - k, k]), np.full(50, 20)).low for k in range(20)]
    assert np.diff(ends).max() < 0.003
    assert ends[0] < wilson_interval(1000, 1000).low


def test_no_clusters_leave_all_open_and_wrong_counts_are_an_error():
    assert np.isnan(clustered_rate(np.empty(0), np.empty(0))).all()
    with pytest.raises(ValueError, match="no more successes than trials"):
        clustered_rate([2], [1])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=200))
def test_nine_tenths_reach_the_worst_decile(values: list[float]):
    told = worst_decile(values, resamples=50)
    assert told.estimate in values
    assert np.mean(np.array(values) >= told.estimate) >= 0.9
    assert np.mean(np.array(values) <= told.estimate) >= 0.1
    assert worst_decile([0.5, 1.0], resamples=50).estimate == 0.5
