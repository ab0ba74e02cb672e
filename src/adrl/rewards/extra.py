"""A user's own shaping term, with all that it brings: how it is weighed, new features, new quantities of a step."""

import inspect
import itertools
import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from adrl.errors import ConfigError
from adrl.rewards.features import FEATURES, Feature
from adrl.rewards.step import Array, Step

MATURITY = "maturity"
"""What a weight calls S of eq 13; its other inputs are features."""

Weight = Callable[[Any], Any]
"""f -> weight before eq 16, f having each feature and the maturity as an attribute: numpy's or JAX's arrays."""


class RewardTerm:
    """A shaping term that is not one of the paper's six, or takes the place of one."""

    def __init__(
        self,
        name: str,
        value: Callable[[Step, Any], Array],
        weight: Callable[..., Any] | float,
        *,
        features: Mapping[str, Feature] | None = None,
        quantities: Mapping[str, Callable[[Any], Array]] | None = None,
    ) -> None:
        """name: that of one of the four shaping terms takes its place. value(step, RewardConfig): (N,) a step's pay.

        weight: a function of the features by name and of the maturity, `lambda f: 0.1 + 0.1 * f.maturity`, of numpy's
        and of JAX's arrays, 0 or more, normalised with the other shaping terms as in eq 16; or a number, which stays as
        it is. A function of four parameters is given T_obs, T_goal, T_stop and S. features: new ones that the weight
        needs, name -> function(step, RewardConfig) -> (N,) in [0, 1]. quantities: new ones of a step, name ->
        function(NavSim) -> (N,), which value and features find in step.quantities.

        Raises ConfigError for a weight that is negative or not finite somewhere, or of a feature that nobody brings.
        """
        self.name, self.value = name, value
        self.features = dict(features or {})
        self.quantities = dict(quantities or {})
        if taken := set(self.features) & {*FEATURES, MATURITY}:
            raise ConfigError(
                f"reward term {name!r} brings the feature {min(taken)!r}, which is there; rename it"
            )
        if callable(weight):
            weight = weight if len(inspect.signature(weight).parameters) == 1 else _by_position(weight)
            self._check(weight)
        elif not (math.isfinite(weight) and weight >= 0.0):
            raise ConfigError(f"reward term {name!r}: its weight is {weight}; give 0 or more")
        self.weight: Weight | float = weight

    def _check(self, weight: Weight) -> None:
        inputs = (*FEATURES, *self.features, MATURITY)
        states = np.array(list(itertools.product((0.0, 0.5, 1.0), repeat=len(inputs))))
        try:
            given = np.asarray(weight(SimpleNamespace(**dict(zip(inputs, states.T, strict=True)))))
        except AttributeError as error:
            raise ConfigError(
                f"reward term {self.name!r}: its weight asks for {error.name!r}; there are {', '.join(inputs)}"
            ) from None
        if given.shape not in ((), (len(states),)):
            raise ConfigError(
                f"reward term {self.name!r}: its weight has shape {given.shape}; give one a state"
            )
        for state, number in zip(states.tolist(), np.broadcast_to(given, len(states)).tolist(), strict=True):
            if not (math.isfinite(number) and number >= 0.0):
                raise ConfigError(
                    f"reward term {self.name!r}: its weight for {', '.join(inputs)} = {state} is {number}; "
                    "give 0 or more"
                )

    def __str__(self) -> str:
        return self.name


def _by_position(weight: Callable[..., Any]) -> Weight:
    """A weight of T_obs, T_goal, T_stop, S."""
    return lambda f: weight(*(getattr(f, name) for name in FEATURES), f.maturity)
