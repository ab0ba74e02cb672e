"""sdf: tasks in a Gazebo world."""

import os
from collections.abc import Sequence
from pathlib import Path

from adrl.types import World
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.sdf import load_sdf


class SdfScenario(FixedWorld):
    """Start and goal inside what stands in the world. models, ignore and errors are those of load_sdf."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        models: Sequence[str | os.PathLike[str]] = (),
        ignore: Sequence[str] = (),
    ) -> None:
        world = load_sdf(path, models=models, ignore=ignore)
        super().__init__(f"sdf:{Path(path).stem}", world, open_bounds=True)
        self.notes = world.notes
        """What was left out of the world, and what was guessed: a line each."""

    @property
    def training_worlds(self) -> list[World]:
        """The one."""
        return [self.world]
