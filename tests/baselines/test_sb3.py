"""Stable-Baselines3 sees the same environment, bootstraps where ours does, and leaves a policy that we can drive."""

import itertools
import json
import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.interface import Validation
from adrl.deploy.policy import PolicyConfig, load_policy
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, UnknownName
from adrl.types import RobotConfig
from env_tasks import OneTask, straight_task

# On a laptop without it these are skipped; in CI the import below fails.
if os.environ.get("CI") != "true":
    pytest.importorskip("stable_baselines3")

import torch

from adrl.baselines.sb3 import ALGORITHMS, Sb3VecEnv, make_model, mean_q, promised, to_policy, train_sb3

NUM_ENVS = 8
FORWARD, STOP = (1.0, 0.0), (-1.0, 0.0)


def small(**options: Any) -> TrainConfig:
    td3 = Td3Config(widths=(16, 12), batch_size=16, gamma=0.95)
    return TrainConfig(
        **{"steps": 64 * NUM_ENVS, "start_steps": 80, "td3": td3, "log_interval_steps": 64} | options
    )


def world(time_limit_s: float, distance_m: float = 3.0) -> NavVectorEnv:
    task = straight_task(RobotConfig(), distance_m, time_limit_s=time_limit_s)
    return NavVectorEnv(NUM_ENVS, scenario=OneTask(task), randomize=False)


def test_steps_are_those_of_the_environment() -> None:
    """Same observations, rewards and endings; an ended row's true successor is kept, and why it ended."""
    ours, theirs = NavVectorEnv(NUM_ENVS, seed=3), Sb3VecEnv(NavVectorEnv(NUM_ENVS, seed=3))
    np.testing.assert_array_equal(ours.reset()[0], theirs.reset())
    rng, seen = np.random.default_rng(0), {"done": 0}
    for _ in range(300):
        action = rng.uniform(-1.0, 1.0, (NUM_ENVS, 2)).astype(np.float32)
        action[:, 0] = 1.0
        observation, rewards, terminated, truncated, info = ours.step(action)
        got = theirs.step(action)
        np.testing.assert_array_equal(got[0], observation)
        np.testing.assert_array_equal(got[1], rewards)
        np.testing.assert_array_equal(got[2], terminated | truncated)
        for i, done in enumerate(got[2]):
            assert bool(got[3][i]) == done, "only an ended row has something to say"
            if done:
                np.testing.assert_array_equal(got[3][i]["terminal_observation"], info["final_obs"][i])
                assert got[3][i]["TimeLimit.truncated"] == truncated[i]
                assert got[3][i]["is_success"] == info["success"][i]
                seen["done"] += 1
    assert seen["done"] > 5


def test_the_seed_given_counts() -> None:
    env = Sb3VecEnv(NavVectorEnv(3))
    env.seed(7)
    np.testing.assert_array_equal(env.reset(), NavVectorEnv(3).reset(seed=7)[0])
    assert len(env.get_attr("robot")) == 3
    assert env.env_is_wrapped(object, [0, 2]) == [False, False]
    with pytest.raises(ConfigError, match="all environments"):
        env.set_attr("maturity", 1.0, indices=[0])
    env.set_attr("maturity", 0.25)
    assert env.env_method("expert_actions")[0].shape == (3, 2)
    assert env.env.maturity == 0.25


