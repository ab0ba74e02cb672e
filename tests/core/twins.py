"""Slow, obvious Python twins of the core's kernels.

What the LiDAR sees and what a footprint hits come from one list of shapes: circles, and convex polygons, of
which a segment is one of two corners and a solid cell one of four.
"""

import heapq
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array, OccupancyGrid, World

Point = tuple[float, float]
Pose = tuple[float, float, float]
Corners = list[Point]
Circle = tuple[float, float, float]
Cell = tuple[int, int]

DIAGONAL = math.sqrt(2.0)


# --- geometry -----------------------------------------------------------------------------------


def _cross(a: Point, b: Point) -> float:
    return a[0] * b[1] - a[1] * b[0]


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1]


def placed(pose: Pose, local: Point) -> Point:
    """A point given in the frame of a pose, in the world."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return pose[0] + c * local[0] - s * local[1], pose[1] + s * local[0] + c * local[1]


def edges(corners: Corners) -> Iterator[tuple[Point, Point]]:
    """Pairs of neighbouring corners, the last with the first."""
    for i, a in enumerate(corners):
        yield a, corners[(i + 1) % len(corners)]


def disc_place(disc: Array, time_s: float) -> Circle:
    """Where a moving disc is: it runs from end to end and back at constant speed until stop_s."""
    x1, y1, x2, y2, radius, speed, phase, stop_s = (float(value) for value in disc)
    length = math.hypot(x2 - x1, y2 - y1)
    if length == 0.0:
        return x1, y1, radius
    run = (phase * 2.0 * length + speed * min(time_s, stop_s)) % (2.0 * length)
    along = min(run, 2.0 * length - run) / length
    return x1 + along * (x2 - x1), y1 + along * (y2 - y1), radius


def cell_corners(grid: OccupancyGrid, row: int, column: int) -> Corners:
    """The square of a cell in the world, counter-clockwise."""
    r = grid.resolution_m
    square = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
    return [placed(grid.origin, (r * x, r * y)) for x, y in square]


def shapes(world: World, time_s: float = 0.0) -> tuple[list[Circle], list[Corners]]:
    """All that exists at one instant: circles, and convex polygons of two or more corners."""
    circles = [(float(x), float(y), float(r)) for x, y, r in world.circles]
    circles += [disc_place(disc, time_s) for disc in world.discs]
    polygons: list[Corners] = [[(float(x), float(y)) for x, y in polygon] for polygon in world.polygons]
    polygons += [[(float(x1), float(y1)), (float(x2), float(y2))] for x1, y1, x2, y2 in world.segments]
    if world.grid is not None:
        polygons += [
            cell_corners(world.grid, int(row), int(column)) for row, column in np.argwhere(world.grid.solid)
        ]
    return circles, polygons


def inside(corners: Corners, p: Point) -> bool:
    """Whether a point lies in a closed convex polygon; nothing lies in a segment."""
    return len(corners) > 2 and all(_cross(_minus(b, a), _minus(p, a)) >= 0.0 for a, b in edges(corners))


# --- ray casting --------------------------------------------------------------------------------


def ray_circle(origin: Point, direction: Point, circle: Circle) -> float:
    """Metres along a ray to where it enters a circle; infinity when it does not."""
    to = (circle[0] - origin[0], circle[1] - origin[1])
    along = to[0] * direction[0] + to[1] * direction[1]
    beside2 = to[0] ** 2 + to[1] ** 2 - along**2
    if along < 0.0 or beside2 > circle[2] ** 2:
        return math.inf
    return along - math.sqrt(circle[2] ** 2 - beside2)


def ray_segment(origin: Point, direction: Point, a: Point, b: Point) -> float:
    """Metres along a ray to a segment; infinity when it passes by or runs alongside."""
    e, to = _minus(b, a), _minus(a, origin)
    slope = _cross(direction, e)
    if abs(slope) <= 1e-9 * math.hypot(*e):
        return math.inf
    t, u = _cross(to, e) / slope, _cross(to, direction) / slope
    return t if t >= 0.0 and 0.0 <= u <= 1.0 else math.inf


def ray(world: World, origin: Point, angle_rad: float, max_range_m: float, time_s: float = 0.0) -> float:
    """Range of one beam: 0 from inside an obstacle, max_range_m when nothing is hit."""
    circles, polygons = shapes(world, time_s)
    direction = (math.cos(angle_rad), math.sin(angle_rad))
    hits = [max_range_m]
    for circle in circles:
        deep = math.dist(origin, circle[:2]) <= circle[2]
        hits.append(0.0 if deep else ray_circle(origin, direction, circle))
    for corners in polygons:
        if inside(corners, origin):
            hits.append(0.0)
        hits += [ray_segment(origin, direction, a, b) for a, b in edges(corners)]
    return min(hits)


# --- clearance ----------------------------------------------------------------------------------


def point_to_segment(p: Point, a: Point, b: Point) -> float:
    """Distance from a point to a segment."""
    e, to = _minus(b, a), _minus(p, a)
    length2 = e[0] ** 2 + e[1] ** 2
    u = 0.0 if length2 == 0.0 else min(1.0, max(0.0, (e[0] * to[0] + e[1] * to[1]) / length2))
    return math.dist(p, (a[0] + u * e[0], a[1] + u * e[1]))


def point_to_polygon(p: Point, corners: Corners) -> float:
    """Distance from a point to a convex polygon; 0 inside."""
    return 0.0 if inside(corners, p) else min(point_to_segment(p, a, b) for a, b in edges(corners))


def overlap(one: Corners, other: Corners) -> bool:
    """Separating axes: two convex polygons are apart when the normal of some edge tells them apart."""
    sides = [_minus(b, a) for corners in (one, other) for a, b in edges(corners)]
    # Two segments on one line are told apart along the line, which is the normal of neither.
    for side in sides + [(-side[1], side[0]) for side in sides]:
        first, second = ([_cross(side, p) for p in corners] for corners in (one, other))
        if max(first) < min(second) or max(second) < min(first):
            return False
    return True


def polygon_to_polygon(one: Corners, other: Corners) -> float:
    """Distance between convex polygons: apart, the nearest points include a corner of one of them."""
    if overlap(one, other):
        return 0.0
    return min(
        point_to_segment(p, a, b)
        for corners, others in ((one, other), (other, one))
        for p in corners
        for a, b in edges(others)
    )


def clearance(
    world: World, pose: Pose, radius_m: float, footprint: Array, limit_m: float, time_s: float = 0.0
) -> float:
    """Distance from the footprint's edge to the nearest obstacle, at most limit_m; 0 or less in overlap."""
    circles, polygons = shapes(world, time_s)
    gaps = [limit_m]
    if len(footprint) == 0:
        p = pose[:2]
        gaps += [math.dist(p, circle[:2]) - circle[2] - radius_m for circle in circles]
        gaps += [point_to_polygon(p, corners) - radius_m for corners in polygons]
    else:
        body = [placed(pose, (float(x), float(y))) for x, y in footprint]
        gaps += [point_to_polygon(circle[:2], body) - circle[2] for circle in circles]
        gaps += [polygon_to_polygon(body, corners) for corners in polygons]
    return min(gaps)


