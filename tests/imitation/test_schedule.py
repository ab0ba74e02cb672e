"""Laws of the schedule (eqs 3, 5, 13) and of the loop S -> weights -> Q -> S."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.errors import ConfigError
from adrl.imitation.schedule import (
    LEAST_REACH,
    PATIENCE_UPDATES,
    Bounds,
    MaturityState,
    ScheduleConfig,
    alpha,
    arrivals,
    bounds_in_use,
    lambda_bc,
    measured_maturity,
    update,
)
from adrl.runs import RunConfig

CONFIG = ScheduleConfig()
unit = st.floats(0.0, 1.0)
DT = CONFIG.interval_updates


def at(maturity: float) -> MaturityState:
    return MaturityState(maturity=maturity)


@given(unit, unit)
def test_the_expert_is_released_as_the_critic_matures(a: float, b: float):
    young, old = sorted((a, b))
    assert CONFIG.alpha_min <= alpha(at(old), CONFIG) <= alpha(at(young), CONFIG) <= CONFIG.alpha_max
    assert 0.0 < lambda_bc(at(old), CONFIG) <= lambda_bc(at(young), CONFIG) <= CONFIG.lambda_max


def test_phases():
    """Stabilisation: alpha near its maximum, lambda at it. Autonomy: both nearly released."""
    assert alpha(at(0.0), CONFIG) > 0.95 * CONFIG.alpha_max
    assert lambda_bc(at(0.0), CONFIG) == CONFIG.lambda_max
    assert alpha(at(CONFIG.b_alpha / CONFIG.k_alpha), CONFIG) == (CONFIG.alpha_min + CONFIG.alpha_max) / 2
    assert alpha(at(1.0), CONFIG) < CONFIG.alpha_min + 0.05 * CONFIG.alpha_max
    assert math.isclose(lambda_bc(at(1.0), CONFIG), CONFIG.lambda_max * math.exp(-CONFIG.k_q))


def test_a_tenth_of_the_cloning_stays_where_the_policy_is_shown_the_way():
    """By hand; a floor that is given holds under every guidance."""
    left = math.exp(-CONFIG.k_q)
    assert math.isclose(lambda_bc(at(1.0), CONFIG.under("map")), CONFIG.lambda_max * (0.1 + 0.9 * left))
    assert math.isclose(lambda_bc(at(1.0), CONFIG.under("goal")), CONFIG.lambda_max * left)
    for guidance, floor in (("map", 0.1), ("goal", 0.0), ("replan", 0.0), ("map,goal", 0.0)):
        assert RunConfig(guidance=guidance).resolved().schedule.lambda_floor == floor
    given = ScheduleConfig(lambda_floor=0.3)
    assert given.under("map").lambda_floor == given.under("goal").lambda_floor == 0.3


def test_without_imitation_nothing_is_left_of_it():
    plain = ScheduleConfig(alpha_min=0.0, alpha_max=0.0, lambda_max=0.0)
    for s in (0.0, 0.3, 1.0):
        assert alpha(at(s), plain) == 0.0
        assert lambda_bc(at(s), plain) == 0.0


@given(st.floats(-10, 10), st.floats(-5, 5), st.floats(0.01, 5), st.floats(0.1, 100), st.floats(-5, 5))
def test_measured_maturity_ignores_scale_and_offset_of_the_reward(
    q: float, low: float, span: float, scale: float, offset: float
):
    plain = measured_maturity(q, Bounds(low, low + span))
    other = measured_maturity(scale * q + offset, Bounds(scale * low + offset, scale * (low + span) + offset))
    assert 0.0 <= plain <= 1.0
    assert math.isclose(plain, other, abs_tol=1e-6)


def test_an_expert_no_better_than_chance_measures_nothing():
    assert measured_maturity(5.0, Bounds(1.0, 1.0)) == 0.0
    assert measured_maturity(5.0, Bounds(1.0, 0.0)) == 0.0


def run(values: list[float], config: ScheduleConfig = CONFIG, first: float | None = 0.0) -> list[float]:
    """first: what the cold critic has said, so that by default the bounds are those given; None for the first value."""
    state, out = MaturityState(cold=first, cold_share=first), []
    for value in values:
        state = update(state, value, Bounds(0.0, 1.0), DT, config)
        out.append(state.maturity)
    return out


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=60))
def test_maturity_is_bounded_and_its_rate_limited(values: list[float]):
    path = [0.0, *run(values)]
    for before, after in pairwise(path):
        assert 0.0 <= after <= 1.0
        assert -DT / CONFIG.fall_updates - 1e-12 <= after - before <= DT / CONFIG.rise_updates + 1e-12


WITH_ARRIVALS = replace(CONFIG, rise="arrivals")


@given(st.lists(st.lists(st.booleans(), max_size=30), min_size=1, max_size=40))
def test_with_arrivals_s_rises_by_the_share_that_arrives(ended: list[list[bool]]):
    """However mature the critic calls itself. The average as a sum: an episode weighs 19/20 of the next one."""
    state, seen = MaturityState(cold=0.0, cold_share=0.0), []
    for arrived in ended:
        before, seen = state.maturity, seen + arrived
        state = update(arrivals(state, arrived), 100.0, Bounds(0.0, 1.0), DT, WITH_ARRIVALS)
        share = sum(one / 20 * (19 / 20) ** later for later, one in enumerate(reversed(seen)))
        assert state.arriving == pytest.approx(share)
        allowed = before + share * DT / WITH_ARRIVALS.rise_updates
        assert state.maturity <= min(allowed, 1.0) + 1e-12
        assert any(seen) or state.maturity == 0.0


def test_where_all_arrive_s_rises_as_without_arrivals():
    state = MaturityState(cold=0.0, cold_share=0.0, arriving=1.0)
    for expected in run([1.0] * 60):
        state = update(arrivals(state, [True] * 5), 1.0, Bounds(0.0, 1.0), DT, WITH_ARRIVALS)
        assert state.maturity == pytest.approx(expected)


def test_s_falls_with_the_critic_although_all_arrive():
    """Arrivals hold S back; they do not make it."""
    state = MaturityState(cold=0.0, cold_share=0.0, arriving=1.0, maturity=0.5)
    assert update(arrivals(state, [True]), -1.0, Bounds(0.0, 1.0), DT, WITH_ARRIVALS).maturity < 0.5


def test_arrivals_are_counted_in_the_warm_up():
    config = replace(WITH_ARRIVALS, warmup_updates=5 * DT)
    assert update(arrivals(MaturityState(), [True]), 1.0, Bounds(0.0, 1.0), DT, config).arriving == 1 / 20


def test_maturity_stays_zero_in_the_warm_up_whatever_the_critic_says():
    path = run([100.0] * 20, ScheduleConfig(warmup_updates=5 * DT))
    assert path[:5] == [0.0] * 5
    assert path[5] > 0.0


PATIENT = CONFIG.under("map")
"""Q_max stays the expert's return."""


