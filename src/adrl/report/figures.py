"""Pictures of a training run and of routes, as PNG or PDF files. No display and no global state: no pyplot."""

import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.path import Path as MarkerPath
from matplotlib.transforms import Affine2D
from matplotlib.typing import LineStyleType
from numpy.typing import NDArray

from adrl import files
from adrl.report.metrics_log import read_metrics
from adrl.types import GOAL_TOLERANCE_M, OccupancyGrid, World

Array = NDArray[np.float64]

# Okabe and Ito's palette, made for colour-blind readers; its yellow is too faint on white and left out.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
_DASHES = ((5, 1.5), (3, 1, 1, 1), (1.5, 1.2), (6, 1, 1, 1, 1, 1), (8, 2), (2, 3))
STROKES: tuple[LineStyleType, ...] = ("-", *((0, dashes) for dashes in _DASHES))
"""Line pattern beside each colour, so that a grey print and lines that cover each other stay legible."""
SOLID, EDGE, INK, MOVING = "#B9BEC6", "#7C838D", "#30343A", "#E9C46A"
_DPI = 140
LEGEND_COLUMNS = 7
_CURVES = {
    "S": "maturity S",
    "alpha": "expert share alpha",
    "lambda_bc": "imitation weight lambda_bc",
}
# An arrow head along x, in the marker's unit square.
_HEADING = MarkerPath([(1.0, 0.0), (-0.7, 0.7), (-0.35, 0.0), (-0.7, -0.7), (1.0, 0.0)], closed=True)
_END_MARKERS = {"success": "o", "collision": "X", "timeout": "s"}


def learning_curve(logs: Mapping[str, str | os.PathLike[str]], out: str | os.PathLike[str]) -> None:
    """Write learning_curve_figure(logs) to the file out, PNG or PDF."""
    save(learning_curve_figure(logs), out)


def learning_curve_figure(logs: Mapping[str, str | os.PathLike[str]]) -> Figure:
    """Success, S, alpha and lambda_bc against wall clock.

    logs: label of a run -> its metrics.jsonl. Success is drawn where it was evaluated; a quantity that a
    method does not log is left out. Raises CheckpointError on a log that cannot be read.
    """
    if not logs:
        raise ValueError("no log to draw; give one run or more")
    runs = {label: read_metrics(path) for label, path in logs.items()}
    figure = blank_figure(10.0, 4.6)
    axes = figure.subplot_mosaic([["success", name] for name in _CURVES], width_ratios=[1.7, 1.0])
    for index, (label, rows) in enumerate(runs.items()):
        style = dict(zip(("color", "linestyle"), line_style(index), strict=True))
        _curve(axes["success"], rows, "success", scale=100.0, label=label, marker="o", **style)
        for name in _CURVES:
            _curve(axes[name], rows, name, **style)
    _curve_axes(axes["success"], "success, %", top=100.0)
    for name, title in _CURVES.items():
        _curve_axes(axes[name], title, top=1.0)
        axes[name].sharex(axes["success"])
        axes[name].tick_params(labelbottom=name == list(_CURVES)[-1])
    axes["success"].set_xlabel("wall clock, s")
    axes[list(_CURVES)[-1]].set_xlabel("wall clock, s")
    axes["success"].set_xlim(0.0, 1.02 * max(1.0, *(rows["wall_s"].max() for rows in runs.values())))
    if len(runs) > 1:
        axes["success"].legend(loc="lower right", frameon=False)
    return figure


def _curve(axes: Axes, rows: Mapping[str, Array], name: str, *, scale: float = 1.0, **style: Any) -> None:
    """One quantity of one run; rows where it is null are joined over."""
    values = rows.get(name, np.empty(0))
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == 1:  # a line of one point is not to be seen
        style |= {"marker": "o"}
    axes.plot(rows["wall_s"][known], scale * values[known], linewidth=1.8, markersize=4, **style)


