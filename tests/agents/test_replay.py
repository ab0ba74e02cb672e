"""Replay against a slow twin that keeps everything in lists."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adrl.agents.replay import Replay
from adrl.errors import CheckpointError, DatasetError
from adrl.imitation.demonstrations import Demonstrations

GAMMA, D = 0.9, 3


def fill(replay: Replay, steps: int, seed: int) -> list[deque[dict]]:
    """Add random steps with random endings; returns what each environment's ring then holds, oldest first."""
    rng = np.random.default_rng(seed)
    n = replay.num_envs
    twin = [deque(maxlen=replay.rows) for _ in range(n)]
    for t in range(steps):
        step = {
            "observation": rng.normal(size=(n, D)).astype(np.float32),
            "action": rng.normal(size=(n, 2)).astype(np.float32),
            "terms": rng.normal(size=(n, 6)).astype(np.float32),
            "features": rng.random((n, 3), dtype=np.float32),
            "next_observation": rng.normal(size=(n, D)).astype(np.float32),
            "terminated": rng.random(n) < 0.15,
        }
        step["truncated"] = ~step["terminated"] & (rng.random(n) < 0.15)
        replay.add(**step, maturity=0.1 * t)
        step["maturity"] = np.full(n, 0.1 * t, np.float32)
        for e in range(n):
            twin[e].append({name: np.array(value[e]) for name, value in step.items()})
    return twin


def window(rows: list[dict], start: int, n_step: int) -> dict:
    """The window that starts at rows[start], one step at a time."""
    signals, discounts = [], []
    row = rows[start]
    for j in range(n_step):
        row = rows[start + j]
        signals.append(np.concatenate([row["terms"], row["features"], [row["maturity"]]]))
        discounts.append(GAMMA**j)
        if row["terminated"] or row["truncated"]:
            break
    return {
        "observation": rows[start]["observation"],
        "action": rows[start]["action"],
        "signals": np.array(signals),
        "step_discount": discounts + [0.0] * (n_step - len(discounts)),
        "bootstrap_observation": row["next_observation"],
        "bootstrap_discount": 0.0 if row["terminated"] else GAMMA ** len(signals),
    }


@given(st.integers(1, 4), st.integers(4, 40), st.integers(1, 4), st.integers(0, 10_000))
@settings(max_examples=40)
def test_every_sampled_window_is_one_the_twin_holds(num_envs: int, steps: int, n_step: int, seed: int):
    replay = Replay(12, num_envs, D, n_step, GAMMA)
    twin = fill(replay, steps, seed)
    expected = {
        rows[i]["observation"].tobytes(): window(list(rows), i, n_step)
        for rows in twin
        for i in range(len(rows) - n_step + 1)
    }
    batch = replay.sample(np.random.default_rng(seed), 2, 50, 0)
    seen = set()
    for update in range(2):
        for row in range(50):
            key = batch.observation[update, row].tobytes()
            assert key in expected, "a window over the write head, or of a row that was overwritten"
            seen.add(key)
            for name, value in expected[key].items():
                got = getattr(batch, name)[update, row]
                assert_allclose(got[: len(value)] if name == "signals" else got, value, rtol=1e-6)
    if len(expected) <= 10:
        assert len(seen) == len(expected), "some windows are never drawn"


def demonstrations(steps: int = 20, size: int = D) -> Demonstrations:
    rng = np.random.default_rng(5)
    ended = np.arange(steps) % 7 == 6
    ended[-1] = True
    return Demonstrations(
        observation=rng.normal(size=(steps, size)).astype(np.float32),
        action=rng.normal(size=(steps, 2)).astype(np.float32),
        expert_action=rng.normal(size=(steps, 2)).astype(np.float32),
        next_observation=rng.normal(size=(steps, size)).astype(np.float32),
        reward_terms=rng.normal(size=(steps, 6)).astype(np.float32),
        features=rng.random((steps, 3), dtype=np.float32),
        terminated=ended & (np.arange(steps) < 10),
        truncated=ended & (np.arange(steps) >= 10),
    )


