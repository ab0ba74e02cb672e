"""The tables of the pages, made from the files they stand in: no number of them is written by hand.

    python docs/tables.py            writes every table of README.md and docs/ anew
    python docs/tables.py --check    says which pages do not tell what their files say, and fails

A page holds a table between two comments, the first of which names a form of FORMS and a file or folder below
docs/results:

    <!-- table: compare compare/jackal-131k.json -->
    <!-- end of table -->
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from adrl import files
from adrl.baselines.planners import PLANNERS
from adrl.benchmarks.fault_drives import OUTCOMES
from adrl.benchmarks.faults import FAULTS
from adrl.comparison.config import DRIVING
from adrl.comparison.results import Row, markdown
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.errors import ConfigError
from adrl.evaluation.metrics import COMMON
from adrl.evaluation.statistics import bootstrap_mean, entry, wilson_interval
from adrl.report.markdown import cell, plain, table
from adrl.reproduction.reported import label
from adrl.runs.card import card

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"
BLOCK = re.compile(r"(<!-- table: (?P<form>\S+) (?P<file>\S+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


def compare_rows(path: Path) -> list[str]:
    """The rows of the results.json of adrl compare: intervals over seeds, of a planner over tasks."""
    return _compared("method", _json(path)["rows"])


def compare_all(path: Path) -> list[str]:
    """The same with every column, as adrl compare itself writes it."""
    content = _json(path)
    rows = [dict.fromkeys(COMMON) | row for row in content["rows"]]  # files of before have no common tasks
    return [*markdown(rows, "", content["missing"]).strip().splitlines(), ""]


def runs(path: Path) -> list[str]:
    """Evaluations of single trainings, a list: a row for each method, or map, and guidance, intervals over seeds."""
    evaluated = _json(path)
    name = "method" if "method" in evaluated[0] else "map"

    def kind(run: Row) -> tuple[str, str]:
        return run[name], run["guidance"]

    rows = [_over_seeds(name, list(group)) for _, group in groupby(sorted(evaluated, key=kind), kind)]
    return _compared(name, rows)


def _over_seeds(name: str, evaluated: Sequence[Row]) -> Row:
    """Means over the seeds of one method or map; of seeds that never arrived without their time and path."""
    row = {name: evaluated[0][name], "guidance": evaluated[0]["guidance"], "seeds": len(evaluated)}
    for metric in {"success", "collision", "time_s", "optimality", "S"} & evaluated[0].keys():
        row |= entry(metric, bootstrap_mean([run[metric] for run in evaluated if run[metric] is not None]))
    return row | {"success_worst": min(run["success"] for run in evaluated)}


def _compared(name: str, compared: Sequence[Row]) -> list[str]:
    """Rows as adrl compare has them; name: what differs between them."""
    headings = (
        *(name, "guidance", "seeds", "success, %", "worst seed, %", "hit, %"),
        *("Av.T, s", "path / shortest", *(["S at the end"] if "S" in compared[0] else [])),
    )
    rows = [
        [
            label(row[name]),
            f"`{row['guidance']}`",
            "-" if row["seeds"] is None else str(row["seeds"]),
            cell(row, "success", 1, 100.0),
            "-" if row["success_worst"] is None else f"{100.0 * row['success_worst']:.1f}",
            cell(row, "collision", 1, 100.0),
            cell(row, "time_s", 1),
            cell(row, "optimality", 2),
            *([cell(row, "S", 2)] if "S" in row else []),
        ]
        for row in compared
    ]
    return table(headings, rows)


def regret_rows(path: Path) -> list[str]:
    """The methods of the regret.json of adrl regret."""
    headings = ("method", "regret in success, points", "greatest", "regret in time, %", "greatest")
    rows = [
        [
            row["method"],
            cell(row, "regret_success", 1, 100.0),
            f"{100.0 * row['worst_success']:.1f}",
            cell(row, "regret_time", 1, 100.0),
            f"{100.0 * row['worst_time']:.1f}",
        ]
        for row in _json(path)["rows"]
    ]
    return table(headings, rows)


def planner_rows(folder: Path) -> list[str]:
    """Planners, a row for each file of docs/measure.py."""
    headings = (
        *("robot", "place", "guidance", "planner", "drives", "success, %", "hit, %", "late, %"),
        *("Av.T, s", "path / shortest"),
    )
    rows = [
        [
            *(row["robot"], f"`{row['scenario']}`", f"`{row['guidance']}`", f"`{row['policy']}`"),
            str(row["episodes"]),
            cell(row, "success", 1, 100.0),
            *(f"{100.0 * row[name]:.1f}" for name in ("collision", "timeout")),
            *(cell(row, "time_s", 1), cell(row, "optimality", 2)),
        ]
        for row in _of_today(folder)
    ]
    return table(headings, rows)


def people_rows(folder: Path) -> list[str]:
    """What drives among people, a row for each file of docs/measure.py."""
    headings = (
        *("place", "what drives", "guidance", "drives", "success, %", "collision, %", "at fault, %"),
        *("nearest, m", "within 0.5 m, s", "frozen, s", "lost, s"),
    )
    rows = [
        [
            *(f"`{row['scenario']}`", f"`{row['policy']}`", f"`{row['guidance']}`", str(row["episodes"])),
            *(cell(row, name, 1, 100.0) for name in ("success", "collision", "at_fault")),
            cell(row, "person_distance_m", 2),
            *(plain(row[name], 2) for name in ("near_person_s", "frozen_s", "lost_s")),
        ]
        for row in _of_today(folder)
    ]
    return table(headings, rows)


def barn_rows(folder: Path) -> list[str]:
    """What drives in the BARN benchmark's worlds, a row for each file of docs/measure.py: intervals over worlds."""
    headings = ("what drives", "guidance", "v_max, m/s", "runs", "success, %", "hit, %", "score")
    rows = [
        [
            *(f"`{row['policy']}`", f"`{row['guidance']}`", f"{row['v_max_mps']:g}", str(row["episodes"])),
            *(cell(row, name, 1, 100.0) for name in ("success", "collision")),
            cell(row, "score", 3),
        ]
        for row in _of_today(folder)
    ]
    return table(headings, rows)


