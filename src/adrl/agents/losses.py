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

LEAST_SPREAD = 1e-6
"""Critics that agree to the last digit are this far apart, in the reward's units."""


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
    release: Scalar = 0.0
    """By state: the share of the cloning weight that a row loses where its S(s) is 1; 0 to 1."""


class Shape(NamedTuple):
    """What is fixed when the update is compiled."""

    actor: Sizes
    critic: Sizes
    td3: Td3Config
    reward: RewardConfig
    guide_proposes: bool = False
    """Whether the target takes the guide's action where that is better (IBRL)."""


def n_step_returns(batch: Batch, weights: Weights, config: RewardConfig) -> Array:
    """sum_j gamma^j r_{t+j}, the reward formed here from the stored terms with today's S (eq 17): (..., B).

    Literal: with the S of the day it was stored. It depends on no network, so one pass serves all batches of a call.
    """
    columns = np.cumsum([len(reward_terms(config)), len(config.features())])
    terms, features, stored = jnp.split(batch.signals, columns, axis=-1)
    maturity = stored[..., 0] if config.eq17 == "literal" else weights.maturity
    rewards = reward(terms, features, maturity, config)  # (..., B, n, R) -> (..., B, n)
    return (rewards * batch.step_discount).sum(axis=-1)


def targets(
    actor: Array, critics: Array, batch: Batch, returns: Array, shape: Shape, guide: Array | None = None
) -> Array:
    """y = sum_j gamma^j r_{t+j} + gamma^k (1 - terminated) min_i Q'_i(s_{t+k}, a'): (B,).

    a' = clip(pi'(s_{t+k}) + clip(noise)), or the guide's action where that is worth more (IBRL). returns: (B,) the sum.
    actor, critics: the target networks. guide: parameters of an actor, read if it proposes.
    """
    td3 = shape.td3
    noise = jnp.clip(td3.target_noise_std * batch.target_noise, -td3.target_noise_clip, td3.target_noise_clip)
    successor = batch.bootstrap_observation
    action = jnp.clip(networks.actor(actor, successor, shape.actor) + noise, -1.0, 1.0)
    value = least_value(critics, successor, action, shape)
    if guide is not None and shape.guide_proposes:
        proposed = networks.actor(guide, successor, shape.actor)
        value = jnp.maximum(value, least_value(critics, successor, proposed, shape))
    return returns + batch.bootstrap_discount * value


def least_value(critics: Array, observation: Array, action: Array, shape: Shape) -> Array:
    """min_i Q_i(s, a): (B,)."""
    sizes, layer_norm = shape.critic, shape.td3.critic_layer_norm
    return jnp.minimum(*networks.twin_critics(critics, observation, action, sizes, layer_norm))


def better_action(critics: Array, observation: Array, first: Array, second: Array, shape: Shape) -> Array:
    """argmax over both actions (B, 2) of min_i Q'_i(s, a), as in IBRL (Hu et al. 2023): (B, 2); the first if equal."""
    of_first, of_second = (least_value(critics, observation, action, shape) for action in (first, second))
    return jnp.where((of_first >= of_second)[:, None], first, second)


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
    """E_D2[w(s) |pi(s) - a_e|^2], w by Td3Config.row_weights.

    While the actor only clones (q_weight 0) the critics are not yet to be trusted, and w is 1.
    """
    action = networks.actor(actor, expert.observation, shape.actor)
    error = squared_error(action, expert.action)
    if shape.td3.row_weights == "all":
        return error.mean()
    sizes, layer_norm = shape.critic, shape.td3.critic_layer_norm
    of_actor, of_expert = (
        jnp.stack(networks.twin_critics(critics, expert.observation, a, sizes, layer_norm))
        for a in (action, expert.action)
    )
    if shape.td3.row_weights == "q-filter":
        row = (of_expert[0] > of_actor[0]).astype(error.dtype)
    elif shape.td3.row_weights == "spread":
        row = expert_is_better(of_actor, of_expert)
    else:
        row = 1.0 - weights.release * state_maturity(of_actor, of_expert)
    return (error * jax.lax.stop_gradient(jnp.where(weights.q_weight == 0.0, 1.0, row))).mean()


def squared_error(action: Array, label: Array) -> Array:
    """|a - a_e|^2 of actions (M, 2) and labels (M, 2): (M,)."""
    return ((action - label) ** 2).sum(axis=-1)


def expert_is_better(of_actor: Array, of_expert: Array) -> Array:
    """How likely the critics hold the expert's action to be the better one, values (2, M) of both critics: (M,).

    Phi((m_e - m_pi) / sqrt(v_e + v_pi)), with the mean and variance over the critics, as if values were normal and
    independent: SPReD-P (Zhu et al. 2025).
    """
    spread = jnp.sqrt(of_expert.var(axis=0, ddof=1) + of_actor.var(axis=0, ddof=1))
    return jax.scipy.stats.norm.cdf(
        (of_expert.mean(axis=0) - of_actor.mean(axis=0)) / (spread + LEAST_SPREAD)
    )


def state_maturity(of_actor: Array, of_expert: Array) -> Array:
    """S(s) = clip((Q(s, pi(s)) - Q_min(s)) / (Q_max(s) - Q_min(s)), 0, 1), eq 13 by state, values (2, M): (M,).

    Q_min(s) and Q_max(s) are the value of the expert's action there, less and more by how much the critics differ
    about the actor's advantage over it: S is 0 where they prefer the expert's action by more than that, 1 where the
    actor's, 1/2 where neither. What a critic says too much of a state, whatever the action, drops out.
    """
    advantage = of_actor - of_expert
    spread = jnp.abs(advantage[0] - advantage[1]) + LEAST_SPREAD
    return jnp.clip(0.5 * (1.0 + advantage.mean(axis=0) / spread), 0.0, 1.0)
