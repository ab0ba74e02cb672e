"""What the package's extras bring, and the word to whoever needs one that is not installed."""

import importlib.util

from adrl.errors import MissingExtra

MODULES = {
    "train": ("jax", "minari", "tensorboardX"),
    "baselines": ("torch", "stable_baselines3"),
    "ray": ("ray",),
    "regret": ("statsmodels",),
}
"""Modules of the extras that are asked for before any work."""


def require(extra: str, what: str) -> None:
    """Raises MissingExtra unless the modules of the extra are installed; imports none. what: what needs it."""
    if any(importlib.util.find_spec(name) is None for name in MODULES[extra]):
        raise MissingExtra.named(extra, what)