SLOW = replace(CONFIG, patience_updates=1e8)
"""Q_max comes down, but not within a test."""


@given(unit)
def test_a_steady_value_is_reached(value: float):
    assert math.isclose(run([value] * 400, PATIENT)[-1], value, abs_tol=0.01)


@given(st.floats(LEAST_REACH, 1.0))
def test_where_the_critic_settles_short_of_the_expert_the_release_is_completed_all_the_same(value: float):
    """After patience_updates the gap of Q_max has closed by 63 %, by hand; in the end S is 1."""
    settled = [value] * round(PATIENCE_UPDATES["goal"] / DT)
    expected = value / (value + math.exp(-1.0) * (1.0 - value))
    assert run(settled)[-1] == pytest.approx(expected, abs=0.05)
    assert run(settled * 8)[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("values", [[0.05], [0.0, 0.1]])
def test_a_critic_that_has_not_learnt_releases_little_however_long(values: list[float]):
    assert max(run(values * (1000 // len(values)))) <= max(values) / LEAST_REACH + 0.02


def test_who_is_shown_the_way_is_measured_against_the_expert_for_ever():
    """Guidance map: the expert's return is within reach. A constant that is given holds under every guidance."""
    assert max(run([0.4] * 2000, CONFIG.under("map"))) == pytest.approx(0.4, abs=0.01)
    assert run([0.4] * 2000, CONFIG.under("replan"))[-1] == pytest.approx(1.0, abs=0.02)
    assert ScheduleConfig(patience_updates=7.0).under("map").patience_updates == 7.0


def test_a_critic_that_goes_on_rising_raises_the_bound_again():
    """From 0.3, where Q_max has come down to, to 0.9."""
    state = MaturityState(cold=0.0, cold_share=0.0, reach=0.3, average=0.3, maturity=1.0)
    for _ in range(100):
        state = update(state, 0.9, Bounds(0.0, 1.0), DT, CONFIG)
    assert state.reach == pytest.approx(0.9, abs=0.01)


def test_a_collapse_of_the_critic_barely_takes_the_release_back():
    path = run([0.8] * 100 + [-5.0] * 10)
    assert path[99] - path[-1] < 0.05


@pytest.mark.parametrize("config", [CONFIG, PATIENT], ids=["default", "Q_max stays"])
@pytest.mark.parametrize("lag_updates", [300.0, 1000.0, 3000.0])
@pytest.mark.parametrize("feedback", [0.8, 1.6])
def test_the_loop_through_the_weights_settles(lag_updates: float, feedback: float, config: ScheduleConfig):
    """S changes the weights, and the measured value falls by feedback * S once the critic has followed.

    S overshoots once at the most, comes down slowly and stays where value and S agree, measured to where Q_max is.
    """
    state, q, path = MaturityState(cold=0.0, cold_share=0.0), 0.0, []
    for _ in range(3000):
        q += (1.0 - math.exp(-DT / lag_updates)) * (0.9 - feedback * state.maturity - q)
        state = update(state, q, Bounds(0.0, 1.0), DT, config)
        path.append(state.maturity)
    # 0.9 - feedback S = reach S, where reach is 1, or has come down as far as it may.
    balance = 0.9 / ((1.0 if config is PATIENT else LEAST_REACH) + feedback)
    assert math.isclose(path[-1], balance, abs_tol=2e-3)
    after_peak = path[path.index(max(path)) :]
    assert min(after_peak) > balance - 0.03
    swings = [abs(b - a) for a, b in pairwise(after_peak)]
    assert max(swings, default=0.0) <= DT / CONFIG.rise_updates
    assert max(path[-300:]) - min(path[-300:]) < 2e-3


@pytest.mark.parametrize(
    "bad",
    [
        {"alpha_max": 1.5},
        {"alpha_min": 0.6},
        {"k_q": math.nan},
        {"lambda_max": -1.0},
        {"rise_updates": 0.0},
        {"patience_updates": 0.0},
    ],
)
def test_bad_constants_are_refused_by_name(bad: dict[str, float]):
    with pytest.raises(ConfigError, match=next(iter(bad))):
        ScheduleConfig(**bad)  # pyright: ignore[reportArgumentType]


LITERAL = ScheduleConfig(k_alpha=8.0, b_alpha=4.0, lambda_max=0.5, k_q=4.0).literal()


def test_eqs_3_and_5_as_printed_by_hand():
    """Q = -1: alpha = sigma(8 + 4), lambda = 0.5 e^4, both above their maxima; Q = 0.5: sigma(0), 0.5 e^-2."""
    young = MaturityState(statistic=-1.0)
    assert math.isclose(alpha(young, LITERAL), 1.0 / (1.0 + math.exp(-12.0)))
    assert math.isclose(lambda_bc(young, LITERAL), 0.5 * math.exp(4.0))
    assert alpha(young, CONFIG) <= CONFIG.alpha_max
    assert lambda_bc(young, CONFIG) <= CONFIG.lambda_max
    older = MaturityState(statistic=0.5)
    assert math.isclose(alpha(older, LITERAL), 0.5)
    assert math.isclose(lambda_bc(older, LITERAL), 0.5 * math.exp(-2.0))
    assert math.isfinite(lambda_bc(MaturityState(statistic=-1e9), LITERAL))


def test_eq_13_as_printed_hides_progress_behind_running_extremes():
    """Any value that is the highest so far counts as fully mature, and the next lower one as not at all."""
    state, path = MaturityState(), []
    for value in (0.3, 0.4, 0.2, 0.3):
        state = update(state, value, Bounds(0.0, 10.0), DT, LITERAL)
        path.append(state.maturity)
    assert path == pytest.approx([0.0, 1.0, 0.0, 0.5])
    assert (state.lowest, state.highest) == (0.2, 0.4)


def test_the_clock_releases_whatever_the_critic_says():
    config = ScheduleConfig(driver="clock", warmup_updates=500, clock_updates=1000.0)
    state, path = MaturityState(), []
    for _ in range(20):
        state = update(state, -100.0, Bounds(0.0, 1.0), DT, config)
        path.append(state.maturity)
    assert path == pytest.approx([min(max((100 * i - 500) / 1000, 0.0), 1.0) for i in range(1, 21)])


def test_a_probe_is_needed_only_where_it_is_used():
    assert CONFIG.needs_probe
    assert ScheduleConfig(driver="return", eq2="literal", eq13="literal").needs_probe
    assert ScheduleConfig(eq13="literal").needs_probe  # eq 2 is measured on it
    assert ScheduleConfig(eq2="literal").needs_probe  # and eq 13 against it
    assert not LITERAL.needs_probe
    assert not ScheduleConfig(driver="clock").needs_probe
    for name in ("driver", "rise"):
        with pytest.raises(ConfigError, match=name):
            ScheduleConfig(**{name: "moon"})  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("later", [Bounds(-2.0, 1.0), Bounds(-20.0, 10.0), Bounds(3.0, 6.0)])
def test_what_a_cold_critic_promises_is_no_maturity(later: Bounds):
    """Chance earns -2, the expert 1, and a critic that knows nothing says 0, two thirds of the way: S starts at 0.

    It is 1/2 at five sixths of the way, under the weights of then or others that have other bounds.
    """
    state, path = MaturityState(), []
    for value, bounds in [(0.0, Bounds(-2.0, 1.0))] * 5 + [
        (later.low + 5 / 6 * (later.high - later.low), later)
    ] * 100:
        state = update(state, value, bounds, DT, SLOW)
        path.append(state.maturity)
    assert path[4] == 0.0
    assert math.isclose(path[-1], 0.5, abs_tol=0.01)
    low, high = bounds_in_use(state, later, SLOW)
    assert low == pytest.approx(later.low + 2 / 3 * (later.high - later.low))
    assert high == pytest.approx(later.high, rel=1e-4)


@given(st.lists(st.tuples(unit, st.floats(-3.0, 0.0), st.floats(0.1, 3.0)), min_size=2, max_size=40))
def test_where_the_expert_is_in_reach_the_bounds_are_the_first_value_and_its_return(
    rows: list[tuple[float, float, float]],
):
    """Against the obvious twin; bounds change from one measurement to the next."""
    state, average, maturity, cold = MaturityState(), 0.0, 0.0, None
    gain = 1.0 - math.exp(-DT / PATIENT.smoothing_updates)
    for value, low, high in rows:
        state = update(state, value, Bounds(low, high), DT, PATIENT)
        cold = value if cold is None else cold
        average += gain * (measured_maturity(value, Bounds(max(low, cold), high)) - average)
        change = min(max(average - maturity, -DT / PATIENT.fall_updates), DT / PATIENT.rise_updates)
        maturity = min(max(maturity + change, 0.0), 1.0)
        assert state.maturity == pytest.approx(maturity, abs=1e-12)


def test_a_cold_critic_that_promises_too_much_does_not_end_the_release():
    path = run([2.0] * 100, first=None)
    assert path[-1] > 0.9


def test_a_fixed_share_stays_fixed_in_the_literal_form_too():
    fixed = ScheduleConfig(alpha_min=0.5, alpha_max=0.5, lambda_max=0.2, k_q=0.0).literal()
    for q in (-3.0, 0.0, 3.0):
        assert alpha(MaturityState(statistic=q), fixed) == 0.5
        assert lambda_bc(MaturityState(statistic=q), fixed) == 0.2


PROGRESS = replace(CONFIG, driver="progress")
EXPERT = Bounds(0.0, 1.0)


@given(st.lists(unit, min_size=1, max_size=30))
def test_by_progress_the_cloning_weight_stays_in_its_range(returns: list[float]):
    state = MaturityState()
    for earned in returns:
        state = update(state, earned, EXPERT, DT, PROGRESS)
        assert 0.0 <= lambda_bc(state, PROGRESS) <= PROGRESS.lambda_max


def test_by_progress_the_cloning_weight_falls_until_the_return_drops():
    """Zhao et al. 2022: faster the less is earned, which leaves less of it than of a return near the target."""
    far, near = MaturityState(), MaturityState()
    for _ in range(3):
        far, near = (
            update(state, earned, EXPERT, DT, PROGRESS) for state, earned in ((far, 0.2), (near, 0.9))
        )
    assert lambda_bc(far, PROGRESS) < lambda_bc(near, PROGRESS) < PROGRESS.lambda_max
    dropped = update(near, 0.0, EXPERT, DT, PROGRESS)
    assert lambda_bc(dropped, PROGRESS) > lambda_bc(near, PROGRESS)
    assert lambda_bc(update(near, 0.95, EXPERT, DT, PROGRESS), PROGRESS) < lambda_bc(near, PROGRESS)
    assert alpha(far, replace(PROGRESS, alpha_min=0.05, alpha_max=0.05)) == 0.05
