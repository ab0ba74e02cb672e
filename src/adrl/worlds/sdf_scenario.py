"""sdf: tasks in a Gazebo world made of primitives."""

import os
from pathlib import Path

from adrl.types import World
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.sdf import load_sdf


class SdfScenario(FixedWorld):
    """Start and goal inside the world's bounds. Raises WorldError when the world cannot be read."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(f"sdf:{Path(path).stem}", load_sdf(path))

    @property
    def training_worlds(self) -> list[World]:
        """The one."""
        return [self.world]
