"""Placing obstacles so that a robot fits through between any two of them: no place is shut off by them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array, RobotConfig, World
from adrl.worlds.shapes import box, cover, enclosure, place

Bounds = tuple[float, float, float, float]
THIN_M = 0.12
"""Thickness of free-standing walls and of the sides of traps."""


def gap_range(gap_m: tuple[float, float], robot: RobotConfig) -> tuple[float, float]:
    """Gaps free on the planning grid: inflated from both sides, and more for cells off the middle."""
    need = 2.0 * robot.circumscribed_radius_m + 0.2
    return max(gap_m[0], need), max(gap_m[1], need + 0.1)


@dataclass(frozen=True, eq=False)
class Item:
    """One thing to place: its parts about (0, 0), and discs (K, 3) that hold it and what must stay clear."""

    discs: Array
    polygons: tuple[Array, ...] = ()
    circles: Array = field(default_factory=lambda: np.empty((0, 3)))

    def at(self, x_m: float, y_m: float) -> "Item":
        """The same thing at (x, y)."""
        move = np.array([x_m, y_m, 0.0])
        return Item(self.discs + move, tuple(part + move[:2] for part in self.polygons), self.circles + move)

    def transposed(self) -> "Item":
        """The same thing with x and y exchanged."""
        # Mirrored corners run clockwise, hence their order is turned too.
        parts = tuple(part[::-1, ::-1] for part in self.polygons)
        return Item(self.discs[:, [1, 0, 2]], parts, self.circles[:, [1, 0, 2]])


def box_item(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> Item:
    """A rectangle centred at (x, y), its length along yaw."""
    shape = (x_m, y_m, length_m, width_m, yaw_rad)
    return Item(cover(*shape), (box(*shape),))


def circle_item(radius_m: float) -> Item:
    """A disc about (0, 0)."""
    circle = np.array([(0.0, 0.0, radius_m)])
    return Item(circle, circles=circle)


def trap_item(depth_m: float, width_m: float, yaw_rad: float) -> Item:
    """A U-trap about (0, 0): three thin boxes around a pocket that opens towards yaw and that nothing is put into."""
    parts = (
        box(0.0, 0.5 * width_m, depth_m, THIN_M),
        box(0.0, -0.5 * width_m, depth_m, THIN_M),
        box(-0.5 * depth_m, 0.0, THIN_M, width_m + THIN_M),
    )
    discs = cover(0.0, 0.0, depth_m + THIN_M, width_m + THIN_M, yaw_rad)
    return Item(discs, tuple(place(part, 0.0, 0.0, yaw_rad) for part in parts))


class Layout:
    """Obstacles of a walled rectangle under construction. Each new one keeps a gap to all that stand."""

    TRIES = 30

    def __init__(self, rng: np.random.Generator, bounds: Bounds, gap_m: tuple[float, float]) -> None:
        self.items: list[Item] = []
        self._rng = rng
        self._bounds = bounds
        self._gap_m = gap_m
        self._discs = np.empty((0, 3))

    def add(self, item: Item) -> None:
        """Put up an item where it is."""
        self.items.append(item)
        self.keep_clear(item.discs)

    def keep_clear(self, discs: Array) -> None:
        """What is placed from now on keeps its gap to discs (K, 3) x, y, radius too."""
        self._discs = np.concatenate([self._discs, discs])

    def scatter(self, count: int, draw: Callable[[np.random.Generator], Item]) -> None:
        """Place up to count items at random; one that fits at none of TRIES places is left out."""
        low, high = self._bounds[:2], self._bounds[2:]
        for _ in range(count):
            item, gap = draw(self._rng), self._rng.uniform(*self._gap_m)
            places = self._rng.uniform(low, high, (self.TRIES, 2))
            self._add_first_fitting(item, places, gap)

    def line_walls(self, count: int, draw: Callable[[np.random.Generator], tuple[float, float]]) -> None:
        """Place up to count boxes, (length, depth) each, with their backs to a wall; the rest as scatter()."""
        low, high = self._bounds[:2], self._bounds[2:]
        for _ in range(count):
            (length, depth), gap = draw(self._rng), self._rng.uniform(*self._gap_m)
            wall = int(self._rng.integers(4))
            axis = wall % 2  # of the wall's normal
            places = self._rng.uniform(low, high, (self.TRIES, 2))
            places[:, axis] = self._bounds[wall] + (0.5 if wall < 2 else -0.5) * depth
            sides = (depth, length) if axis == 0 else (length, depth)
            self._add_first_fitting(box_item(0.0, 0.0, *sides), places, gap, wall)

    def _add_first_fitting(self, item: Item, places: Array, gap_m: float, wall: int | None = None) -> None:
        fitting = self._fitting(item.discs, places, gap_m, wall)
        if len(fitting):
            self.add(item.at(*places[fitting[0]]))

    def _fitting(self, discs: Array, places: Array, gap_m: float, wall: int | None) -> NDArray[np.intp]:
        """Which of places (T, 2) discs (K, 3) can be moved to and keep the gap to walls and all there is.

        wall: the one that it may touch, an index into the bounds.
        """
        x_min, y_min, x_max, y_max = self._bounds
        x, y = places[:, :1] + discs[:, 0], places[:, 1:] + discs[:, 1]  # (T, K)
        reach = discs[:, 2] + gap_m
        to_walls = [x - x_min, y - y_min, x_max - x, y_max - y]
        least_to_walls = np.minimum.reduce([d for i, d in enumerate(to_walls) if i != wall])
        inside = np.flatnonzero((least_to_walls >= reach).all(axis=1))
        x, y = x[inside], y[inside]
        least = reach[:, None] + self._discs[:, 2]
        dx, dy = x[..., None] - self._discs[:, 0], y[..., None] - self._discs[:, 1]  # (T', K, D)
        return inside[(dx**2 + dy**2 >= least**2).all(axis=(1, 2))]


def walled_world(bounds: Bounds, items: list[Item]) -> World:
    """A world of items within four walls."""
    return World(
        bounds=bounds,
        circles=np.concatenate([np.empty((0, 3)), *(item.circles for item in items)]),
        polygons=tuple(part for item in items for part in item.polygons),
        segments=enclosure(bounds),
    )