def robots(folder: Path) -> list[str]:
    """The robots' files of a folder, as they are."""
    lines = []
    for path in sorted(folder.glob("*.toml")):
        lines += [f'```toml title="{path.name}"', *path.read_text(encoding="utf-8").splitlines(), "```", ""]
    return lines


def fault_counts(path: Path) -> list[str]:
    """What the drives of adrl bench faults come to over all faults, with Wilson's intervals, and by robot and place."""
    drives = [
        (FAULTS[row["fault"]], *drive.split()[:2], outcome)
        for row in _faults_of_today(path)
        for drive, outcome in row["ends"].items()
    ]
    told = [outcome for fault, *_, outcome in drives if fault.told]
    untold = [outcome for fault, *_, outcome in drives if not fault.told]
    enough = [outcome for fault, *_, outcome in drives if fault.drivable]
    lines = [
        f"- **Hits at things that stand, under faults that something tells of: {_of(told, 'hit_standing')}.**",
        f"- The same under the two faults that nothing tells of: {_of(untold, 'hit_standing')}.",
        f"- **Out of time, under faults that leave enough to drive by: {_of(enough, 'timeout')}.**",
        "",
    ]
    rows = []
    for place in dict.fromkeys(tuple(where) for _, *where, _ in drives):
        here = [(fault, outcome) for fault, *where, outcome in drives if tuple(where) == place]
        hits = sum(outcome == "hit_standing" for fault, outcome in here if fault.told)
        moving = sum(outcome == "hit_moving" for _, outcome in here)
        enough = [outcome for fault, outcome in here if fault.drivable]
        late = f"{enough.count('timeout')} of {len(enough)}"
        rows.append([f"`{place[0]}`", f"`{place[1]}`", str(len(here)), str(hits), str(moving), late])
    headings = (
        *("robot", "scenario", "drives", "hits at what stands, faults that are told", "hits with what moves"),
        "out of time, faults that leave enough",
    )
    return [*lines, *table(headings, rows)]


