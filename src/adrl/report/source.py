"""What a report is made of: the result files of a training run, of an evaluation or of a comparison."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NotRequired, TypedDict

import numpy as np
from msgspec import Meta

from adrl.agents.metrics import METRICS_FILE
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import CONFIG_FILE, WEIGHTS_FILE
from adrl.errors import CheckpointError, FileError
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.results import EPISODES_FILE, SUMMARY_FILE, TRACES_FILE, read_episodes, read_table
from adrl.evaluation.trace_file import read_traces
from adrl.evaluation.traces import Traces
from adrl.json_files import checked, read_json

if TYPE_CHECKING:
    import pyarrow as pa

RESULTS_FILE, SETTINGS_FILE = "results.json", "settings.json"
"""Of a comparison's folder."""


@dataclass(frozen=True, kw_only=True)
class Evaluated:
    """One evaluation's files."""

    label: str
    """What it is called in the report: unique in it."""
    summary: Mapping[str, Any]
    episodes: Episodes
    traces: Traces | None
    """None where an evaluation kept none: it was made by an earlier version."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """All that a report shows."""

    kind: str
    """run, evaluation or comparison."""
    name: str
    facts: dict[str, str]
    """What was done, in words and numbers."""
    logs: dict[str, list[Path]] = field(default_factory=dict)
    """Method -> the metrics.jsonl of each of its seeds."""
    rows: list[dict[str, Any]]
    """Of the table of results: `label`, `note`, and metrics with _low and _high."""
    evaluations: list[Evaluated]
    driven: "pa.Table | None" = None
    """Every episode of a comparison, with columns method, seed and guidance."""
    missing: list[str] = field(default_factory=list)
    """Jobs of a comparison that have no result; evaluations of a run's policy as it was before."""


def read_source(folder: str | os.PathLike[str]) -> Source:
    """Read a folder that adrl train, evaluate or compare wrote. Raises CheckpointError naming a bad file."""
    folder = Path(folder)
    if not folder.is_dir():
        raise CheckpointError(f"{folder}: no such folder; give that of a run, a comparison or an evaluation")
    if (folder / RESULTS_FILE).exists() and (folder / SETTINGS_FILE).exists():
        return _comparison(folder)
    if (folder / METRICS_FILE).exists():
        return _run(folder)
    if (folder / SUMMARY_FILE).exists():
        evaluation = _evaluated(folder, folder.resolve().name)
        summary = evaluation.summary
        facts = {key: str(summary[key]) for key in ("policy", "scenario", "robot", "guidance", "split")}
        return Source(
            kind="evaluation",
            name=folder.resolve().name,
            facts=facts | {"episodes": str(summary["episodes"])},
            rows=[_row(evaluation)],
            evaluations=[evaluation],
        )
    raise CheckpointError(
        f"{folder}: holds neither {METRICS_FILE} of a training run, {RESULTS_FILE} of a comparison nor "
        f"{SUMMARY_FILE} of an evaluation"
    )


def evaluation_folders(run: Path) -> list[Path]:
    """Folders in a run's where adrl evaluate --out left its results, by name."""
    return sorted(path.parent for path in run.glob(f"*/{SUMMARY_FILE}"))


def outdated(run: Path) -> list[Path]:
    """Those of the evaluation folders that are of the run's policy as it was before: it has been trained for longer.

    Told by what stands in them, not by the files' times. Raises AdrlError.
    """
    if not (run / WEIGHTS_FILE).exists():
        return []
    policy = find_policy(run)
    return [folder for folder in evaluation_folders(run) if _is_earlier(read_summary(folder), policy)]


def _is_earlier(summary: Mapping[str, Any], policy: ResolvedPolicy) -> bool:
    if (summary.get("method"), summary.get("policy")) != (policy.method, policy.name):
        return False
    if summary.get("policy_fingerprint") is not None:
        return summary["policy_fingerprint"] != policy.fingerprint
    # Of a version that kept none.
    return any(summary.get(name) != policy.training[name] for name in ("env_steps", "gradient_updates"))


Rate = Annotated[float, Meta(ge=0.0, le=1.0)]


class _Summary(TypedDict):
    """What is read of the summary of adrl evaluate; the rest are numbers that are shown as they are."""

    policy: str
    method: str
    robot: str
    scenario: str
    guidance: str
    split: str
    episodes: int
    success: Rate
    collision: Rate
    timeout: Rate
    paper_literal: NotRequired[bool]


class _Name(TypedDict, total=False):
    name: str


class _Seed(TypedDict, total=False):
    seed: int


class _Learner(TypedDict, total=False):
    learner: _Seed


class _Trained(TypedDict, total=False):
    """What is read of a run's config.json."""

    method: str
    scenario: str
    guidance: str
    robot: _Name
    family: _Name
    settings: _Learner
    train_seconds: float | None
    env_steps: int | None
    gradient_updates: int | None
    maturity: float | None


class _Job(TypedDict):
    method: str
    seed: int | None


class _CompareRow(TypedDict):
    method: str
    guidance: str
    seeds: int | None


class _CompareResults(TypedDict):
    rows: list[_CompareRow]
    missing: list[str]


class _Budget(TypedDict):
    steps: int | None
    max_seconds: float | None


class _Shared(TypedDict):
    scenario: str
    robot: _Name
    guidance: str
    episodes: int
    robots: NotRequired[int | None]
    split: str
    learner: _Budget


class _CompareSettings(TypedDict):
    settings: _Shared


