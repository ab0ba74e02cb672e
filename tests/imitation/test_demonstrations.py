"""Demonstrations: what is recorded is what happened, and the noise is as stated."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, DatasetError
from adrl.imitation import Demonstrations, Driver, NoiseConfig, collect
from adrl.rewards import REWARD_TERMS
from adrl.runs.rounds import Gathered

NOISY = NoiseConfig(fraction=0.4, std=0.6, burst_s=0.5)


@pytest.fixture(scope="module")
def recorded() -> Demonstrations:
    return collect(NavVectorEnv(16, task_pool=64), 4000, noise=NOISY, seed=3)


def columns(data: Demonstrations) -> dict[str, np.ndarray]:
    return {field.name: getattr(data, field.name) for field in fields(data)}


def test_recording_is_what_the_environment_did(recorded: Demonstrations) -> None:
    """Replayed in a fresh environment, the actions lead to the same bytes; the labels are the expert's."""
    env = NavVectorEnv(16, task_pool=64)
    observation, _ = env.reset(seed=3)
    rows = {name: column.reshape(16, 250, *column.shape[1:]) for name, column in columns(recorded).items()}
    for t in range(250):
        assert rows["observation"][:, t].tobytes() == observation.tobytes()
        assert rows["expert_action"][:, t].tobytes() == env.expert_actions().tobytes()
        observation, _, terminated, truncated, info = env.step(rows["action"][:, t])
        assert rows["next_observation"][:, t].tobytes() == info["next_obs"].tobytes()
        assert rows["reward_terms"][:, t].tobytes() == info["reward_terms"].tobytes()
        assert rows["features"][:, t].tobytes() == info["features"].tobytes()
        np.testing.assert_array_equal(rows["terminated"][:, t], terminated)
        np.testing.assert_array_equal(rows["truncated"][:, t], truncated | ((t == 249) & ~terminated))
        np.testing.assert_array_equal(recorded.success.reshape(16, 250)[:, t], info["success"])


def test_windows_never_cross_episodes(recorded: Demonstrations) -> None:
    """Within an episode the successor is the next observation; where it is not, an episode has ended."""
    chained = (recorded.observation[1:] == recorded.next_observation[:-1]).all(axis=1)
    np.testing.assert_array_equal(chained, ~recorded.ended[:-1])
    assert recorded.ended[-1]
    assert recorded.ended[249::250].all(), "every row's recording ends"
    assert recorded.terminated.sum() > 10


def test_shapes_types_and_count() -> None:
    """At least as many steps as asked for, a whole number of rows."""
    data = collect(NavVectorEnv(6, task_pool=8), 100)
    assert len(data) == 102
    assert {name: column.dtype.name for name, column in columns(data).items() if column.dtype != bool} == {
        name: "float64" if name == "periods" else "float32"
        for name in columns(data)
        if name not in ("terminated", "truncated")
    }
    assert data.reward_terms.shape == (102, len(REWARD_TERMS))
    assert all(column.flags.c_contiguous for column in columns(data).values())


def test_equal_seeds_equal_bytes() -> None:
    def run(seed: int, threads: int = 1) -> bytes:
        data = collect(NavVectorEnv(4, task_pool=8, num_threads=threads), 200, seed=seed)
        return b"".join(column.tobytes() for column in columns(data).values())

    assert run(1) == run(1, threads=2)
    assert run(1) != run(2)


def test_without_noise_the_expert_is_executed_and_arrives() -> None:
    data = collect(NavVectorEnv(16, task_pool=64), 6000, noise=NoiseConfig(fraction=0.0))
    np.testing.assert_array_equal(data.action, data.expert_action)
    assert data.success.sum() >= 0.95 * data.terminated.sum() > 10


