"""The grid a path is planned on, and what of it is free for one robot."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adrl import _core
from adrl.errors import PlanningError
from adrl.geometry import in_robot_frame
from adrl.types import Array, OccupancyGrid, RobotConfig, World

RESOLUTION_M = 0.05
"""Side of a planning cell. A map keeps its own between this and COARSEST_MAP_M."""
COARSEST_MAP_M = 0.1
MARGIN_M = 0.05
"""Distance a path keeps from obstacles beyond the robot's own radius."""
MAX_CELLS = 4_000_000
"""Larger worlds are planned on larger cells,"""
MAX_RESOLUTION_M = 0.25
"""up to this side; beyond it narrow passages would be lost and planning is refused."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanningGrid:
    """Clearances at cell centres. Row-major [y, x], axes along the world's, cell (0, 0) lower left."""

    clearance_m: NDArray[np.float32]
    """(H, W) distance from the cell's centre to the nearest static obstacle, at most limit_m."""
    inside: NDArray[np.bool_]
    """(H, W) cells that a path may cross. A map ends at its image's edge."""
    task_cells: NDArray[np.bool_]
    """(H, W) cells where a task may start and end: surely seen free."""
    resolution_m: float
    origin_m: tuple[float, float]
    """Lower left corner of cell (0, 0) in the world."""
    limit_m: float

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of all cells."""
        height, width = self.clearance_m.shape
        x, y = self.origin_m
        return x, y, x + width * self.resolution_m, y + height * self.resolution_m

    def centre(self, cells: ArrayLike) -> Array:
        """(..., 2) row, column, whole or fractional -> (..., 2) x, y."""
        x_y = np.asarray(cells, dtype=np.float64)[..., ::-1]
        return np.ascontiguousarray((x_y + 0.5) * self.resolution_m + self.origin_m)

    def cell(self, points: ArrayLike) -> NDArray[np.intp]:
        """(..., 2) x, y -> (..., 2) row, column, which may lie outside."""
        return np.floor((np.asarray(points) - self.origin_m)[..., ::-1] / self.resolution_m).astype(np.intp)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(..., 2) x, y -> (...) whether a path may be there."""
        cells = self.cell(points)
        within = ((cells >= 0) & (cells < self.clearance_m.shape)).all(axis=-1)
        return within & self._at(self.inside, cells)

    def clearance_at(self, points: ArrayLike) -> NDArray[np.float32]:
        """(..., 2) x, y -> (...) clearance at the centre of the nearest cell."""
        return self._at(self.clearance_m, self.cell(points))

    def _at(self, values: NDArray, cells: NDArray[np.intp]) -> NDArray:
        height, width = self.clearance_m.shape
        return values[np.clip(cells[..., 0], 0, height - 1), np.clip(cells[..., 1], 0, width - 1)]


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeSpace:
    """Where the centre of one robot may be, taken for a disc."""

    grid: PlanningGrid
    inflation_m: float
    """Clearance that a cell needs."""
    blocked: NDArray[np.uint8]
    """(H, W) 1 where the robot may not be."""


def inflation_m(radius_m: float, resolution_m: float) -> float:
    """Clearance at a cell's centre that keeps a disc of radius_m clear of obstacles anywhere in the cell.

    The radius and a margin, which is at least the 0.71 cells from a centre to a corner: every straight line
    through free cells is then free of collision.
    """
    return radius_m + max(MARGIN_M, 0.75 * resolution_m)


def clearance_limit_m(robot: RobotConfig) -> float:
    """A limit for planning_grid that serves this robot at every resolution."""
    return inflation_m(robot.circumscribed_radius_m, MAX_RESOLUTION_M) + 0.05


def planning_grid(world: World, limit_m: float, include: Iterable[tuple[float, float]] = ()) -> PlanningGrid:
    """The grid over the world's bounds, grown by 1 m about every point of include that they leave out.

    limit_m: clearances are cut off here; give the largest inflation that will be asked for.
    Raises PlanningError for a world so large that its cells would exceed MAX_RESOLUTION_M.
    """
    x_min, y_min, x_max, y_max = world.bounds
    for x, y in include:
        # A point on the upper border would fall into a cell beyond it.
        if not (x_min <= x <= x_max - 1e-3 and y_min <= y <= y_max - 1e-3):
            x_min, y_min = min(x_min, x - 1.0), min(y_min, y - 1.0)
            x_max, y_max = max(x_max, x + 1.0), max(y_max, y + 1.0)
    resolution = _resolution(world, (x_max - x_min) * (y_max - y_min))
    width = max(1, math.ceil((x_max - x_min) / resolution - 1e-6))
    height = max(1, math.ceil((y_max - y_min) / resolution - 1e-6))
    clearance = _core.clearance_field(world.native, x_min, y_min, width, height, resolution, limit_m)
    inside = task_cells = np.ones((height, width), dtype=np.bool_)
    if world.grid is not None:
        inside, task_cells = _seen_by(world.grid, (x_min, y_min), (height, width), resolution)
    return PlanningGrid(
        clearance_m=clearance,
        inside=inside,
        task_cells=task_cells,
        resolution_m=resolution,
        origin_m=(x_min, y_min),
        limit_m=limit_m,
    )


def free_space(grid: PlanningGrid, robot: RobotConfig, radius_m: float | None = None) -> FreeSpace:
    """The cells with room for the robot, taken for a disc: of radius_m, or its circumscribed one."""
    inflation = inflation_m(robot.circumscribed_radius_m if radius_m is None else radius_m, grid.resolution_m)
    if inflation > grid.limit_m:
        raise ValueError(f"clearances end at {grid.limit_m} m, robot {robot.name!r} needs {inflation} m")
    # The tolerance lets a cell pass whose clearance is the inflation but for rounding.
    blocked = (grid.clearance_m < inflation - 1e-5) | ~grid.inside
    return FreeSpace(grid=grid, inflation_m=inflation, blocked=blocked.astype(np.uint8))


def _resolution(world: World, area_m2: float) -> float:
    own = RESOLUTION_M if world.grid is None else world.grid.resolution_m
    resolution = max(min(max(own, RESOLUTION_M), COARSEST_MAP_M), math.sqrt(area_m2 / MAX_CELLS))
    if resolution > MAX_RESOLUTION_M:
        raise PlanningError(
            f"the world covers {area_m2:.3g} m^2; planning goes up to "
            f"{MAX_CELLS * MAX_RESOLUTION_M**2:.3g} m^2: cut it into parts"
        )
    return resolution


def _seen_by(
    bitmap: OccupancyGrid, origin_m: tuple[float, float], shape: tuple[int, int], resolution_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(H, W) planning cells whose centre lies on the bitmap, and those on a cell of it that was seen free."""
    rows, columns = np.indices(shape)
    centres = (np.stack([columns, rows], axis=-1, dtype=np.float64) + 0.5) * resolution_m + np.array(origin_m)
    on_bitmap = in_robot_frame(np.array(bitmap.origin), centres)
    column, row = np.floor(np.moveaxis(on_bitmap, -1, 0) / bitmap.resolution_m).astype(np.intp)
    height, width = bitmap.solid.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    free = bitmap.solid == 0 if bitmap.observed_free is None else bitmap.observed_free
    return inside, inside & free[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
