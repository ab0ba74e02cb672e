"""Whole training runs in environments whose values are known by hand."""

from pathlib import Path

import numpy as np
import pytest

from adrl.agents import checkpoint, networks
from adrl.agents.backend import jnp
from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.methods import method_config
from adrl.agents.train import TrainResult, train
from probe_envs import PLAIN, Aim, Constant, Endless, ProbeEnv, Signed, TwoSteps

GAMMA = 0.9
TD3 = Td3Config(widths=(32, 32), batch_size=64, bc_batch_size=32, gamma=GAMMA, polyak=0.05)


def run(env: ProbeEnv, out: Path, updates: int = 1500) -> TrainResult:
    steps = updates // 4 * env.num_envs + 64
    config = TrainConfig(
        steps=steps, start_steps=64, exploration_std=(0.2, 0.8), td3=TD3, reward=PLAIN, replay_capacity=10_000
    )
    return train(method_config("td3", config), env, out)


def q_of(out: Path, x: float, action: tuple[float, float] = (0.0, 0.0)) -> list[float]:
    """Both trained critics at a state and action."""
    saved = checkpoint.load(out)
    assert saved is not None
    observation, a = jnp.array([[x, 1.0]]), jnp.array([action])
    sizes = networks.critic_sizes(2, TD3.widths)
    critics = jnp.asarray(saved.part("learner")["critics"])
    q = networks.twin_critics(critics, observation, a, sizes, TD3.critic_layer_norm)
    return [float(value[0]) for value in q]


def test_a_constant_reward_is_the_value(tmp_path: Path):
    run(Constant(), tmp_path, 600)
    assert q_of(tmp_path, 0.0) == pytest.approx([1.0, 1.0], abs=0.03)


def test_the_value_follows_the_observation(tmp_path: Path):
    run(Signed(), tmp_path, 800)
    assert q_of(tmp_path, 1.0) == pytest.approx([1.0, 1.0], abs=0.05)
    assert q_of(tmp_path, -1.0) == pytest.approx([-1.0, -1.0], abs=0.05)


def test_a_later_reward_is_discounted_once(tmp_path: Path):
    run(TwoSteps(), tmp_path, 800)
    assert q_of(tmp_path, 1.0) == pytest.approx([1.0, 1.0], abs=0.03)
    assert q_of(tmp_path, 0.0) == pytest.approx([GAMMA, GAMMA], abs=0.03)


def test_truncation_bootstraps(tmp_path: Path):
    """A learner that takes truncation for an end finds at most 1 + gamma + ... + gamma^4 = 4.1."""
    run(Endless(), tmp_path, 3000)
    assert q_of(tmp_path, 0.0) == pytest.approx([1 / (1 - GAMMA)] * 2, rel=0.05)


def test_the_actor_finds_the_best_action_of_each_state(tmp_path: Path):
    policy = run(Aim(), tmp_path, 2000).policy
    best = policy.act(np.array([[1.0, 1.0], [-1.0, 1.0]], np.float32))
    np.testing.assert_allclose(best, [[0.6, -0.3], [-0.6, -0.3]], atol=0.1)
