"""Which part of a world tasks may lie in, where the bounds reach beyond what stands there."""

import math

import numpy as np
from numpy.typing import NDArray

from adrl.geometry import lies_within
from adrl.planning.grid import PlanningGrid
from adrl.types import GOAL_TOLERANCE_M, Array, World
from adrl.worlds.tasks import TaskSpace

OUTBUILDING = 0.1
"""Enclosed regions below this share of the open ground are sheds and hollow things, not what a robot drives in."""
ROOM_M = 4.0 * GOAL_TOLERANCE_M
"""Diagonal below which a region has no room for a task."""


def inside(world: World, tasks: TaskSpace) -> tuple[TaskSpace, str]:
    """Where tasks lie, and one line that says where and why if there was a choice, else "".

    A region is enclosed if the robot cannot drive from it to the edge of the bounds; tasks lie in the largest one.
    Where none is, they lie on the open ground: between the things that stand in the world, within their convex hull,
    not around it. A room whose doorway lets the robot out is open ground, too. Open ground ten times as large as the
    largest enclosed region is preferred to it.
    """
    regions, cell_m2 = tasks.regions, tasks.space.grid.resolution_m**2
    extents_m = tasks.extents_m
    areas_m2 = np.bincount(regions.ravel(), minlength=len(extents_m) + 1)[1:] * cell_m2
    at_edge = np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]])
    reaches_edge = np.isin(np.arange(1, len(extents_m) + 1), at_edge)
    ground = tasks.on(
        np.concatenate([[False], reaches_edge])[regions] & _in_hull(world, tasks.space.grid)
    ).reaching(ROOM_M)
    ground_m2 = len(ground.cells) * cell_m2
    enclosed = np.flatnonzero(~reaches_edge & (extents_m >= ROOM_M))
    if len(enclosed) == 0:
        if ground_m2 > 0.0:
            return ground, ""
        return tasks, "tasks lie around what stands there: it encloses no room, and there is none between it"
    largest = enclosed[np.argmax(areas_m2[enclosed])]
    if areas_m2[largest] < OUTBUILDING * ground_m2:
        return ground, (
            f"tasks lie on the {ground_m2:.0f} m2 of open ground: the largest of {len(enclosed)} enclosed regions has "
            f"{areas_m2[largest]:.1f} m2, less than a tenth of it"
        )
    room = tasks.on(regions == largest + 1)
    left_out = [f"smaller enclosed ones ({len(enclosed) - 1})"] if len(enclosed) > 1 else []
    left_out += [f"open ground ({ground_m2:.0f} m2)"] if ground_m2 > 0.0 else []
    if not left_out:
        return room, ""
    x, y = tasks.space.grid.centre(np.argwhere(room.allowed).mean(axis=0))
    return room, (
        f"tasks lie in the largest enclosed region, {areas_m2[largest]:.0f} m2 about ({x:.1f}, {y:.1f}); left out: "
        f"{', '.join(left_out)}"
    )


def _circle(x: float, y: float, radius_m: float, corners: int = 16) -> Array:
    angles = np.arange(corners) * (2.0 * math.pi / corners)
    return np.column_stack([x + radius_m * np.cos(angles), y + radius_m * np.sin(angles)])


def _points(world: World) -> Array:
    """(P, 2) points that all of the world's standing shapes lie between."""
    circles = [_circle(x, y, r) for x, y, r in world.circles]
    return np.concatenate([np.empty((0, 2)), *world.polygons, world.segments.reshape(-1, 2), *circles])


def _in_hull(world: World, grid: PlanningGrid) -> NDArray[np.bool_]:
    """(H, W) cells whose centre lies in the convex hull of what stands in the world."""
    from scipy.spatial import ConvexHull, QhullError

    points, shape = _points(world), grid.clearance_m.shape
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # nothing, or all on one line
        return np.zeros(shape, dtype=np.bool_)
    return lies_within(points[hull.vertices], grid.centre(np.moveaxis(np.indices(shape), 0, -1)))
