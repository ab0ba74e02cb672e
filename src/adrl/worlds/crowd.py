"""crowd, corridor and doorway: small places made for people. office is rooms with people."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds.layout import THIN_M, Bounds, box_item, gap_range, walled_world
from adrl.worlds.people import Ground, anywhere
from adrl.worlds.shapes import enclosure
from adrl.worlds.tasks import draw_in_new_world

EDGE_M = 0.6
"""Between a wall and where people set out."""


@dataclass(frozen=True, kw_only=True)
class Square:
    """A walled square with nothing in it."""

    name: str = "crowd"
    size_m: float = 10.0
    straight_m: tuple[float, float] = (6.0, 11.0)
    """Least and greatest distance from start to goal."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """The square; nothing is drawn."""
        bounds = (0.0, 0.0, self.size_m, self.size_m)
        return World(bounds=bounds, segments=enclosure(bounds))

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw start and goal. Raises TaskError."""
        ways = self.straight_m
        return draw_in_new_world(self, rng, robot, path_range_m=ways, straight_range_m=ways)[0]


def crowd_walks(rng: np.random.Generator, ground: Ground) -> Iterator[Array | None]:
    """One of three kinds for all: through the middle of a circle, two streams that cross, anywhere."""
    kind = ("circle", "crossing", "random")[int(rng.integers(3))]
    if kind == "random":
        yield from anywhere(rng, ground)
    x_min, y_min, x_max, y_max = ground.bounds
    low, high = np.array([x_min, y_min]) + EDGE_M, np.array([x_max, y_max]) - EDGE_M
    middle, reach = 0.5 * (low + high), 0.5 * float((high - low).min())
    while True:
        if kind == "circle":
            angle = rng.uniform(-math.pi, math.pi)
            ahead = rng.uniform(0.75, 1.0) * reach * np.array([math.cos(angle), math.sin(angle)])
            a, b = middle - ahead, middle + ahead + rng.uniform(-0.3, 0.3, 2)
        else:
            a, b = rng.uniform(low, high), rng.uniform(low, high)
            axis = int(rng.integers(2))
            a[axis], b[axis] = low[axis], high[axis]
            b[1 - axis] = np.clip(a[1 - axis] + rng.uniform(-1.0, 1.0), low[1 - axis], high[1 - axis])
            # Some have come a part of their way already.
            a = a + rng.uniform(0.0, 0.4) * (b - a)
        yield np.array([a, b])


@dataclass(frozen=True, kw_only=True)
class Passage:
    """A straight corridor, walled all round, driven from one end to the other."""

    name: str = "corridor"
    length_m: float = 16.0
    width_m: tuple[float, float] = (2.0, 3.0)
    """Widened for a robot that could not pass a person in it."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw a corridor along x."""
        least = 2.0 * robot.circumscribed_radius_m + 1.0
        width = max(float(rng.uniform(*self.width_m)), least)
        bounds = (0.0, 0.0, self.length_m, width)
        return World(bounds=bounds, segments=enclosure(bounds))

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a corridor, and start and goal near its ends. Raises TaskError."""
        ways = (0.65 * self.length_m, self.length_m)
        return draw_in_new_world(self, rng, robot, path_range_m=ways, straight_range_m=ways)[0]


def opposing_flows(rng: np.random.Generator, ground: Ground) -> Iterator[Array | None]:
    """Along a corridor from end to end, half of the people each way."""
    x_min, y_min, x_max, y_max = ground.bounds
    for k in range(2**31):
        ends = (x_min + EDGE_M, x_max - EDGE_M) if k % 2 == 0 else (x_max - EDGE_M, x_min + EDGE_M)
        a, b = (np.array([x, rng.uniform(y_min, y_max)]) for x in ends)
        a[0] += rng.uniform(0.0, 0.9) * (b[0] - a[0])
        yield np.array([a, b]) if ground.is_free(a) and ground.is_free(b) else None


@dataclass(frozen=True, kw_only=True)
class TwoRooms:
    """Two rooms with one door between them; start and goal are on its two sides."""

    name: str = "doorway"
    room_m: float = 5.0
    """Side of a room."""
    door_m: tuple[float, float] = (1.0, 1.4)
    """Width of the door; widened for a robot that needs more."""

    def generate(self, rng: np.random.Generator, robot: RobotConfig) -> World:
        """Draw the door's place and width."""
        bounds: Bounds = (0.0, 0.0, 2.0 * self.room_m, self.room_m)
        half = 0.5 * float(rng.uniform(*gap_range(self.door_m, robot)))
        middle = float(rng.uniform(0.3, 0.7)) * self.room_m
        pieces = [(0.0, middle - half), (middle + half, self.room_m)]
        walls = [box_item(self.room_m, 0.5 * (low + high), THIN_M, high - low) for low, high in pieces]
        return walled_world(bounds, walls)

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a door, and start and goal on its two sides. Raises TaskError for a robot too large for the rooms."""
        while True:
            ways = (0.8 * self.room_m, 3.0 * self.room_m)
            task, _ = draw_in_new_world(self, rng, robot, path_range_m=ways, straight_range_m=ways)
            if (task.start[0] - self.room_m) * (task.goal[0] - self.room_m) < 0.0:
                return task


def through_the_door(rng: np.random.Generator, ground: Ground) -> Iterator[Array | None]:
    """From any place in one room to any in the other."""
    middle = 0.5 * (ground.bounds[0] + ground.bounds[2])
    while True:
        a, b = ground.draw(rng), ground.draw(rng)
        yield ground.route(a, b) if (a[0] - middle) * (b[0] - middle) < 0.0 else None
