"""What moves and senses robots, by name: our simulator, or another that takes its place."""

import pkgutil
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.registry import look_up
from adrl.types import RobotConfig, Task


class Body(Protocol):
    """Moves and senses robots instead of our simulator, as Gazebo does. b: NavSim's arrays."""

    @property
    def num_envs(self) -> int:
        """Robots it has; there may be fewer in the arrays."""
        ...

    def reset(self, indices: NDArray[np.intp], tasks: Sequence[Task], b: Mapping[str, NDArray[Any]]) -> None:
        """Put robots at their tasks' starts; write pose, odometry, twist and ranges."""
        ...

    def step(self, b: Mapping[str, NDArray[Any]]) -> None:
        """Drive the active robots for a control period; write these, and time, travelled and collided."""
        ...


class Simulator(Protocol):
    """Makes the robots of a simulator, for as long as a context lasts."""

    def __call__(
        self, robot: RobotConfig, num_envs: int = 1, *, seed: int = 0
    ) -> AbstractContextManager[Body]:
        """num_envs robots side by side."""
        ...


NATIVE = "native"
"""Our simulator: there is nothing to make."""
SIMULATORS = {
    NATIVE: None,
    # Text: what it names stands above this module, and is imported when it is asked for.
    "gazebo": "adrl.integrations.gazebo:Gazebo",
}


def find_simulator(name: str) -> Simulator | None:
    """Of SIMULATORS, or of an installed package's entry point group "adrl.simulators"; None for ours.

    Raises UnknownName.
    """
    found = look_up("simulator", name, SIMULATORS)
    return pkgutil.resolve_name(found) if isinstance(found, str) else found