def _of(outcomes: Sequence[str], outcome: str) -> str:
    """How many drives ended so, and their share."""
    count = outcomes.count(outcome)
    share = entry("share", wilson_interval(count, len(outcomes)))
    return f"{count} of {len(outcomes)} drives, {cell(share, 'share', 1, 100.0)} %"


def fault_rows(path: Path) -> list[str]:
    """How the drives of adrl bench faults ended, a row a fault, and what the robots said."""
    rows = [
        [
            row["fault"],
            " / ".join(str(list(row["ends"].values()).count(outcome)) for outcome in OUTCOMES),
            ", ".join(f"`{reason}`" for reason in row["reasons"] if reason not in ORDINARY),
        ]
        for row in _faults_of_today(path)
    ]
    return table(("fault", "arrived / hit what stands / hit what moves / out of time", "reasons given"), rows)


def _faults_of_today(path: Path) -> list[Row]:
    """What docs/measure.py measured. Raises ConfigError for drives of other policies, or of before."""
    content = _json(path)
    policies = {name: find_policy(name).fingerprint for name in content["policies"]}
    if (content["policies"], content["driving"]) != (policies, DRIVING):
        raise ConfigError(f"{content['command']}: is of before; run python docs/measure.py faults")
    return content["faults"]


def _of_today(folder: Path) -> list[Row]:
    """What docs/measure.py measured. Raises FileNotFoundError where there is nothing, and ConfigError for drives of
    other weights, or of before."""
    rows = [_json(path) for path in sorted(folder.glob("*.json"))]
    if not rows:
        raise FileNotFoundError(f"{folder}: nothing is measured; run python docs/measure.py {folder.name}")
    for row in rows:
        if (row["policy_fingerprint"], row.get("driving")) != (
            find_policy(row["policy"], PLANNERS).fingerprint,
            DRIVING,
        ):
            raise ConfigError(
                f"{row.get('command', row['scenario'])}: is of before; run python docs/measure.py {folder.name}"
            )
    return rows


def policy_card(folder: Path) -> list[str]:
    """The card of the shipped policy of the folder's name, from what docs/measure.py wrote there."""
    policy = load_policy(resolve_policy(folder.name))
    return card(policy.config, policy.fingerprint, _of_today(folder))


def _json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


ORDINARY = frozenset(("limited", "unseen", "obstacle", "recovering"))
"""Reasons that are given in any drive."""

FORMS: dict[str, Callable[[Path], list[str]]] = {
    "barn": barn_rows,
    "compare": compare_rows,
    "compare-all": compare_all,
    "fault-counts": fault_counts,
    "faults": fault_rows,
    "people": people_rows,
    "planners": planner_rows,
    "policy": policy_card,
    "regret": regret_rows,
    "robots": robots,
    "runs": runs,
}
"""How a file, or a folder of them, becomes a table."""


def rewritten(page: str) -> str:
    """The page with its tables as their files have them. Raises KeyError for an unknown form, OSError for no file."""

    def anew(match: re.Match[str]) -> str:
        lines = FORMS[match["form"]](RESULTS / match["file"])
        return match[1] + "\n" + "\n".join(lines) + "\n" + match[4]

    return BLOCK.sub(anew, page)


def pages() -> Iterable[Path]:
    """README.md and the pages of the documentation."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))


def main() -> int:
    """Write, or check."""
    parser = argparse.ArgumentParser(description="Make the tables of the pages from the files they name.")
    parser.add_argument("--check", action="store_true", help="change nothing; fail where a page differs")
    check = parser.parse_args().check
    differing = []
    for path in pages():
        text = path.read_text(encoding="utf-8")
        anew = rewritten(text)
        if anew != text:
            differing.append(path)
            if not check:
                files.atomic_write_text(path, anew)
    for path in differing:
        print(
            f"{path.relative_to(ROOT)}: {'differs from its files; run python docs/tables.py' if check else 'written'}"
        )
    return 1 if check and differing else 0


if __name__ == "__main__":
    sys.exit(main())
