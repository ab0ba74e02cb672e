"""The paper's section IV with our statistics: two scenarios, each a comparison, and what is kept of them."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adrl import files
from adrl.agents.config import TrainConfig
from adrl.agents.metrics import METRICS_FILE
from adrl.comparison.compare import compare
from adrl.comparison.config import CompareConfig
from adrl.comparison.jobs import EPISODES_FILE, ROUTES_FILE, Job, all_jobs, is_finished
from adrl.comparison.results import read_runs
from adrl.evaluation.results import write_table
from adrl.report import reproduction as kept
from adrl.report.metrics_log import read_metrics
from adrl.report.reported import METHODS
from adrl.runs import versions

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA_VERSION = 1
ROUTES = 3
"""Test tasks whose routes are drawn (Fig. 7)."""
PLANNER_SEED = kept.NO_SEED


def preset(name: str) -> dict[str, CompareConfig]:
    """scenario -> its comparison, of the preset quick or full.

    As in the paper policies see the goal and no map, the replanner is off in training, and every policy is then driven
    without and with it. Both scenarios have the same budget of environment steps.
    """
    seeds, episodes, steps, validation = {"quick": (2, 50, 65_536, 20), "full": (10, 200, 262_144, 40)}[name]
    return {
        scenario: CompareConfig(
            scenario=scenario,
            methods=",".join(METHODS),
            seeds=seeds,
            episodes=episodes,
            guidance="goal",
            eval_guidance="goal,replan",
            validation_episodes=validation,
            routes=ROUTES,
            keep_checkpoints=False,
            learner=TrainConfig(steps=steps, log_interval_steps=4096, eval_interval_steps=16_384),
        )
        for scenario in ("clutter", "complex")
    }


def reproduce(
    comparisons: Mapping[str, CompareConfig],
    out: Path,
    results: Path,
    *,
    name: str,
    on_change: Callable[[int, int, int], None] | None = None,
) -> dict[str, Path]:
    """Run what is not done yet, and write to the folder `results` what is kept; see adrl.report.reproduction.

    comparisons: scenario -> its comparison, whose folder is out/SCENARIO. name: the preset's. on_change(done, running,
    total) is told the progress over all of them. Returns the jobs whose process failed: scenario/name -> its log.
    Raises AdrlError as compare does.
    """
    placed = {scenario: replace(config, out=out / scenario) for scenario, config in comparisons.items()}
    jobs = {scenario: all_jobs(config) for scenario, config in placed.items()}
    total = sum(map(len, jobs.values()))
    failed: dict[str, Path] = {}
    for scenario, config in placed.items():
        others = sum(is_finished(placed[s], job) for s in placed if s != scenario for job in jobs[s])

        def tell(done: int, running: int, _: int, others: int = others) -> None:
            if on_change is not None:
                on_change(others + done, running, total)

        result = compare(config, tell)
        failed |= {f"{scenario}/{job}": log for job, log in result.failed.items()}
    keep(placed, results, name)
    return failed


def keep(placed: Mapping[str, CompareConfig], results: Path, name: str) -> None:
    """Write what adrl.report.reproduction reads, from the finished jobs of the comparisons."""
    runs: list[dict[str, Any]] = []
    tables: dict[str, list[pa.Table]] = {kept.CURVES_FILE: [], kept.EPISODES_FILE: [], kept.ROUTES_FILE: []}
    wall_s = 0.0
    for scenario, config in placed.items():
        for job in all_jobs(config):
            if not is_finished(config, job):
                continue
            folder = config.out / job.name
            for run in read_runs([folder]):
                row = {"scenario": scenario, "method": job.method, "seed": job.seed}
                row["guidance"] = run.summary["guidance"]
                runs.append(row | {metric: run.summary[metric] for metric in kept.RUN_METRICS})
            if job.seed is not None:
                tables[kept.CURVES_FILE].append(_curve(folder, scenario, job))
                wall_s += runs[-1]["train_seconds"]
            tables[kept.EPISODES_FILE].append(_episodes(folder, scenario, job))
            if job.seed in (None, config.learner.seed):
                tables[kept.ROUTES_FILE].append(_routes(folder, scenario, job))
    for file, parts in tables.items():
        write_table(results / file, _compact(parts))
    files.write_json(results / kept.RUNS_FILE, {"schema_version": SCHEMA_VERSION, "runs": runs})
    files.write_json(results / kept.ABOUT_FILE, _about(placed, name, wall_s))


def _about(placed: Mapping[str, CompareConfig], name: str, wall_s: float) -> dict[str, Any]:
    scenarios = {
        scenario: {
            "title": config.title(),
            "guidance": config.guidance,
            "evaluated": list(config.guidance_names),
            "steps": config.learner.steps,
            "seeds": config.seeds,
            "episodes": config.episodes,
            "split": config.split,
            "robot": config.robot,
            "missing": [job.name for job in all_jobs(config) if not is_finished(config, job)],
        }
        for scenario, config in placed.items()
    }
    about = {
        "schema_version": SCHEMA_VERSION,
        "preset": name,
        "written": time.strftime("%Y-%m-%d", time.gmtime()),
    }
    return about | {"train_seconds": wall_s, "versions": versions(), "scenarios": scenarios}


def _whose(count: int, scenario: str, job: Job) -> dict[str, Any]:
    import pyarrow as pa

    seed = PLANNER_SEED if job.seed is None else job.seed
    return {
        "scenario": pa.array([scenario] * count, pa.string()),
        "method": pa.array([job.method] * count, pa.string()),
        "seed": pa.array([seed] * count, pa.int32()),
    }


def _curve(folder: Path, scenario: str, job: Job) -> "pa.Table":
    import pyarrow as pa

    log = read_metrics(folder / METRICS_FILE)
    count = len(log["wall_s"])
    missing = np.full(count, np.nan)
    columns = {n: pa.array(log.get(n, missing).astype(np.float32)) for n in kept.CURVE_COLUMNS}
    return pa.table(_whose(count, scenario, job) | columns)


def _episodes(folder: Path, scenario: str, job: Job) -> "pa.Table":
    """What tables and figures need of each episode."""
    import pyarrow as pa

    table = _read(folder / EPISODES_FILE)
    kinds = {"task": pa.int16(), "success": pa.bool_(), "collision": pa.bool_()}
    kinds |= dict.fromkeys(("distance_m", "time_s", "shortest_m"), pa.float32())
    columns = {name: table.column(name).cast(kind, safe=False) for name, kind in kinds.items()}
    return pa.table(_whose(len(table), scenario, job) | {"guidance": table.column("guidance")} | columns)


def _routes(folder: Path, scenario: str, job: Job) -> "pa.Table":
    import pyarrow as pa

    table = _read(folder / ROUTES_FILE)
    return pa.table(
        _whose(len(table), scenario, job) | {name: table.column(name) for name in table.column_names}
    )


def _read(path: Path) -> "pa.Table":
    import pyarrow.parquet as pq

    return pq.ParquetFile(path).read()


def _compact(parts: "list[pa.Table]") -> "pa.Table":
    import pyarrow as pa

    return pa.concat_tables(parts).combine_chunks()
