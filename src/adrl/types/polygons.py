"""Convex polygons, corners counter-clockwise."""

import math

import numpy as np

from adrl import _core
from adrl.geometry import Array
from adrl.types.base import require

MOST_M = 10.0
"""No corner of a footprint has a greater coordinate."""


def outline(corners: Array) -> Array:
    """(V, 2) corners of a convex polygon, either way round -> (W, 2) the same counter-clockwise, as few as it has.

    Raises ConfigError, whose text goes on from what the polygon is called.
    """
    require(bool((np.abs(corners) <= MOST_M).all()), f"has a corner beyond {-MOST_M:g} to {MOST_M:g} m")
    corners = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]
    if len(corners) >= 3:
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        straight = np.abs(turns(corners)) <= 1e-9 * lengths * np.roll(lengths, -1)
        corners = corners[~np.roll(straight, 1)]
    require(
        3 <= len(corners) <= _core.MAX_CORNERS,
        f"has {len(corners)} corners, those on a straight edge left out; give 3 to {_core.MAX_CORNERS}",
    )
    x, y = corners.T
    if float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0:
        corners = np.ascontiguousarray(corners[::-1])
    dents = np.roll(corners, -1, axis=0)[turns(corners) < 0.0]
    require(
        len(dents) == 0,
        f"is not convex: it bends inwards at {', '.join(f'({x:g}, {y:g})' for x, y in dents)}; leave such corners out, "
        "which makes it larger",
    )
    require(
        _winds_once(corners), "crosses itself; give its corners in the order in which they follow each other"
    )
    return corners


def turns(corners: Array) -> Array:
    """(V, 2) corners -> (V,) cross products of the edges that meet at the following corner: above 0 to the left."""
    # Not np.roll: a world of boxes is checked in half the time.
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    following = np.concatenate([edges[1:], edges[:1]])
    return edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]


def _winds_once(corners: Array) -> bool:
    """Whether the edges turn by one full circle in all, and not by more."""
    edges = np.roll(corners, -1, axis=0) - corners
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    turned = np.remainder(np.roll(headings, -1) - headings, 2.0 * math.pi).sum()
    return abs(turned - 2.0 * math.pi) < 1e-6


def require_convex(name: str, corners: Array) -> None:
    require(
        len(corners) >= 3 and bool(np.isfinite(corners).all()),
        f"{name} needs three or more finite corners",
    )
    require(
        bool((turns(corners) > 0.0).all()),
        f"{name} is not convex with its corners counter-clockwise",
    )
