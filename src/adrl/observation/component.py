"""What an observation is made of: components, side by side, each a few numbers of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.types import Array, RobotConfig

if TYPE_CHECKING:
    from adrl.observation.motion import ScanHistory

F32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Senses:
    """What N robots sense and know. The same in training, in evaluation and on a robot."""

    ranges: F32
    """(N, K) metres, K the most that any kind has; columns beyond a robot's own beams hold its greatest range."""
    goal: Array
    """(N, 2) metres, in the robot's frame: the point that the guidance gives."""
    twist: Array
    """(N, 2) measured m/s, rad/s."""
    last_action: F32
    """(N, 2) in [-1, 1]."""
    history: "ScanHistory | None" = None
    """Of the scans, its newest being ranges; None where no component needs it."""
    path: Array | None = None
    """(N, P, 2) metres, in the robot's frame: points of the path ahead; None where no component needs it."""
    kind: NDArray[np.intp] = field(kw_only=True)
    """(N,) which of the encoder's robots each row is, by its number: all 0 for an encoder of one."""

    def of(self, rows: NDArray[np.intp], num_beams: int) -> "Senses":
        """Of the robots `rows` (M,) alone, all of one kind, which has num_beams beams."""
        history = None if self.history is None else self.history.of(rows, num_beams)
        return Senses(
            self.ranges[rows, :num_beams],
            self.goal[rows],
            self.twist[rows],
            self.last_action[rows],
            history,
            None if self.path is None else self.path[rows],
            kind=np.zeros(len(rows), np.intp),
        )


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
    """A part of the observation: `size` numbers of each robot."""

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
        """Left for right within the component; None where one of the robots is not symmetric."""
        ...


class ComponentFactory(Protocol):
    """Makes the component of one robot, of which several share an encoder by OfEach: a class with a name will do."""

    @property
    def name(self) -> str:
        """By which a policy finds it again."""
        ...

    def __call__(self, robot: RobotConfig, config: Any) -> Component:
        """config: the EncoderConfig."""
        ...


class OfEach:
    """A component of several robots, of components that know one robot each: one writes the rows of its own kind."""

    def __init__(self, name: str, robots: Sequence[RobotConfig], parts: Sequence[Component]) -> None:
        """Raises ConfigError for parts of several sizes."""
        sizes = {part.size for part in parts}
        if len(sizes) > 1:
            raise ConfigError(
                f"encoder.extra_components: {name!r} has {min(sizes)} to {max(sizes)} numbers, by the robot; "
                "robots in one batch need as many each"
            )
        self.size = parts[0].size
        self.limit = max(part.limit for part in parts)
        self._robots, self._parts = robots, parts

    def write(self, senses: Senses, out: F32) -> None:
        """Fill (N, size)."""
        for k in np.unique(senses.kind):
            rows = np.flatnonzero(senses.kind == k)
            own = np.empty((len(rows), self.size), np.float32)
            self._parts[k].write(senses.of(rows, self._robots[k].lidar.num_beams), own)
            out[rows] = own

    def mirror(self) -> Mirror | None:
        """That of all parts; None where they have none, or not the same."""
        first, *others = (part.mirror() for part in self._parts)
        same = first is not None and all(
            other is not None
            and np.array_equal(other.order, first.order)
            and np.array_equal(other.sign, first.sign)
            for other in others
        )
        return first if same else None


def unchanged(size: int, *flipped: int) -> Mirror:
    """The mirror of numbers that keep their places; those at `flipped` change their sign."""
    sign = np.ones(size, np.float32)
    sign[list(flipped)] = -1.0
    return Mirror(np.arange(size), sign)
