"""What the rows of one simulator may be: robots of several kinds, and how each is guided."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from adrl.errors import UnknownName
from adrl.types import GUIDANCE, Array, RobotConfig, RobotRows

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A robot, and what leads it."""

    robot: RobotConfig
    guidance: str = "goal"
    """One of GUIDANCE."""
    taken_as: RobotConfig | None = None
    """The robot as a policy of another one takes it, with speeds and a LiDAR's reach of its own; as it is when None.
    See adrl.deploy.another_robot.as_trained."""

    def __post_init__(self) -> None:
        if self.guidance not in GUIDANCE:
            raise UnknownName("guidance", self.guidance, GUIDANCE)

    @property
    def known_as(self) -> RobotConfig:
        """The robot that the policy takes it for."""
        return self.taken_as or self.robot


@dataclass(frozen=True, eq=False, kw_only=True)
class KindRows:
    """Kinds in arrays (N,): of every kind, or of the rows that are of them. rows[indices] are some."""

    robot: RobotRows
    known: RobotRows
    """As the policies take them."""
    on_map: Mask
    """They know the map, and so where they are."""
    led: Mask
    """The replanner leads them."""
    car: Mask
    """They cannot turn on the spot."""

    @classmethod
    def of(cls, kinds: Sequence[Kind], *, plans_itself: bool) -> Self:
        """plans_itself: the policy makes its own routes, and no replanner any."""
        guidance = np.array([kind.guidance for kind in kinds])
        return cls(
            robot=RobotRows.of([kind.robot for kind in kinds]),
            known=RobotRows.of([kind.known_as for kind in kinds]),
            on_map=guidance == "map",
            led=(guidance == "replan") & (not plans_itself),
            car=np.array([kind.robot.is_car for kind in kinds]),
        )

    def __getitem__(self, rows: Any) -> Self:
        return type(self)(
            robot=self.robot[rows],
            known=self.known[rows],
            on_map=self.on_map[rows],
            led=self.led[rows],
            car=self.car[rows],
        )


def agreed(mask: Mask) -> bool | None:
    """What all kinds are, None where some are and some are not."""
    return bool(mask[0]) if (mask == mask[0]).all() else None


def chosen(agreed: bool | None, mask: Mask, yes: Array, no: Array) -> Array:
    """(N, ...) rows of yes where the mask (N,) is true, of no elsewhere; one of them itself where all kinds agree."""
    if agreed is not None:
        return yes if agreed else no
    return np.where(mask.reshape(-1, *[1] * (yes.ndim - 1)), yes, no)
