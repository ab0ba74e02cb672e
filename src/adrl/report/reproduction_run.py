"""Where, with what and how long the kept results of `adrl reproduce` were made, as the runs recorded it."""

from collections.abc import Iterable
from typing import Any

from adrl.report.reproduction import Results


def run_lines(results: Results) -> list[str]:
    """A table for the head of the page."""
    sessions: list[dict[str, Any]] = results.about.get("sessions", [])
    trained = [run for run in results.runs if run["seed"] is not None]
    # Each has several evaluations.
    seconds = {(run["scenario"], run["method"], run["seed"]): run["train_seconds"] for run in trained}
    rows = {
        "machine": _distinct(_machine(session) for session in sessions),
        "versions": _versions([*results.versions, *(session["versions"] for session in sessions)]),
        "commit": _distinct(session["commit"] or "not of a checkout" for session in sessions),
        "wall clock": _wall_clock(sessions),
        "measured by": _distinct(session["measured_by"] for session in sessions),
        "training": f"{sum(seconds.values()) / 60.0:.0f} core-minutes in {len(seconds)} runs, evaluation left out",
    }
    return ["| | |", "|-|-|", *(f"| {name} | {text or 'not recorded'} |" for name, text in rows.items()), ""]


def _machine(session: dict[str, Any]) -> str:
    cores = "a Ray cluster, started from" if session["cores"] is None else f"{session['cores']} cores of"
    return f"{cores} {session['machine']}"


def _versions(several: list[dict[str, str]]) -> str:
    found: dict[str, dict[str, None]] = {}
    for versions in several:
        for name, version in versions.items():
            found.setdefault(name, {})[version] = None
    return ", ".join(f"{name} {' and '.join(kinds)}" for name, kinds in found.items())


def _wall_clock(sessions: list[dict[str, Any]]) -> str:
    if not sessions:
        return ""
    minutes, seconds = divmod(round(sum(session["wall_s"] for session in sessions)), 60)
    hours, minutes = divmod(minutes, 60)
    jobs = sum(session["jobs"] for session in sessions)
    calls = "1 session" if len(sessions) == 1 else f"{len(sessions)} sessions together"
    return f"{hours} h {minutes} min {seconds} s, {jobs} jobs, {calls}"


def _distinct(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))
