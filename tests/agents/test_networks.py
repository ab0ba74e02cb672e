"""Networks against slow, obvious numpy twins; their custom derivatives against JAX's own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from adrl.agents import networks
from adrl.agents.backend import jax, jnp

F32 = NDArray[np.float32]

SIZES = (5, 8, 6, 1)


def relu_mlp(layers: list[tuple[F32, F32]], x: F32, layer_norm: bool) -> F32:
    """One row at a time, LayerNorm as the textbook has it."""
    rows = []
    for row in x:
        h = row.astype(np.float64)
        for weight, bias in layers[:-1]:
            h = h @ weight
            if layer_norm:
                h = (h - h.mean()) / np.sqrt(h.var() + networks.NORM_EPSILON)
            h = np.maximum(h + bias, 0.0)
        weight, bias = layers[-1]
        rows.append(h @ weight.T + bias)
    return np.array(rows)


def random_parameters(seed: int, sizes: networks.Sizes) -> F32:
    return (
        np.random.default_rng(seed)
        .normal(size=len(networks.init(np.random.default_rng(0), sizes)))
        .astype(np.float32)
    )


@given(st.integers(0, 10_000), st.booleans())
@settings(max_examples=5)
def test_critics_equal_the_textbook(seed: int, layer_norm: bool):
    rng = np.random.default_rng(seed)
    observation, action = (
        rng.normal(size=(7, 3)).astype(np.float32),
        rng.normal(size=(7, 2)).astype(np.float32),
    )
    both = [random_parameters(seed, SIZES), random_parameters(seed + 1, SIZES)]
    q = networks.twin_critics(
        jnp.array(np.concatenate(both)), jnp.array(observation), jnp.array(action), SIZES, layer_norm
    )
    x = np.concatenate([observation, action], axis=1)
    for got, parameters in zip(q, both, strict=True):
        expected = relu_mlp(networks.unflatten(parameters, SIZES), x, layer_norm)[:, 0]
        assert_allclose(got, expected, rtol=1e-3, atol=1e-3)


def test_the_actor_equals_the_textbook():
    sizes = (5, 8, 6, 2)
    parameters = random_parameters(0, sizes)
    observation = np.random.default_rng(1).normal(size=(7, 5)).astype(np.float32)
    got = networks.actor(jnp.array(parameters), jnp.array(observation), sizes)
    expected = np.tanh(relu_mlp(networks.unflatten(parameters, sizes), observation, False))
    assert_allclose(got, expected, rtol=1e-5, atol=1e-5)


def plain_critic(parameters: jax.Array, x: jax.Array) -> jax.Array:
    """What twin_critics computes for its first critic, in plain JAX with its own derivatives."""
    *hidden, (weight, bias) = networks.unflatten(
        parameters[: len(networks.init(np.random.default_rng(0), SIZES))], SIZES
    )
    for w, b in hidden:
        h = x @ w
        h = (h - h.mean(axis=-1, keepdims=True)) / jnp.sqrt(
            h.var(axis=-1, keepdims=True) + networks.NORM_EPSILON
        )
        x = jax.nn.relu(h + b)
    return (x @ weight.T + bias)[:, 0]


@pytest.mark.parametrize("argument", ["parameters", "action"])
def test_custom_derivatives_equal_jax_derivatives(argument: str):
    rng = np.random.default_rng(3)
    parameters = jnp.array(np.concatenate([random_parameters(3, SIZES), random_parameters(4, SIZES)]))
    observation = jnp.array(rng.normal(size=(16, 3)), jnp.float32)
    action = jnp.array(rng.normal(size=(16, 2)), jnp.float32)

    def ours(p: jax.Array, a: jax.Array) -> jax.Array:
        return jnp.sin(networks.first_critic(p, observation, a, SIZES, True)).sum()

    def plain(p: jax.Array, a: jax.Array) -> jax.Array:
        return jnp.sin(plain_critic(p, jnp.concatenate([observation, a], axis=-1))).sum()

    which = 0 if argument == "parameters" else 1
    got, expected = (jax.grad(f, argnums=which)(parameters, action) for f in (ours, plain))
    assert float(jnp.abs(expected).max()) > 0.1
    assert_allclose(got, expected, rtol=1e-3, atol=1e-4)


def test_first_actions_and_values_are_small():
    rng = np.random.default_rng(0)
    observation = jnp.array(10.0 * rng.normal(size=(100, 5)), jnp.float32)
    actor = networks.init(rng, (5, 64, 64, 2))
    assert float(jnp.abs(networks.actor(jnp.array(actor), observation, (5, 64, 64, 2))).max()) < 0.2
