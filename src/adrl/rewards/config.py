"""Constants of the reward. Terms keep the paper's numbers; `scale` brings their sum near 1."""

import math
from dataclasses import dataclass, fields

from adrl.errors import ConfigError

STANDING_AT_WORST = 3.3
"""The most that a reference period of standing costs: the least the weighted shaping terms can sum to."""


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Constants of eqs 7 to 17, corrected forms. Stored with every run.

    The weights keep this order for gamma <= 0.98 a reference period: reaching the goal > standing, circling,
    spinning, orbiting > crashing. Standing in the worst place costs at most 3.3 a period, 165 for ever; a
    crash costs failure_weight * 200. A longer horizon needs a larger failure_weight: 2 for gamma = 0.99.
    """

    success_reward: float = 200.0
    """r_su of eq 7, paid once on arrival."""
    failure_penalty: float = 200.0
    """-r_f of eq 8, paid once on collision."""
    safe_clearance_m: float = 0.3
    """d_safe - d_r of eq 11: clearance of the footprint's edge, in m, below which an obstacle costs."""
    stagnation_fraction: float = 0.15
    """d_m of eq 12 as a fraction of max_speed * dt, the longest step a robot can make."""
    near_goal_m: float = 3.0
    """Distance in m below which the goal counts as near: T_goal rises from 0 here to 1 at the goal."""
    success_weight: float = 1.0
    """Weight of the success row; fixed, while the four shaping rows always sum to 1."""
    failure_weight: float = 1.0
    """Weight of the failure row; fixed."""
    scale: float = 0.02
    """Factor on the weighted sum (eq 17), so that values stay within a few units."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"reward.{field.name} is {value}; give a positive number")
        if self.stagnation_fraction >= 1.0:
            raise ConfigError(f"reward.stagnation_fraction is {self.stagnation_fraction}; give less than 1")
