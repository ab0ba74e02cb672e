"""Result files of an evaluation (design section 9), and the table that compares several of them."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from adrl import files, outputs
from adrl.deploy.policies import ResolvedPolicy
from adrl.errors import CheckpointError, ConfigError, FileError, brief
from adrl.evaluation.metrics import (
    OVER_SUCCESSES,
    Episodes,
    on_common_tasks,
    rates_of,
    samples_of,
    solved_by_all,
)
from adrl.evaluation.statistics import (
    Interval,
    bootstrap_mean,
    paired_difference,
    paired_rate_difference,
    wilson_interval,
)
from adrl.json_files import read_json

if TYPE_CHECKING:
    import pyarrow as pa
    from rich.table import Table

SCHEMA_VERSION = 1
"""Raised when a key changes its meaning or goes away, not when one is added."""

MAX_BYTES, MAX_ROWS = 2**30, 10**7
"""Of a table that is read."""

SUMMARY_FILE, EPISODES_FILE = "summary.json", "episodes.parquet"
ROBOTS_FILE, TRACES_FILE = "robots.parquet", "traces.safetensors"
"""Of an evaluation's folder; robots.parquet, of a family's, has a row a robot: see by_robot."""

Summary = dict[str, Any]
"""One evaluation as it stands in the JSON file."""


@dataclass(frozen=True, kw_only=True)
class RunMeta:
    """Which policy was evaluated on what."""

    policy: str
    """Name of the policy, or the run folder it came from."""
    method: str
    """How it was made: adrl, td3, ..., or astar-dwa."""
    robot: str
    scenario: str
    guidance: str
    split: str
    simulator: str = "native"
    """native, or gazebo."""
    paper_literal: bool = False
    """Guidance `replan` computed its equations as printed."""
    supervised: bool = False
    """The runtime with its supervisor drove, as on a robot."""
    trained_paper_literal: bool | None = None
    """The training computed every equation as printed; None where there was none, or its run does not say."""
    trained_for: str | None = None
    """Name of the robot that the policy was made for; None for any."""
    policy_fingerprint: str | None = None
    """The same for the same weights; None for code."""
    warnings: Sequence[str] = ()
    """What a reader of the numbers has to know, as that the policy was trained for another robot."""
    train_seconds: float | None = None
    """Wall clock spent on training; None for a planner."""
    env_steps: int | None = None
    """Environment steps of training; None for a planner."""
    gradient_updates: int | None = None
    """Critic updates of training; None for a planner."""

    @classmethod
    def of(cls, driver: ResolvedPolicy, **where: Any) -> Self:
        """Of a policy; where: the fields that do not follow from it."""
        return cls(
            policy=driver.name,
            method=driver.method,
            trained_for=driver.made_for,
            policy_fingerprint=driver.fingerprint,
            **driver.training,
            **where,
        )


def summarise(episodes: Episodes, meta: RunMeta) -> Summary:
    """The JSON document of one evaluation. Each metric comes with _low and _high, its 95 % interval.

    Rates have Wilson intervals; means have percentile bootstrap intervals over episodes. `distance_m`,
    `time_s` and `optimality` are over successes. None where undefined: no success, or an interval from a
    single number. Equal episodes give equal documents.
    """
    summary: Summary = {**about_run(meta), "episodes": len(episodes)}
    for ending in rates_of(episodes):
        flags = getattr(episodes, ending)
        summary |= interval_entry(ending, wilson_interval(int(flags.sum()), len(flags)))
    for name, samples in samples_of(episodes).items():
        summary |= interval_entry(name, bootstrap_mean(samples(episodes)))
    return summary | training_of(meta)


TRAINING = ("train_seconds", "env_steps", "gradient_updates")


def about_run(meta: RunMeta) -> Summary:
    """What a document begins with: of which policy it is, and where it drove."""
    about = {key: value for key, value in asdict(meta).items() if key not in TRAINING}
    return {"schema_version": SCHEMA_VERSION, **about, "warnings": list(meta.warnings)}


def training_of(meta: RunMeta) -> Summary:
    """What it ends with: what the policy's training took."""
    return {key: _defined(getattr(meta, key)) for key in TRAINING}


def require_results_folder(option: str, path: outputs.PathLike | None) -> None:
    """An evaluation can be saved at path: a new folder, or that of another, which it replaces. Raises ConfigError."""
    outputs.require_folder(
        option, path, SUMMARY_FILE, parts=(EPISODES_FILE, ROBOTS_FILE, TRACES_FILE)
    )  # the summary is written last
    summary = None if path is None else Path(path) / SUMMARY_FILE
    if summary is None or not summary.exists():
        return
    try:
        known = "split" in read_json(summary, dict[str, Any])
    except FileError:
        known = False
    if not known:
        raise ConfigError(f"{option} {path} holds results of something else; give another folder")


def compare_paired(first: Episodes, second: Episodes) -> dict[str, Interval]:
    """Metric by metric, first minus second on the tasks both drove, with paired 95 % intervals.

    Tango's of rates, which tells what none that differ leaves open; bootstrap intervals of the others.
    Metrics over successes use the tasks that both solved, so that neither gains by failing the long ones.
    """
    tasks = on_common_tasks([first, second])
    solved = solved_by_all([first, second])
    differences = {
        ending: paired_rate_difference(*(getattr(episodes, ending) for episodes in tasks))
        for ending in rates_of(first, second)
    }
    for name, samples in samples_of(first, second).items():
        pair = solved if name in (*OVER_SUCCESSES, "lost_s") else tasks
        differences[name] = paired_difference(*(samples(episodes) for episodes in pair))
    return differences


