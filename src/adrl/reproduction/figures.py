"""The paper's figures from kept results, and beside each the one that matters more."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import LineStyleType

from adrl.evaluation.learning_time import median_seconds_to_level
from adrl.evaluation.statistics import Interval, probability_of_improvement, seed_iqm, seed_mean
from adrl.report.figures import EDGE, PALETTE, RoutePanel, blank_figure, line_style, routes_figure, save
from adrl.reproduction.numbers import (
    HARD_SHARE,
    LEVELS,
    hard_worlds,
    steady_episodes,
    success_on,
    times_to,
)
from adrl.reproduction.reported import ABLATIONS, LABELS, METHODS, OURS, PLANNER, RIVALS
from adrl.reproduction.results import Array, Results
from adrl.worlds import get_scenario, load_robot, task_set

KINDS = ("png", "pdf")
VALUE_COLUMNS = 4
_VALUES: tuple[tuple[str, tuple[str, LineStyleType], str], ...] = (
    ("q_start", (PALETTE[0], "-"), "promised"),
    ("return_start", (PALETTE[1], "--"), "realised"),
)
REPLANNED, OPEN = "replan", 0.28
"""Guidance of the evaluation with the replanner, and how far below the other its dots are, in places."""
POINTS = 60
"""Places along the x axis where curves of several seeds are averaged."""
Curve = Mapping[str, Array]


def figures(results: Results) -> dict[str, Figure]:
    """Name of a file -> its figure."""
    found = {
        "fig4-ablations": q_figure(results, ABLATIONS),
        "fig5-methods": q_figure(results, RIVALS),
        "fig6-convergence": convergence_figure(results),
        "success": success_figure(results),
        "promised-and-realised": value_figure(results),
        "survival": survival_figure(results),
        "methods": methods_figure(results),
    }
    for scenario in results.scenarios:
        for guidance in results.about["scenarios"][scenario]["evaluated"]:
            if panels := _route_panels(results, scenario, guidance):
                found[f"fig7-routes-{scenario}-{guidance}"] = routes_figure(panels, styles=ROUTE_STYLES)
    return found


def write_figures(results: Results, folder: Path) -> list[Path]:
    """Write all of them, each as PNG and PDF."""
    drawn = figures(results)
    paths = [folder / f"{name}.{kind}" for name in drawn for kind in KINDS]
    for path in paths:
        save(drawn[path.stem], path)
    return paths


def q_figure(results: Results, methods: Sequence[str]) -> Figure:
    """Mean Q, Q from its least value (0) to its greatest (1), and success, over training episodes; a row a scenario."""
    figure, grid = _grid(results, 3)
    for row, scenario in zip(grid, results.scenarios, strict=True):
        for method in results.methods_of(scenario, methods):
            curves, style = results.curves_of(scenario, method), _style(method)
            label = _label(results, scenario, method, " (value V)" if method == "sb3-ppo" else "")
            _band(row[0], curves, "episode", lambda curve: curve["q_mean"], style, label)
            _band(row[1], curves, "episode", _rescaled, style, label)
            _band(row[2], curves, "episode", _success, style, label)
        titles = ("mean Q", "mean Q, 0 its least, 1 its greatest value", "success in validation, %")
        for axes, title in zip(row, titles, strict=True):
            _axes(axes, f"{scenario}: {title}", "training episodes")
        row[1].set_ylim(-0.03, 1.03)
        row[2].set_ylim(-3.0, 103.0)
        _legend_beside(row[2])
    return figure


def _success(curve: Curve) -> Array:
    return 100.0 * curve["success"]


BROWN = "#7A4E2D"
ROUTE_STYLES: dict[str, tuple[str, LineStyleType]] = {
    LABELS[PLANNER]: (BROWN, "-"),
    **{LABELS[method]: line_style(METHODS.index(method)) for method in RIVALS},
}
"""Of the routes: a method's as in the other figures."""


def _style(method: str) -> tuple[str, LineStyleType]:
    """The same in every figure."""
    return line_style(METHODS.index(method))


