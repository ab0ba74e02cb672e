"""Shapes that worlds are built from. Metres, radians, corners counter-clockwise."""

import math

import numpy as np

from adrl.types import Array


def box(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> Array:
    """(4, 2) corners of a rectangle centred at (x, y), its length along yaw."""
    corners = np.array([(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]) * (length_m, width_m)
    return place(corners, x_m, y_m, yaw_rad)


def place(points: Array, x_m: float, y_m: float, yaw_rad: float) -> Array:
    """(P, 2) points of a frame at (x, y, yaw) -> the same points in the world."""
    # Not geometry.in_world_frame, which rounds otherwise: drawn worlds would differ from before in their last bits.
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return points @ np.array([(c, s), (-s, c)]) + (x_m, y_m)


def enclosure(bounds: tuple[float, float, float, float]) -> Array:
    """(4, 4) wall segments around (x_min, y_min, x_max, y_max)."""
    x_min, y_min, x_max, y_max = bounds
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    return np.array([(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)])


def cover(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float) -> Array:
    """(K, 3) discs x, y, radius in a row that together hold the rectangle of box()."""
    long, short = max(length_m, width_m), min(length_m, width_m)
    along = yaw_rad if length_m >= width_m else yaw_rad + 0.5 * math.pi
    # Discs of a thin wall reach over its sides a little; with fewer of them worlds are drawn faster.
    count = max(1, math.ceil(long / max(short, 0.3)))
    step = long / count
    offsets = (np.arange(count) + 0.5) * step - 0.5 * long
    radius = math.hypot(0.5 * step, 0.5 * short)
    return np.column_stack(
        [x_m + offsets * math.cos(along), y_m + offsets * math.sin(along), np.full(count, radius)]
    )
