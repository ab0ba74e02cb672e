"""TD3: the learner's state and its compiled update. Pure functions; the loop around them is in train.py.

for each pair (policy_delay) of batches:
    y       = n-step target                      losses.targets
    critics = Adam(critics, critic_loss)         each batch
    actor   = Adam(actor, actor_loss)            last batch
    targets = polyak(targets, networks)
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adrl.agents import losses, networks
from adrl.agents.backend import jax, jnp
from adrl.agents.config import AVERAGE_POWER, Td3Config
from adrl.agents.losses import Batch, ExpertBatch, Shape, Weights
from adrl.rewards import RewardConfig

Array = jax.Array

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8


class Adam(NamedTuple):
    """Moments of one parameter vector."""

    mean: Array
    square: Array
    steps: Array
    """() float32: the exponent of the bias correction."""


class LearnerState(NamedTuple):
    """All that an update changes. Parameter vectors, see networks.py."""

    actor: Array
    critics: Array
    target_actor: Array
    average_actor: Array
    target_critics: Array
    actor_adam: Adam
    critic_adam: Adam
    guide: Array | None = None
    """The actor as pretraining left it, where a method goes on using it (TrainConfig.guide)."""


class UpdateInfo(NamedTuple):
    """Means over the updates of one call."""

    q_mean: Array
    """Mean Q_1 over the mixed batch (eq 2, literal form), in the reward's units."""
    critic_loss: Array


Update = Callable[[LearnerState, Batch, ExpertBatch | None, Weights], tuple[LearnerState, Array, UpdateInfo]]
"""State (donated), batches (U / policy_delay, policy_delay, ...), expert batches (U / policy_delay, ...),
weights -> new state, a copy of the actor's parameters, info."""


def make_shape(
    observation_size: int, td3: Td3Config, reward: RewardConfig, *, guide_proposes: bool = False
) -> Shape:
    """Layer sizes and constants of the compiled update."""
    actor = networks.actor_sizes(observation_size, td3.widths)
    critic = networks.critic_sizes(observation_size, td3.widths)
    return Shape(actor, critic, td3, reward, guide_proposes)


def init_state(rng: np.random.Generator, shape: Shape) -> LearnerState:
    """Fresh networks; targets equal to them."""
    actor = networks.init(rng, shape.actor)
    critics = np.concatenate([networks.init(rng, shape.critic), networks.init(rng, shape.critic)])

    def fresh(vector: np.ndarray) -> Adam:
        return Adam(jnp.zeros(vector.shape), jnp.zeros(vector.shape), jnp.zeros(()))

    # Each leaf owns its memory: the state is donated, and a buffer cannot be given away twice.
    return LearnerState(
        actor=jnp.array(actor),
        critics=jnp.array(critics),
        target_actor=jnp.array(actor),
        average_actor=jnp.array(actor),
        target_critics=jnp.array(critics),
        actor_adam=fresh(actor),
        critic_adam=fresh(critics),
    )


def with_actor(state: LearnerState, actor: np.ndarray) -> LearnerState:
    """The state with another actor (P,), and its target and average with it."""
    # As above: each leaf its own memory.
    return state._replace(
        actor=jnp.array(actor), target_actor=jnp.array(actor), average_actor=jnp.array(actor)
    )


@functools.cache
def make_update(shape: Shape) -> Update:
    """The update of a shape, compiled: one call runs all batches it is given. Learners of one process share it."""

    def update_critics(state: LearnerState, batch: Batch, returns: Array) -> tuple[LearnerState, UpdateInfo]:
        target = losses.targets(state.target_actor, state.target_critics, batch, returns, shape, state.guide)
        gradient_of = jax.value_and_grad(losses.critic_loss, has_aux=True)
        (loss, q_mean), gradient = gradient_of(state.critics, batch, target, shape)
        critics, adam = _adam(state.critics, gradient, state.critic_adam, shape.td3.critic_learning_rate)
        return state._replace(critics=critics, critic_adam=adam), UpdateInfo(q_mean, loss)

    def update_actor(
        state: LearnerState, batch: Batch, expert: ExpertBatch | None, weights: Weights
    ) -> LearnerState:
        gradient = jax.grad(losses.actor_loss)(
            state.actor, state.critics, batch.observation, expert, weights, shape
        )
        actor, adam = _adam(state.actor, gradient, state.actor_adam, shape.td3.actor_learning_rate)
        average = _follow(state.average_actor, actor, shape.td3.actor_average, adam.steps)
        return state._replace(actor=actor, actor_adam=adam, average_actor=average)

    def update_targets(state: LearnerState) -> LearnerState:
        polyak, steps = shape.td3.polyak, state.actor_adam.steps
        return state._replace(
            target_actor=_follow(state.target_actor, state.actor, polyak, steps),
            target_critics=_follow(state.target_critics, state.critics, polyak, steps),
        )

    def update(
        state: LearnerState, batches: Batch, experts: ExpertBatch | None, weights: Weights
    ) -> tuple[LearnerState, Array, UpdateInfo]:
        def delayed(
            state: LearnerState, rows: tuple[Batch, Array, ExpertBatch | None]
        ) -> tuple[LearnerState, list[UpdateInfo]]:
            several, returns, expert = rows
            batch, infos = several, []
            for i in range(shape.td3.policy_delay):
                batch = Batch(*(field[i] for field in several))
                state, info = update_critics(state, batch, returns[i])
                infos.append(info)
            state = update_targets(update_actor(state, batch, expert, weights))
            return state, infos

        returns = losses.n_step_returns(batches, weights, shape.reward)
        state, infos = jax.lax.scan(delayed, state, (batches, returns, experts))
        means = UpdateInfo(*(jnp.stack(values).mean() for values in zip(*infos, strict=True)))
        return state, state.actor, means

    return jax.jit(update, donate_argnums=0)


