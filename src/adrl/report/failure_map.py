"""Where in one world a policy fails: of the episodes that came through a cell, how many ended badly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.metrics import Episodes
from adrl.evaluation.traces import Traces
from adrl.types import Array

MOST_CELLS = 64
"""Along the longer side of the map."""
LEAST_CELL_M = 0.25

Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class FailureMap:
    """Counts on a grid over a world's bounds, row-major [y, x], lower left first."""

    x0_m: float
    y0_m: float
    cell_m: float
    passed: Counts
    """(H, W) episodes whose route touched the cell, each counted once."""
    failed: Counts
    """(H, W) those of them that did not arrive, wherever they ended."""
    collided: Counts
    """(H, W) episodes that collided in the cell."""

    @property
    def window_m(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of the cells that were passed, with two more around them."""
        rows, columns = np.nonzero(self.passed)
        low, high = (columns.min() - 2, rows.min() - 2), (columns.max() + 3, rows.max() + 3)
        origin = np.array([self.x0_m, self.y0_m])
        x_min, y_min, x_max, y_max = np.concatenate(
            [origin + self.cell_m * np.array(at) for at in (low, high)]
        )
        return float(x_min), float(y_min), float(x_max), float(y_max)


def failure_map(traces: Traces, episodes: Episodes) -> FailureMap | None:
    """None where the tasks have worlds of their own. Raises ValueError when the two are not of the same tasks."""
    if traces.world is None:
        return None
    if not np.array_equal(traces.tasks, episodes.task):
        raise ValueError("routes and episodes are of different tasks")
    x_min, y_min, x_max, y_max = traces.world.bounds
    cell_m = max(LEAST_CELL_M, max(x_max - x_min, y_max - y_min) / MOST_CELLS)
    width, height = int(np.ceil((x_max - x_min) / cell_m)), int(np.ceil((y_max - y_min) / cell_m))
    passed, failed, collided = np.zeros((3, height, width), np.int64)

    def cells(points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        column, row = np.floor((points - (x_min, y_min)) / cell_m).astype(np.intp).T
        return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)

    for route, arrived in zip(traces.routes, episodes.success, strict=True):
        row, column = np.unique(np.stack(cells(_dense(route, 0.1 * cell_m))), axis=1)
        passed[row, column] += 1
        failed[row, column] += not arrived
    row, column = cells(episodes.final_pose[episodes.collision, :2])
    np.add.at(collided, (row, column), 1)
    return FailureMap(x0_m=x_min, y0_m=y_min, cell_m=cell_m, passed=passed, failed=failed, collided=collided)


def _dense(route: Array, spacing_m: float) -> Array:
    """The same polyline with points at most spacing_m apart."""
    length = np.hypot(*np.diff(route, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(length)])
    at = np.linspace(0.0, along[-1], 2 + int(along[-1] / spacing_m))
    return np.stack([np.interp(at, along, route[:, 0]), np.interp(at, along, route[:, 1])], axis=1)
