"""Value-driven imitation: maturity S (eqs 2, 13), expert reliance alpha (eq 3), cloning weight lambda (eq 5).

Corrected forms: alpha and lambda follow S, not the raw Q, so that neither depends on the scale of the reward.
"""

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

from adrl.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ScheduleConfig:
    """Constants of eqs 3, 5 and 13. Times count gradient updates."""

    alpha_min: float = 0.05
    """Share of expert rows in a batch that is never released."""
    alpha_max: float = 0.5
    """Share of expert rows at S = 0. Near 1 learning is offline: the critic never sees its mistakes."""
    k_alpha: float = 8.0
    """k_alpha of eq 3: how sharply alpha falls with S."""
    b_alpha: float = 4.0
    """b_alpha of eq 3: alpha is half released at S = b_alpha / k_alpha."""
    lambda_max: float = 0.5
    """lambda_max of eq 5: weight of cloning beside the normalised Q at S = 0."""
    k_q: float = 4.0
    """k_q of eq 5: lambda falls by exp(-k_q) from S = 0 to S = 1."""
    warmup_updates: int = 500
    """Updates during which S stays 0: the critic starts cold and its values mean nothing yet."""
    smoothing_updates: float = 400.0
    """Time constant of the exponential moving average over measured maturities."""
    rise_updates: float = 3000.0
    """Updates that S takes at the least from 0 to 1."""
    fall_updates: float = 30000.0
    """Updates that S takes at the least from 1 to 0. Far more than rise_updates: the ratchet."""
    interval_updates: int = 100
    """Updates between two measurements."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"schedule.{field.name} is {value}; give 0 or more")
        if not self.alpha_min <= self.alpha_max <= 1.0:
            raise ConfigError(
                f"schedule: alpha_min {self.alpha_min}, alpha_max {self.alpha_max}; give 0 <= min <= max <= 1"
            )
        for name in ("smoothing_updates", "rise_updates", "fall_updates", "interval_updates"):
            if getattr(self, name) <= 0:
                raise ConfigError(
                    f"schedule.{name} is {getattr(self, name)}; give a positive number of updates"
                )


class MaturityState(NamedTuple):
    """What the maturity remembers. Plain numbers, so a checkpoint holds it as JSON."""

    maturity: float = 0.0
    """S(t) in [0, 1]."""
    average: float = 0.0
    """Moving average of the measured maturities, before the rate limit."""
    updates: int = 0
    """Gradient updates since the critic began to learn."""


class Bounds(NamedTuple):
    """Q_min and Q_max of eq 13, in the reward's units, under the weights that hold today."""

    low: float
    """Mean discounted return of a random policy from the probe's start states."""
    high: float
    """The same of the demonstrations."""


def alpha(maturity: float, config: ScheduleConfig) -> float:
    """alpha = alpha_min + (alpha_max - alpha_min) sigma(b_alpha - k_alpha S) (eq 3): expert rows' share."""
    released = 1.0 / (1.0 + math.exp(config.k_alpha * maturity - config.b_alpha))
    return config.alpha_min + (config.alpha_max - config.alpha_min) * released


def lambda_bc(maturity: float, config: ScheduleConfig) -> float:
    """lambda = lambda_max exp(-k_q S) (eq 5): weight of cloning in the actor's objective (eq 6)."""
    return config.lambda_max * math.exp(-config.k_q * maturity)


def measured_maturity(probe_value: float, bounds: Bounds) -> float:
    """clip((Q - Q_min) / (Q_max - Q_min), 0, 1) (eq 13). 0 where the expert is no better than chance."""
    span = bounds.high - bounds.low
    if span <= 1e-6:
        return 0.0
    return min(max((probe_value - bounds.low) / span, 0.0), 1.0)


def update(
    state: MaturityState, probe_value: float, bounds: Bounds, dt_updates: int, config: ScheduleConfig
) -> MaturityState:
    """One measurement of S, dt_updates after the last.

    probe_value is the mean over fixed start states of min_i Q'_i(s0, pi(s0)) (eq 2, corrected: a batch's mean
    would depend on alpha itself). S moves the reward's weights, they move Q, and Q moves S. Three things
    break this loop: the bounds are formed under the same weights as Q, the average is slow against the
    critic, and S falls ten times slower than it may rise, so it cannot swing.
    """
    updates = state.updates + dt_updates
    if updates <= config.warmup_updates:
        return MaturityState(updates=updates)
    gain = 1.0 - math.exp(-dt_updates / config.smoothing_updates)
    average = state.average + gain * (measured_maturity(probe_value, bounds) - state.average)
    most, least = dt_updates / config.rise_updates, -dt_updates / config.fall_updates
    change = min(max(average - state.maturity, least), most)
    return MaturityState(min(max(state.maturity + change, 0.0), 1.0), average, updates)
