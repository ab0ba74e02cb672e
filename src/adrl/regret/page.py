"""The page of `adrl regret`: tables in Markdown, the same numbers as JSON, and a figure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from adrl import files
from adrl.comparison.config import CompareConfig
from adrl.regret.numbers import OUTCOMES, cell_rows, method_rows
from adrl.regret.regret import ENOUGH_SEEDS, missing, scores
from adrl.report.figures import blank_figure, line_style, save
from adrl.report.markdown import cell as text_of
from adrl.report.markdown import plain, table

SCHEMA_VERSION = 1
RESULTS_FILE, PAGE_FILE, FIGURE_FILE = "regret.json", "README.md", "regret.png"
MOST_NAMED = 8
"""Missing trainings that are named."""
UNITS = {"success": "points", "time": "%"}
NOTE = (
    "Regret: how much worse than the best method of the cell, mean over cells. Success: in points. Time: the mean time "
    "a task, the time limit where it was not solved, in % of the best method's. Intervals of 95 %: the training seed "
    "is the unit, resampled within each cell, seed s of one method paired with seed s of the other. Less the first "
    "method's: above 0 the first is better. p: sign flips of all pairs, corrected after Holm for the number of methods "
    "in a column."
)


def few_seeds(seeds: int) -> str | None:
    """What is said where the seeds prove nothing."""
    if seeds >= ENOUGH_SEEDS:
        return None
    return f"{seeds} of {ENOUGH_SEEDS} seeds: fewer than {ENOUGH_SEEDS} make no claim"


def write_page(comparisons: Mapping[str, CompareConfig], folder: Path) -> list[Path]:
    """Write what the complete cells say, and which jobs of the others are missing. Returns the files."""
    first = next(iter(comparisons.values()))
    lacking, found = missing(comparisons), scores(comparisons)
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "methods": list(first.method_names),
        "seeds": first.seeds,
        "claim": first.seeds >= ENOUGH_SEEDS,
        "cells": {name: config.title() for name, config in comparisons.items()},
        "missing": lacking,
        "rows": [],
        "cell_rows": [],
    }
    if found is not None:
        content |= {"rows": method_rows(found[0]), "cell_rows": cell_rows(*found)}
    files.write_json(folder / RESULTS_FILE, content)
    files.atomic_write_text(folder / PAGE_FILE, _page(content))
    paths = [folder / RESULTS_FILE, folder / PAGE_FILE]
    if content["rows"]:
        save(regret_figure(content["rows"]), folder / FIGURE_FILE)
        paths.append(folder / FIGURE_FILE)
    return paths


def _page(content: Mapping[str, Any]) -> str:
    lines = ["# Regret", "", NOTE, ""]
    if warning := few_seeds(content["seeds"]):
        lines += [f"**{warning}.**", ""]
    if content["rows"]:
        count = len(content["cells"]) - len(content["missing"])
        lines += [f"{count} cells, {content['seeds']} seeds.", "", *_methods(content["rows"])]
        lines += [f"![Regret of each method]({FIGURE_FILE})", "", *_cells(content)]
    lines += ["## Cells", "", *(f"- `{name}`: {title}" for name, title in content["cells"].items()), ""]
    for name, jobs in content["missing"].items():
        lines += [
            f"`{name}` is not in the tables: {_told_missing(jobs, len(content['methods']) * content['seeds'])}.",
            "",
        ]
    return "\n".join(lines)


def _told_missing(jobs: Sequence[str], trainings: int) -> str:
    """Of the trainings of a cell."""
    if len(jobs) == trainings:
        return "it has not been run"
    named = ", ".join(jobs[:MOST_NAMED]) + (", ..." if len(jobs) > MOST_NAMED else "")
    return f"{len(jobs)} of its {trainings} trainings are missing, {named}"


def _methods(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    first = rows[0]["method"]
    headings = ["method"]
    for outcome, unit in UNITS.items():
        headings += [f"regret in {outcome}, {unit}", "greatest in a cell", f"less {first}", "p (Holm)"]
    cells = []
    for row in rows:
        texts = [row["method"]]
        for outcome in OUTCOMES:
            texts.append(text_of(row, f"regret_{outcome}", 1, 100.0))
            texts.append(plain(100.0 * row[f"worst_{outcome}"], 1))
            texts.append(text_of(row, f"less_first_{outcome}", 1, 100.0, "+"))
            texts.append(plain(row[f"p_holm_{outcome}"], 4))
        cells.append(texts)
    return table(headings, cells)


def _cells(content: Mapping[str, Any]) -> list[str]:
    """Of each cell: success and time of every method, and its regrets."""
    lines = []
    headings = (
        *("cell", "method", "success, %", "regret, points"),
        *("time a task, s", "regret, %", "Av.T s, solved by all"),
    )
    rows = [
        [
            f"`{row['cell']}`",
            row["method"],
            text_of(row, "success", 1, 100.0),
            plain(100.0 * row["regret_success"], 1),
            text_of(row, "time_s", 1),
            plain(100.0 * row["regret_time"], 1),
            plain(row["common_time_s"], 1),
        ]
        for row in content["cell_rows"]
    ]
    lines += ["## Every cell", "", *table(headings, rows)]
    return lines


def regret_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Mean regret of each method with its interval, a panel an outcome; the least on top."""
    figure = blank_figure(9.0, 1.2 + 0.32 * len(rows))
    panels = figure.subplots(1, len(OUTCOMES))
    for axes, outcome in zip(panels, OUTCOMES, strict=True):
        ordered = sorted(enumerate(rows), key=lambda item: -item[1][f"regret_{outcome}"])
        for place, (index, row) in enumerate(ordered):
            value, low, high = (row[f"regret_{outcome}{end}"] for end in ("", "_low", "_high"))
            color, _ = line_style(index)
            if low is not None:
                axes.plot([100.0 * low, 100.0 * high], [place, place], color=color, linewidth=2.0)
            axes.plot(100.0 * value, place, "o", color=color)
        axes.set_yticks(range(len(ordered)), [row["method"] for _, row in ordered])
        axes.set_xlabel(f"regret in {outcome}, {UNITS[outcome]}")
        axes.grid(axis="x", alpha=0.3)
    return figure
