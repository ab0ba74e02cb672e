"""From the result of each training to one row a method. The training seed is the unit of every interval."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from adrl import api
from adrl.agents.metrics import METRICS_FILE
from adrl.baselines.planners import PLANNERS
from adrl.comparison.jobs import EPISODES_FILE, RESULT_FILE
from adrl.errors import CheckpointError, FileError
from adrl.evaluation.learning_time import median_seconds_to_level, seconds_to_level
from adrl.evaluation.metrics import COMMON, SOCIAL, means_on_common_tasks
from adrl.evaluation.results import plain_table, read_table
from adrl.evaluation.statistics import Interval, entry, probability_of_improvement, seed_iqm, seed_mean
from adrl.json_files import checked, read_json
from adrl.report.metrics_log import read_metrics

if TYPE_CHECKING:
    from rich.table import Table

OURS = "adrl"
"""The method whose probability of improvement over each other one is told."""
MEANS = ("success", "collision", "timeout", "distance_m", "time_s", "optimality", "spl")
TRAINING = ("train_seconds", "env_steps", "gradient_updates")
DECILE = "worst_decile"
"""Told of the robots of a family alone."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Evaluated:
    """One evaluation of one training, or of the planner, which has no seed."""

    method: str
    seed: int | None
    summary: dict[str, Any]
    seconds_to_90: float
    """Infinite where it never happened, NaN where nothing was evaluated in training."""
    beside_planner: dict[str, float]
    """means_on_common_tasks with the planner as the reference; empty without one, and for the planner."""


def read_runs(folders: Sequence[Path]) -> list[Evaluated]:
    """The evaluations in result folders METHOD-sSEED. Raises CheckpointError naming a malformed file."""
    runs = []
    planners = [outcomes(folder) for folder in folders if folder.name == api.PLANNER]
    planner = next(iter(planners[0].values())) if planners else None
    for folder in folders:
        path = folder / RESULT_FILE
        try:
            content = read_json(path, _Result)
            method, seed = content["method"], content["seed"]
            seconds = math.nan if seed is None else _seconds_to_90(folder / METRICS_FILE)
            driven = {} if seed is None or planner is None else outcomes(folder)
            for summary in content["evaluations"]:
                _require_summary(summary)
                own = driven.get(summary["guidance"])
                beside = {} if own is None or planner is None else means_on_common_tasks(own, planner)
                runs.append(Evaluated(method, seed, summary, seconds, beside))
        except FileError as error:
            raise CheckpointError(f"{path} {error}; delete it and run again") from None
        except KeyError as error:
            raise CheckpointError(
                f"{folder}: its episodes are of other evaluations ({error}); delete it and run again"
            ) from None
    return runs


class _Guidance(TypedDict):
    guidance: str


class _Result(TypedDict):
    """What is read of the summary.json of a job."""

    method: str
    seed: int | None
    evaluations: list[dict[str, Any]]


def _require_summary(summary: dict[str, Any]) -> None:
    """It has a guidance, and all metrics as numbers, or None where undefined. Raises FileError."""
    checked(summary, _Guidance)
    metrics = measured([summary])
    names = [*(name + end for name in metrics for end in ("", "_low", "_high")), *TRAINING]
    if lacking := [name for name in names if name not in summary]:
        raise FileError(f"lacks {lacking[0]} of an evaluation")
    checked({name: summary[name] for name in names}, dict[str, float | None])


