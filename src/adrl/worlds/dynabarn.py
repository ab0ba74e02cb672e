"""dynabarn: DynaBARN's kind of world (Nair et al. 2022): cylinders that cross an open square along random polynomials.

Spawn, goal, its tolerance, the square and the cylinders' radius are as published; how many there are, the degrees and
the speeds are ours. They run to and fro along their curves and see nothing: where the benchmark's cylinders jump back
to the beginning of theirs, these turn.
"""

import math
from dataclasses import dataclass

import numpy as np

from adrl.types import Array, People, RobotConfig, Task, World
from adrl.worlds.tasks import time_limit_s

HALF_M = 10.0
"""Half a side of the square."""
START, GOAL = (12.0, 0.0, math.pi), (-9.0, 0.0)
GOAL_TOLERANCE_M = 0.3
WALLS = np.array([(10.0, 10.0, -10.0, 10.0), (-10.0, 10.0, -10.0, -10.0), (-10.0, -10.0, 10.0, -10.0)])
"""Open towards +x, whence the robot comes."""
KNOT_M = 1.0
"""Between two points of a curve."""


@dataclass(frozen=True, kw_only=True)
class DynaBarn:
    """The benchmark drives a Jackal of at most 0.5 m/s: robot jackal_dynabarn."""

    name: str = "dynabarn"
    count: tuple[int, int] = (8, 20)
    """Fewest and most cylinders."""
    degree: tuple[int, int] = (1, 3)
    """Of the polynomials."""
    speed_mps: tuple[float, float] = (0.3, 1.5)
    radius_m: float = 0.5

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw the cylinders. Start, goal and walls are always the same."""
        count = int(rng.integers(self.count[0], self.count[1] + 1))
        curves = [self._draw_curve(rng) for _ in range(count)]
        shortest_m = START[0] - GOAL[0]
        return Task(
            world=World(bounds=(-HALF_M, -HALF_M, START[0] + 1.0, HALF_M), segments=WALLS),
            start=START,
            goal=GOAL,
            path=np.array([START[:2], GOAL]),
            shortest_m=shortest_m,
            time_limit_s=time_limit_s(shortest_m, robot),
            goal_tolerance_m=GOAL_TOLERANCE_M,
            people=People(
                routes=tuple(curves),
                radius_m=np.full(count, self.radius_m),
                speed_mps=rng.uniform(*self.speed_mps, count),
                share=np.zeros(count),
                reaction_s=np.zeros(count),
                group=np.full(count, -1),
                blind=np.ones(count, dtype=bool),
            ),
        )

    def _draw_curve(self, rng: np.random.Generator) -> Array:
        """(W, 2) points on a polynomial through degree + 1 random places, as far as it stays in the square; it begins
        anywhere on its way, in either direction, and x and y may be exchanged."""
        half = HALF_M - self.radius_m
        while True:
            degree = int(rng.integers(self.degree[0], self.degree[1] + 1))
            x = np.linspace(-half, half, 400)
            knots = rng.uniform(-half, half, (2, degree + 1))
            y = np.polyval(np.polyfit(knots[0], knots[1], degree), x)
            inside = np.abs(y) <= half
            if not inside.any():
                continue
            curve = np.column_stack([x, y])[_longest_run(inside)]
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
            if along[-1] < 4.0:
                continue
            at = np.linspace(0.0, along[-1], math.ceil(along[-1] / KNOT_M) + 1)
            points = np.column_stack([np.interp(at, along, curve[:, k]) for k in (0, 1)])
            if rng.random() < 0.5:
                points = points[:, ::-1]
            return points[::-1] if rng.random() < 0.5 else points


def _longest_run(flags: Array) -> slice:
    """The longest stretch of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return slice(int(begins[longest]), int(ends[longest]))