def _label(results: Results, scenario: str, method: str, note: str = "") -> str:
    """Its name, and how many of the seeds have ended where not all have."""
    ended, wanted = results.seeds(scenario, method), results.about["scenarios"][scenario]["seeds"]
    return LABELS[method] + note + ("" if ended == wanted else f", {ended} of {wanted} seeds")


def _rescaled(curve: Curve) -> Array:
    """Rewards differ between methods, and so do the scales of Q: only the shape is comparable."""
    values = curve["q_mean"]
    known = values[np.isfinite(values)]
    span = np.ptp(known) if len(known) else 0.0
    return (values - known.min()) / span if span > 1e-9 else np.full_like(values, np.nan)


def convergence_figure(results: Results) -> Figure:
    """Episodes to steady-state mean Q (Fig. 6), and environment steps to a success that is good for something."""
    figure, grid = _grid(results, 1 + len(LEVELS))
    for row, scenario in zip(grid, results.scenarios, strict=True):
        names = results.methods_of(scenario, METHODS)
        episodes = [steady_episodes(results, scenario, name) for name in names]
        longest = max((c["episode"][-1] for n in names for c in results.curves_of(scenario, n)), default=1.0)
        budget = results.about["scenarios"][scenario]["steps"]
        _dots(row[0], names, episodes, longest)
        _axes(row[0], f"{scenario}: episodes to steady-state mean Q", "training episodes")
        for axes, level in zip(row[1:], LEVELS, strict=True):
            times = [times_to(results, scenario, name, level, "env_steps") for name in names]
            _dots(axes, names, times, budget)
            _axes(axes, f"{scenario}: steps to {100 * level:.0f} % success", "environment steps")
    return figure


def _dots(axes: Axes, names: Sequence[str], values: Sequence[Sequence[float]], end: float) -> None:
    """A dot a seed, a line at the median where it is finite, and how many got there; end: of the longest run."""
    labels = []
    for place, (name, column) in enumerate(zip(names, values, strict=True)):
        reached = [value for value in column if np.isfinite(value)]
        colour, _ = _style(name)
        axes.plot(reached, [place] * len(reached), "o", color=colour, markersize=4, alpha=0.7)
        if math.isfinite(median := median_seconds_to_level(column)):
            axes.plot([median] * 2, [place - 0.3, place + 0.3], color=colour, linewidth=2.0)
        labels.append(f"{LABELS[name]}  {len(reached)}/{len(column)}")
    axes.set_yticks(range(len(names)), labels, fontsize=8)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.04 * end)


def success_figure(results: Results) -> Figure:
    """Success in validation against environment steps and against wall clock."""
    figure, grid = _grid(results, 2)
    for row, scenario in zip(grid, results.scenarios, strict=True):
        for method in results.methods_of(scenario, METHODS):
            curves = results.curves_of(scenario, method)
            for axes, column in zip(row, ("env_steps", "wall_s"), strict=True):
                _band(axes, curves, column, _success, _style(method), _label(results, scenario, method))
        _axes(row[0], f"{scenario}: success in validation, %", "environment steps")
        _axes(row[1], f"{scenario}: success in validation, %", "wall clock, s")
        for axes in row:
            axes.set_ylim(-3.0, 103.0)
        _legend_beside(row[-1])
    return figure


