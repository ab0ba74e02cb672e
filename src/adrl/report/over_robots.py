"""What makes a robot hard: success over the numbers of the robots that drove."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adrl.evaluation.statistics import clustered_rate
from adrl.report.figures import PALETTE, blank_figure

PANELS = {
    "max_speed_mps": ("greatest speed, m/s", 1.0),
    "circumscribed_radius_m": ("radius about the origin, m", 1.0),
    "lidar.fov_rad": ("field of view, degrees", 180.0 / math.pi),
    "stop_time_s": ("time to stop from full speed, s", 1.0),
}
"""Column -> its name on the axis, and in what unit."""
GROUPS, LEAST = 8, 4
"""Of robots, by size; with at least so many robots each."""


def over_robots_figure(robots: Mapping[str, NDArray[Any]]) -> Figure:
    """Success over speed, size, field of view and stopping time: a dot a robot, and groups of as many robots each with
    their 95 % interval. robots: columns of over_robots.by_robot."""
    figure = blank_figure(11.0, 3.2)
    panels = figure.subplots(1, len(PANELS), sharey=True)
    for axes, (column, (name, unit)) in zip(panels, PANELS.items(), strict=True):
        _panel(axes, unit * np.asarray(robots[column], np.float64), robots)
        axes.set_xlabel(name, fontsize=9)
        axes.grid(color="#E4E6EA", linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("success, %", fontsize=9)
    return figure


def _panel(axes: Axes, values: NDArray[np.float64], robots: Mapping[str, NDArray[Any]]) -> None:
    success, trials = robots["success"], robots["episodes"]
    axes.plot(values, 100.0 * success, ".", color=PALETTE[4], markersize=4, alpha=0.6)
    groups = max(1, min(GROUPS, len(values) // LEAST))
    # Robots of one number, as many LiDARs see a full circle, are of one group.
    ends = np.unique(np.quantile(values, np.linspace(0.0, 1.0, groups + 1)[1:-1], method="lower"))
    group = np.searchsorted(ends, values, side="left")
    for rows in (np.flatnonzero(group == number) for number in np.unique(group)):
        rate = clustered_rate(np.rint(success[rows] * trials[rows]), trials[rows])
        ends = [[100.0 * (rate.estimate - rate.low)], [100.0 * (rate.high - rate.estimate)]]
        at = float(np.median(values[rows]))
        axes.errorbar(
            at, 100.0 * rate.estimate, yerr=ends, fmt="o", color=PALETTE[0], markersize=5, capsize=2
        )
