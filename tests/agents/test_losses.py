"""Laws of the update: plain TD3 without imitation, targets by hand, rewards of today's weights."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from adrl.agents import losses, networks, td3
from adrl.agents.backend import jax, jnp
from adrl.agents.config import Td3Config
from adrl.agents.losses import Batch, ExpertBatch, Shape, Weights
from adrl.rewards import RewardConfig, reward

D, B, M, N_STEP = 6, 32, 16, 3
CONFIG = Td3Config(widths=(16, 16), batch_size=B, bc_batch_size=M, n_step=N_STEP)
SHAPE = td3.make_shape(D, CONFIG, RewardConfig())
PLAIN = Weights(np.float32(0.5), lambda_bc=np.float32(0.0), q_weight=np.float32(1.0))


def random_batch(seed: int, lead: tuple[int, ...] = ()) -> Batch:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> NDArray[np.float32]:
        return rng.normal(size=(*lead, B, *shape)).astype(np.float32)

    signals = np.concatenate([normal(N_STEP, 6), rng.random((*lead, B, N_STEP, 4))], axis=-1)
    return Batch(
        observation=normal(D),
        action=np.tanh(normal(2)),
        signals=signals.astype(np.float32),
        step_discount=np.broadcast_to(np.array([1, 0.99, 0.9801], np.float32), (*lead, B, N_STEP)).copy(),
        bootstrap_observation=normal(D),
        bootstrap_discount=np.float32(0.97) * (rng.random((*lead, B)) < 0.8),
        target_noise=normal(2),
    )


def random_experts(seed: int, lead: tuple[int, ...] = ()) -> ExpertBatch:
    rng = np.random.default_rng(seed)
    observation = rng.normal(size=(*lead, M, D)).astype(np.float32)
    return ExpertBatch(observation, rng.uniform(-1, 1, (*lead, M, 2)).astype(np.float32))


def fresh(seed: int = 0, shape: Shape = SHAPE) -> td3.LearnerState:
    """Networks with large last layers, so that gradients are."""
    state = td3.init_state(np.random.default_rng(seed), shape)
    return state._replace(actor=state.actor * 3.0, critics=state.critics * 3.0)


def assert_equal_bytes(a: object, b: object) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert_array_equal(np.asarray(x), np.asarray(y))


def test_without_imitation_the_actor_has_exactly_td3s_gradient():
    state, batch = fresh(), random_batch(0)

    def td3_loss(actor: jax.Array) -> jax.Array:
        action = networks.actor(actor, batch.observation, SHAPE.actor)
        return -networks.first_critic(state.critics, batch.observation, action, SHAPE.critic, True).mean()

    def ours(actor: jax.Array) -> jax.Array:
        return losses.actor_loss(actor, state.critics, batch.observation, random_experts(1), PLAIN, SHAPE)

    gradient = jax.jit(jax.grad(ours))(state.actor)
    assert float(jnp.abs(gradient).max()) > 1e-3
    assert_array_equal(gradient, jax.jit(jax.grad(td3_loss))(state.actor))


def test_without_imitation_whole_updates_are_exactly_td3s():
    update = td3.make_update(SHAPE)
    batches = random_batch(0, (4, 2))
    plain, plain_actor, _ = update(fresh(), batches, None, PLAIN)
    ours, ours_actor, _ = update(fresh(), batches, random_experts(1, (4,)), PLAIN)
    assert_equal_bytes(plain, ours)
    assert_array_equal(plain_actor, ours_actor)
    assert not np.array_equal(plain.actor, fresh().actor)


def test_cloning_alone_ignores_the_critic():
    state, batch, experts = fresh(), random_batch(0), random_experts(1)
    clone = Weights(0.0, lambda_bc=1.0, q_weight=0.0)

    def direction(critics: jax.Array) -> NDArray[np.float32]:
        gradient = jax.grad(losses.actor_loss)(state.actor, critics, batch.observation, experts, clone, SHAPE)
        return np.asarray(gradient / jnp.linalg.norm(gradient))

    assert_allclose(direction(state.critics), direction(2.0 * state.critics), atol=1e-5)


def test_the_cloning_weight_means_the_same_for_any_scale_of_the_reward():
    """Q 100 times as large: the gradient points the same way (eq 6 with Q divided by mean |Q|)."""
    state, batch, experts = fresh(), random_batch(0), random_experts(1)
    half = len(networks.init(np.random.default_rng(0), SHAPE.critic))
    last_layer = np.ones(2 * half, np.float32)
    for start in (0, half):
        last_layer[start + half - CONFIG.widths[-1] - 1 : start + half] = 100.0
    weights = Weights(0.0, lambda_bc=0.5, q_weight=1.0)
    shape = SHAPE._replace(td3=replace(CONFIG, q_scale_floor=1e-6))

    def gradient(critics: jax.Array) -> NDArray[np.float32]:
        return np.asarray(
            jax.grad(losses.actor_loss)(state.actor, critics, batch.observation, experts, weights, shape)
        )

    assert_allclose(
        gradient(state.critics * last_layer), 100.0 * gradient(state.critics), rtol=2e-3, atol=1e-3
    )


def test_targets_by_hand():
    state, batch = fresh(), random_batch(2)
    weights = Weights(np.float32(0.3), 0.0, 1.0)
    returns = losses.n_step_returns(batch, weights, SHAPE.reward)
    got = losses.targets(state.target_actor, state.target_critics, batch, returns, SHAPE)
    for i in range(B):
        terms, features = batch.signals[i, :, :6], batch.signals[i, :, 6:9]
        r = [reward(terms[j], features[j], 0.3, SHAPE.reward) for j in range(N_STEP)]
        successor = jnp.array(batch.bootstrap_observation[i : i + 1])
        noise = np.clip(0.2 * batch.target_noise[i], -0.5, 0.5)
        action = np.clip(networks.actor(state.target_actor, successor, SHAPE.actor) + noise, -1, 1)
        q1, q2 = networks.twin_critics(state.target_critics, successor, jnp.array(action), SHAPE.critic, True)
        y = r[0] + 0.99 * r[1] + 0.9801 * r[2] + batch.bootstrap_discount[i] * min(float(q1[0]), float(q2[0]))
        assert_allclose(got[i], y, rtol=1e-4, atol=1e-5)


def test_stored_terms_take_the_weights_of_today():
    batch = random_batch(3)
    early, late = (losses.n_step_returns(batch, Weights(s, 0.0, 1.0), SHAPE.reward) for s in (0.0, 1.0))
    assert float(jnp.abs(early - late).max()) > 1e-3


def test_the_q_filter_clones_only_where_the_critic_prefers_the_expert():
    shape = SHAPE._replace(td3=replace(CONFIG, row_weights="q-filter"))
    state, experts = fresh(), random_experts(1)
    action = networks.actor(state.actor, experts.observation, SHAPE.actor)
    q_actor, q_expert = (
        networks.first_critic(state.critics, experts.observation, a, SHAPE.critic, True)
        for a in (action, experts.action)
    )
    preferred = np.asarray(q_expert > q_actor)
    assert 0 < preferred.sum() < M
    error = np.square(np.asarray(action) - experts.action).sum(axis=-1)
    weights = Weights(np.float32(0.5), np.float32(0.3), np.float32(1.0))
    got = losses.cloning_loss(state.actor, state.critics, experts, weights, shape)
    assert_allclose(got, (error * preferred).mean(), rtol=1e-5)
    warming_up = weights._replace(q_weight=np.float32(0.0))
    everything = losses.cloning_loss(state.actor, state.critics, experts, warming_up, shape)
    assert_allclose(everything, error.mean(), rtol=1e-5)


TWINS = arrays(np.float32, (2, 5), elements=st.floats(-10.0, 10.0, width=32))


@given(TWINS, st.floats(0.1, 10.0), st.floats(1.01, 100.0))
def test_a_state_is_released_where_the_critics_prefer_the_actor_by_more_than_they_differ(
    of_expert: NDArray[np.float32], spread: float, certainty: float
):
    """S(s) = 1 there; 0 where they prefer the expert by more; 1/2 where neither."""
    differing = np.array([[0.5 * spread], [-0.5 * spread]])
    for advantage, maturity in ((certainty * spread, 1.0), (-certainty * spread, 0.0), (0.0, 0.5)):
        of_actor = jnp.array(of_expert + differing + advantage)
        assert_allclose(losses.state_maturity(of_actor, jnp.array(of_expert)), maturity, atol=1e-3)


@given(TWINS, TWINS, st.permutations(range(5)))
def test_a_states_maturity_is_its_own(
    of_actor: NDArray[np.float32], of_expert: NDArray[np.float32], order: list[int]
):
    """Rows in another order keep theirs; where actor and expert change places it is the complement."""
    maturity = np.asarray(losses.state_maturity(jnp.array(of_actor), jnp.array(of_expert)))
    turned = losses.state_maturity(jnp.array(of_actor[:, order]), jnp.array(of_expert[:, order]))
    assert_array_equal(turned, maturity[order])
    assert_allclose(
        losses.state_maturity(jnp.array(of_expert), jnp.array(of_actor)), 1.0 - maturity, atol=1e-5
    )


@given(TWINS, TWINS)
def test_spread_weighs_a_row_by_how_likely_the_expert_is_better(
    of_actor: NDArray[np.float32], of_expert: NDArray[np.float32]
):
    """Phi of the difference of the means over the deviation of the difference, by hand."""
    got = losses.expert_is_better(jnp.array(of_actor), jnp.array(of_expert))
    for row in range(5):
        actor, expert = of_actor[:, row].astype(float), of_expert[:, row].astype(float)
        deviation = math.sqrt(np.var(actor, ddof=1) + np.var(expert, ddof=1)) + losses.LEAST_SPREAD
        z = (expert.mean() - actor.mean()) / deviation
        assert_allclose(got[row], 0.5 * (1.0 + math.erf(z / math.sqrt(2.0))), atol=2e-3)


def test_by_state_a_released_row_is_not_cloned_and_the_others_fully():
    shape = SHAPE._replace(td3=replace(CONFIG, row_weights="state"))
    state, experts = fresh(), random_experts(1)
    action = networks.actor(state.actor, experts.observation, SHAPE.actor)
    of_actor, of_expert = (
        jnp.stack(networks.twin_critics(state.critics, experts.observation, a, SHAPE.critic, True))
        for a in (action, experts.action)
    )
    maturity = np.asarray(losses.state_maturity(of_actor, of_expert))
    assert {0.0, 1.0} <= set(maturity.tolist())
    error = np.square(np.asarray(action) - experts.action).sum(axis=-1)
    for release in (0.0, 0.25, 1.0):
        weights = Weights(np.float32(0.5), np.float32(0.3), np.float32(1.0), np.float32(release))
        got = losses.cloning_loss(state.actor, state.critics, experts, weights, shape)
        assert_allclose(got, (error * (1.0 - release * maturity)).mean(), rtol=1e-5)


def test_of_two_actions_the_one_of_the_higher_lesser_value_is_taken_in_driving_and_in_the_target():
    shape = SHAPE._replace(guide_proposes=True)
    state, batch = fresh(), random_batch(2)
    guide = fresh(5).actor
    observation = jnp.array(batch.bootstrap_observation)
    actions = [networks.actor(vector, observation, SHAPE.actor) for vector in (state.target_actor, guide)]
    lesser = [
        np.minimum(*networks.twin_critics(state.target_critics, observation, a, SHAPE.critic, True))
        for a in actions
    ]
    guides = lesser[1] > lesser[0]
    assert 0 < guides.sum() < B
    chosen = losses.better_action(state.target_critics, observation, actions[0], actions[1], shape)
    assert_array_equal(chosen, np.where(guides[:, None], actions[1], actions[0]))
    quiet = batch._replace(target_noise=np.zeros_like(batch.target_noise))
    nothing = jnp.zeros(B)
    target = losses.targets(state.target_actor, state.target_critics, quiet, nothing, shape, guide)
    assert_allclose(target, batch.bootstrap_discount * np.maximum(*lesser), rtol=1e-4, atol=1e-5)
    alone = losses.targets(state.target_actor, state.target_critics, quiet, nothing, SHAPE, guide)
    assert_allclose(alone, batch.bootstrap_discount * lesser[0], rtol=1e-4, atol=1e-5)


def test_one_call_of_many_updates_equals_many_calls_of_few():
    update = td3.make_update(SHAPE)
    batches, experts = random_batch(0, (4, 2)), random_experts(1, (4,))
    weights = Weights(np.float32(0.5), np.float32(0.3), np.float32(1.0))
    once, _, _ = update(fresh(), batches, experts, weights)
    state = fresh()
    for i in range(0, 4, 2):
        part = Batch(*(field[i : i + 2] for field in batches))
        state, _, _ = update(state, part, ExpertBatch(*(f[i : i + 2] for f in experts)), weights)
    for a, b in zip(jax.tree.leaves(once), jax.tree.leaves(state), strict=True):
        assert_allclose(a, b, rtol=1e-4, atol=1e-6)


def test_the_returned_actor_survives_the_next_update():
    """The state is donated: its memory is written again. The copy handed out for acting must not be."""
    update = td3.make_update(SHAPE)
    state, actor, _ = update(fresh(), random_batch(0, (4, 2)), None, PLAIN)
    before = np.array(state.actor)
    for seed in range(20):
        state, _, _ = update(state, random_batch(seed, (4, 2)), None, PLAIN)
    assert_array_equal(actor, before)


def test_averages_and_targets_forget_their_start():
    """Polynomial-decay averaging by hand: share 16 / (t + 15) of the t-th network, 1 of the first."""
    update, state = td3.make_update(SHAPE), fresh()
    expected = [np.zeros_like(np.asarray(network)) for network in (state.actor, state.critics)]
    for t in range(1, 7):
        state, _, _ = update(state, random_batch(t, (1, 2)), None, PLAIN)
        for average, network in zip(expected, (state.actor, state.critics), strict=True):
            average += 16.0 / (t + 15.0) * (np.asarray(network) - average)
    assert np.abs(expected[0] - np.asarray(state.actor)).max() > 1e-4
    assert_allclose(state.average_actor, expected[0], rtol=1e-4, atol=1e-6)
    assert_allclose(state.target_actor, expected[0], rtol=1e-4, atol=1e-6)
    assert_allclose(state.target_critics, expected[1], rtol=1e-4, atol=1e-6)


def test_averages_and_targets_follow_exponentially_in_the_end():
    """Long after the start a target takes over its share, and not less."""
    update, state = td3.make_update(SHAPE), fresh()
    state = state._replace(actor_adam=state.actor_adam._replace(steps=jnp.float32(1e5)))
    old = np.array(state.target_critics)
    state, _, _ = update(state, random_batch(1, (1, 2)), None, PLAIN)
    moved = np.asarray(state.target_critics) - old
    assert_allclose(moved, CONFIG.polyak * (np.asarray(state.critics) - old), rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize("layer_norm", [True, False])
def test_the_critic_descends_to_its_target(layer_norm: bool):
    shape = SHAPE._replace(td3=replace(CONFIG, critic_layer_norm=layer_norm))
    update = td3.make_update(shape)
    batch = random_batch(0, (4, 2))._replace(bootstrap_discount=np.zeros((4, 2, B), np.float32))
    batch = Batch(*(np.broadcast_to(field[:1, :1], field.shape).copy() for field in batch))
    state = fresh(shape=shape)
    state, _, first = update(state, batch, None, PLAIN)
    last = first
    for _ in range(100):
        state, _, last = update(state, batch, None, PLAIN)
    assert float(last.critic_loss) < 0.05 * float(first.critic_loss)


def test_eq_6_as_printed_weighs_cloning_by_the_scale_of_the_reward():
    """-mean Q + lambda BC, both terms computed apart; corrected, the second is times mean |Q|."""
    literal = SHAPE._replace(td3=replace(CONFIG, eq6="literal"))
    corrected = SHAPE._replace(td3=replace(CONFIG, q_scale_floor=1e-9))
    state, batch, experts = fresh(), random_batch(0), random_experts(1)
    weights = Weights(0.0, lambda_bc=0.7, q_weight=1.0)
    action = networks.actor(state.actor, batch.observation, SHAPE.actor)
    q = np.asarray(networks.first_critic(state.critics, batch.observation, action, SHAPE.critic, True))
    cloned = np.asarray(networks.actor(state.actor, experts.observation, SHAPE.actor))
    cloning = np.square(cloned - experts.action).sum(axis=-1).mean()
    for shape, factor in ((literal, 1.0), (corrected, np.abs(q).mean())):
        got = losses.actor_loss(state.actor, state.critics, batch.observation, experts, weights, shape)
        assert_allclose(got, -q.mean() + 0.7 * factor * cloning, rtol=1e-4)


def test_eq_17_as_printed_keeps_the_weights_of_the_day_a_step_was_stored():
    batch = random_batch(3)
    config = SHAPE.reward.literal()
    early, late = (losses.n_step_returns(batch, Weights(s, 0.0, 1.0), config) for s in (0.0, 1.0))
    assert_array_equal(early, late)
    for i in range(B):
        signals = batch.signals[i]
        r = [reward(row[:6], row[6:9], float(row[9]), config) for row in signals]
        expected = sum(d * x for d, x in zip(batch.step_discount[i], r, strict=True))
        assert_allclose(early[i], expected, rtol=1e-4, atol=1e-4)
