"""Where, with what and how long the kept results of `adrl reproduce` were made, as the runs recorded it."""

from collections.abc import Iterable
from typing import Any

from adrl.reproduction.results import Results


def run_lines(results: Results) -> list[str]:
    """A table for the head of the page."""
    calls: list[dict[str, Any]] = results.about.get("calls", [])
    trained = [run for run in results.runs if run["seed"] is not None]
    # Each has several evaluations.
    seconds = {(run["scenario"], run["method"], run["seed"]): run["train_seconds"] for run in trained}
    rows = {
        "machine": _distinct(_machine(call) for call in calls),
        "versions": _versions([*results.versions, *(call["versions"] for call in calls)]),
        "commit": _distinct(call["commit"] or "not of a checkout" for call in calls),
        "wall clock": _wall_clock(calls),
        "measured by": _distinct(call["measured_by"] for call in calls),
        "training": f"{sum(seconds.values()) / 60.0:.0f} core-minutes in {len(seconds)} runs, evaluation left out",
    }
    return ["| | |", "|-|-|", *(f"| {name} | {text or 'not recorded'} |" for name, text in rows.items()), ""]


def _machine(call: dict[str, Any]) -> str:
    cores = "a Ray cluster, started from" if call["cores"] is None else f"{call['cores']} cores of"
    return f"{cores} {call['machine']}"


def _versions(several: list[dict[str, str]]) -> str:
    found: dict[str, dict[str, None]] = {}
    for versions in several:
        for name, version in versions.items():
            found.setdefault(name, {})[version] = None
    return ", ".join(f"{name} {' and '.join(kinds)}" for name, kinds in found.items())


def _wall_clock(calls: list[dict[str, Any]]) -> str:
    if not calls:
        return ""
    minutes, seconds = divmod(round(sum(call["wall_s"] for call in calls)), 60)
    hours, minutes = divmod(minutes, 60)
    jobs = sum(call["jobs"] for call in calls)
    count = "1 call" if len(calls) == 1 else f"{len(calls)} calls together"
    return f"{hours} h {minutes} min {seconds} s, {jobs} jobs, {count}"


def _distinct(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))
