"""rooms: a floor of furnished rooms with doors, 14 x 14 m.

Doors make a tree of the rooms, and a few more doors make loops, so that the way leads through rooms and seldom along
the straight line. Furniture keeps a gap to all but the wall behind it and leaves doors clear: every task is solvable.
"""

import math
from dataclasses import dataclass

import numpy as np

from adrl.types import RobotConfig, Task, World
from adrl.worlds.layout import Bounds, Item, Layout, box_item, circle_item, gap_range, walled_world
from adrl.worlds.tasks import draw_in_new_world

JAMB_M = 0.2
"""Least wall between a door and a corner, beyond the corner's own wall."""


@dataclass(frozen=True, kw_only=True)
class Rooms:
    """Start and goal are in different rooms."""

    name: str = "rooms"
    size_m: float = 14.0
    """Side of the building."""
    room_m: tuple[float, float] = (2.4, 5.0)
    """Least and greatest side of a room, walls included; widened for a robot whose doors need more. The greatest is
    twice the least or more."""
    wall_thickness_m: tuple[float, float] = (0.12, 0.15)
    door_m: tuple[float, float] = (0.8, 1.1)
    """Width of doors; widened for a robot that needs more."""
    gap_m: tuple[float, float] = (0.6, 0.7)
    """Least distance of furniture; widened likewise."""
    extra_doors: float = 0.1
    """Share of the walls between two rooms that get a door although the rooms are connected without it."""
    cupboards: tuple[int, int] = (2, 4)
    """Fewest and most boxes with their backs to a wall, tried for each room."""
    tables: tuple[int, int] = (1, 3)
    """The same of boxes and circles that stand free."""
    straight_m: tuple[float, float] = (3.0, 12.0)
    """Least straight distance from start to goal, and the greatest of the pairs tried: paths too long are cut."""
    path_m: tuple[float, float] = (8.0, 20.0)
    """Least and greatest length of the shortest path. The least is more than one room holds."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a world whose doors this robot fits through."""
        plan = self.floor_plan(rng, robot)
        gap_m = gap_range(self.gap_m, robot)
        keep_clear = np.array([door.disc for door in plan.doors]).reshape(-1, 3)
        items = [piece for wall in plan.walls for piece in plan.pieces(wall)]
        for room in plan.rooms:
            layout = Layout(rng, _inside(room, plan.thickness_m, self.size_m), gap_m)
            layout.keep_clear(keep_clear)
            layout.line_walls(int(rng.integers(self.cupboards[0], self.cupboards[1] + 1)), _draw_cupboard)
            layout.scatter(int(rng.integers(self.tables[0], self.tables[1] + 1)), _draw_table)
            items += layout.items
        return walled_world((0.0, 0.0, self.size_m, self.size_m), items)

    def floor_plan(self, rng: np.random.Generator, robot: RobotConfig) -> "FloorPlan":
        """Draw walls and doors alone: what generate() begins with."""
        doors_m = gap_range(self.door_m, robot)
        thickness_m = rng.uniform(*self.wall_thickness_m)
        jamb_m = JAMB_M + 0.5 * thickness_m
        # Somewhere on each wall two rooms share as much of it as a room's least side: it must hold the widest door.
        least_m = max(self.room_m[0], doors_m[1] + 2.0 * jamb_m)
        area = (0.0, 0.0, self.size_m, self.size_m)
        rooms, walls = _split(rng, area, least_m, max(self.room_m[1], 2.0 * least_m))
        doors = _draw_doors(rng, rooms, doors_m, jamb_m, self.extra_doors)
        return FloorPlan(tuple(rooms), tuple(walls), tuple(doors), thickness_m)

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal. Raises TaskError for a robot too large for it."""
        task, _ = draw_in_new_world(
            self, rng, robot, path_range_m=self.path_m, straight_range_m=self.straight_m
        )
        return task


@dataclass(frozen=True)
class Wall:
    """A wall between rooms, by its centre line. It may hold several doors."""

    axis: int
    """0: along y at a place of x; 1: along x at a place of y."""
    at_m: float
    low_m: float
    high_m: float


@dataclass(frozen=True)
class Door:
    """An opening in a wall."""

    axis: int
    at_m: float
    """As of the wall it is in."""
    middle_m: float
    width_m: float

    @property
    def disc(self) -> tuple[float, float, float]:
        """x, y, radius of what furniture keeps its gap to."""
        x, y = (self.at_m, self.middle_m) if self.axis == 0 else (self.middle_m, self.at_m)
        return x, y, 0.5 * self.width_m


@dataclass(frozen=True)
class FloorPlan:
    """The building without its furniture."""

    rooms: tuple[Bounds, ...]
    """Between the centre lines of their walls."""
    walls: tuple[Wall, ...]
    doors: tuple[Door, ...]
    thickness_m: float

    def pieces(self, wall: Wall) -> list[Item]:
        """A wall's boxes, between its doors."""
        inside = [door for door in self.doors if (door.axis, door.at_m) == (wall.axis, wall.at_m)]
        low, ends = wall.low_m, []
        for door in sorted(inside, key=lambda door: door.middle_m):
            ends.append((low, door.middle_m - 0.5 * door.width_m))
            low = door.middle_m + 0.5 * door.width_m
        ends.append((low, wall.high_m))
        along_y = [box_item(wall.at_m, 0.5 * (a + b), self.thickness_m, b - a) for a, b in ends]
        return along_y if wall.axis == 0 else [piece.transposed() for piece in along_y]


