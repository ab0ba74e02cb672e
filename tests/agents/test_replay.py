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
from adrl.observation import Mirror

GAMMA, D = 0.9, 3
MIRROR = Mirror(np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0], np.float32))


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
        step["periods"] = rng.choice([1.0, 0.5, 2.3], n)
        replay.add(**step, maturity=0.1 * t)
        step["maturity"] = np.full(n, 0.1 * t, np.float32)
        for e in range(n):
            twin[e].append({name: np.array(value[e]) for name, value in step.items()})
    return twin


def window(rows: list[dict], start: int, n_step: int) -> dict:
    """The window that starts at rows[start], one step at a time."""
    signals, discounts, elapsed = [], [], 0.0
    row = rows[start]
    for j in range(n_step):
        row = rows[start + j]
        signals.append(np.concatenate([row["terms"], row["features"], [row["maturity"]]]))
        discounts.append(GAMMA**elapsed)
        elapsed += row["periods"]
        if row["terminated"] or row["truncated"]:
            break
    return {
        "observation": rows[start]["observation"],
        "action": rows[start]["action"],
        "signals": np.array(signals),
        "step_discount": discounts + [0.0] * (n_step - len(discounts)),
        "bootstrap_observation": row["next_observation"],
        "bootstrap_discount": 0.0 if row["terminated"] else GAMMA**elapsed,
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
        periods=rng.choice([1.0, 0.5, 2.3], steps),
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
            "periods": np.broadcast_to(data.periods, 20)[i],
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


@given(st.integers(1, 4), st.integers(4, 60), st.integers(1, 4), st.integers(0, 10_000))
@settings(max_examples=40)
def test_the_last_rows_lead_to_failures(num_envs: int, steps: int, n_step: int, seed: int):
    """Each is a whole window of the ring, in which or soon after which its environment fails."""
    replay = Replay(12, num_envs, D, n_step, GAMMA, failure_share=0.25)
    twin = fill(replay, steps, seed)
    restored = Replay(12, num_envs, D, n_step, GAMMA, failure_share=0.25)
    restored.set_state({name: np.array(array) for name, array in replay.state().items()})
    batch = replay.sample(np.random.default_rng(seed), 3, 40, 0)
    for a, b in zip(batch, restored.sample(np.random.default_rng(seed), 3, 40, 0), strict=True):
        assert_array_equal(a, b)
    expected: dict[bytes, dict] = {}
    for ring in twin:
        rows = list(ring)
        for failed in [i for i, row in enumerate(rows) if row["terminated"] and row["terms"][1] < 0.0]:
            for start in range(max(0, failed - 9), failed + 1):
                key = rows[start]["observation"].tobytes()
                expected[key] = window(rows, start, min(n_step, len(rows) - start))
    if not expected:
        return
    seen = set()
    for update in range(3):
        for row in range(30, 40):
            key = batch.observation[update, row].tobytes()
            assert key in expected
            for name in ("action", "bootstrap_discount", "step_discount"):
                got, value = getattr(batch, name)[update, row], np.asarray(expected[key][name])
                assert_allclose(got[: len(value)] if value.ndim else got, value, rtol=1e-6)
            seen.add(key)
    # Starts before the ring's first row are its first row: of two, one may be drawn 30 times in 30.
    assert len(seen) > 1 or len(expected) < 4


def mirrored_observation(rows: np.ndarray) -> np.ndarray:
    """What MIRROR makes of (..., 3) observations, written out."""
    return np.stack([rows[..., 1], rows[..., 0], -rows[..., 2]], axis=-1)


def mirrored_action(rows: np.ndarray) -> np.ndarray:
    return np.stack([rows[..., 0], -rows[..., 1]], axis=-1)


@pytest.mark.parametrize("failure_share", [0.0, 0.25])
def test_every_other_row_is_mirrored_as_a_whole(failure_share: float):
    """Observation, successor and action of a row together; what it paid and the rows between stay as they were."""
    plain, ours = (
        Replay(12, 2, D, 3, GAMMA, demonstrations(), mirror=mirror, failure_share=failure_share)
        for mirror in (None, MIRROR)
    )
    for replay in (plain, ours):
        fill(replay, 30, 0)
    one, other = (replay.sample(np.random.default_rng(3), 4, 21, 20) for replay in (plain, ours))
    moved = {
        "observation": mirrored_observation,
        "bootstrap_observation": mirrored_observation,
        "action": mirrored_action,
    }
    for name, before, after in zip(one._fields, one, other, strict=True):
        assert_array_equal(after[:, 1::2], before[:, 1::2], err_msg=name)
        expected = moved[name](before[:, ::2]) if name in moved else before[:, ::2]
        assert_array_equal(after[:, ::2], expected, err_msg=name)
    for name, array in plain.state().items():
        assert_array_equal(ours.state()[name], array, err_msg="the store itself was mirrored")


def test_every_other_label_is_mirrored_with_its_state():
    plain, ours = (Replay(12, 2, D, 3, GAMMA, demonstrations(), mirror=m) for m in (None, MIRROR))
    one, other = (replay.sample_labels(np.random.default_rng(3), (4, 21)) for replay in (plain, ours))
    assert_array_equal(other.observation[:, 1::2], one.observation[:, 1::2])
    assert_array_equal(other.action[:, 1::2], one.action[:, 1::2])
    assert_array_equal(other.observation[:, ::2], mirrored_observation(one.observation[:, ::2]))
    assert_array_equal(other.action[:, ::2], mirrored_action(one.action[:, ::2]))
    assert ours.checksum() == plain.checksum(), "the store itself was mirrored"