class CloneState(NamedTuple):
    """All that cloning alone changes."""

    actor: Array
    average_actor: Array
    adam: Adam


def fresh_clone(actor: np.ndarray) -> CloneState:
    """A clone of these parameters (P,), which nothing has been shown to."""
    moments = Adam(jnp.zeros(actor.shape), jnp.zeros(actor.shape), jnp.zeros(()))
    return CloneState(jnp.array(actor), jnp.array(actor), moments)


@functools.cache
def make_cloning(sizes: networks.Sizes) -> Callable[[CloneState, ExpertBatch, Array], CloneState]:
    """Compile updates by the labels alone: state (donated), batches (U, B, ...), learning rates (U,) -> new state.

    By the absolute error: of an expert that drives on or backs out the squared one of eq 6 learns the mean, which is to
    stand, and this one the more frequent.
    """

    def error(actor: Array, batch: ExpertBatch) -> Array:
        return jnp.abs(networks.actor(actor, batch.observation, sizes) - batch.action).sum(axis=-1).mean()

    def update(state: CloneState, given: tuple[ExpertBatch, Array]) -> tuple[CloneState, None]:
        batch, learning_rate = given
        actor, adam = _adam(state.actor, jax.grad(error)(state.actor, batch), state.adam, learning_rate)
        average = _follow(state.average_actor, actor, Td3Config.actor_average, adam.steps)
        return CloneState(actor, average, adam), None

    return jax.jit(
        lambda state, batches, rates: jax.lax.scan(update, state, (batches, rates))[0], donate_argnums=0
    )


@functools.cache
def make_probe_value(shape: Shape) -> Callable[[LearnerState, Array], Array]:
    """Compile mean_s0 min_i Q'_i(s0, pi(s0)) over (P, D) start states (eq 2, corrected)."""

    def probe_value(state: LearnerState, observation: Array) -> Array:
        action = networks.actor(state.actor, observation, shape.actor)
        return losses.least_value(state.target_critics, observation, action, shape).mean()

    return jax.jit(probe_value)


@functools.cache
def make_better_action(shape: Shape) -> Callable[[Array, Array, Array, Array], Array]:
    """Compile losses.better_action of target critics, observations and two actions for each."""
    return jax.jit(functools.partial(losses.better_action, shape=shape))


@functools.cache
def make_q_of_average(shape: Shape) -> Callable[[LearnerState, Array], Array]:
    """Compile mean_s Q_1(s, pi(s)) of the averaged actor over states (B, D)."""

    def q_of_average(state: LearnerState, observation: Array) -> Array:
        action = networks.actor(state.average_actor, observation, shape.actor)
        layer_norm = shape.td3.critic_layer_norm
        return networks.first_critic(state.critics, observation, action, shape.critic, layer_norm).mean()

    return jax.jit(q_of_average)


def _follow(average: Array, new: Array, share: float, steps: Array) -> Array:
    """The average after actor update number `steps`: exponential in the end, and until then over the last sixteenth of
    the updates or so. Networks that know nothing yet are soon forgotten."""
    share_now = jnp.maximum(share, (1.0 + AVERAGE_POWER) / (steps + AVERAGE_POWER))
    return average + share_now * (new - average)


def _adam(parameters: Array, gradient: Array, adam: Adam, learning_rate: Array | float) -> tuple[Array, Adam]:
    """One step of Adam (Kingma and Ba 2015) with bias correction: one pass over a flat vector."""
    steps = adam.steps + 1.0
    mean = BETA_1 * adam.mean + (1.0 - BETA_1) * gradient
    square = BETA_2 * adam.square + (1.0 - BETA_2) * gradient**2
    rate = learning_rate * jnp.sqrt(1.0 - BETA_2**steps) / (1.0 - BETA_1**steps)
    return parameters - rate * mean / (jnp.sqrt(square) + EPSILON), Adam(mean, square, steps)
