"""A run's budget: --steps, --max-seconds or both. The one that is spent first ends the run."""

import math

from adrl.agents.config import TrainConfig
from adrl.errors import ConfigError


class BudgetSpent(ConfigError):
    """A run that is to go on has had its whole budget, and its policy is written."""


def require_end(config: TrainConfig) -> None:
    """Raises ConfigError for a run that would never end."""
    if config.steps is None and config.max_seconds is None:
        raise ConfigError(
            "a run needs an end; give --steps (environment steps) or --max-seconds (wall clock): steps or max_seconds"
        )


def spent_fraction(config: TrainConfig, env_steps: int, wall_s: float) -> float:
    """Share in [0, 1] of the budget that is used up: of the part that is spent first. 1 exactly where one is."""
    by_steps = env_steps / config.steps if config.steps is not None else 0.0
    by_time = wall_s / config.max_seconds if config.max_seconds is not None else 0.0
    return min(max(by_steps, by_time), 1.0)


def require_updates(config: TrainConfig, updates: int, env_steps: int, setup_s: float) -> None:
    """Raises ConfigError for a run that has ended before it learnt from a step of its own: its policy would be noise.

    Updates on demonstrations come before the first step.

    setup_s: wall clock from the start of the run to its first step.
    """
    if updates > 0 and env_steps > 0:
        return
    if config.max_seconds is None or (config.steps is not None and env_steps >= config.steps):
        raise ConfigError(
            f"no policy: {env_steps} environment steps ended before the first update, which comes after start_steps "
            f"= {config.start_steps}; give more --steps"
        )
    raise ConfigError(
        f"no policy: --max-seconds {config.max_seconds:g} is a total, and set-up took {setup_s:.1f} s of it: it "
        f"ended before the robot's first step; give --max-seconds {math.ceil(setup_s) + 60} for about a minute of "
        "training"
    )


def spent(config: TrainConfig, where: str, env_steps: int, wall_s: float) -> BudgetSpent:
    """The error of a finished run in folder `where` that is resumed with no more budget than it has had."""
    if config.steps is not None and env_steps >= config.steps:
        return BudgetSpent(
            f"{where} has had its {env_steps} environment steps; give --steps above {env_steps}"
        )
    return BudgetSpent(
        f"{where} has had its {config.max_seconds:g} s, set-up of the resumed run included; give --max-seconds above "
        f"{math.ceil(wall_s)}"
    )
