"""Phase-aligned weights, eqs 14 to 16. Works on numpy and JAX arrays, inside jit too."""

from collections.abc import Callable
from typing import Any

from adrl.rewards.config import RewardConfig

# Rows take T_obs, T_goal, T_stop (arrays of one shape) and S, and give a weight before normalisation.
# Why no loop pays although the weights change with the state: where T_obs lowers the reward for approaching,
# r_o costs more than a retreat saves (5 * 0.15 > 0.6), and T_goal is a function of the distance alone.
SHAPING_ROWS: dict[str, Callable[[Any, Any, Any, Any], Any]] = {
    "motion": lambda t_obs, t_goal, t_stop, s: 0.3 - 0.1 * t_goal,  # ours: turns are cheaper near the goal
    "approach": lambda t_obs, t_goal, t_stop, s: 0.6 * (1.0 - t_obs) * (1.0 - s) + 0.1 * s,  # 14, T_goal = 1
    "obstacle": lambda t_obs, t_goal, t_stop, s: 0.15 + 0.15 * t_obs,  # ours: a near threat counts more
    "stagnation": lambda t_obs, t_goal, t_stop, s: 0.8 * t_stop * (1.0 - s) + 0.05,  # 15
}


def _approach_literal(t_obs: Any, t_goal: Any, t_stop: Any, s: Any) -> Any:
    """w_di = 0.6 (1 - T_obs) T_goal (1 - S) + 0.1 S (eq 14 as printed)."""
    return 0.6 * (1.0 - t_obs) * t_goal * (1.0 - s) + 0.1 * s


def weights(features: Any, maturity: Any, config: RewardConfig) -> Any:
    """w'_i of eq 16: (..., F) features, S in [0, 1], one or (...) -> (..., R) weights.

    In the order of reward_terms(config). The shaping rows are divided by their sum. Success and failure keep a fixed
    weight: normalised with the others, they would make a crash cheaper than standing in front of an obstacle.
    Literal: all are divided by the sum of all.
    """
    xp = features.__array_namespace__()
    maturity = xp.asarray(maturity, dtype=features.dtype)
    columns = features[..., 0], features[..., 1], features[..., 2]
    shaping = SHAPING_ROWS
    if config.eq14 == "literal":
        shaping = shaping | {"approach": _approach_literal}
    shaping = shaping | {term.name: term.weight for term in config.extra()}
    rows = [row(*columns, maturity) for row in shaping.values()]
    total = sum(rows[1:], start=rows[0])
    fixed = [xp.full_like(total, config.success_weight), xp.full_like(total, config.failure_weight)]
    if config.eq16 == "literal":
        total = total + config.success_weight + config.failure_weight
        fixed = [row / total for row in fixed]
    return xp.stack([*fixed, *(row / total for row in rows)], axis=-1)
