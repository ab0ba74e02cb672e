"""What an observation is made of: components, side by side, each a few numbers of its own."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array, RobotConfig

if TYPE_CHECKING:
    from adrl.observation.motion import ScanHistory

F32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Senses:
    """What N robots sense and know. The same in training, in evaluation and on a robot."""

    ranges: F32
    """(N, K) metres."""
    goal: Array
    """(N, 2) metres, in the robot's frame: the point that the guidance gives."""
    twist: Array
    """(N, 2) measured m/s, rad/s."""
    last_action: F32
    """(N, 2) in [-1, 1]."""
    history: "ScanHistory | None" = None
    """Of the scans, its newest being ranges; None where no component needs it."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """Turns what a symmetric robot sees and does into what it would see and do in the mirrored world."""

    order: NDArray[np.intp]
    """(D,) index of the number that takes each place of an observation."""
    sign: F32
    """(D,) its factor, 1 or -1."""

    def observation(self, rows: F32) -> None:
        """Mirror observations (..., D) in place."""
        rows[...] = rows[..., self.order] * self.sign

    def action(self, rows: F32) -> None:
        """Mirror actions (..., 2) in place: the yaw rate turns round."""
        rows[..., 1] *= -1.0


@runtime_checkable
class Component(Protocol):
    """A part of the observation: `size` numbers of one robot and its settings."""

    @property
    def size(self) -> int:
        """How many numbers."""
        ...

    @property
    def limit(self) -> float:
        """No number of a simulated robot's is further from 0."""
        ...

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, size)."""
        ...

    def mirror(self) -> Mirror | None:
        """Left for right within the component; None for a robot that is not symmetric."""
        ...


class ComponentFactory(Protocol):
    """Makes a robot's component: a class with a name will do."""

    @property
    def name(self) -> str:
        """By which a policy finds it again."""
        ...

    def __call__(self, robot: RobotConfig, config: Any) -> Component:
        """config: the EncoderConfig."""
        ...


def unchanged(size: int, *flipped: int) -> Mirror:
    """The mirror of numbers that keep their places; those at `flipped` change their sign."""
    sign = np.ones(size, np.float32)
    sign[list(flipped)] = -1.0
    return Mirror(np.arange(size), sign)
