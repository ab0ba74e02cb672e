"""Figures for papers: what the page shows, as PNG and PDF files."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from adrl.evaluation.traces import Trace
from adrl.report.document import charts
from adrl.report.failure_map import FailureMap, failure_map
from adrl.report.figures import (
    EDGE,
    INK,
    PALETTE,
    RoutePanel,
    blank_figure,
    draw_world,
    line_style,
    routes_figure,
    save,
)
from adrl.report.source import Evaluated, Source
from adrl.types import World

KINDS = ("png", "pdf")
ROUTES = 6
"""Panels of the routes' figure: failures first, then arrivals."""
_SHARE = LinearSegmentedColormap.from_list("share", ["#F6E3D8", PALETTE[1]])


def paper_figures(source: Source, folder: str | os.PathLike[str]) -> list[Path]:
    """Write them to a folder, and say what was written. Raises CheckpointError on a log that cannot be read."""
    folder = Path(folder)
    figures: dict[str, Figure] = {}
    if source.logs:
        figures["training"] = charts_figure(charts(source))
    if source.kind == "comparison":
        figures["success"] = success_figure(source.rows)
    for entry in source.evaluations:
        name = "".join(letter if letter.isalnum() else "-" for letter in entry.label)
        if entry.traces is None or not entry.traces.episodes:
            continue
        figures[f"routes-{name}"] = routes_figure(
            _panels(entry.traces.episodes, str(entry.summary["method"]))
        )
        found = failure_map(entry.traces, entry.episodes)
        if found is not None and entry.traces.world is not None:
            figures[f"failures-{name}"] = failure_figure(found, entry.traces.world, entry)
    paths = [folder / f"{name}.{kind}" for name in figures for kind in KINDS]
    for path in paths:
        save(figures[path.stem], path)
    return paths


def charts_figure(shown: Sequence[Mapping[str, Any]], axis: str = "wall_s") -> Figure:
    """The page's charts against wall clock, three a row; bands where there are several seeds."""
    rows = math.ceil(len(shown) / 3)
    figure = blank_figure(11.0, 2.9 * rows)
    grid = figure.subplots(rows, 3, squeeze=False)
    for axes, chart in zip(grid.flat, shown, strict=False):
        for index, series in enumerate(chart["series"]):
            _line(axes, series[axis], series["name"], index)
        axes.set_title(
            f"{chart['title']}, {chart['unit']}" if chart["unit"] else chart["title"], loc="left", fontsize=10
        )
        axes.set_xlabel("wall clock, s", fontsize=9)
        axes.grid(color="#E4E6EA", linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
        if len(chart["series"]) > 1:
            axes.legend(frameon=False, fontsize=7)
    for axes in grid.flat[len(shown) :]:
        axes.set_axis_off()
    return figure


def _line(axes: Axes, data: Mapping[str, Any], name: str, index: int) -> None:
    colour, stroke = line_style(index)
    x, y = (np.array(data[key], np.float64) for key in ("x", "y"))
    axes.plot(x, y, color=colour, linestyle=stroke, linewidth=1.6, label=name)
    if "low" in data:
        low, high = (np.array(data[key], np.float64) for key in ("low", "high"))
        axes.fill_between(x, low, high, color=colour, alpha=0.12, linewidth=0)


def success_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Success of each method with its 95 % interval, the best at the top."""
    known = sorted((row for row in rows if row["success"] is not None), key=lambda row: row["success"])
    figure = blank_figure(6.0, 0.9 + 0.3 * len(known))
    axes = figure.subplots()
    several = len({row["guidance"] for row in known}) > 1
    for place, row in enumerate(known):
        low, high = row["success_low"], row["success_high"]
        if low is not None and high is not None:
            axes.plot([100 * low, 100 * high], [place, place], color=EDGE, linewidth=1.4)
        axes.plot(100 * row["success"], place, "o", color=PALETTE[row["label"] == "adrl"], markersize=6)
    axes.set_yticks(
        range(len(known)), [row["label"] + (f", {row['guidance']}" if several else "") for row in known]
    )
    axes.set_xlabel("success, %, with 95 % intervals")
    axes.grid(axis="x", color="#E4E6EA", linewidth=0.8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


def failure_figure(found: FailureMap, world: World, entry: Evaluated) -> Figure:
    """Of the episodes that came through a cell, the share that failed; where they ended."""
    x_min, y_min, x_max, y_max = found.window_m
    height = 6.0 * min(1.6, max(0.4, (y_max - y_min) / (x_max - x_min)))
    figure = blank_figure(6.8, height)
    axes = figure.subplots()
    share = np.ma.masked_invalid(
        np.divide(
            100.0 * found.failed,
            found.passed,
            out=np.full(found.passed.shape, np.nan),
            where=found.passed > 0,
        )
    )
    rows, columns = share.shape
    extent = (found.x0_m, found.x0_m + columns * found.cell_m, found.y0_m, found.y0_m + rows * found.cell_m)
    image = axes.imshow(share, origin="lower", extent=extent, cmap=_SHARE, vmin=0.0, vmax=100.0, zorder=0.5)
    draw_world(axes, world)
    episodes = entry.episodes
    for ending, marker in (("collision", "x"), ("timeout", "s")):
        ends = episodes.final_pose[getattr(episodes, ending), :2]
        if len(ends):
            line = axes.plot(
                *ends.T, marker, color=INK, markersize=5, label=f"{ending} ({len(ends)})", zorder=5
            )
            line[0].set_markerfacecolor("none")
    axes.set_aspect("equal")
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    figure.colorbar(image, ax=axes, label="failed, % of the episodes that passed", shrink=0.6)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _panels(episodes: Sequence[Trace], method: str) -> list[RoutePanel]:
    chosen = sorted(episodes, key=lambda trace: trace.ending == "success")[:ROUTES]
    return [
        RoutePanel(
            world=trace.world,
            start=(float(trace.pose[0, 0]), float(trace.pose[0, 1]), float(trace.pose[0, 2])),
            goal=trace.goal,
            goal_tolerance_m=trace.goal_tolerance_m,
            path=trace.path,
            trajectories={method: np.asarray(trace.pose[:, :2], np.float64)},
            endings={method: trace.ending},
            title=f"task {trace.task}",
        )
        for trace in chosen
    ]
