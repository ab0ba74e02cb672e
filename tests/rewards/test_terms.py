"""Each sub-reward against its equation, by hand and by law."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.errors import ConfigError
from adrl.rewards import FEATURES, REWARD_TERMS, RewardConfig, features, reward, terms, weights
from reward_steps import CONFIG, a_step, term


def test_terms_have_the_order_of_the_table():
    assert tuple(REWARD_TERMS) == ("success", "failure", "motion", "approach", "obstacle", "stagnation")
    assert tuple(FEATURES) == ("threat", "proximity", "stop")
    assert terms(a_step(), CONFIG).shape == (1, 6)
    assert terms(a_step(), CONFIG).dtype == np.float32


def test_ends_pay_once():
    assert term("success", reached=True) == 200.0
    assert term("success", collided=True) == 0.0
    assert term("failure", collided=True) == -200.0
    assert term("failure") == 0.0


def test_motion_is_free_at_full_speed_straight_on_and_costs_elsewhere():
    assert term("motion") == 0.0
    assert term("motion", speed_mps=0.0) == -1.0
    assert_allclose(term("motion", speed_mps=0.3, yaw_rate_radps=-0.75), 0.5 - 0.4 - 1.0, rtol=1e-6)


def test_full_speed_to_the_goal_approaches_by_one():
    assert_allclose(term("approach", distance_m=3.94), 1.0, rtol=1e-5)
    assert_allclose(term("approach", distance_m=4.06), -1.0, rtol=1e-5)


headings = st.lists(st.floats(-math.pi, math.pi), min_size=2, max_size=8)


@given(headings, st.lists(st.floats(0.0, 10.0), min_size=8, max_size=8))
def test_approach_sums_to_nothing_over_a_loop(heading: list[float], distance: list[float]):
    path = list(zip(heading, distance, strict=False))
    loop = [*path, path[0]]
    h, d = np.array(loop).T
    step = replace(
        a_step(),
        heading_error_rad=h[1:],
        previous_heading_error_rad=h[:-1],
        distance_m=d[1:],
        previous_distance_m=d[:-1],
    )
    assert abs(REWARD_TERMS["approach"](step, CONFIG).sum()) < 1e-9


@given(st.floats(-1.5, 1.5), st.floats(1e-4, 1e-3))
def test_turning_follows_eq_10_for_small_turns(heading: float, turn: float):
    previous = math.copysign(abs(heading) + turn, heading)
    expected = 0.5 * math.exp(-2.0 * abs(heading)) * turn / 0.06
    got = term("approach", heading_error_rad=heading, previous_heading_error_rad=previous)
    assert_allclose(got, expected, rtol=3e-3, atol=3e-6)


def test_obstacle_costs_from_the_safe_clearance_down_to_contact():
    assert term("obstacle", clearance_m=0.3) == 0.0
    assert_allclose(term("obstacle", clearance_m=0.15), -2.5)
    assert term("obstacle", clearance_m=0.0) == -5.0
    assert term("obstacle", clearance_m=-0.1) == -5.0


@given(st.floats(-0.1, 1.0), st.floats(-0.1, 1.0))
def test_nearer_never_costs_less(a: float, b: float):
    near, far = sorted((a, b))
    assert term("obstacle", clearance_m=near) <= term("obstacle", clearance_m=far) <= 0.0


def test_stagnation_starts_at_its_threshold():
    threshold = CONFIG.stagnation_fraction * 0.06
    assert term("stagnation", mean_displacement_m=0.99 * threshold) == -3.0
    assert term("stagnation", mean_displacement_m=1.01 * threshold) == 0.0


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_shaping_weights_are_normalised_and_ends_fixed(t_obs: float, t_goal: float, t_stop: float, s: float):
    w = weights(np.array([t_obs, t_goal, t_stop]), s, CONFIG)
    assert (w >= 0.0).all()
    assert_allclose(w[2:].sum(), 1.0)
    assert tuple(w[:2]) == (CONFIG.success_weight, CONFIG.failure_weight)


def test_printed_rows_by_hand():
    """Eqs 14, 15 at T = (0.5, 0.25, 1), S = 0.5: 0.6 * 0.5 * 0.5 + 0.05 = 0.2 and 0.8 * 0.5 + 0.05 = 0.45."""
    w = weights(np.array([0.5, 0.25, 1.0]), 0.5, CONFIG)
    assert_allclose(w[3] / w[5], 0.2 / 0.45)


def test_features_span_zero_to_one():
    calm = features(a_step(), CONFIG)
    assert_allclose(calm, [[0.0, 0.0, 0.0]])
    alarmed = features(a_step(clearance_m=0.0, distance_m=0.0, mean_displacement_m=0.0), CONFIG)
    assert_allclose(alarmed, [[1.0, 1.0, 1.0]])
    between = features(a_step(clearance_m=0.15, distance_m=1.5, mean_displacement_m=0.0045), CONFIG)
    assert_allclose(between, [[0.5, 0.5, 0.5]], rtol=1e-5)


def test_reward_is_the_weighted_sum_in_numpy_and_in_jax():
    import jax
    import jax.numpy as jnp

    rng = np.random.default_rng(0)
    r = rng.normal(size=(4, 3, 6)).astype(np.float32)
    f = rng.random((4, 3, 3), dtype=np.float32)
    by_hand = CONFIG.scale * np.array(
        [[(r[i, j] * weights(f[i, j], 0.3, CONFIG)).sum() for j in range(3)] for i in range(4)]
    )
    got = reward(r, f, 0.3, CONFIG)
    assert got.dtype == np.float32
    assert_allclose(got, by_hand, rtol=1e-5)
    jitted = jax.jit(lambda r, f, s: reward(r, f, s, CONFIG))(r, f, jnp.float32(0.3))
    assert_allclose(np.asarray(jitted), by_hand, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("bad", [math.nan, -1.0, 0.0, math.inf])
@pytest.mark.parametrize("name", ["safe_clearance_m", "scale", "failure_weight"])
def test_bad_constants_are_refused_by_name(name: str, bad: float):
    with pytest.raises(ConfigError, match=name):
        RewardConfig(**{name: bad})  # pyright: ignore[reportArgumentType]
