"""What each equation does as printed: trains ADRL with one literal equation at a time, for docs/fidelity.md's table.

    python docs/fidelity.py [--only trained|replanned] [--steps N] [--seeds N] [--episodes N] [--out DIR]

Every row of the first table is ADRL on `clutter` with that one equation literal and all others corrected, evaluated on
validation tasks. The equations of the replanner do not touch training: in the second they are compared on `complex`
with policy diffbot, all but its first row without foresight, so that eq 18 alone asks for plans. Stopped, the same
command goes on with the trainings. The tables stand between the two markers of docs/fidelity.md.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import tyro

from adrl import api, files
from adrl.agents.config import TrainConfig
from adrl.agents.metrics import METRICS_FILE
from adrl.comparison.compare import compare
from adrl.comparison.config import CompareConfig
from adrl.imitation.schedule import EQUATIONS as SCHEDULE
from adrl.planning.replanner_config import EQUATIONS as REPLANNER
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards.config import EQUATIONS as REWARD

HERE = Path(__file__).parent
PAGE, RESULTS = HERE / "fidelity.md", HERE / "results" / "fidelity.json"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to measure, and how much."""

    only: Literal["trained", "replanned"] | None = None
    """One of the two tables; the other stays as it is."""
    steps: int = 96_000
    """Environment steps of each training, about 6,000 updates."""
    seeds: int = 4
    """Trainings of each row."""
    episodes: int = 300
    """Validation tasks of each evaluation."""
    out: Path = Path("runs/fidelity")
    """Where the runs go."""


def learners(base: TrainConfig) -> dict[str, TrainConfig]:
    """The learner of each row."""
    rows = {"all corrected": base}
    for name in SCHEDULE:
        rows[name] = replace(base, schedule=replace(base.schedule, **{name: "literal"}))
    rows["eq6"] = replace(base, td3=replace(base.td3, eq6="literal"))
    for name in REWARD:
        rows[name] = replace(base, reward=replace(base.reward, **{name: "literal"}))
    return rows | {"all literal": base.literal()}


def train_row(name: str, learner: TrainConfig, options: Options) -> dict[str, Any]:
    """Means over the seeds: how the policies end, and where the schedule stood at the end."""
    config = CompareConfig(
        methods="adrl",
        seeds=options.seeds,
        episodes=options.episodes,
        split="validation",
        out=options.out / name.replace(" ", "-"),
        learner=learner,
    )
    (row,) = [r for r in compare(config).rows if r["method"] == "adrl"]
    last = [
        json.loads((config.out / f"adrl-s{seed}" / METRICS_FILE).read_text().splitlines()[-1])
        for seed in range(options.seeds)
    ]
    measured = ("success", "success_low", "success_high", "collision", "timeout", "time_s")
    schedule = {k: sum(r[k] for r in last) / len(last) for k in ("S", "alpha", "lambda_bc", "q_mean")}
    return {"row": name} | {key: row[key] for key in measured} | schedule


def replan_row(name: str, replanner: ReplannerConfig, options: Options) -> dict[str, Any]:
    """Policy `diffbot` on `complex` with guidance replan."""
    result = api.evaluate(
        "diffbot",
        scenario="complex",
        guidance="replan",
        split="validation",
        episodes=options.episodes,
        replanner=replanner,
    )
    measured = ("success", "success_low", "success_high", "collision", "timeout", "time_s", "optimality")
    return {"row": name, "replans": float(result.rollout.replans.mean())} | {
        k: result.summary[k] for k in measured
    }


def table(columns: dict[str, tuple[str, float, int]], rows: list[dict[str, Any]]) -> list[str]:
    """Markdown lines. columns: heading -> key, factor, decimals."""

    def cell(row: dict[str, Any], key: str, factor: float, decimals: int) -> str:
        value = row[key]
        text = "-" if value is None else f"{factor * value:.{decimals}f}"
        if key == "success" and row["success_low"] is not None:
            text += f" [{factor * row['success_low']:.1f}, {factor * row['success_high']:.1f}]"
        return text

    lines = ["| literal | " + " | ".join(columns) + " |", "|-" * (len(columns) + 1) + "|"]
    lines += [
        f"| {row['row']} | " + " | ".join(cell(row, *c) for c in columns.values()) + " |" for row in rows
    ]
    return lines


def replanners() -> dict[str, ReplannerConfig]:
    """The constants of each row of the second table."""
    default = ReplannerConfig()
    alone = replace(default, foresight_m=0.0)
    rows = {"all corrected": default, "no foresight": alone}
    rows |= {name: replace(alone, **{name: "literal"}) for name in REPLANNER}
    return rows | {"eq22": replace(alone, headings=True), "all literal": alone.literal()}


def main(options: Options) -> None:
    """Measure what was asked for, and write the page's tables."""
    found: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    if options.only != "replanned":
        base = TrainConfig(steps=options.steps)
        found["trained"] = [train_row(name, learner, options) for name, learner in learners(base).items()]
    if options.only != "trained":
        found["replanned"] = [replan_row(name, config, options) for name, config in replanners().items()]
    files.write_json(RESULTS, {"schema_version": 1} | found)
    lines = [BEGIN, "", *tables(found), END]
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    files.atomic_write_text(PAGE, before + "\n".join(lines) + rest.split(END)[1])


def tables(found: dict[str, Any]) -> list[str]:
    """Markdown lines of the tables that have been measured."""
    success = ("success", 100.0, 1)
    ends = {
        "collision %": ("collision", 100.0, 1),
        "timeout %": ("timeout", 100.0, 1),
        "Av.T s": ("time_s", 1.0, 1),
    }
    schedule = {
        "S": ("S", 1.0, 2),
        "alpha": ("alpha", 1.0, 2),
        "lambda": ("lambda_bc", 1.0, 3),
        "mean Q": ("q_mean", 1.0, 2),
    }
    more = {"optimality": ("optimality", 1.0, 2), "replans an episode": ("replans", 1.0, 1)}
    columns = {
        "trained": {"success % [95 %, over seeds]": success} | ends | schedule,
        "replanned": {"success % [95 % Wilson, over episodes]": success} | ends | more,
    }
    return [line for name in columns if name in found for line in (*table(columns[name], found[name]), "")]


if __name__ == "__main__":
    main(tyro.cli(Options))
