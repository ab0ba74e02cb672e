"""An actor's parameter vector as a policy in numpy, and back."""

import numpy as np
from numpy.typing import NDArray

from adrl.agents import networks
from adrl.agents.backend import jax
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import ConfigError


def policy_of(
    vector: jax.Array | NDArray[np.float32], sizes: networks.Sizes, config: PolicyConfig
) -> MlpPolicy:
    """The policy of parameters (P,), in memory of its own. Waits for the update that makes them."""
    *hidden, (weight, bias) = networks.unflatten(np.array(vector), sizes)
    return MlpPolicy([*hidden, (weight.T, bias)], config)


def vector_of(policy: MlpPolicy, sizes: networks.Sizes) -> NDArray[np.float32]:
    """(P,) the policy's parameters as networks.unflatten reads them. Raises ConfigError for other sizes."""
    if policy.config.sizes != sizes:
        raise ConfigError(
            f"the policy to start from has layers of {policy.config.sizes} units, the run {sizes}; "
            "give the same encoder and td3.widths"
        )
    *hidden, (weight, bias) = policy.layers
    return np.concatenate([part.ravel() for pair in [*hidden, (weight.T, bias)] for part in pair])
