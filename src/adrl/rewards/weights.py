"""Phase-aligned weights, eqs 14 to 16. Works on numpy and JAX arrays, inside jit too."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from adrl.rewards.config import RewardConfig
from adrl.rewards.extra import MATURITY, RewardTerm, Weight
from adrl.rewards.terms import reward_terms

# Rows give a weight before normalisation. f.threat is T_obs, f.proximity T_goal, f.stop T_stop, f.maturity S.
# Why no loop pays although the weights change with the state: where T_obs lowers the reward for approaching,
# r_o costs more than a retreat saves (5 * 0.15 > 0.6), and T_goal is a function of the distance alone.
SHAPING_ROWS: dict[str, Weight] = {
    "motion": lambda f: 0.3 - 0.1 * f.proximity,  # ours: turns are cheaper near the goal
    "approach": lambda f: 0.6 * (1.0 - f.threat) * (1.0 - f.maturity) + 0.1 * f.maturity,  # 14, T_goal = 1
    "obstacle": lambda f: 0.15 + 0.15 * f.threat,  # ours: a near threat counts more
    "stagnation": lambda f: 0.8 * f.stop * (1.0 - f.maturity) + 0.05,  # 15
}


EXTRA_TERMS: dict[str, RewardTerm] = {
    # Terminal reward: nothing is paid for nearing the goal. The row stays, so that the others weigh what they weighed.
    "no-approach": RewardTerm(
        "approach", lambda step, _: np.zeros(len(step.reached)), SHAPING_ROWS["approach"]
    ),
}
"""Extra terms that go by name here; other packages offer more."""


def _approach_literal(f: Any) -> Any:
    """w_di = 0.6 (1 - T_obs) T_goal (1 - S) + 0.1 S (eq 14 as printed)."""
    return 0.6 * (1.0 - f.threat) * f.proximity * (1.0 - f.maturity) + 0.1 * f.maturity


def weights(features: Any, maturity: Any, config: RewardConfig) -> Any:
    """w'_i of eq 16: (..., F) features, S in [0, 1], one or (...) -> (..., R) weights.

    In the order of reward_terms(config). The shaping rows are divided by their sum. Success and failure keep a fixed
    weight: normalised with the others, they would make a crash cheaper than standing in front of an obstacle. So do
    extra terms whose weight is a number. Literal: all are divided by the sum of all.
    """
    xp = features.__array_namespace__()
    columns = {name: features[..., i] for i, name in enumerate(config.features())}
    f = SimpleNamespace(**columns, **{MATURITY: xp.asarray(maturity, dtype=features.dtype)})
    shaping, fixed = rows(config)
    shares = {name: row(f) for name, row in shaping.items()}
    total = sum(list(shares.values())[1:], start=next(iter(shares.values())))
    given = {name: xp.full_like(total, weight) for name, weight in fixed.items()}
    if config.eq16 == "literal":
        total = sum(given.values(), start=total)
        given = {name: weight / total for name, weight in given.items()}
    given |= {name: share / total for name, share in shares.items()}
    return xp.stack([given[name] for name in reward_terms(config)], axis=-1)


def rows(config: RewardConfig) -> tuple[dict[str, Weight], dict[str, float]]:
    """The weights that eq 16 normalises, as functions, and those that it leaves, as numbers, by the terms' names."""
    shaping = dict(SHAPING_ROWS)
    if config.eq14 == "literal":
        shaping["approach"] = _approach_literal
    fixed = {"success": config.success_weight, "failure": config.failure_weight}
    for term in config.extra():
        if callable(term.weight):
            shaping[term.name] = term.weight
        else:
            shaping.pop(term.name, None)
            fixed[term.name] = term.weight
    return shaping, fixed
