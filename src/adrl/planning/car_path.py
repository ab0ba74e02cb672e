"""Paths on a known map that a car can drive, whichever way it looks at their start."""

import numpy as np

from adrl import _core
from adrl.planning.grid import PlanningGrid
from adrl.types import Array, RobotConfig

MARGINS_M = (0.1, 0.05)
"""Distances that paths keep from obstacles: the first with which there is one."""


def car_path(
    grid: PlanningGrid, start: tuple[float, float, float], goal: tuple[float, float], robot: RobotConfig
) -> Array | None:
    """(P, 2) path from start (x, y, yaw) to goal (x, y), ends included; None when there is none.

    Hybrid A* (Dolgov et al. 2008) with the exact footprint: lines, and arcs of the tightest curve as chords. Where the
    car turns back the path does. A metre backward costs as much as two forward, turning back half a metre. Starts that
    are nearer to an obstacle than the margin are left as near as they are.
    """
    clearance = np.where(grid.inside, grid.clearance_m, np.float32(0.0))
    height, width = clearance.shape
    for margin_m in MARGINS_M:
        # What a cell's centre tells of the rest of it is less sure on large cells.
        margin_m = max(margin_m, 0.75 * grid.resolution_m + 0.0125)
        planner = _core.CarPlanner(robot.native, margin_m, height, width, grid.resolution_m)
        poses = planner.plan(clearance, grid.origin_m, start, goal)
        if len(poses) > 0:
            return np.ascontiguousarray(poses[:, :2])
    return None
