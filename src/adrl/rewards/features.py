"""The features that set the weights (section III-B-2). The paper names three; the formulas are ours."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.rewards.step import Array, Step

Feature = Callable[[Step, Any], Array]
"""(step, RewardConfig) -> (N,) in [0, 1], of the state that the step ends in."""


class Constants(Protocol):
    """What features need of a RewardConfig."""

    @property
    def safe_clearance_m(self) -> float: ...

    near_goal_m: ClassVar[float]
    stagnation_fraction: ClassVar[float]

    def features(self) -> Mapping[str, Feature]:
        """All of a reward: FEATURES, and those that its extra terms bring."""
        ...


def threat(step: Step, config: Constants) -> Array:  # (N,)
    """T_obs = clip(1 - c / c_safe, 0, 1): 0 at the safe clearance, 1 at contact. Above 0, r_o costs."""
    return np.clip(1.0 - step.clearance_m / config.safe_clearance_m, 0.0, 1.0)


def proximity(step: Step, config: Constants) -> Array:  # (N,)
    """T_goal = clip(1 - d / d_near, 0, 1): 0 far from the goal, 1 at it."""
    return np.clip(1.0 - step.distance_m / config.near_goal_m, 0.0, 1.0)


def stop(step: Step, config: Constants) -> Array:  # (N,)
    """T_stop = clip(1 - p / d_m, 0, 1) for the mean displacement p of five steps: 1 for one that stands."""
    threshold_m = config.stagnation_fraction * step.max_step_m
    return np.clip(1.0 - step.mean_displacement_m / threshold_m, 0.0, 1.0)


FEATURES: dict[str, Feature] = {
    "threat": threat,
    "proximity": proximity,
    "stop": stop,
}


def features(step: Step, config: Constants) -> NDArray[np.float32]:
    """(N, F) features in [0, 1] of the state a step ends in, columns in the order of config.features().

    They weigh the rewards of the *next* step, the one taken from that state.
    """
    return np.stack([feature(step, config) for feature in config.features().values()], axis=-1).astype(
        np.float32
    )
