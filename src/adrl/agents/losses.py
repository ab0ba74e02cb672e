"""The losses of TD3 and the cloning term of eq 6. Pure functions of parameters and a batch."""

from typing import Any, NamedTuple

import numpy as np

from adrl.agents import networks
from adrl.agents.backend import jax, jnp
from adrl.agents.config import Td3Config
from adrl.agents.networks import Sizes
from adrl.rewards import RewardConfig, reward, reward_terms

Array = jax.Array
Rows = Any
"""An array: numpy's on its way in, JAX's inside the update."""
Scalar = jax.Array | np.floating | float


class Batch(NamedTuple):
    """Rows of the mixed buffer D = (1 - alpha) D1 + alpha D2 (eq 4). n is the number of steps of a target."""

    observation: Rows
    """(B, D) s_t."""
    action: Rows
    """(B, 2) executed a_t."""
    signals: Rows
    """(B, n, R + F + 1) of the steps t, t+1, ...: reward terms, features of the states left, S of when they were
    stored."""
    step_discount: Rows
    """(B, n) gamma^j where step t+j belongs to the episode of step t, else 0."""
    bootstrap_observation: Rows
    """(B, D) the true successor of the window's last step."""
    bootstrap_discount: Rows
    """(B,) gamma^k after a window of k steps; 0 if it ended by termination, not if by truncation."""
    target_noise: Rows
    """(B, 2) standard normal numbers for the target's action."""


class ExpertBatch(NamedTuple):
    """Rows of D2 for the cloning term."""

    observation: Rows
    """(M, D)."""
    action: Rows
    """(M, 2) the expert's label a_e, not the executed action."""


class Weights(NamedTuple):
    """What the schedule says today: scalars, so that a new value compiles nothing."""

    maturity: Scalar
    """S(t) of the reward's weights (eqs 14-17)."""
    lambda_bc: Scalar
    """lambda(t) (eq 5)."""
    q_weight: Scalar
    """1, or 0 while the critic warms up and the actor only clones."""


class Shape(NamedTuple):
    """What is fixed when the update is compiled."""

    actor: Sizes
    critic: Sizes
    td3: Td3Config
    reward: RewardConfig


def n_step_returns(batch: Batch, weights: Weights, config: RewardConfig) -> Array:
    """sum_j gamma^j r_{t+j}, the reward formed here from the stored terms with today's S (eq 17): (..., B).

    Literal: with the S of the day it was stored. It depends on no network, so one pass serves all batches of a call.
    """
    columns = np.cumsum([len(reward_terms(config)), len(config.features())])
    terms, features, stored = jnp.split(batch.signals, columns, axis=-1)
    maturity = stored[..., 0] if config.eq17 == "literal" else weights.maturity
    rewards = reward(terms, features, maturity, config)  # (..., B, n, R) -> (..., B, n)
    return (rewards * batch.step_discount).sum(axis=-1)


def targets(actor: Array, critics: Array, batch: Batch, returns: Array, shape: Shape) -> Array:
    """y = sum_j gamma^j r_{t+j} + gamma^k (1 - terminated) min_i Q'_i(s_{t+k}, a'): (B,).

    a' = clip(pi'(s_{t+k}) + clip(noise)). returns: (B,) the sum. actor, critics: the target networks.
    """
    td3 = shape.td3
    noise = jnp.clip(td3.target_noise_std * batch.target_noise, -td3.target_noise_clip, td3.target_noise_clip)
    successor = batch.bootstrap_observation
    action = jnp.clip(networks.actor(actor, successor, shape.actor) + noise, -1.0, 1.0)
    q1, q2 = networks.twin_critics(critics, successor, action, shape.critic, td3.critic_layer_norm)
    return returns + batch.bootstrap_discount * jnp.minimum(q1, q2)


def critic_loss(critics: Array, batch: Batch, target: Array, shape: Shape) -> tuple[Array, Array]:
    """mean (Q_1 - y)^2 + mean (Q_2 - y)^2, and the batch's mean Q_1."""
    q1, q2 = networks.twin_critics(
        critics, batch.observation, batch.action, shape.critic, shape.td3.critic_layer_norm
    )
    return ((q1 - target) ** 2).mean() + ((q2 - target) ** 2).mean(), q1.mean()


def actor_loss(
    actor: Array,
    critics: Array,
    observation: Array,
    expert: ExpertBatch | None,
    weights: Weights,
    shape: Shape,
) -> Array:
    """-E[Q_1(s, pi(s))] + lambda max(mean |Q_1|, floor) E_D2[|pi(s) - a_e|^2] (eq 6).

    This is eq 6 with Q divided by its mean absolute value, times that value: lambda means the same for any
    scale of the reward, and lambda = 0 leaves TD3's gradient untouched. Literal: without that factor.
    """
    action = networks.actor(actor, observation, shape.actor)
    q = networks.first_critic(critics, observation, action, shape.critic, shape.td3.critic_layer_norm)
    climb = -q.mean()
    if expert is None:
        return climb
    cloning = weights.lambda_bc * cloning_loss(actor, critics, expert, weights, shape)
    if shape.td3.eq6 == "corrected":
        cloning *= jax.lax.stop_gradient(jnp.maximum(jnp.abs(q).mean(), shape.td3.q_scale_floor))
    return weights.q_weight * climb + cloning


def cloning_loss(actor: Array, critics: Array, expert: ExpertBatch, weights: Weights, shape: Shape) -> Array:
    """E_D2[|pi(s) - a_e|^2]; with q_filter rows count 0 where Q_1 does not prefer the expert's action.

    While the actor only clones (q_weight 0) the critics are not yet to be trusted, and nothing is filtered.
    """
    action = networks.actor(actor, expert.observation, shape.actor)
    error = ((action - expert.action) ** 2).sum(axis=-1)
    if not shape.td3.q_filter:
        return error.mean()
    sizes, layer_norm = shape.critic, shape.td3.critic_layer_norm
    of_expert = networks.first_critic(critics, expert.observation, expert.action, sizes, layer_norm)
    of_actor = networks.first_critic(critics, expert.observation, action, sizes, layer_norm)
    preferred = jax.lax.stop_gradient((of_expert > of_actor) | (weights.q_weight == 0.0))
    return (error * preferred).mean()
