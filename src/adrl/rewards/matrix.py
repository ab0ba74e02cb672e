"""The reward, eq 17. Replay stores terms and features; the sum is formed with today's S when sampled."""

from typing import Any

from adrl.rewards.config import RewardConfig
from adrl.rewards.weights import weights


def reward(terms: Any, features: Any, maturity: Any, config: RewardConfig) -> Any:
    """R = scale * sum_i w'_i r_i (eq 17): (..., R) terms, (..., F) features, S -> (...).

    features are those of the state in which the action was taken. numpy and JAX arrays alike.
    """
    return config.scale * (terms * weights(features, maturity, config)).sum(axis=-1)  # (..., R) -> (...)
