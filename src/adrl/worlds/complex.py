"""complex: a walled square of 17 x 17 m, dense with walls, narrow gaps, U-traps, boxes and circles.

Any two obstacles keep a gap that the robot fits through, so no place is shut off and every task is solvable;
what makes it hard is that the gaps are narrow, the walls force detours and the traps open to any side.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from adrl.planning.grid import FreeSpace
from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds.shapes import box, cover, enclosure, place
from adrl.worlds.tasks import draw_in_new_world


@dataclass(frozen=True, kw_only=True)
class Complex:
    """Start and goal are about 21 m of shortest path apart, the length of the paper's Table I."""

    name: str = "complex"
    size_m: float = 17.0
    """Side of the walled square."""
    partitions: int = 2
    """Walls from side to side, each with one to three gaps."""
    gap_m: tuple[float, float] = (0.7, 1.0)
    """Width of the gaps in walls and least distance of obstacles; widened for a robot that needs more."""
    traps: int = 4
    """U-traps: three thin boxes, open to one side."""
    walls: int = 4
    """Free-standing thin walls."""
    boxes: int = 14
    circles: int = 22
    path_m: tuple[float, float] = (19.0, 23.0)
    """Least and greatest length of the shortest path."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world whose gaps this robot fits through."""
        layout = Layout(rng, self.size_m, _gap_range(self.gap_m, robot))
        for i in range(self.partitions):
            layout.add_partition((i + rng.uniform(0.85, 1.15)) / (self.partitions + 1))
        layout.transpose_half_of_the_time()
        layout.scatter(self.traps, _draw_trap)
        layout.scatter(self.walls, _draw_wall)
        layout.scatter(self.boxes, _draw_box)
        layout.scatter(self.circles, _draw_circle)
        return layout.world()

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal. Raises TaskError for a robot too large for it."""
        return self.draw(rng, robot)[0]

    def draw(
        self, rng: np.random.Generator, robot: RobotConfig, limit_m: float = 0.0
    ) -> tuple[Task, FreeSpace]:
        """As task(), with the free space it was drawn from; its clearances reach to limit_m at least."""
        low, high = self.path_m
        return draw_in_new_world(
            self, rng, robot, path_range_m=self.path_m, straight_range_m=(0.78 * low, high), limit_m=limit_m
        )


def _gap_range(gap_m: tuple[float, float], robot: RobotConfig) -> tuple[float, float]:
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


def _draw_trap(rng: np.random.Generator) -> Item:
    """Three thin boxes around a pocket, open towards a random side."""
    depth, width, yaw = rng.uniform(0.8, 1.4), rng.uniform(1.0, 1.8), rng.uniform(-math.pi, math.pi)
    thick = 0.12
    parts = (
        box(0.0, 0.5 * width, depth, thick),
        box(0.0, -0.5 * width, depth, thick),
        box(-0.5 * depth, 0.0, thick, width + thick),
    )
    discs = cover(0.0, 0.0, depth + thick, width + thick, yaw)
    return Item(discs, tuple(place(part, 0.0, 0.0, yaw) for part in parts))


def _draw_wall(rng: np.random.Generator) -> Item:
    return _box_item(rng.uniform(1.2, 2.6), 0.12, rng.uniform(-math.pi, math.pi))


def _draw_box(rng: np.random.Generator) -> Item:
    return _box_item(rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), rng.uniform(-math.pi, math.pi))


def _box_item(length_m: float, width_m: float, yaw_rad: float) -> Item:
    shape = (0.0, 0.0, length_m, width_m, yaw_rad)
    return Item(cover(*shape), (box(*shape),))


def _draw_circle(rng: np.random.Generator) -> Item:
    circle = np.array([(0.0, 0.0, rng.uniform(0.15, 0.45))])
    return Item(circle, circles=circle)


class Layout:
    """Obstacles of a world under construction. Each new one keeps a gap to all that stand."""

    THICKNESS_M = 0.15
    TRIES = 30

    def __init__(self, rng: np.random.Generator, size_m: float, gap_m: tuple[float, float]) -> None:
        self._rng = rng
        self._size_m = size_m
        self._gap_m = gap_m
        self._discs = np.empty((0, 3))
        self._items: list[Item] = []

    def add_partition(self, at: float) -> None:
        """A thin wall along x = at * size, with one to three gaps."""
        x = at * self._size_m
        gaps = np.sort(self._rng.uniform(0.06, 0.94, self._rng.integers(1, 4))) * self._size_m
        low = 0.0
        pieces = []
        for middle in gaps:
            half = 0.5 * self._rng.uniform(*self._gap_m)
            if middle - half - low < self.THICKNESS_M:
                continue  # two gaps that meet: keep the first
            pieces.append((low, middle - half))
            low = middle + half
        pieces.append((low, self._size_m))
        for bottom, top in pieces:
            shape = (x, 0.5 * (bottom + top), self.THICKNESS_M, top - bottom, 0.0)
            self._add(Item(cover(*shape), (box(*shape),)))

    def transpose_half_of_the_time(self) -> None:
        """Exchange x and y of all that stands, or leave it."""
        if self._rng.random() < 0.5:
            # Mirrored corners run clockwise, hence their order is turned too.
            self._items = [Item(i.discs, tuple(p[::-1, ::-1] for p in i.polygons)) for i in self._items]
            self._discs = self._discs[:, [1, 0, 2]]

    def scatter(self, count: int, draw: Callable[[np.random.Generator], Item]) -> None:
        """Place up to count items at random; one that fits at none of TRIES places is left out."""
        for _ in range(count):
            item, gap = draw(self._rng), self._rng.uniform(*self._gap_m)
            places = self._rng.uniform(0.0, self._size_m, (self.TRIES, 2))
            fitting = self._fitting(item.discs, places, gap)
            if len(fitting):
                self._add(item.at(*places[fitting[0]]))

    def world(self) -> World:
        """What has been placed, walled in."""
        bounds = (0.0, 0.0, self._size_m, self._size_m)
        return World(
            bounds=bounds,
            circles=np.concatenate([item.circles for item in self._items]),
            polygons=tuple(part for item in self._items for part in item.polygons),
            segments=enclosure(bounds),
        )

    def _add(self, item: Item) -> None:
        self._items.append(item)
        self._discs = np.concatenate([self._discs, item.discs])

    def _fitting(self, discs: Array, places: Array, gap_m: float) -> NDArray[np.intp]:
        """Which of places (T, 2) discs (K, 3) can be moved to and keep the gap to walls and all there is."""
        x, y = places[:, :1] + discs[:, 0], places[:, 1:] + discs[:, 1]  # (T, K)
        reach = discs[:, 2] + gap_m
        to_walls = np.minimum.reduce([x, self._size_m - x, y, self._size_m - y])
        inside = np.flatnonzero((to_walls >= reach).all(axis=1))
        x, y = x[inside], y[inside]
        least = reach[:, None] + self._discs[:, 2]
        dx, dy = x[..., None] - self._discs[:, 0], y[..., None] - self._discs[:, 1]  # (T', K, D)
        return inside[(dx**2 + dy**2 >= least**2).all(axis=(1, 2))]
