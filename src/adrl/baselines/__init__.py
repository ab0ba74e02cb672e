"""Policies that ADRL is compared with."""

from dataclasses import dataclass

from adrl import extras


@dataclass(frozen=True)
class Baseline:
    """One of Stable-Baselines3's algorithms, and how it is used."""

    algorithm: str
    """TD3, SAC or PPO."""
    habits: bool = False
    """With our learner's habits, as far as the library's interface takes them (sb3_habits.py); if not, as its users
    have it."""

    def __str__(self) -> str:
        return f"{self.algorithm} of Stable-Baselines3{', with our habits' if self.habits else ''}"


SB3_METHODS: dict[str, Baseline] = {
    "sb3-td3": Baseline("TD3"),
    "sb3-sac": Baseline("SAC"),
    "sb3-ppo": Baseline("PPO"),
    "sb3-td3-habits": Baseline("TD3", habits=True),
    "sb3-sac-habits": Baseline("SAC", habits=True),
    "sb3-ppo-habits": Baseline("PPO", habits=True),
}
"""Learned baselines by method."""


def require_sb3() -> None:
    """Raises MissingExtra unless Stable-Baselines3 and PyTorch are installed; imports neither."""
    extras.require("baselines", f"each of the methods {', '.join(SB3_METHODS)}")
