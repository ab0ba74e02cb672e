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


def installed(extra: str) -> bool:
    """Whether the modules of the extra are there; imports none."""
    return all(importlib.util.find_spec(name) is not None for name in MODULES[extra])


def require(extra: str, what: str) -> None:
    """Raises MissingExtra unless the extra is installed. what: what needs it."""
    if not installed(extra):
        raise MissingExtra.named(extra, what)