def _split(
    rng: np.random.Generator, area: Bounds, least_m: float, greatest_m: float
) -> tuple[list[Bounds], list[Wall]]:
    """Halve an area across its longer side until no side is longer than greatest_m, nor one shorter than least_m."""
    low, high = area[:2], area[2:]
    sides = high[0] - low[0], high[1] - low[1]
    axis = 0 if sides[0] >= sides[1] else 1
    if sides[axis] <= greatest_m:
        return [area], []
    at = float(rng.uniform(low[axis] + least_m, high[axis] - least_m))
    first = (low[0], low[1], at, high[1]) if axis == 0 else (low[0], low[1], high[0], at)
    second = (at, low[1], high[0], high[1]) if axis == 0 else (low[0], at, high[0], high[1])
    wall = Wall(axis, at, low[1 - axis], high[1 - axis])
    rooms, walls = _split(rng, first, least_m, greatest_m)
    more_rooms, more_walls = _split(rng, second, least_m, greatest_m)
    return rooms + more_rooms, [wall, *walls, *more_walls]


def _draw_doors(
    rng: np.random.Generator,
    rooms: list[Bounds],
    width_m: tuple[float, float],
    jamb_m: float,
    extra: float,
) -> list[Door]:
    """Doors that connect all rooms, and some more."""
    shared = [
        (a, b, *wall)
        for a, first in enumerate(rooms)
        for b, second in enumerate(rooms)
        if (wall := _shared_wall(first, second)) is not None
        and wall[3] - wall[2] >= width_m[1] + 2.0 * jamb_m
    ]
    group = np.arange(len(rooms))
    doors = []
    for i in rng.permutation(len(shared)):
        a, b, axis, at, low, high = shared[i]
        joins = group[a] != group[b]
        if not joins and rng.random() >= extra:
            continue
        group[group == group[b]] = group[a]
        width = float(rng.uniform(*width_m))
        reach = jamb_m + 0.5 * width
        doors.append(Door(axis, at, float(rng.uniform(low + reach, high - reach)), width))
    return doors


def _shared_wall(first: Bounds, second: Bounds) -> tuple[int, float, float, float] | None:
    """Axis, place, low and high end of the wall at the upper end of the first room and the lower one of the second."""
    for axis in (0, 1):
        if first[2 + axis] == second[axis]:
            low = max(first[1 - axis], second[1 - axis])
            high = min(first[3 - axis], second[3 - axis])
            if low < high:
                return axis, first[2 + axis], low, high
    return None


def _inside(room: Bounds, thickness_m: float, size_m: float) -> Bounds:
    """The room between the faces of its walls; the building's own have no thickness."""
    half = 0.5 * thickness_m
    low = [side if side == 0.0 else side + half for side in room[:2]]
    high = [side if side == size_m else side - half for side in room[2:]]
    return low[0], low[1], high[0], high[1]


def _draw_cupboard(rng: np.random.Generator) -> tuple[float, float]:
    """Length along its wall and depth."""
    return rng.uniform(0.5, 1.6), rng.uniform(0.3, 0.6)


def _draw_table(rng: np.random.Generator) -> Item:
    if rng.random() < 0.5:
        return circle_item(rng.uniform(0.15, 0.45))
    return box_item(0.0, 0.0, rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), rng.uniform(-math.pi, math.pi))