def value_figure(results: Results) -> Figure:
    """What the critic promises from the validation starts (line) and the discounted return that came (dashed)."""
    rows = math.ceil(len(METHODS) / VALUE_COLUMNS)
    figure = blank_figure(3.2 * VALUE_COLUMNS, 2.5 * rows * len(results.scenarios))
    grid = figure.subplots(rows * len(results.scenarios), VALUE_COLUMNS, squeeze=False)
    for place, scenario in enumerate(results.scenarios):
        cells = list(grid[rows * place : rows * (place + 1)].flat)
        for axes, method in zip(cells, METHODS, strict=False):
            curves = results.curves_of(scenario, method)
            for column, stroke, label in _VALUES:
                _band(axes, curves, "env_steps", lambda curve, column=column: curve[column], stroke, label)
            _axes(axes, f"{scenario}: {_label(results, scenario, method)}", "environment steps")
        for axes in cells[len(METHODS) :]:
            axes.set_axis_off()
    entries = [
        Line2D([], [], color=colour, linestyle=stroke, label=label) for _, (colour, stroke), label in _VALUES
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def survival_figure(results: Results) -> Figure:
    """Share of the seeds that are not yet at a level of success, against wall clock (Kaplan and Meier's curve)."""
    figure, grid = _grid(results, len(LEVELS))
    for row, scenario in zip(grid, results.scenarios, strict=True):
        for axes, level in zip(row, LEVELS, strict=True):
            for method in results.methods_of(scenario, METHODS):
                x, share = survival(times_to(results, scenario, method, level, "wall_s"))
                end = max(curve["wall_s"][-1] for curve in results.curves_of(scenario, method))
                colour, stroke = _style(method)
                x, share = np.append(x, max(end, x[-1])), np.append(share, share[-1])
                label = _label(results, scenario, method)
                axes.step(x, 100.0 * share, where="post", color=colour, linestyle=stroke, label=label)
            _axes(axes, f"{scenario}: seeds below {100 * level:.0f} % success, %", "wall clock, s")
            axes.set_ylim(-3.0, 103.0)
        _legend_beside(row[-1])
    return figure


def survival(times: Sequence[float]) -> tuple[Array, Array]:
    """Times at which seeds reach a level, 0 before them, and the share of seeds that has not: 1 at first.

    All runs have the same budget and a run is only cut off by its end, so this is Kaplan and Meier's estimate.
    """
    reached = np.sort([value for value in times if np.isfinite(value)])
    left = 1.0 - np.arange(1, len(reached) + 1) / max(len(times), 1)
    return np.concatenate([[0.0], reached]), np.concatenate([[1.0], left])


def methods_figure(results: Results) -> Figure:
    """Success as its interquartile mean, on the worst worlds, and the chance that ADRL improves on a method."""
    figure, grid = _grid(results, 3)
    for row, scenario in zip(grid, results.scenarios, strict=True):
        guidance = results.trained_with(scenario)
        names = results.methods_of(scenario, METHODS)
        success = {name: results.values(scenario, name, guidance, "success") for name in names}
        hard = hard_worlds(results, scenario)
        labels = {name: _label(results, scenario, name) for name in names}
        _intervals(row[0], {name: seed_iqm(success[name]) for name in names}, labels)
        title = f"{scenario}: success, IQM, %"
        if guidance != REPLANNED and REPLANNED in results.about["scenarios"][scenario]["evaluated"]:
            helped = {name: results.values(scenario, name, REPLANNED, "success") for name in names}
            _intervals(row[0], {name: seed_iqm(helped[name]) for name in names}, labels, OPEN)
            title += " (open: with replanner)"
        _axes(row[0], title, "")
        _intervals(
            row[1], {name: seed_mean(success_on(results, scenario, name, hard)) for name in names}, labels
        )
        _axes(row[1], f"{scenario}: success on the worst {100 * HARD_SHARE:.0f} % of worlds, %", "")
        rivals = [name for name in names if name != OURS] if OURS in names else []
        better = {name: probability_of_improvement(success[OURS], success[name]) for name in rivals}
        _intervals(row[2], better, labels)
        row[2].axvline(50.0, color=EDGE, linewidth=1.0, linestyle=":")
        for axes in row:
            axes.set_xlim(-3.0, 103.0)
        _axes(row[2], f"{scenario}: a seed of ADRL better, %", "")
    return figure


def _intervals(
    axes: Axes, values: Mapping[str, Interval], labels: Mapping[str, str], below: float = 0.0
) -> None:
    """A dot a method with its interval; an open one, that much below its place, where it is the second there."""
    for place, (name, (estimate, low, high)) in enumerate(values.items()):
        colour, _ = _style(name)
        if np.isfinite(low):
            axes.plot([100.0 * low, 100.0 * high], [place + below] * 2, color=colour, linewidth=2.0)
        fill = "white" if below else colour
        axes.plot(
            100.0 * estimate, place + below, "o", color=colour, markerfacecolor=fill, markersize=5, zorder=3
        )
    axes.set_yticks(range(len(values)), [labels[name] for name in values], fontsize=8)
    axes.set_ylim(max(len(values), 1) - 0.4, -0.6)


def _band(
    axes: Axes,
    curves: Sequence[Curve],
    x_column: str,
    of: Callable[[Curve], Array],
    style: tuple[str, LineStyleType],
    label: str,
) -> None:
    """Mean over seeds with a 95 % bootstrap band, where every seed has a value.

    Seeds are averaged at equal environment steps, x too: in wall clock or episodes the slow and the fast ones may have
    no value in common.
    """
    known = [(curve, of(curve)) for curve in curves]
    known = [
        ({n: curve[n][np.isfinite(y)] for n in ("env_steps", x_column)}, y[np.isfinite(y)])
        for curve, y in known
    ]
    known = [(curve, y) for curve, y in known if len(y)]
    if not known:
        return
    first, last = (
        choose(curve["env_steps"][end] for curve, _ in known) for choose, end in ((max, 0), (min, -1))
    )
    if last < first:
        return
    steps = np.linspace(first, last, POINTS)
    places = np.mean([np.interp(steps, curve["env_steps"], curve[x_column]) for curve, _ in known], axis=0)
    values = np.stack([np.interp(steps, curve["env_steps"], y) for curve, y in known])  # (seeds, POINTS)
    colour, stroke = style
    axes.plot(places, values.mean(axis=0), color=colour, linestyle=stroke, linewidth=1.6, label=label)
    if len(values) > 1:
        bands = [seed_mean(column, resamples=1000) for column in values.T]
        low, high = [band.low for band in bands], [band.high for band in bands]
        axes.fill_between(places, low, high, color=colour, alpha=0.13, linewidth=0.0)


def _route_panels(results: Results, scenario: str, guidance: str) -> list[RoutePanel]:
    """The same test tasks driven by the methods of Table I, the first seed of each."""
    recorded = {
        method: results.routes.get((scenario, method, "map" if method == PLANNER else guidance))
        for method in (PLANNER, *RIVALS)
    }
    driven = {method: routes for method, routes in recorded.items() if routes is not None}
    if not driven.keys() - {PLANNER}:
        return []
    about = results.about["scenarios"][scenario]
    count = max(int(routes["task"].max()) for routes in driven.values()) + 1
    tasks = task_set(
        get_scenario(results.scenario_of(scenario)), load_robot(about["robot"]), about["split"], count
    )
    panels = []
    for number, task in enumerate(tasks):
        lines, endings = {}, {}
        for method, routes in driven.items():
            chosen = routes["task"] == number
            if chosen.any():
                lines[LABELS[method]] = np.stack([routes["x_m"][chosen], routes["y_m"][chosen]], axis=1)
                endings[LABELS[method]] = _ending(results, scenario, method, guidance, number)
        panels.append(
            RoutePanel(
                world=task.world,
                start=task.start,
                goal=task.goal,
                goal_tolerance_m=task.goal_tolerance_m,
                trajectories=lines,
                endings=endings,
                title=f"{scenario}, guidance {guidance}, test task {number}",
            )
        )
    return panels


def _ending(results: Results, scenario: str, method: str, guidance: str, task: int) -> str:
    runs = results.outcomes(scenario, method, "map" if method == PLANNER else guidance)
    run = runs[min(runs)]
    row = int(np.flatnonzero(run["task"] == task)[0])
    if run["success"][row]:
        return "success"
    return "collision" if run["collision"][row] else "timeout"


def _grid(results: Results, columns: int, width_in: float = 4.2) -> tuple[Figure, Any]:
    rows = len(results.scenarios)
    figure = blank_figure(width_in * columns, 3.1 * rows)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _legend_beside(axes: Axes) -> None:
    """To the right, where no curve is."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles, labels, frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _axes(axes: Axes, title: str, x_label: str) -> None:
    axes.set_title(title, loc="left", fontsize=9)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    if x_label == "environment steps":
        axes.xaxis.set_major_formatter(lambda steps, _: f"{steps / 1000:g}k" if steps else "0")
    axes.set_xlabel(x_label, fontsize=8)
    axes.grid(color="#E4E6EA", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
