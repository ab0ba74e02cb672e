"""Cloning by itself: the clone comes to what the labels say, and goes on where it was."""

from collections.abc import Callable

import numpy as np

from adrl.agents.cloning import Clone
from adrl.agents.td3 import CloneState
from adrl.deploy.policy import PolicyConfig
from adrl.imitation import Demonstrations
from adrl.observation import Mirror
from adrl.rewards import REWARD_TERMS

SIZE = 5
ABOUT = PolicyConfig(input_size=SIZE, widths=(32, 32))


def shown(rng: np.random.Generator, count: int = 2000) -> Demonstrations:
    """Labels that are a smooth function of what is seen, and turn round with it."""
    seen = rng.uniform(-1.0, 1.0, (count, SIZE)).astype(np.float32)
    label = np.tanh(np.stack([seen[:, 0] + seen[:, 2] ** 2, seen[:, 1]], axis=1)).astype(np.float32)
    ended = np.zeros(count, bool)
    ended[-1] = True
    return Demonstrations(
        observation=seen,
        action=label,
        expert_action=label,
        next_observation=seen,
        reward_terms=np.zeros((count, len(REWARD_TERMS)), np.float32),
        features=np.zeros((count, 3), np.float32),
        terminated=ended,
        truncated=np.zeros(count, bool),
        periods=np.ones(count),
    )


def error(clone: Clone, data: Demonstrations) -> float:
    return float(((clone.policy(ABOUT).act(data.observation) - data.expert_action) ** 2).mean())


def a_clone(mirror: Mirror | None = None, seed: int = 0) -> Clone:
    return Clone((32, 32), SIZE, mirror, np.random.default_rng(seed))


def test_more_updates_come_nearer_to_the_labels_on_states_never_shown():
    rng = np.random.default_rng(1)
    data, other, clone = shown(rng), shown(rng), a_clone()
    errors = [error(clone, other)]
    for _ in range(2):
        clone.fit(data, 500, rng)
        errors.append(error(clone, other))
    assert errors[2] < errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-3


def test_equal_seeds_give_equal_bytes():
    data = shown(np.random.default_rng(2))
    prints = []
    for seed in (0, 0, 1):
        clone = a_clone(seed=seed)
        clone.fit(data, 50, np.random.default_rng(seed))
        prints.append(clone.policy(ABOUT).fingerprint)
    assert prints[0] == prints[1] != prints[2]


def test_one_that_was_saved_goes_on_to_the_same_bytes():
    data, through, other = shown(np.random.default_rng(2)), a_clone(), a_clone(seed=1)
    through.fit(data, 100, np.random.default_rng(5))
    other.set_state(through.state())
    for clone in (through, other):
        clone.fit(data, 100, np.random.default_rng(6))
    assert through.policy(ABOUT).fingerprint == other.policy(ABOUT).fingerprint


def test_a_mirrored_state_is_learnt_with_the_mirrored_action_and_the_labels_stay_as_they_are():
    data, sign = shown(np.random.default_rng(3)), np.ones(SIZE, np.float32)
    sign[1] = -1.0
    right = data.observation[:, 1] > 0.0
    half = Demonstrations(
        **{
            name: np.concatenate([getattr(data, name)[right], getattr(data, name)[-1:]])
            for name in data.__dataclass_fields__
        }
    )
    kept = half.observation.tobytes(), half.expert_action.tobytes()
    clone = a_clone(Mirror(np.arange(SIZE), sign))
    clone.fit(half, 1000, np.random.default_rng(4))
    assert (half.observation.tobytes(), half.expert_action.tobytes()) == kept
    assert error(clone, data) < 1e-2, "the left half was never shown"


def test_of_two_answers_the_more_frequent_is_learnt_and_not_what_lies_between():
    """Who drives on in two of three cases and backs out in the third does not stand."""
    rng = np.random.default_rng(4)
    data, clone = shown(rng), a_clone()
    forward = rng.random(len(data)) < 2 / 3
    data.expert_action[:, 0] = np.where(forward, 0.8, -0.8)
    clone.fit(data, 1000, rng)
    assert np.abs(clone.policy(ABOUT).act(data.observation)[:, 0] - 0.8).mean() < 0.1


def test_the_last_fit_comes_to_rest():
    """Labels that cannot be learnt move a clone for ever, but not in the last calls, where nothing more is to come."""
    rng, moved = np.random.default_rng(5), {}
    data = shown(rng)
    data.expert_action[:] = rng.choice([-0.9, 0.9], data.expert_action.shape)
    for last in (False, True):
        clone, steps = a_clone(), []
        clone._update = spied(clone._update, steps)
        clone.fit(data, 500, np.random.default_rng(6), last=last)
        moved[last] = steps
    assert moved[True][0] > 0.9 * moved[False][0]
    assert moved[True][-1] < 0.1 * moved[False][-1]


def spied(update: Callable, steps: list[float]) -> Callable:
    """Notes how far the parameters go in each call."""

    def noted(state: CloneState, *given: object) -> CloneState:
        before = np.array(state.actor)
        after = update(state, *given)
        steps.append(float(np.linalg.norm(np.array(after.actor) - before)))
        return after

    return noted
