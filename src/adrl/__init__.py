"""ADRL: train, evaluate and deploy LiDAR navigation policies.

    import adrl, gymnasium
    env = gymnasium.make("adrl/Nav-v0", scenario="clutter", robot="diffbot")

Importing this loads neither JAX nor Gymnasium nor matplotlib: the names below are looked up when they are
first used, and the environment is registered when Gymnasium is there, be it before or after.
"""

from typing import Any

from adrl.registration import ENV_ID, register_when_possible

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "ENV_ID",
    "RunConfig",
    "TrainConfig",
    "__version__",
    "evaluate",
    "evaluate_family",
    "load_policy",
    "train",
]

# Named, not imported: the package stands below all that it offers. __init__.pyi tells type checkers.
_API = ("RunConfig", "TrainConfig", "evaluate", "evaluate_family", "load_policy", "train")

register_when_possible()


def __getattr__(name: str) -> Any:
    """The API and the version, when they are asked for."""
    if name in _API:
        from importlib import import_module

        value = getattr(import_module("adrl.api"), name)
    elif name == "__version__":
        from importlib.metadata import version

        value = version("adrl")
    else:
        raise AttributeError(f"module 'adrl' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