def test_noise_is_as_stated() -> None:
    """Its share of the time, its spread, the mean length of a burst; held within a burst."""
    noise = NoiseConfig(fraction=0.3, std=0.1, burst_s=1.0)
    env = NavVectorEnv(256, task_pool=16)
    data = collect(env, 256 * 200, noise=noise)
    offset = (data.action - data.expert_action).reshape(256, 200, 2)
    noisy = (offset != 0.0).any(axis=2)
    assert noisy[:, 100:].mean() == pytest.approx(0.3, abs=0.03)
    free = (np.abs(data.action) < 1.0).all(axis=1).reshape(256, 200)  # not clipped
    same = free[:, :-1] & free[:, 1:] & noisy[:, :-1] & noisy[:, 1:]
    change = np.abs(np.diff(offset, axis=1)).max(axis=2)
    # Bursts last ten steps; only those back to back change the offset.
    assert (change[same] > 1e-6).mean() < 0.1
    lengths = burst_lengths(noisy)
    assert lengths.mean() * 0.1 == pytest.approx(1.0, rel=0.1)
    turning = offset[:, :, 1][noisy & free]
    assert turning.std() == pytest.approx(0.1, rel=0.1)
    assert abs(turning.mean()) < 0.02


def burst_lengths(noisy: np.ndarray) -> np.ndarray:
    """Lengths of runs of True that both begin and end inside their row."""
    lengths = []
    for row in noisy:
        edges = np.flatnonzero(np.diff(row.astype(int)))
        begins, ends = edges[~row[edges]], edges[row[edges]]
        ends = ends[ends > begins[0]] if len(begins) else ends[:0]
        lengths += list(ends - begins[: len(ends)])
    return np.array(lengths)


def test_noise_shows_recovery() -> None:
    """The expert, pushed, is seen where it would not go: nearer to obstacles and turned further away."""
    calm, pushed = (
        collect(NavVectorEnv(16, task_pool=32), 4000, noise=NoiseConfig(fraction=f)) for f in (0.0, 0.5)
    )
    sideways = [np.abs(data.observation[:, 37]) for data in (calm, pushed)]  # sine of the goal's direction
    assert pushed.features[:, 0].mean() > calm.features[:, 0].mean()
    assert np.quantile(sideways[1], 0.7) > np.quantile(sideways[0], 0.7)


def test_progress_is_told() -> None:
    told: list[tuple[int, int]] = []
    collect(NavVectorEnv(4, task_pool=4), 10, on_step=lambda done, total: told.append((done, total)))
    assert told == [(4, 12), (8, 12), (12, 12)]


@pytest.mark.parametrize("steps", [0, -5])
def test_nothing_to_record(steps: int) -> None:
    with pytest.raises(ConfigError, match=f"steps is {steps}"):
        collect(NavVectorEnv(2, task_pool=2), steps)


def test_environment_must_reset_itself() -> None:
    with pytest.raises(ConfigError, match="autoreset_mode"):
        collect(NavVectorEnv(2, task_pool=2, autoreset_mode="Disabled"), 10)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("fraction", 1.0),
        ("fraction", -0.1),
        ("fraction", math.nan),
        ("std", -1.0),
        ("std", math.inf),
        ("burst_s", 0.0),
    ],
)
def test_bad_noise_names_the_option(option: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"noise.{option}"):
        NoiseConfig(**{option: value})


def spoil(name: str, data: dict[str, Any]) -> None:
    """One fault, by its name."""
    if name == "empty":
        data.update({key: column[:0] for key, column in data.items()})
    elif name == "short":
        data["action"] = data["action"][:-1]
    elif name == "narrow":
        data["features"] = data["features"][:, :2]
    elif name == "NaN":
        data["observation"][3, 1] = np.nan
    elif name == "both":
        data["terminated"][-1] = data["truncated"][-1] = True
    elif name == "no episode":
        data["terminated"][-1] = data["truncated"][-1] = False


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("empty", "hold no step"),
        ("short", r"action is \(3999, 2\), expected \(4000, 2\)"),
        ("narrow", r"features is \(4000, 2\)"),
        ("NaN", "observation holds NaN"),
        ("both", "both terminated and truncated"),
        ("no episode", "ends no episode"),
    ],
)
def test_malformed_demonstrations(recorded: Demonstrations, fault: str, message: str) -> None:
    data: dict[str, Any] = {name: column.copy() for name, column in columns(recorded).items()}
    spoil(fault, data)
    with pytest.raises(DatasetError, match=message):
        Demonstrations(**data)