def _read(path: Path, kind: type) -> dict[str, Any]:
    """A JSON object of at least this kind. Raises CheckpointError naming the file."""
    try:
        content = read_json(path, dict[str, Any])
        checked(content, kind)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; it is not what adrl wrote, make it anew") from None
    return content


def read_run(folder: Path) -> dict[str, Any]:
    """What a run's config.json says. Raises CheckpointError."""
    return _read(folder / CONFIG_FILE, _Trained)


def read_summary(folder: Path) -> dict[str, Any]:
    """That of adrl evaluate. Raises CheckpointError."""
    return _read(folder / SUMMARY_FILE, _Summary)


def _run(folder: Path) -> Source:
    config = read_run(folder) if (folder / CONFIG_FILE).exists() else {}
    method = str(config.get("method", "policy"))
    earlier = outdated(folder)
    evaluations = [_evaluated(path, path.name) for path in evaluation_folders(folder) if path not in earlier]
    # Its own policy before what it is measured against.
    evaluations.sort(key=lambda entry: entry.summary["method"] != method)
    return Source(
        kind="run",
        name=folder.resolve().name,
        facts=_run_facts(config),
        logs={method: [folder / METRICS_FILE]},
        rows=[_row(evaluation) for evaluation in evaluations],
        evaluations=evaluations,
        missing=[f"{path.name} (of the policy before it was trained for longer)" for path in earlier],
    )


def robot_of_run(config: Mapping[str, Any]) -> str:
    """Name of the robot, or of the family, that a run's config.json says it was trained for."""
    return str((config.get("family") or config.get("robot") or {}).get("name", "unknown"))


def _run_facts(config: Mapping[str, Any]) -> dict[str, str]:
    """Of a finished run; a run that is going on has no config.json yet."""
    if not config:
        return {"state": "not finished"}
    facts = {key: str(config[key]) for key in ("method", "scenario", "guidance") if key in config}
    facts["robot"] = robot_of_run(config)
    learner = config.get("settings", {}).get("learner", {})
    if "seed" in learner:
        facts["seed"] = str(learner["seed"])
    for key, name, form in (
        ("train_seconds", "trained for", "{:,.0f} s"),
        ("env_steps", "environment steps", "{:,}"),
        ("gradient_updates", "updates", "{:,}"),
        ("maturity", "S at the end", "{:.2f}"),
    ):
        if config.get(key) is not None:
            facts[name] = form.format(config[key])
    return facts


def _comparison(folder: Path) -> Source:
    results = _read(folder / RESULTS_FILE, _CompareResults)
    shared = _read(folder / SETTINGS_FILE, _CompareSettings)["settings"]
    jobs = {path.parent: _read(path, _Job) for path in folder.glob(f"*/{SUMMARY_FILE}")}
    logs: dict[str, list[Path]] = {}
    evaluations = []
    # By the seed's number: s10 comes after s9.
    for job, about in sorted(jobs.items(), key=lambda item: (item[1]["method"], item[1]["seed"] or 0)):
        if about["seed"] is not None:
            logs.setdefault(about["method"], []).append(job / METRICS_FILE)
        for kept in evaluation_folders(job):
            evaluations.append(_evaluated(kept, f"{job.name}, {kept.name}"))
    rows = [dict(row) for row in results["rows"]]
    for row in rows:
        seeds = "not trained here" if row["seeds"] is None else f"{row['seeds']} seeds"
        row |= {"label": row["method"], "note": f"{row['guidance']}, {seeds}"}
    learner = shared["learner"]
    budgets = [] if learner["steps"] is None else [f"{learner['steps']:,} steps"]
    budgets += [] if learner["max_seconds"] is None else [f"{learner['max_seconds']:g} s"]
    facts = {
        "scenario": shared["scenario"],
        "robot": shared["robot"].get("name", "unknown"),
        "trained with guidance": shared["guidance"],
        "budget of each run": " or ".join(budgets),
        "methods": str(len(logs)),
        "training runs": str(sum(map(len, logs.values()))),
        "evaluated on": f"{shared['episodes']} {shared['split']} tasks"
        + (f" of each of {shared['robots']} robots" if shared.get("robots") else ""),
    }
    # The order of the table, the planner's last.
    order = list(dict.fromkeys(row["method"] for row in rows))
    evaluations.sort(
        key=lambda entry: order.index(entry.summary["method"]) if entry.summary["method"] in order else 0
    )
    return Source(
        kind="comparison",
        name=folder.resolve().name,
        facts=facts,
        logs={name: logs[name] for name in order if name in logs},
        rows=rows,
        evaluations=evaluations,
        driven=read_table(folder / EPISODES_FILE) if (folder / EPISODES_FILE).exists() else None,
        missing=results["missing"],
    )


def _evaluated(folder: Path, label: str) -> Evaluated:
    summary = read_summary(folder)
    path, episodes = folder / TRACES_FILE, read_episodes(folder / EPISODES_FILE)
    traces = read_traces(path) if path.exists() else None
    if traces is not None and not np.array_equal(traces.tasks, episodes.task):
        raise CheckpointError(f"{path}: is of other tasks than {EPISODES_FILE}; evaluate again")
    return Evaluated(
        label=label,
        summary=summary,
        episodes=episodes,
        traces=traces,
    )


def _row(evaluation: Evaluated) -> dict[str, Any]:
    summary = evaluation.summary
    note = f"{summary['policy']} on {summary['scenario']}, {summary['guidance']}, {summary['split']}"
    return {**summary, "label": evaluation.label, "note": note}
