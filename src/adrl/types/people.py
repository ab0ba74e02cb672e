"""People who walk about in a task."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.geometry import Array
from adrl.types.base import require

MOST_PEOPLE = _core.MAX_PEOPLE
"""In a task, together with the moving discs of its world."""
RADIUS_M = (0.15, 0.6)
FASTEST_MPS = 3.0
SLOWEST_REACTION_S = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class People:
    """P people. Each walks to and fro along a route of its own, at a preferred speed, and keeps off walls, the others
    and, by its share, the robot (ORCA; van den Berg, Guy, Lin, Manocha 2011)."""

    routes: tuple[Array, ...] = ()
    """(W, 2) points, the start first, that can be walked straight from one to the next; of one who stands one will
    do."""
    radius_m: Array = field(default_factory=lambda: np.empty(0))
    """(P,) of the body, which the robot may not touch."""
    speed_mps: Array = field(default_factory=lambda: np.empty(0))
    """(P,) preferred; 0 stands, and others go round."""
    share: Array = field(default_factory=lambda: np.empty(0))
    """(P,) of what is to be done to avoid the robot, the part that the person does: 0 does not look and leaves all to
    the robot, 0.5 is reciprocal, 1 leaves nothing to it."""
    reaction_s: Array = field(default_factory=lambda: np.empty(0))
    """(P,) time between two decisions."""
    group: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))
    """(P,) people of one number keep together; -1 walks alone."""
    blind: NDArray[np.bool_] | None = None
    """(P,) those that avoid nothing at all, neither people nor walls, and whom all others avoid; None: nobody."""
    legs: bool = False
    """A LiDAR sees two legs of 0.1 m that swing, not the body."""

    def __post_init__(self) -> None:
        count = len(self.routes)
        limits = {
            "radius_m": RADIUS_M,
            "speed_mps": (0.0, FASTEST_MPS),
            "share": (0.0, 1.0),
            "reaction_s": (0.0, SLOWEST_REACTION_S),
            "group": (-1, 2**31 - 1),
        }
        for name, (low, high) in limits.items():
            array = np.ascontiguousarray(
                getattr(self, name), dtype=np.int32 if name == "group" else np.float64
            )
            require(
                array.shape == (count,), f"people.{name} has shape {array.shape}; give one number a route"
            )
            require(bool(((array >= low) & (array <= high)).all()), f"people.{name}: give {low} to {high}")
            object.__setattr__(self, name, array)
        if self.blind is not None:
            blind = np.array(self.blind, dtype=bool)
            require(blind.shape == (count,), f"people.blind has shape {blind.shape}; give one flag a route")
            object.__setattr__(self, "blind", blind)
        require(count <= MOST_PEOPLE, f"{count} people; a task holds at most {MOST_PEOPLE}")
        routes = tuple(np.ascontiguousarray(route, dtype=np.float64) for route in self.routes)
        for k, route in enumerate(routes):
            least = 2 if self.speed_mps[k] > 0.0 else 1
            require(
                route.ndim == 2 and route.shape[1] == 2 and len(route) >= least,
                f"people.routes[{k}] has shape {route.shape}; give (W, 2) points, {least} or more",
            )
            require(bool(np.isfinite(route).all()), f"people.routes[{k}] holds a number that is not finite")
        object.__setattr__(self, "routes", routes)

    def __len__(self) -> int:
        return len(self.routes)

    @property
    def starts(self) -> Array:
        """(P, 2) where they begin."""
        return np.array([route[0] for route in self.routes]).reshape(-1, 2)

    @cached_property
    def native(self) -> "_core.Crowd":
        """The same people, laid out for the simulator."""
        blind = np.zeros(len(self)) if self.blind is None else self.blind
        walkers = [self.radius_m, self.speed_mps, self.share, self.reaction_s, self.group, blind]
        ends = np.cumsum([0, *(len(route) for route in self.routes)]).astype(np.int32)
        return _core.Crowd(
            np.ascontiguousarray(np.column_stack(walkers), dtype=np.float64),
            np.ascontiguousarray(np.concatenate([*self.routes, np.empty((0, 2))])),
            ends,
            self.legs,
        )


NOBODY = People()