def distance_field(solid: NDArray[np.uint8]) -> Array:
    """(H, W) -> (H, W) cells from each centre to the nearest solid cell's centre: looks at all of them."""
    rows, columns = np.indices(solid.shape)
    least = np.full(solid.shape, np.inf)
    for row, column in np.argwhere(solid):
        least = np.minimum(least, np.hypot(rows - row, columns - column))
    return least


# --- planning -----------------------------------------------------------------------------------


def moves(blocked: NDArray[np.uint8], cell: Cell) -> Iterator[tuple[Cell, float]]:
    """Free neighbours of a cell with their cost; a diagonal needs both cells beside it free."""

    def free(row: int, column: int) -> bool:
        return 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1] and not blocked[row, column]

    row, column = cell
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            if (dr, dc) == (0, 0) or not free(row + dr, column + dc):
                continue
            if dr and dc and not (free(row + dr, column) and free(row, column + dc)):
                continue
            yield (row + dr, column + dc), DIAGONAL if dr and dc else 1.0


def dijkstra(blocked: NDArray[np.uint8], start: Cell) -> dict[Cell, float]:
    """Octile distance in cells from the start to every cell that can be reached."""
    if blocked[start]:
        return {}
    done: dict[Cell, float] = {}
    frontier = [(0.0, start)]
    while frontier:
        cost, cell = heapq.heappop(frontier)
        if cell in done:
            continue
        done[cell] = cost
        for neighbour, step in moves(blocked, cell):
            if neighbour not in done:
                heapq.heappush(frontier, (cost + step, neighbour))
    return done


# --- motion -------------------------------------------------------------------------------------


def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def integrate(pose: Pose, v: float, w: float, dt_s: float) -> Pose:
    """x' = x + v/w (sin(theta + w dt) - sin theta), y' = y - v/w (cos(theta + w dt) - cos theta)."""
    x, y, theta = pose
    turned = theta + w * dt_s
    if w == 0.0:
        return x + v * dt_s * math.cos(theta), y + v * dt_s * math.sin(theta), wrapped(theta)
    return (
        x + v / w * (math.sin(turned) - math.sin(theta)),
        y - v / w * (math.cos(turned) - math.cos(theta)),
        wrapped(turned),
    )


def follow(value: float, command: float, lag_s: float, acceleration: float, dt_s: float) -> float:
    """First-order lag towards a command, its change held to the acceleration limit."""
    change = (command - value) * (1.0 - math.exp(-dt_s / lag_s) if lag_s > 0.0 else 1.0)
    return value + min(acceleration * dt_s, max(-acceleration * dt_s, change))


def steered(twist: tuple[float, float], radius_m: float) -> tuple[float, float]:
    """What a car that turns no tighter than radius_m does of a twist; 0 turns on the spot."""
    v, w = twist
    if radius_m <= 0.0 or abs(w) * radius_m <= abs(v):
        return twist
    return v, math.copysign(abs(v) / radius_m, w)
