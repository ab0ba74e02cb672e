"""What a report is made of: the result files of a training run, of an evaluation or of a comparison."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adrl.agents.metrics import METRICS_FILE
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import CONFIG_FILE, WEIGHTS_FILE
from adrl.errors import CheckpointError
from adrl.evaluation.metrics import RATES, Episodes
from adrl.evaluation.results import EPISODES_FILE, SUMMARY_FILE, read_episodes, read_table
from adrl.evaluation.traces import TRACES_FILE, Traces, read_traces

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
    return [
        folder for folder in evaluation_folders(run) if _is_earlier(read_json(folder / SUMMARY_FILE), policy)
    ]


def _is_earlier(summary: Mapping[str, Any], policy: ResolvedPolicy) -> bool:
    if (summary.get("method"), summary.get("policy")) != (policy.method, policy.name):
        return False
    if summary.get("policy_fingerprint") is not None:
        return summary["policy_fingerprint"] != policy.fingerprint
    # Of a version that kept none.
    return any(summary.get(name) != policy.training[name] for name in ("env_steps", "gradient_updates"))


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object. Raises CheckpointError naming the file."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path}: not a readable JSON file ({error})") from None
    if not isinstance(content, dict):
        raise CheckpointError(f"{path}: not a JSON object")
    return content


def _run(folder: Path) -> Source:
    config = read_json(folder / CONFIG_FILE) if (folder / CONFIG_FILE).exists() else {}
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


def _run_facts(config: Mapping[str, Any]) -> dict[str, str]:
    """Of a finished run; a run that is going on has no config.json yet."""
    if not config:
        return {"state": "not finished"}
    facts = {key: str(config[key]) for key in ("method", "scenario", "guidance") if key in config}
    facts["robot"] = str(config.get("robot", {}).get("name", "unknown"))
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
    results, settings = read_json(folder / RESULTS_FILE), read_json(folder / SETTINGS_FILE)
    path = folder / RESULTS_FILE
    logs: dict[str, list[Path]] = {}
    evaluations = []
    try:
        jobs = {path.parent: read_json(path) for path in folder.glob(f"*/{SUMMARY_FILE}")}
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
        shared = settings["settings"]
        learner = shared["learner"]
        budgets = [] if learner["steps"] is None else [f"{learner['steps']:,} steps"]
        budgets += [] if learner["max_seconds"] is None else [f"{learner['max_seconds']:g} s"]
        facts = {
            "scenario": str(shared["scenario"]),
            "robot": str(shared["robot"]["name"]),
            "trained with guidance": str(shared["guidance"]),
            "budget of each run": " or ".join(budgets),
            "methods": str(len(logs)),
            "training runs": str(sum(map(len, logs.values()))),
            "evaluated on": f"{shared['episodes']} {shared['split']} tasks",
        }
        missing = [str(name) for name in results["missing"]]
    except (KeyError, TypeError) as error:
        raise CheckpointError(f"{path}: not the results of adrl compare ({error!r})") from None
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
        missing=missing,
    )


def _evaluated(folder: Path, label: str) -> Evaluated:
    summary = read_json(folder / SUMMARY_FILE)
    needed = {"policy", "method", "robot", "scenario", "guidance", "split", "episodes", *RATES}
    if absent := sorted(needed - summary.keys()):
        raise CheckpointError(
            f"{folder / SUMMARY_FILE}: not the summary of adrl evaluate; it lacks {absent[0]!r}"
        )
    traces = folder / TRACES_FILE
    return Evaluated(
        label=label,
        summary=summary,
        episodes=read_episodes(folder / EPISODES_FILE),
        traces=read_traces(traces) if traces.exists() else None,
    )


def _row(evaluation: Evaluated) -> dict[str, Any]:
    summary = evaluation.summary
    note = f"{summary['policy']} on {summary['scenario']}, {summary['guidance']}, {summary['split']}"
    return {**summary, "label": evaluation.label, "note": note}
