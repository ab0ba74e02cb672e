"""The six sub-rewards, eqs 7 to 12. A term is a function and one line in REWARD_TERMS; RewardConfig may add others.

The corrected formulas are for a step of one reference period; the four shaping terms of another step are paid in
proportion. Literal forms are the paper's numbers as they stand.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.rewards.config import RewardConfig
from adrl.rewards.step import Array, Step

OBSTACLE_PENALTY = 5.0  # eq 11
STAGNATION_PENALTY = 3.0  # eq 12
STAGNATION_WINDOW = 5
"""Steps over which eq 12 averages displacements."""
YAW_RATE_COST = 0.8  # eq 9
HEADING_GAIN_M = 0.25  # eq 10: 0.5 / 2.0, metres of progress that facing the goal is worth
HEADING_DECAY = 2.0  # eq 10, 1/rad
SINGULARITY_M = 1e-3  # eq 11, literal: the quotient is cut here, to stay finite


def success(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_su = 200 on arrival (eq 7)."""
    return config.success_reward * step.reached


def failure(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_f = -200 on collision (eq 8). A timeout costs nothing: time is not observed, so it truncates.

    Literal: -200 where the robot's centre is within d_r of an obstacle's coordinates, or on timeout. A contact with
    an obstacle that has size is no failure then.
    """
    failed = step.collided
    if config.eq8 == "literal":
        failed = (step.coordinate_distance_m < step.contact_m) | step.timed_out
    return -config.failure_penalty * failed


def motion(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_v = v/v_max - 0.8 |w|/w_max - 1 (eq 9 minus 1), at most 0: every second costs, so no circle pays.

    Literal: without the -1.
    """
    speed = np.clip(step.speed_mps / step.max_speed_mps, -1.0, 1.0)
    yaw_rate = np.clip(np.abs(step.yaw_rate_radps) / step.max_yaw_rate_radps, 0.0, 1.0)
    if config.eq9 == "literal":
        return speed - YAW_RATE_COST * yaw_rate
    return (speed - YAW_RATE_COST * yaw_rate - 1.0) * step.periods


def approach(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_d = (d(t-1) - d(t) + 1/4 exp(-2 |h(t)|) - 1/4 exp(-2 |h(t-1)|)) / (v_max dt) (eq 10), h heading.

    The heading part is the integral over the step of eq 10's 0.5 exp(-2 |h|) times the decrease of |h|. Taken
    at the step's end instead, a turn of 0.15 rad to the goal and back pays 0.0194 m; the integral pays
    nothing. Literal: |dp| + 0.5 exp(-2 |h|) |dtheta|, which pays driving and turning anywhere.
    """
    if config.eq10 == "literal":
        facing = np.exp(-HEADING_DECAY * np.abs(step.heading_error_rad))
        return step.displacement_m + 0.5 * facing * np.abs(step.turn_rad)
    progress = step.previous_distance_m - step.distance_m
    facing = np.exp(-HEADING_DECAY * np.abs(step.heading_error_rad))
    previously = np.exp(-HEADING_DECAY * np.abs(step.previous_heading_error_rad))
    return (progress + HEADING_GAIN_M * (facing - previously)) / step.max_step_m * step.periods


def obstacle(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_o = -5 clip((c_safe - c) / c_safe, 0, 1), clearance c = d_ob - d_r, c_safe = d_safe - d_r (eq 11).

    Literal: -5 / (d_ob - d_safe) where d_ob < d_safe, which is positive; cut where the quotient's divisor, which
    is c - c_safe, is smaller than SINGULARITY_M.
    """
    if config.eq11 == "literal":
        inside = step.clearance_m < config.safe_clearance_m
        divisor = np.minimum(step.clearance_m - config.safe_clearance_m, -SINGULARITY_M)
        return np.where(inside, -OBSTACLE_PENALTY / divisor, 0.0)
    near = np.clip(1.0 - step.clearance_m / config.safe_clearance_m, 0.0, 1.0)
    return -OBSTACLE_PENALTY * near * step.periods


def stagnation(step: Step, config: RewardConfig) -> Array:  # (N,)
    """r_s = -3 where the mean of the last five displacements is below d_m (eq 12)."""
    stagnant = step.mean_displacement_m < config.stagnation_fraction * step.max_step_m
    return -STAGNATION_PENALTY * stagnant * step.periods


REWARD_TERMS: dict[str, Callable[[Step, RewardConfig], Array]] = {
    "success": success,
    "failure": failure,
    "motion": motion,
    "approach": approach,
    "obstacle": obstacle,
    "stagnation": stagnation,
}


def reward_terms(config: RewardConfig) -> dict[str, Callable[[Step, RewardConfig], Array]]:
    """The R terms of a reward: the six, then the extra ones; one with the name of one of the six takes its place."""
    return REWARD_TERMS | {term.name: term.value for term in config.extra()}


def terms(step: Step, config: RewardConfig) -> NDArray[np.float32]:
    """(N, R) sub-rewards of a step, columns in the order of reward_terms(config).

    Raises ConfigError for an extra term that does not give N finite numbers.
    """
    values = {name: term(step, config) for name, term in reward_terms(config).items()}
    for name in (term.name for term in config.extra()):
        shape, expected = np.shape(values[name]), step.reached.shape
        if shape != expected or not np.isfinite(values[name]).all():
            raise ConfigError(
                f"reward term {name!r} gives numbers of shape {shape} for {expected} steps, or not finite ones; "
                "give one finite number a step"
            )
    return np.stack(list(values.values()), axis=-1).astype(np.float32)
