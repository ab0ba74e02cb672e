"""Registers our environments in Gymnasium without importing it: `import adrl` stays light, before it or after."""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ENV_ID = "adrl/Nav-v0"
ENVS = {
    # Text, not classes: what they name is imported by the first make().
    ENV_ID: ("adrl.envs:NavEnv", "adrl.envs:make_nav_vec"),
    "adrl/Gazebo-v0": (
        "adrl.integrations.gazebo.env:GazeboEnv",
        "adrl.integrations.gazebo.env:make_gazebo_vec",
    ),
}
"""Each environment's class, and what makes many side by side."""
MAX_EPISODE_STEPS = 100_000
"""More than any task gives: each has a time limit of its own. Others' software wants a number here."""


def register_when_possible() -> None:
    """Register now if Gymnasium is loaded, else as soon as it is. Doing so again changes nothing."""
    if "gymnasium" in sys.modules:
        _register()
    elif not any(isinstance(finder, _GymnasiumFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumFinder())


def _register() -> None:
    from gymnasium.envs.registration import register, registry

    for name, (single, vector) in ENVS.items():
        if name not in registry:
            register(
                name,
                entry_point=single,
                vector_entry_point=vector,
                max_episode_steps=MAX_EPISODE_STEPS,
            )


class _GymnasiumFinder:
    """Finds Gymnasium as all other finders do, and has it loaded by _GymnasiumLoader."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        for finder in tuple(sys.meta_path):
            spec = None if finder is self else finder.find_spec(name, path, target)
            if spec is not None:
                if spec.loader is not None:
                    loader: Any = _GymnasiumLoader(spec.loader)
                    spec.loader = loader
                return spec
        return None


class _GymnasiumLoader:
    """Loads Gymnasium with its own loader, then registers."""

    def __init__(self, loader: Any) -> None:
        self._loader = loader

    def exec_module(self, module: Any) -> None:
        # The module knows its own loader only, as if we had not been there.
        module.__spec__.loader = module.__loader__ = self._loader
        self._loader.exec_module(module)
        _register()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)