def _curve_axes(axes: Axes, title: str, *, top: float) -> None:
    axes.set_title(title, loc="left", fontsize=10)
    # A schedule may go beyond its usual range: literal eq 5 exceeds lambda_max. Nothing logged is cut off.
    values = np.concatenate([[0.0, top], *(np.asarray(line.get_ydata(), float) for line in axes.lines)])
    margin = 0.03 * (values.max() - values.min())
    axes.set_ylim(values.min() - margin, values.max() + margin)
    axes.grid(color="#E4E6EA", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    if not any(len(np.atleast_1d(line.get_xdata())) for line in axes.lines):
        axes.text(0.5, 0.5, "not logged", transform=axes.transAxes, ha="center", va="center", color=EDGE)


@dataclass(frozen=True, eq=False, kw_only=True)
class RoutePanel:
    """One task and how each policy drove it."""

    world: World
    start: tuple[float, float, float]
    """(x, y, yaw)."""
    goal: tuple[float, float]
    goal_tolerance_m: float = GOAL_TOLERANCE_M
    path: Array | None = None
    """(P, 2) the planner's path."""
    trajectories: Mapping[str, Array] = field(default_factory=dict)
    """Policy -> (T, 2) positions, or (T, 3) poses; a name keeps its colour across panels."""
    endings: Mapping[str, str] = field(default_factory=dict)
    """Policy -> success, collision or timeout: the marker at the end of its line."""
    title: str = ""


def routes(panels: Sequence[RoutePanel], out: str | os.PathLike[str], *, columns: int = 3) -> None:
    """Write routes_figure(panels, columns) to the file out, PNG or PDF."""
    save(routes_figure(panels, columns=columns), out)


def routes_figure(
    panels: Sequence[RoutePanel],
    *,
    columns: int = 3,
    styles: Mapping[str, tuple[str, LineStyleType]] | None = None,
) -> Figure:
    """The panels as small multiples: six make two rows of three.

    Obstacles are grey; moving discs are drawn where they start, with the line they run on. Each panel shows a
    square of the world: all of it, or the part about the routes when the world is much larger. styles: policy -> colour
    and pattern; line_style in the order of the policies when left out.
    """
    if not panels:
        raise ValueError("no route to draw; give one panel or more")
    names = list(dict.fromkeys(name for panel in panels for name in panel.trajectories))
    columns = min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    styles = styles or {name: line_style(index) for index, name in enumerate(names)}
    entries = _legend(panels, {name: styles[name] for name in names})
    figure = blank_figure(3.6 * columns, 3.7 * rows + 0.35 * math.ceil(len(entries) / LEGEND_COLUMNS) + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _panel(axes, panel, styles)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set_ylabel("y, m", fontsize=8)
    for axes in grid.flat[max(0, len(panels) - columns) : len(panels)]:
        axes.set_xlabel("x, m", fontsize=8)
    columns = min(LEGEND_COLUMNS, len(entries))
    figure.legend(handles=entries, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure


def _panel(axes: Axes, panel: RoutePanel, styles: Mapping[str, tuple[str, LineStyleType]]) -> None:
    draw_world(axes, panel.world)
    if panel.path is not None:
        axes.plot(*panel.path[:, :2].T, color=INK, linewidth=1.1, linestyle=(0, (1, 1.6)), zorder=4)
    for name, positions in panel.trajectories.items():
        colour, stroke = styles[name]
        axes.plot(*positions[:, :2].T, color="white", linewidth=3.2, alpha=0.7, zorder=5)
        axes.plot(*positions[:, :2].T, color=colour, linewidth=1.7, linestyle=stroke, zorder=6)
        marker = _END_MARKERS.get(panel.endings.get(name, ""))
        if marker is not None:
            end = axes.plot(*positions[-1, :2], marker, color=colour, markersize=6.5, zorder=8)
            end[0].set_markeredgecolor("white")
    x, y, yaw = panel.start
    axes.plot(x, y, marker=_HEADING.transformed(Affine2D().rotate(yaw)), color=INK, markersize=13, zorder=7)
    axes.add_patch(Circle(panel.goal, panel.goal_tolerance_m, facecolor="none", edgecolor=INK, zorder=7))
    axes.plot(*panel.goal, "+", color=INK, markersize=9, zorder=7)
    _view(axes, panel)
    axes.set_title(panel.title, fontsize=9, loc="left")


def draw_world(axes: Axes, world: World) -> None:
    """Draw the geometry the LiDAR sees, discs as they are at time 0, in metres."""
    if world.grid is not None:
        _draw_grid(axes, world.grid)
    solid = [Circle((x, y), radius) for x, y, radius in world.circles]
    solid += [Polygon(corners) for corners in world.polygons]
    axes.add_collection(PatchCollection(solid, facecolor=SOLID, edgecolor=EDGE, linewidth=0.6, zorder=2))
    walls = world.segments.reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(walls), colors=EDGE, linewidths=1.6, zorder=2))
    runs = world.discs[:, :4].reshape(-1, 2, 2)
    to_and_fro = LineCollection(list(runs), colors=MOVING, linewidths=1.2, linestyles="--", zorder=2.5)
    axes.add_collection(to_and_fro)
    discs = [
        Circle(centre, disc[4]) for centre, disc in zip(world.disc_centres(0.0), world.discs, strict=True)
    ]
    axes.add_collection(PatchCollection(discs, facecolor=MOVING, edgecolor=INK, linewidth=0.6, zorder=3))


def _draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    height, width = np.asarray(grid.solid).shape
    x, y, yaw = grid.origin
    axes.imshow(
        np.ma.masked_equal(grid.solid != 0, False),
        cmap=ListedColormap([SOLID]),
        origin="lower",
        extent=(0.0, width * grid.resolution_m, 0.0, height * grid.resolution_m),
        interpolation="nearest",
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
        zorder=1,
    )


def _view(axes: Axes, panel: RoutePanel) -> None:
    """A square window on the whole world, or on the routes where they fill less than half of it."""
    lines = [line[:, :2] for line in (panel.path, *panel.trajectories.values()) if line is not None]
    points = np.concatenate([[panel.start[:2], panel.goal], *lines])
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    bounds = np.array(panel.world.bounds)
    if 2.0 * (high - low).max() > (bounds[2:] - bounds[:2]).max():
        low, high = np.minimum(low + 1.0, bounds[:2]), np.maximum(high - 1.0, bounds[2:])
    centre, half = 0.5 * (low + high), 0.52 * float((high - low).max())
    axes.set_aspect("equal")
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.tick_params(labelsize=7, length=2, color=EDGE, labelcolor=INK)
    axes.spines[:].set_color(SOLID)


def _legend(panels: Sequence[RoutePanel], styles: Mapping[str, tuple[str, LineStyleType]]) -> list[Line2D]:
    """Only what the picture holds."""

    def mark(label: str, marker: MarkerPath | str, **style: Any) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, color=INK, label=label, **style)

    entries = [
        Line2D([], [], color=colour, linestyle=stroke, linewidth=1.8, label=name)
        for name, (colour, stroke) in styles.items()
    ]
    if any(panel.path is not None for panel in panels):
        entries.append(Line2D([], [], color=INK, linestyle=(0, (1, 1.6)), linewidth=1.2, label="A* path"))
    entries += [mark("start", _HEADING, markersize=10), mark("goal", "+", markersize=9)]
    seen = {ending for panel in panels for ending in panel.endings.values()}
    endings = [ending for ending in _END_MARKERS if ending in seen]
    entries += [mark(ending, _END_MARKERS[ending], markersize=6) for ending in endings]
    if any(len(panel.world.discs) for panel in panels):
        entries.append(mark("moving, at start", "o", markerfacecolor=MOVING, markersize=8))
    return entries


def line_style(index: int) -> tuple[str, LineStyleType]:
    """Colour and pattern of line number index; they repeat after len(PALETTE)."""
    return PALETTE[index % len(PALETTE)], STROKES[index % len(STROKES)]


def blank_figure(width_in: float, height_in: float) -> Figure:
    """A figure that no global state knows of, its parts laid out to fit."""
    layout = ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.06)
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, out: str | os.PathLike[str]) -> None:
    """Write a picture of the kind that the file's name ends in, png or pdf, at once. Equal figures give equal bytes."""
    kind = Path(out).suffix[1:]
    buffer = io.BytesIO()
    # Publishers ask for TrueType in a PDF; its date would make every file another.
    with rc_context({"pdf.fonttype": 42}):
        figure.savefig(buffer, format=kind, metadata={"CreationDate": None} if kind == "pdf" else None)
    files.atomic_write_bytes(Path(out), buffer.getvalue())