def test_demonstrations_are_windows_too_and_stand_first_in_each_update():
    data = demonstrations()
    replay = Replay(12, 2, D, 3, GAMMA, data)
    twin = fill(replay, 30, 0)
    rows = [
        {
            "observation": data.observation[i],
            "action": data.action[i],
            "terms": data.reward_terms[i],
            "features": data.features[i],
            "next_observation": data.next_observation[i],
            "terminated": data.terminated[i],
            "truncated": data.truncated[i],
            "maturity": 0.0,
        }
        for i in range(20)
    ]
    expected = {rows[i]["observation"].tobytes(): window(rows, i, 3) for i in range(20)}
    online = {row["observation"].tobytes() for ring in twin for row in ring}
    batch = replay.sample(np.random.default_rng(1), 4, 10, 60)
    assert batch.observation.shape == (4, 70, D)
    seen = set()
    for update in range(4):
        assert all(batch.observation[update, row].tobytes() in online for row in range(60, 70))
        for row in range(60):
            key = batch.observation[update, row].tobytes()
            seen.add(key)
            for name, value in expected[key].items():
                got = getattr(batch, name)[update, row]
                assert_allclose(got[: len(value)] if name == "signals" else got, value, rtol=1e-6)
    assert len(seen) == 20


def test_labels_are_the_experts_not_the_executed_actions():
    data = demonstrations()
    replay = Replay(12, 2, D, 3, GAMMA, data)
    batch = replay.sample_labels(np.random.default_rng(0), (3, 40))
    assert batch.observation.shape == (3, 40, D)
    of = {data.observation[i].tobytes(): data.expert_action[i] for i in range(20)}
    for o, a in zip(batch.observation.reshape(-1, D), batch.action.reshape(-1, 2), strict=True):
        assert_array_equal(a, of[o.tobytes()])


def test_batches_own_their_memory():
    """JAX may alias what it is handed; the ring is written again while the update runs."""
    replay = Replay(12, 2, D, 3, GAMMA, demonstrations())
    fill(replay, 30, 0)
    batch = replay.sample(np.random.default_rng(1), 2, 10, 10)
    labels = replay.sample_labels(np.random.default_rng(1), (2, 10))
    before = [np.array(field) for field in (*batch, *labels)]
    fill(replay, 30, 9)
    for field, copy in zip((*batch, *labels), before, strict=True):
        assert not any(np.shares_memory(field, array) for array in replay.state().values())
        assert_array_equal(field, copy)


@pytest.mark.parametrize("steps", [5, 12, 31])
def test_a_restored_replay_goes_on_to_the_same_bytes(steps: int):
    one, other = Replay(12, 2, D, 3, GAMMA), Replay(12, 2, D, 3, GAMMA)
    fill(one, steps, 0)
    other.set_state({name: np.array(array) for name, array in one.state().items()})
    for seed in (1, 2):
        fill(one, 4, seed)
        fill(other, 4, seed)
        batches = [r.sample(np.random.default_rng(seed), 2, 20, 0) for r in (one, other)]
        for a, b in zip(*batches, strict=True):
            assert_array_equal(a, b)


def test_newest_rows_come_in_order():
    replay = Replay(12, 2, D, 3, GAMMA)
    twin = fill(replay, 30, 0)
    terms, features = replay.newest(5)
    assert terms.shape == (2, 5, 6)
    for e in range(2):
        assert_array_equal(terms[e], [row["terms"] for row in list(twin[e])[-5:]])
        assert_array_equal(features[e], [row["features"] for row in list(twin[e])[-5:]])


def test_foreign_data_are_refused_with_what_to_do():
    with pytest.raises(DatasetError, match=r"4 numbers.*same robot"):
        Replay(12, 2, D, 3, GAMMA, demonstrations(size=4))
    replay, smaller = Replay(12, 2, D, 3, GAMMA), Replay(12, 1, D, 3, GAMMA)
    fill(smaller, 5, 0)
    with pytest.raises(CheckpointError, match="observation"):
        replay.set_state(smaller.state())
