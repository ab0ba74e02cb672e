"""Policies that ADRL is compared with."""

import importlib.util

from adrl.errors import MissingExtra

SB3_METHODS: dict[str, str] = {"sb3-td3": "TD3", "sb3-sac": "SAC", "sb3-ppo": "PPO"}
"""Learned baselines: method -> algorithm of Stable-Baselines3."""


def require_sb3() -> None:
    """Raises MissingExtra unless Stable-Baselines3 and PyTorch are installed; imports neither."""
    if any(importlib.util.find_spec(name) is None for name in ("torch", "stable_baselines3")):
        raise MissingExtra.named("baselines", f"each of the methods {', '.join(SB3_METHODS)}")