@pytest.mark.parametrize(
    ("time_limit_s", "action", "bootstraps"), [(1.0, STOP, True), (60.0, FORWARD, False)]
)
def test_a_target_bootstraps_through_truncation_only(
    time_limit_s: float, action: tuple[float, float], bootstraps: bool
) -> None:
    """What replay hands to the update: done is 1 on arrival and 0 at the time limit, with the true successor."""
    env = world(time_limit_s, distance_m=1.0)
    model = make_model("TD3", env, small(start_steps=10**6))
    buffer: Any = model.replay_buffer  # pyright: ignore[reportAttributeAccessIssue]
    adapter = Sb3VecEnv(env)
    observation, endings = adapter.reset(), 0
    for _ in range(60):
        step = np.tile(np.array(action, np.float32), (NUM_ENVS, 1))
        result: Any = adapter.step(step)
        following, rewards, dones, infos = result
        successor = following.copy()
        for i in np.flatnonzero(dones):
            successor[i] = infos[i]["terminal_observation"]
        buffer.add(observation, successor, step, rewards, dones, infos)
        observation, endings = following, endings + int(dones.sum())
    assert endings >= NUM_ENVS
    targets_end = buffer.dones[: buffer.pos] * (1.0 - buffer.timeouts[: buffer.pos])
    assert targets_end.sum() == (0 if bootstraps else endings)
    assert buffer.timeouts.sum() == (endings if bootstraps else 0)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_policy_in_numpy_is_the_model(algorithm: str) -> None:
    env = world(5.0)
    model = make_model(algorithm, env, small())
    policy = to_policy(model, PolicyConfig(input_size=1, widths=(1,)))
    assert policy.config.widths == (16, 12)
    size = policy.config.input_size
    observation = np.random.default_rng(0).standard_normal((50, size)).astype(np.float32)
    expected, _ = model.predict(observation, deterministic=True)
    np.testing.assert_allclose(policy.act(observation), expected, atol=1e-5)
    assert np.abs(expected).max() > 1e-3


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_the_critic_says_is_what_the_library_predicts(algorithm: str) -> None:
    """Slow twins: the value of the deterministic action, one state at a time."""
    env = world(5.0)
    model: Any = make_model(algorithm, env, small())
    states = (
        np.random.default_rng(1)
        .standard_normal((5, to_policy(model, PolicyConfig(input_size=1, widths=(1,))).config.input_size))
        .astype(np.float32)
    )
    expected = []
    for state in states:
        tensor = torch.as_tensor(state[None])
        if algorithm == "PPO":
            expected.append(model.policy.predict_values(tensor).item())
        else:
            action, _ = model.predict(state, deterministic=True)
            expected.append(model.critic.q1_forward(tensor, torch.as_tensor(action[None])).item())
    assert promised(model, states) == pytest.approx(np.mean(expected), abs=1e-5)
    assert mean_q(model) is None, "nothing has been learnt or seen yet"


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_run_leaves_a_policy_and_rows(algorithm: str, tmp_path: Path) -> None:
    """Updates are counted as they are made; evaluations cost no wall clock; every row says what the critic says."""
    pause_s = 0.15
    asked: list[Any] = []
    env = world(5.0)
    start = env.reset()[0]

    def evaluate(policy: Any, maturity: float) -> Validation:
        asked.append(policy)
        time.sleep(pause_s)
        return Validation(success=0.5, seconds=9.0, start=start, discounted_return=0.25)

    config = small(eval_interval_steps=128)
    began_s = time.monotonic()
    env.maturity = 0.25
    result = train_sb3(
        algorithm,
        env,
        config,
        tmp_path,
        policy_config=PolicyConfig(input_size=1, widths=(1,)),
        evaluate=evaluate,
        tuned={"n_steps": 8, "batch_size": 16} if algorithm == "PPO" else None,
    )
    took_s = time.monotonic() - began_s
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [row["env_steps"] for row in rows] == list(range(64, 513, 64))
    assert [row["success"] for row in rows] == [None, 0.5] * 4
    assert [policy.config.maturity for policy in [*asked, result.policy]] == [0.25] * 5
    assert result.train_seconds <= took_s - 4 * pause_s
    assert rows[-1]["wall_s"] <= result.train_seconds
    # Four for each step of the environment, first after the first step past start_steps. PPO: ten passes over each of
    # eight rollouts of 64 rows.
    assert (result.env_steps, result.updates) == (512, 8 * 10 * 4 if algorithm == "PPO" else 4 * (64 - 10))
    known = rows if algorithm == "PPO" else rows[2:]
    assert all(np.isfinite(row["q_mean"]) for row in known)
    for row in rows[1::2]:
        assert row["overestimation"] == pytest.approx(row["q_start"] - 0.25)
    policy = load_policy(tmp_path)
    assert policy.config.extra["gradient_updates"] == result.updates
    observation = np.ones((3, policy.config.input_size), np.float32)
    np.testing.assert_array_equal(policy.act(observation), result.policy.act(observation))


def test_equal_seeds_equal_policies(tmp_path: Path) -> None:
    about = PolicyConfig(input_size=1, widths=(1,))
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        train_sb3("TD3", NavVectorEnv(NUM_ENVS), small(seed=seed), tmp_path / name, policy_config=about)
    weights = [(tmp_path / name / "policy.safetensors").read_bytes() for name in "abc"]
    assert weights[0] == weights[1] != weights[2]


def test_no_policy_without_updates(tmp_path: Path) -> None:
    about = PolicyConfig(input_size=1, widths=(1,))
    for config, says in (
        (small(steps=32, start_steps=10_000), "start_steps = 10000"),
        (small(steps=None, max_seconds=1e-9), "set-up took"),
    ):
        with pytest.raises(ConfigError, match=says):
            train_sb3("TD3", world(5.0), config, tmp_path, policy_config=about)
        assert not (tmp_path / "policy.safetensors").exists()


def test_the_wall_clock_ends_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock of its own: a busy machine sets up for as long as it likes."""
    about = PolicyConfig(input_size=1, widths=(1,))
    config = small(steps=None, max_seconds=5.0)
    looks = itertools.count()
    monkeypatch.setattr("adrl.baselines.sb3.time", SimpleNamespace(monotonic=lambda: 0.01 * next(looks)))
    result = train_sb3("TD3", world(5.0), config, tmp_path, policy_config=about)
    assert 5.0 <= result.train_seconds < 10.0
    monkeypatch.undo()
    with pytest.raises(ConfigError, match="max_seconds"):
        train_sb3("TD3", world(5.0), small(steps=None), tmp_path, policy_config=about)
    with pytest.raises(UnknownName, match="TD3"):
        make_model("TD4", world(5.0), config)
