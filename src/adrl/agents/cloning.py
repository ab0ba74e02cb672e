"""Cloning by itself: an actor fitted to what an expert would do, before anything is known of values."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents import networks, td3
from adrl.agents.actor_policy import policy_of
from adrl.agents.backend import jax, jnp
from adrl.agents.losses import ExpertBatch
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError
from adrl.imitation import Demonstrations
from adrl.observation import Mirror

ROWS = 512
"""Of an update. Labels are cheap, and the clone is waited for: a small batch would only be noisier."""
UPDATES_A_CALL = 50
"""Compiled into one."""
LEARNING_RATE = 5e-4
"""Of Adam; docs/decisions.md has others."""


class Clone:
    """An actor of a run's size that goes on being fitted to more and more labels. Its policy is the averaged actor."""

    def __init__(
        self, widths: Sequence[int], observation_size: int, mirror: Mirror | None, rng: np.random.Generator
    ) -> None:
        """widths: of the layers. mirror: of the observations; half of the rows are mirrored, None for a robot that is
        not symmetric. rng: of the first weights."""
        self._sizes = networks.actor_sizes(observation_size, widths)
        self._mirror = mirror
        vector = networks.init(rng, self._sizes)
        self._state = td3.fresh_clone(vector)
        self._update = td3.make_cloning(self._sizes)

    def fit(
        self, shown: Demonstrations, updates: int, rng: np.random.Generator, *, last: bool = False
    ) -> None:
        """So many updates more, rounded up to whole calls, on labels drawn evenly from all that was shown.

        last: nothing more will be shown, and the learning rate falls to 0, by half a cosine (Loshchilov and Hutter
        2017).
        """
        calls = -(-updates // UPDATES_A_CALL)
        share = np.linspace(0.0, 1.0, calls * UPDATES_A_CALL, dtype=np.float32).reshape(calls, -1)
        rates = LEARNING_RATE * (0.5 + 0.5 * np.cos(math.pi * share) if last else np.ones_like(share))
        for rate in rates:
            index = rng.integers(len(shown), size=(UPDATES_A_CALL, ROWS))
            observation, label = shown.observation[index], shown.expert_action[index]
            if self._mirror is not None:
                self._mirror.observation(observation[:, ::2])
                self._mirror.action(label[:, ::2])
            self._state = self._update(self._state, ExpertBatch(observation, label), rate)

    def policy(self, config: PolicyConfig) -> MlpPolicy:
        """The averaged actor in numpy, with its own memory."""
        return policy_of(self._state.average_actor, self._sizes, config)

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes, by name."""
        leaves = jax.tree.leaves(self._state)
        return {f"{number}": np.array(leaf) for number, leaf in enumerate(leaves)}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned. Raises CheckpointError for one of another size."""
        mine = self.state()
        shapes, given = ({name: array.shape for name, array in each.items()} for each in (mine, state))
        if shapes != given:
            raise CheckpointError(f"the clone's arrays are {given}, expected {shapes}; delete the rounds")
        leaves = [jnp.array(state[name]) for name in mine]
        self._state = jax.tree.unflatten(jax.tree.structure(self._state), leaves)