def test_where_a_learner_drives_the_labels_are_still_the_experts() -> None:
    """DAgger: what is executed is the learner's, what is shown is what the expert would do there."""
    env = NavVectorEnv(8, task_pool=16)
    turn = np.tile(np.array([-0.5, 0.25], np.float32), (8, 1))
    calm = NoiseConfig(fraction=0.0)
    data = collect(env, 800, noise=calm, seed=2, learner=lambda observation: turn[: len(observation)])
    np.testing.assert_array_equal(data.action, np.tile(turn[0], (len(data), 1)))
    led = collect(env, 800, noise=calm, seed=2)
    first = [k * len(data) // 8 for k in range(8)]
    np.testing.assert_array_equal(data.expert_action[first], led.expert_action[first])
    assert (data.expert_action != data.action).any(axis=1).mean() > 0.9


def test_rounds_are_gathered_one_after_the_other(recorded: Demonstrations) -> None:
    more = collect(NavVectorEnv(4, task_pool=8), 40, seed=9)
    gathered = Gathered(len(recorded) + len(more))
    gathered.add(recorded)
    for name, column in columns(gathered.shown()).items():
        np.testing.assert_array_equal(column, np.broadcast_to(columns(recorded)[name], column.shape))
    gathered.add(replace(more, periods=2.0))
    both = gathered.shown()
    assert len(both) == len(recorded) + len(more)
    for name, column in columns(both).items():
        np.testing.assert_array_equal(column[: len(recorded)], columns(recorded)[name])
        if name != "periods":
            np.testing.assert_array_equal(column[len(recorded) :], columns(more)[name])
    np.testing.assert_array_equal(np.asarray(both.periods)[len(recorded) :], 2.0)


@pytest.mark.parametrize("expert", ["perfect", "slow", "narrow-shy", "cautious", "mapless"])
def test_a_learner_that_stands_is_told_what_the_expert_would_do_there_and_not_how_to_get_unstuck(
    expert: str,
) -> None:
    """In one place a planner says one thing, MPPI about one; its own recovery says others for 2 of 6 s."""
    env = NavVectorEnv(8, scenario="clutter", task_pool=8, randomize=False)
    stand = np.tile(np.array([-1.0, 0.0], np.float32), (8, 1))
    data = collect(env, 8 * 120, expert=expert, noise=NoiseConfig(fraction=0.0), learner=lambda _: stand)
    labels = data.expert_action.reshape(8, 120, 2)
    assert np.ptp(labels[:, 60:], axis=1).max() < {"cautious": 0.5, "mapless": 0.8}.get(expert, 1e-6)
    assert np.abs(labels[:, -1] - stand).max(axis=1).min() > 0.1, "each is told to go"
    # Who is at the wheel itself does recover: the environment's planner is as it was.
    if expert not in ("cautious", "mapless", "narrow-shy"):  # which have controllers of their own
        env.reset(seed=0)
        seen = []
        for _ in range(80):
            seen.append(env.expert_actions())
            env.step(stand)
        assert np.ptp(np.array(seen)[10:], axis=0).max() > 0.1


def test_controllers_recover_again_after_they_were_asked_whatever_happened() -> None:
    control = NavVectorEnv(1, task_pool=1).sim.expert
    with control.advising():
        with control.advising():
            pass
        assert not control.native.recovers
    assert control.native.recovers

    def interrupted() -> None:
        with control.advising():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert control.native.recovers


def test_an_expert_of_ones_own_answers_a_learner_too() -> None:
    class Ahead(Driver):
        def __init__(self, env: NavVectorEnv) -> None:
            super().__init__(env)
            self.control = "mine"

        def actions(self) -> np.ndarray:
            return np.tile(np.array([1.0, 0.0], np.float32), (self.env.num_envs, 1))

    class Hasty:
        def driver(self, env: NavVectorEnv, seed: int) -> Driver:
            return Ahead(env)

    stand = np.tile(np.array([-1.0, 0.0], np.float32), (2, 1))
    data = collect(NavVectorEnv(2, task_pool=2), 20, expert=Hasty(), learner=lambda _: stand)
    assert (data.expert_action == [1.0, 0.0]).all()
