"""What a simulated robot has hit, in words."""

import numpy as np

from adrl.geometry import nearest_on_segments
from adrl.types import Array, World


def nearest_obstacle(world: World, at: tuple[float, float], time_s: float) -> str:
    """What stands or moves nearest to a place in the world, and its point nearest to it."""
    place = np.array(at)
    circles, discs = world.circles, world.discs
    moving = np.column_stack([world.disc_centres(time_s), discs[:, 4]])
    sides = [np.hstack([corners, np.roll(corners, -1, axis=0)]) for corners in world.polygons]
    found = {
        "a pillar": _on_circles(circles, place),
        "a moving disc": _on_circles(moving, place),
        "a wall": _on_segments(world.segments, place),
        "an obstacle's side": _on_segments(np.concatenate([*sides, np.empty((0, 4))]), place),
        "the map": world.solid_cells,
    }
    nearest = {name: _nearest(points, place) for name, points in found.items() if len(points)}
    if not nearest:
        return "nothing that the world has"
    name = min(nearest, key=lambda name: float(np.hypot(*(nearest[name] - place))))
    return f"{name} at ({nearest[name][0]:.2f}, {nearest[name][1]:.2f})"


def _nearest(points: Array, place: Array) -> Array:
    return points[np.argmin(np.hypot(*(points - place).T))]


def _on_circles(circles: Array, place: Array) -> Array:
    """(M, 2) the point of each rim that is nearest."""
    towards = place - circles[:, :2]
    lengths = np.maximum(np.hypot(*towards.T), 1e-9)
    return circles[:, :2] + towards * (circles[:, 2] / lengths)[:, None]


def _on_segments(segments: Array, place: Array) -> Array:
    """(M, 2) the point of each segment that is nearest."""
    return nearest_on_segments(segments[:, :2], segments[:, 2:], place)
