"""The probe's bounds are the discounted returns of the two policies from the same starts."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from adrl.imitation.demonstrations import Demonstrations, column_shapes
from adrl.imitation.probe import BoundsTable, Rollouts, as_shown, record_probe
from adrl.rewards import RewardConfig, reward
from probe_envs import PLAIN, Aim, Endless, Walk

GAMMA = 0.9


def test_returns_by_hand():
    probe = record_probe(Walk(12), seed=1, max_steps=30)
    assert probe.observation.shape == (6, 2)
    # The expert of Walk drives at 0.5: ten steps that pay 0.05 each, or the last five of them from stops half-way.
    left = probe.expert.alive.sum(axis=0)
    assert set(left) == {5, 10}
    bounds = probe.bounds(0.5, GAMMA, PLAIN)
    assert_allclose(
        bounds.high, np.mean([sum(0.05 * GAMMA**t for t in range(steps)) for steps in left]), rtol=1e-5
    )
    assert bounds.low < bounds.high


def test_only_the_first_episode_counts():
    probe = record_probe(Endless(6), seed=1, max_steps=30)
    assert_allclose(probe.expert.value(0.5, GAMMA, PLAIN), sum(GAMMA**t for t in range(5)), rtol=1e-5)


def test_both_policies_start_from_the_same_states():
    probe = record_probe(Aim(100), seed=1, max_steps=250)
    x = probe.observation[:, 0]
    assert set(np.unique(x)) == {-1.0, 1.0}
    assert len(x) == 50
    # Aim pays 1 to the expert of the very state it started in.
    assert_allclose(probe.expert.terms[0, :, 0], 1.0, atol=1e-6)


def test_the_table_equals_the_bounds_on_its_grid_and_stays_between():
    probe = record_probe(Walk(12), seed=1, max_steps=30)
    rng = np.random.default_rng(0)
    for rollouts in (probe.random, probe.expert):
        rollouts.terms[:] = rng.normal(size=rollouts.terms.shape)
        rollouts.features[:] = rng.random(rollouts.features.shape)
    config = RewardConfig()
    table = BoundsTable(probe, GAMMA, config)
    for s in (0.0, 0.25, 1.0):
        assert_allclose(table.at(s), probe.bounds(s, GAMMA, config), atol=1e-6)
    assert_allclose(table.at(0.33), probe.bounds(0.33, GAMMA, config), atol=2e-3)


def test_values_follow_the_weights_of_today():
    probe = record_probe(Walk(12), seed=1, max_steps=30)
    rng = np.random.default_rng(0)
    probe.random.terms[:] = rng.normal(size=probe.random.terms.shape)
    config = RewardConfig()

    def by_hand(s: float) -> float:
        total = 0.0
        alive: NDArray[np.bool_] = probe.random.alive
        for t in range(len(alive)):
            r = reward(probe.random.terms[t], probe.random.features[t], s, config)
            total += GAMMA**t * float(r[alive[t]].sum())
        return total / 6

    values = [probe.random.value(s, GAMMA, config) for s in (0.0, 1.0)]
    assert values == pytest.approx([by_hand(0.0), by_hand(1.0)], rel=1e-4)
    assert values[0] != pytest.approx(values[1], rel=1e-3)


@given(
    st.lists(st.sampled_from([0.25, 0.5, 1.0, 1.7, 3.0]), min_size=1, max_size=7),
    st.integers(1, 30),
    st.integers(0, 1000),
)
def test_every_row_is_discounted_by_the_length_of_its_own_steps(periods: list[float], steps: int, seed: int):
    rng, rows = np.random.default_rng(seed), len(periods)
    terms = np.zeros((steps, rows, 6), np.float32)
    terms[:, :, 0] = rng.normal(size=(steps, rows))
    alive = np.arange(steps)[:, None] < rng.integers(1, steps + 1, rows)
    features = np.zeros((steps, rows, 3), np.float32)
    rollouts = Rollouts(terms=terms, features=features, alive=alive, periods=np.array(periods))
    returns = [
        sum(GAMMA ** (t * periods[p]) * terms[t, p, 0] for t in range(steps) if alive[t, p])
        for p in range(rows)
    ]
    assert_allclose(rollouts.value(0.5, GAMMA, PLAIN), np.mean(returns), rtol=1e-4, atol=1e-5)


def test_what_recorded_drives_earned_by_hand():
    """Two drives of 60 and 10 steps that pay 1 a step: from stops every 25 steps, each to its drive's end."""
    steps = 70
    ended = np.zeros(steps, dtype=bool)
    ended[[59, 69]] = True
    terms = np.zeros((steps, 6), np.float32)
    terms[:, 0] = 1.0
    drives = recording(terms, terminated=ended)
    shown = as_shown(drives, max_steps=40)
    left = sorted(shown.alive.sum(axis=0))
    assert left == [10, 10, 35, 40]
    by_hand = np.mean([sum(GAMMA**t for t in range(steps)) for steps in left])
    assert_allclose(shown.value(0.5, GAMMA, PLAIN), by_hand, rtol=1e-5)


def test_a_recording_that_was_cut_off_counts_as_far_as_it_tells():
    steps = 100
    cut = np.zeros(steps, dtype=bool)
    cut[-1] = True
    terms = np.ones((steps, 6), np.float32)
    assert sorted(as_shown(recording(terms, truncated=cut), 60).alive.sum(axis=0)) == [60, 60]
    assert sorted(as_shown(recording(terms, truncated=cut), 400).alive.sum(axis=0)) == [25, 50, 75, 100]


def recording(terms: NDArray[np.float32], **ends: NDArray[np.bool_]) -> Demonstrations:
    columns: dict[str, Any] = {}
    for name, shape in column_shapes(2, 6, 3).items():
        columns[name] = np.zeros((len(terms), *shape), bool if shape == () else np.float32)
    columns |= ends
    columns["reward_terms"] = terms
    return Demonstrations(**columns)
