"""Slow, obvious Python twins of the core's own map, its routes and its choice of a waypoint."""

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array

Cell = tuple[int, int]
UNIT, DIAGONAL_UNITS = 64, 90
MOVES = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
"""(row, column), counter-clockwise from the x axis."""
HIT, MISS, LOW, HIGH = 30, 6, -20, 60


def log_odds(evidence: int, *, once_free: bool = False) -> int:
    """What a cell holds."""
    return 2 * evidence - once_free


WALL = log_odds(HIGH)
"""What is surely solid and was never surely free."""
GUEST = log_odds(HIGH, once_free=True)
"""What is surely solid and was surely free once."""


def evidence_of(cell: int) -> tuple[int, bool]:
    """And what it says: its evidence, and whether it has once been surely free."""
    return math.ceil(cell / 2), cell % 2 == 1


@dataclass(frozen=True, kw_only=True)
class Costs:
    """RouteCosts of the core, same names."""

    inflation_m: float = 0.1
    comfort_m: float = 0.15
    near_goal_m: float = 0.6
    weight: float = 1.0
    k_obstacle: float = 0.6
    k_goal: float = 0.1
    k_turn: float = 0.3
    turn_m: float = 0.05
    headings: bool = False
    resolution_m: float = 0.05


def integrate(
    cells: NDArray[np.int8],
    origin: Cell,
    resolution_m: float,
    pose: Array,
    ranges: Array,
    angles: Array,
    max_range_m: float,
    parity: int,
) -> None:
    """One scan of a full circle of beams, from a LiDAR at the robot's origin, into a window (H, W). In place."""
    height, width = cells.shape
    x, y = pose[0] / resolution_m - origin[1], pose[1] / resolution_m - origin[0]
    marked: set[Cell] = set()
    count = len(ranges)
    beams = [(math.cos(pose[2] + a), math.sin(pose[2] + a)) for a in angles]
    for (dx, dy), r in zip(beams, ranges, strict=True):
        if not 0.0 < r < max_range_m - 1e-4:
            continue
        reach = r / resolution_m + 0.5
        cell = math.floor(y + reach * dy), math.floor(x + reach * dx)
        if 0 <= cell[0] < height and 0 <= cell[1] < width and cell not in marked:
            marked.add(cell)
            evidence, once_free = evidence_of(int(cells[cell]))
            cells[cell] = log_odds(min(evidence + HIT, HIGH), once_free=once_free)
    for i in range(parity, count, 2):
        dx, dy = beams[i]
        free = min(ranges[i - 1], ranges[i], ranges[(i + 1) % count], max_range_m) / resolution_m - 1.0
        longer = max(abs(dx), abs(dy))
        for k in range(math.floor(free * longer) + 1):
            cell = math.floor(y + k * dy / longer), math.floor(x + k * dx / longer)
            if 0 <= cell[0] < height and 0 <= cell[1] < width and cell not in marked:
                marked.add(cell)
                evidence, once_free = evidence_of(int(cells[cell]))
                evidence = max(evidence - MISS, LOW)
                cells[cell] = log_odds(evidence, once_free=once_free or evidence == LOW)


class Grid:
    """Levels, densities and integer move costs of a window, from the definitions."""

    def __init__(self, solid: NDArray[np.bool_], costs: Costs, start: Cell, target: Cell) -> None:
        self.costs, self.target = costs, target
        self.shape = solid.shape
        res = costs.resolution_m
        limit = max(1, math.ceil((costs.inflation_m + costs.comfort_m) / res))
        at = np.argwhere(solid)
        rows, columns = np.indices(solid.shape)
        squared = np.full(solid.shape, limit**2)
        for r, c in at:
            squared = np.minimum(squared, (rows - r) ** 2 + (columns - c) ** 2)
        spare = (np.sqrt(squared) - costs.inflation_m / res) / (costs.comfort_m / res)
        level = 1 + np.floor(254 * np.clip(1 - spare, 0, 1) + 0.5).astype(int)
        level[(np.sqrt(squared) < costs.inflation_m / res - 1e-6) | (squared == 0)] = 0
        # Around the start as much clearance is asked for as it has.
        reach = math.ceil(costs.inflation_m / res) + 1
        near = (rows - start[0]) ** 2 + (columns - start[1]) ** 2 <= reach**2
        level[(level == 0) & near & (squared >= max(squared[start], 1))] = 255
        level[start] = level[start] or 255
        self.level = level

    def is_free(self, cell: Cell) -> bool:
        height, width = self.shape
        return 0 <= cell[0] < height and 0 <= cell[1] < width and self.level[cell] > 0

    def obstacle_density(self, cell: Cell) -> float:
        return (self.level[cell] - 1) / 254 if self.level[cell] else 1.0

    def entering(self, cell: Cell) -> int:
        dr, dc = abs(cell[0] - self.target[0]), abs(cell[1] - self.target[1])
        octile = UNIT * (max(dr, dc) - min(dr, dc)) + DIAGONAL_UNITS * min(dr, dc)
        costs = self.costs
        away = min(octile / (costs.near_goal_m / costs.resolution_m * UNIT), 1.0)
        density = costs.k_obstacle * self.obstacle_density(cell) + costs.k_goal * away
        return math.ceil(UNIT * (1.0 + costs.weight * density) - 1e-9)

    def moves(self, cell: Cell) -> list[tuple[int, Cell, int]]:
        """(move, next cell, units) of the moves from a cell; corners are not cut."""
        found = []
        for move, (dr, dc) in enumerate(MOVES):
            following = cell[0] + dr, cell[1] + dc
            beside = (cell[0] + dr, cell[1]), (cell[0], cell[1] + dc)
            if self.is_free(following) and all(self.is_free(side) for side in beside):
                straight = self.entering(following)
                found.append((move, following, straight if move % 2 == 0 else -(-straight * 1449 // 1024)))
        return found


def dijkstra(grid: Grid, start: Cell, heading_rad: float) -> dict[Cell, int]:
    """Least units from the start to every cell that can be reached; headings in the state where costs say so."""
    costs = grid.costs
    eighth = 0.25 * math.pi * costs.turn_m / costs.resolution_m * UNIT
    curved = 0.25 * costs.weight * costs.k_turn * UNIT
    turn_units = round(eighth + curved), round(eighth + curved * math.sqrt(2.0))
    first = (start, round(heading_rad / (0.25 * math.pi)) % 8 if costs.headings else 0)
    best = {first: 0}
    queue = [(0, first)]
    done: dict[Cell, int] = {}
    while queue:
        cost, state = heapq.heappop(queue)
        if cost > best[state]:
            continue
        cell, heading = state
        done.setdefault(cell, cost)
        for move, following, units in grid.moves(cell):
            turn = min((move - heading) % 8, (heading - move) % 8) if costs.headings else 0
            through = cost + units + turn * turn_units[move % 2]
            reached = following, move if costs.headings else 0
            if through < best.get(reached, 1 << 60):
                best[reached] = through
                heapq.heappush(queue, (through, reached))
    return done