def write_episodes(path: str | os.PathLike[str], episodes: Episodes) -> None:
    """Write one row an episode as Parquet, atomically."""
    write_table(path, episodes.to_table())


def write_table(path: str | os.PathLike[str], table: "pa.Table") -> None:
    """Write a table as Parquet, atomically."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    files.atomic_write_bytes(path, sink.getvalue().to_pybytes())


def read_episodes(path: str | os.PathLike[str]) -> Episodes:
    """Read what write_episodes wrote. Raises CheckpointError naming the file: missing or malformed."""
    try:
        return Episodes.from_table(read_table(path))
    except CheckpointError as error:
        raise error if str(path) in str(error) else CheckpointError(f"{path}: {error}") from error


def read_table(path: str | os.PathLike[str]) -> "pa.Table":
    """Read what write_table wrote. Raises CheckpointError naming the file: missing, no Parquet, too large."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not os.path.exists(path):
        raise CheckpointError(f"{path}: no such file; run adrl evaluate with --out first")
    try:
        # One file, never a folder of them: pyarrow would take a folder as a dataset.
        file = pq.ParquetFile(pa.py_buffer(files.read_bytes(path, MAX_BYTES)))
        if file.metadata.num_rows > MAX_ROWS:  # a small file may say the same row a billion times
            raise ValueError(f"{file.metadata.num_rows} rows, {MAX_ROWS} at most are read")
        table = file.read()
        table.validate(full=True)
        return table
    except (FileError, pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise CheckpointError(
            f"{path}: not a readable Parquet file ({brief(error)}); evaluate again"
        ) from error


@dataclass(frozen=True, kw_only=True)
class _Column:
    """A column of the comparison table: value * scale, with so many decimals."""

    metric: str
    heading: str
    scale: float = 1.0
    decimals: int


_COLUMNS = (
    _Column(metric="success", heading="success\n%", scale=100.0, decimals=1),
    _Column(metric="collision", heading="collision\n%", scale=100.0, decimals=1),
    _Column(metric="timeout", heading="timeout\n%", scale=100.0, decimals=1),
    _Column(metric="distance_m", heading="Av.D\nm", decimals=1),
    _Column(metric="time_s", heading="Av.T\ns", decimals=1),
    _Column(metric="optimality", heading="optimality\n", decimals=2),
    _Column(metric="spl", heading="SPL\n", decimals=2),
)
_SOCIAL_COLUMNS = (
    *_COLUMNS[:2],
    _Column(metric="at_fault", heading="at fault\n%", scale=100.0, decimals=1),
    _Column(metric="lost_s", heading="lost\ns", decimals=1),
    _Column(metric="frozen_s", heading="frozen\ns", decimals=1),
    _Column(metric="near_person_s", heading="near\ns", decimals=1),
    _Column(metric="person_distance_m", heading="nearest\nm", decimals=2),
)
"""Instead of these, where people walked."""
_CONTEXT = ("scenario", "robot", "guidance", "split", "episodes")


def comparison_table(summaries: Sequence[Mapping[str, Any]]) -> "Table":
    """A rich table, one row a policy: each estimate above its 95 % interval. Fits 80 columns.

    What all summaries share stands in the title; what differs stands below the policy's name.
    """
    from rich.text import Text

    shared = [key for key in _CONTEXT if len({summary[key] for summary in summaries}) == 1]
    title = ", ".join(f"{key} {summaries[0][key]}" for key in shared)
    caption = "below each estimate its 95 % interval; Av.D, Av.T and optimality over successes"
    columns = _COLUMNS
    if any("at_fault" in summary for summary in summaries):
        columns = _SOCIAL_COLUMNS
        caption = (
            "below each estimate its 95 % interval; at fault: collisions by moving into something; lost: to the clear "
            "path at full speed, over successes; near: within 0.5 m of a person"
        )
    warnings = dict.fromkeys(line for summary in summaries for line in summary.get("warnings", ()))
    table = plain_table(title, "\n".join([caption, *(f"WARNING: {line}" for line in warnings)]), padding=0)
    table.add_column("policy\n", overflow="fold", min_width=9)
    for column in columns:
        table.add_column(column.heading, justify="right", no_wrap=True)
    for summary in summaries:
        differing = [f"{key} {summary[key]}" for key in _CONTEXT if key not in shared]
        label = Text(str(summary["policy"]))
        label.append("".join(f"\n{line}" for line in differing), style="dim")
        table.add_row(label, *(_cell(summary, column) for column in columns))
    return table


def plain_table(title: str, caption: str = "", padding: int | tuple[int, int] = (0, 1)) -> "Table":
    """An empty rich table with a rule below its headings and nothing about it."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    return Table(
        title=Text(title),
        title_justify="left",
        caption=Text(caption) if caption else None,
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=padding,
        pad_edge=False,
    )


def _cell(summary: Mapping[str, Any], column: _Column) -> Any:
    from rich.text import Text

    def number(value: float) -> str:
        return f"{value * column.scale:.{column.decimals}f}"

    estimate, low, high = (summary.get(column.metric + suffix) for suffix in ("", "_low", "_high"))
    text = Text("-" if estimate is None else number(estimate))
    if low is not None and high is not None:
        text.append(f"\n{number(low)}-{number(high)}", style="dim")
    return text


def interval_entry(name: str, interval: Interval) -> Summary:
    """The metric with _low and _high, None where undefined."""
    values = zip(("", "_low", "_high"), interval, strict=True)
    return {name + suffix: _defined(value) for suffix, value in values}


def _defined(value: float | None) -> float | None:
    """None for NaN and infinity, which JSON does not have."""
    return None if value is None or not math.isfinite(value) else value
