"""The footprint of the shapes a robot is made of: a disc where it is round, else a convex polygon of few corners."""

import math

import numpy as np

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import Array
from adrl.worlds.sdf.footprint import Footprint

ROUND = 0.97
"""A hull is a disc when it holds one of this share of its radius, about the robot's origin."""
SIDES = 64
"""Of the polygon around a circle."""
SMALL = 0.002
"""Corners are left out that make the area larger by less than this share."""
DIGITS = 4
"""Tenths of a millimetre."""


def footprint_of(parts: Footprint) -> float | tuple[tuple[float, float], ...]:
    """A radius (m) about the origin, or 3 to 16 corners counter-clockwise; either holds all of the parts.

    Raises ConfigError for parts that cover no area.
    """
    angles = 2.0 * math.pi * np.arange(SIDES) / SIDES
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(math.pi / SIDES)
    points = [np.empty((0, 2)), *parts.polygons, np.array(parts.segments).reshape(-1, 2)]
    reach = max([0.0, *(float(np.hypot(*corners.T).max()) for corners in points if len(corners))])
    points += [np.array((x, y)) + r * ring for x, y, r in parts.circles]
    reach = max([reach, *(math.hypot(x, y) + r for x, y, r in parts.circles)])
    hull, spots = Footprint(), np.concatenate(points).round(DIGITS)
    if len(spots):
        hull.add_hull(spots)
    if not hull.polygons:
        raise ConfigError("cover no area")
    (corners,) = hull.polygons
    if _inner_radius(corners) >= ROUND * reach:
        return round(reach, DIGITS)
    return tuple((float(x), float(y)) for x, y in _fewer(corners).round(DIGITS))


def _inner_radius(corners: Array) -> float:
    """Of the largest disc about the origin in a polygon; negative where that lies outside."""
    edges = np.roll(corners, -1, axis=0) - corners
    away = corners[:, 0] * edges[:, 1] - corners[:, 1] * edges[:, 0]
    return float((away / np.hypot(*edges.T)).min())


def _fewer(corners: Array) -> Array:
    """A convex polygon (V, 2) of few corners around one: edges are left out, their neighbours made longer.

    First the edge that adds the least area, as long as that is small or there are too many.
    """
    x, y = corners.T
    small = SMALL * 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    while len(corners) > 3:
        tips, added = _without_each_edge(corners)
        edge = int(added.argmin())
        if not math.isfinite(added[edge]) or (added[edge] > small and len(corners) <= _core.MAX_CORNERS):
            break
        following = (edge + 1) % len(corners)
        corners[edge] = tips[edge]
        corners = np.delete(corners, following, axis=0)
    return corners


def _without_each_edge(corners: Array) -> tuple[Array, Array]:
    """(V, 2) where the neighbours of an edge meet when it is left out, and (V,) the area that adds; inf for nowhere."""
    start, end = corners, np.roll(corners, -1, axis=0)
    before, after = start - np.roll(corners, 1, axis=0), np.roll(corners, -2, axis=0) - end
    edge = end - start
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]) / turn
        tips = start + along[:, None] * before
        gained = tips - start
        added = 0.5 * np.abs(gained[:, 0] * edge[:, 1] - gained[:, 1] * edge[:, 0])
    return tips, np.where((turn > 1e-12) & np.isfinite(added), added, np.inf)