def measured(summaries: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """MEANS, and where people walked in all of these evaluations SOCIAL."""
    return (*MEANS, *SOCIAL) if all("at_fault" in summary for summary in summaries) else MEANS


def outcomes(folder: Path) -> dict[str, dict[str, Any]]:
    """Guidance -> columns of the episodes."""
    table = read_table(folder / EPISODES_FILE)
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    guidance = columns["guidance"]
    return {
        str(name): {key: column[guidance == name] for key, column in columns.items()}
        for name in dict.fromkeys(guidance.tolist())
    }


def _seconds_to_90(path: Path) -> float:
    columns = read_metrics(path)
    return seconds_to_level(
        columns["wall_s"], columns.get("success", np.full(len(columns["wall_s"]), np.nan))
    )


def method_rows(runs: Sequence[Evaluated]) -> list[Row]:
    """One row for each method and guidance, in the order of the runs, the planner's last.

    Rates and other metrics of `measured`, means over seeds with a stratified bootstrap interval `_low`, `_high`;
    `success_iqm`, `success_worst`; `seconds_to_90` the median over seeds, None where it is infinite or nothing was
    evaluated in training, and how many seeds got there; `improvement`: the probability that a seed of ours beats
    one of this method; the keys of means_on_common_tasks, with the planner as the reference; of a family
    `worst_decile` too. The planner has no seeds: its intervals are over episodes.
    """
    groups: dict[tuple[str, str], list[Evaluated]] = {}
    for run in runs:
        groups.setdefault((run.method, run.summary["guidance"]), []).append(run)
    metrics = measured(run.summary for run in runs)
    rows = []
    for (method, guidance), group in groups.items():
        if group[0].seed is None:
            rows.append(_reference_row(group[0], metrics))
            continue
        rival = groups.get((OURS, guidance)) if method != OURS else None
        rows.append(_method_row(group, rival, metrics))
    return sorted(rows, key=lambda row: row["seeds"] is None)


def _method_row(group: list[Evaluated], ours: list[Evaluated] | None, metrics: Sequence[str]) -> Row:
    row: Row = {"method": group[0].method, "guidance": group[0].summary["guidance"], "seeds": len(group)}
    success = _column(group, "success")
    for name in metrics:
        row |= entry(name, seed_mean(_column(group, name)))
    row |= entry("success_iqm", seed_iqm(success)) | {"success_worst": min(success)}
    if deciles := _column(group, DECILE):
        row |= entry(DECILE, seed_mean(deciles))
    seconds = [run.seconds_to_90 for run in group]
    median = median_seconds_to_level(seconds)
    row["seconds_to_90"] = median if math.isfinite(median) else None
    evaluated = not np.isnan(seconds).any()
    row["seeds_to_90"] = int(np.isfinite(seconds).sum()) if evaluated else None
    improvement = (
        (math.nan,) * 3 if ours is None else probability_of_improvement(_column(ours, "success"), success)
    )
    row |= entry("improvement", Interval(*improvement))
    known = [run.beside_planner for run in group if run.beside_planner.get("common_tasks")]
    for name in COMMON:
        row[name] = float(np.mean([entry[name] for entry in known])) if known else None
    for name in TRAINING:
        row[name] = float(np.mean([run.summary[name] for run in group]))
    return row


def _reference_row(run: Evaluated, metrics: Sequence[str]) -> Row:
    summary = run.summary
    row: Row = {"method": run.method, "guidance": summary["guidance"], "seeds": None}
    told = (*metrics, *([DECILE] if DECILE in summary else []))
    row |= {name + end: summary[name + end] for name in told for end in ("", "_low", "_high")}
    nothing = ("seconds_to_90", "seeds_to_90", "success_worst", *TRAINING, *COMMON)
    row["warnings"] = summary.get("warnings", [])
    return row | dict.fromkeys(nothing) | entry("success_iqm", None) | entry("improvement", None)


def _column(group: list[Evaluated], name: str) -> list[float]:
    """A metric of each seed; without the seeds where it is undefined, such as the time of no success."""
    values = [run.summary.get(name) for run in group]
    return [float(value) for value in values if value is not None]


@dataclass(frozen=True)
class _Column:
    heading: str
    metric: str
    decimals: int
    scale: float = 1.0
    interval: bool = False
    beside: bool = False
    """Whether it is also told as a share of the planner's."""


_COLUMNS = (
    _Column("success %", "success", 1, 100.0, True),
    _Column("IQM %", "success_iqm", 1, 100.0),
    _Column("worst %", "success_worst", 1, 100.0),
    _Column("decile %", DECILE, 1, 100.0, True),
    _Column("coll. %", "collision", 1, 100.0),
    _Column("time out %", "timeout", 1, 100.0),
    _Column("Av.D m", "distance_m", 1, beside=True),
    _Column("Av.T s", "time_s", 1, beside=True),
    _Column("opt.", "optimality", 2, beside=True),
    _Column("SPL", "spl", 2),
    _Column("90 % s", "seconds_to_90", 1),
    _Column("adrl better %", "improvement", 0, 100.0, True),
)
_SOCIAL_COLUMNS = (
    _Column("at fault %", "at_fault", 1, 100.0),
    _Column("lost s", "lost_s", 1),
    _Column("frozen s", "frozen_s", 1),
    _Column("near s", "near_person_s", 1),
    _Column("nearest m", "person_distance_m", 2),
)
"""Where people walked, instead of these of the others:"""
_LEFT_OUT = ("success_iqm", "timeout", "distance_m", "optimality", "spl")
_ABOUT = (
    "success: mean over training seeds with its 95 % interval (over episodes for a planner); 90 %: wall clock of "
    "training until two validations in a row reach 90 %, median over seeds; adrl better: chance that a seed of adrl "
    "beats one of the method; "
)
_ABOUT_PATHS = (
    "Av.D, Av.T and opt. (path / shortest path) over each method's own successes, x: as a share of the planner's, over "
    "the tasks that both reached"
)
_ABOUT_PEOPLE = (
    "at fault: collisions by moving into something; Av.T and lost, to the clear path at full speed, over each method's "
    "own successes, x: as a share of the planner's, over the tasks that both reached; near: within 0.5 m of a person"
)


def _columns(rows: Sequence[Row]) -> list[_Column]:
    """Those of the table."""
    of_family = any(DECILE in row for row in rows)
    columns = [column for column in _COLUMNS if of_family or column.metric != DECILE]
    if not any("at_fault" in row for row in rows):
        return columns
    columns = [column for column in columns if column.metric not in _LEFT_OUT]
    behind = [column.metric for column in columns].index("collision") + 1
    return [*columns[:behind], *_SOCIAL_COLUMNS, *columns[behind:]]


def _caption(columns: Sequence[_Column]) -> str:
    metrics = {column.metric for column in columns}
    text = _ABOUT + (_ABOUT_PEOPLE if "at_fault" in metrics else _ABOUT_PATHS)
    return text + ("; decile: success that nine of ten robots reach at least" if DECILE in metrics else "")


def _cell(row: Row, column: _Column) -> tuple[str, str]:
    """The estimate and its interval, as text."""

    def number(value: float) -> str:
        return f"{value * column.scale:.{column.decimals}f}"

    value = row.get(column.metric)
    if value is None:
        never = column.metric == "seconds_to_90" and row["seeds_to_90"] is not None
        return (">budget" if never else "-"), ""
    if column.beside:
        own, planners = (row[f"{whose}{column.metric}_common"] for whose in ("", "reference_"))
        return number(value), f"x {own / planners:.2f}" if own is not None and planners else ""
    low, high = row.get(f"{column.metric}_low"), row.get(f"{column.metric}_high")
    if not column.interval or low is None or high is None:
        return number(value), ""
    return number(value), f"{number(low)}-{number(high)}"


def _note(row: Row) -> str:
    """What is said of a row besides its method."""
    return (
        f"{row['guidance']}, {untrained(row)}"
        if row["seeds"] is None
        else f"{row['guidance']}, n={row['seeds']}"
    )


def untrained(row: Row) -> str:
    """What a method without seeds is."""
    return "planner" if row["method"] in PLANNERS else "as it is"


def _warnings(rows: Sequence[Row]) -> list[str]:
    return [f"WARNING: {line}" for row in rows for line in row.get("warnings", ())]


def markdown(rows: Sequence[Row], title: str, missing: Sequence[str] = ()) -> str:
    """The table as Markdown; `missing` names jobs whose results are not in it."""
    columns = _columns(rows)
    headings = ["method", "guidance", *(column.heading for column in columns)]
    lines = [title, "", "| " + " | ".join(headings) + " |", "|" + "-|" * len(headings)]
    for row in rows:
        cells = [_cell(row, column) for column in columns]
        texts = [value + (f" [{interval}]" if interval else "") for value, interval in cells]
        lines.append("| " + " | ".join([row["method"], _note(row), *texts]) + " |")
    lines += ["", _caption(columns) + "."]
    for line in _warnings(rows):
        lines += ["", line]
    if missing:
        lines += ["", f"Not in it yet: {', '.join(missing)}."]
    return "\n".join(lines) + "\n"


def rich_table(rows: Sequence[Row], title: str) -> "Table":
    """The table for a terminal: each estimate above its interval. Fits 80 columns."""
    from rich.text import Text

    columns = _columns(rows)
    table = plain_table(title, "\n".join([_caption(columns), *_warnings(rows)]), padding=0)
    table.add_column("method", overflow="fold", min_width=10)
    for column in columns:
        table.add_column(column.heading.replace(" ", "\n"), justify="right", no_wrap=True)
    for row in rows:
        cells = [Text(row["method"]).append(f"\n{_note(row)}", style="dim")]
        for column in columns:
            value, interval = _cell(row, column)
            cells.append(Text(value).append(f"\n{interval}" if interval else "", style="dim"))
        table.add_row(*cells)
    return table
