"""What exists, and what is to be done in it."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.geometry import Array, in_world_frame
from adrl.types.base import HasNative, require
from adrl.types.people import MOST_PEOPLE, NOBODY, People
from adrl.types.polygons import require_convex

GOAL_TOLERANCE_M = 0.3
"""Distance to the goal at which it is reached, in training and on a robot; benchmarks have their own."""


@dataclass(frozen=True, kw_only=True)
class OccupancyGrid:
    """A bitmap of solid cells. Row-major [y, x]; cell (0, 0) has its lower left corner at the origin."""

    solid: NDArray[np.uint8]
    """(H, W) 1 where the cell is solid: occupied or unknown."""
    resolution_m: float
    """Side of a cell."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """(x, y, yaw) of the lower left corner of cell (0, 0) in the world."""
    observed_free: NDArray[np.bool_] | None = None
    """(H, W) cells surely seen free; tasks start and end there. None: every cell that is not solid."""


@dataclass(frozen=True, eq=False, kw_only=True)
class World(HasNative):
    """What exists: the LiDAR sees and the footprint hits this very geometry."""

    bounds: tuple[float, float, float, float]
    """(x_min, y_min, x_max, y_max) of the area where tasks are drawn and planned. Not a wall by itself."""
    circles: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(C, 3) x, y, radius."""
    polygons: tuple[Array, ...] = ()
    """Convex polygons, each (V, 2), corners counter-clockwise."""
    segments: Array = field(default_factory=lambda: np.empty((0, 4)))
    """(S, 4) x1, y1, x2, y2: walls without thickness."""
    discs: Array = field(default_factory=lambda: np.empty((0, 8)))
    """(M, 8) moving discs: x1, y1, x2, y2, radius, speed_mps, phase, stop_s. A disc runs to and fro between
    its two ends; phase in [0, 1) is where in the round trip it is at time 0; it stands still after stop_s
    seconds."""
    grid: OccupancyGrid | None = None

    def __post_init__(self) -> None:
        for name, width in (("circles", 3), ("segments", 4), ("discs", 8)):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64).reshape(-1, width)
            # A disc may never stop: stop_s is the one number that may be infinite.
            checked = np.minimum(array, [math.inf] * 7 + [0.0]) if name == "discs" else array
            require(bool(np.isfinite(checked).all()), f"world.{name} holds a number that is not finite")
            object.__setattr__(self, name, array)
        for corners in self.polygons:
            require_convex("world polygon", corners)
        x_min, y_min, x_max, y_max = self.bounds
        require(x_min < x_max and y_min < y_max, f"world.bounds {self.bounds} is empty")

    def disc_centres(self, time_s: float) -> Array:
        """(M, 2) where the moving discs are at time_s."""
        return disc_centres(self.discs, time_s)

    def coordinates(self, time_s: float) -> Array:
        """(M, 2) one point an obstacle, its middle: what eq 8 calls its coordinates. Solid cells are one each."""
        points = [self.circles[:, :2], 0.5 * (self.segments[:, :2] + self.segments[:, 2:])]
        points += [corners.mean(axis=0, keepdims=True) for corners in self.polygons]
        points.append(self.disc_centres(time_s))
        return np.concatenate([*points, self.solid_cells])

    @cached_property
    def solid_cells(self) -> Array:
        """(M, 2) middles of the solid cells of the grid."""
        if self.grid is None:
            return np.empty((0, 2))
        cells = np.argwhere(self.grid.solid)[:, ::-1].astype(np.float64)
        middles = (cells + 0.5) * self.grid.resolution_m
        return in_world_frame(np.array(self.grid.origin), middles)

    @cached_property
    def without_discs(self) -> "World":
        """What stands. Robots under way plan in it: where discs were at first is of no use to them."""
        return self if len(self.discs) == 0 else replace(self, discs=np.empty((0, 8)))

    @cached_property
    def native(self) -> "_core.World":
        """The same geometry, laid out for the kernels."""
        corners = np.concatenate([*self.polygons, np.empty((0, 2))])
        sizes = [len(p) for p in self.polygons]
        offsets = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(np.int32)
        grid = self.grid
        return _core.World(
            self.circles,
            np.ascontiguousarray(corners, dtype=np.float64),
            offsets,
            self.segments,
            self.discs,
            np.ascontiguousarray(grid.solid if grid else np.empty((0, 0)), dtype=np.uint8),
            grid.resolution_m if grid else 1.0,
            grid.origin if grid else (0.0, 0.0, 0.0),
        )


def disc_centres(discs: Array, time_s: float) -> Array:
    """(M, 8) rows of World.discs -> (M, 2) where they are at time_s; the kernels' MovingDisc::at is the same."""
    ends, speed, phase, stop_s = discs[:, :4], discs[:, 5], discs[:, 6], discs[:, 7]
    run = np.hypot(*(ends[:, 2:] - ends[:, :2]).T)
    rounds = phase + speed * np.minimum(time_s, stop_s) / np.maximum(2.0 * run, 1e-9)
    share = 1.0 - np.abs(1.0 - 2.0 * np.remainder(rounds, 1.0))
    return ends[:, :2] + share[:, None] * (ends[:, 2:] - ends[:, :2])


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(HasNative):
    """One episode: a world, where the robot starts and where it must go."""

    world: World
    start: tuple[float, float, float]
    """(x, y, yaw)."""
    goal: tuple[float, float]
    path: Array
    """(P, 2) shortened A* path for this robot, start and goal included; for a car one that it can drive from its start:
    see adrl.planning.car_path."""
    shortest_m: float
    """Length of the shortest feasible path of the inflated footprint: the reference of optimality and SPL."""
    time_limit_s: float
    goal_tolerance_m: float = GOAL_TOLERANCE_M
    people: People = NOBODY
    """Who walks about. Where they are is the episode's own."""

    def __post_init__(self) -> None:
        moving = len(self.world.discs) + len(self.people)
        require(
            moving <= MOST_PEOPLE, f"{moving} moving discs and people; a task holds at most {MOST_PEOPLE}"
        )

    @cached_property
    def native(self) -> "_core.Task":
        """The same task, laid out for the simulator."""
        path = np.ascontiguousarray(self.path, dtype=np.float64)
        crowd = self.people.native if len(self.people) else None
        return _core.Task(self.world.native, self.start, self.goal, self.goal_tolerance_m, path, crowd)
