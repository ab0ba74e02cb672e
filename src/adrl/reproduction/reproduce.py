"""The paper's section IV with our statistics: a comparison in each place, and what is kept of them."""

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adrl import files
from adrl.agents.metrics import METRICS_FILE
from adrl.comparison.compare import claim, compare
from adrl.comparison.config import CompareConfig
from adrl.comparison.jobs import EPISODES_FILE, ROUTES_FILE, Job, all_jobs, is_finished
from adrl.comparison.pool import cores
from adrl.comparison.results import read_runs
from adrl.evaluation.results import read_table, write_table
from adrl.report.metrics_log import read_metrics
from adrl.reproduction import results as kept
from adrl.reproduction.calls import Call
from adrl.runs import versions

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA_VERSION = 2


def reproduce(
    comparisons: Mapping[str, CompareConfig],
    out: str | os.PathLike[str],
    results: str | os.PathLike[str],
    *,
    name: str,
    only: Collection[str] | None = None,
    on_change: Callable[[int, int, int], None] | None = None,
) -> dict[str, Path]:
    """Run what is not kept yet, and keep each job's result when it has ended; see adrl.reproduction.results.

    comparisons: place -> its comparison, which runs in out/PLACE. What is in `results` is not run again, even when
    `out` is gone. name: the preset's. only: the places to work on; the others are in the results as missing.
    on_change(done, running, total) is told the progress over all of them. Returns the jobs whose process failed:
    place/name -> its log. Raises AdrlError as compare does.
    """
    out, results = Path(out), Path(results)
    every = {scenario: replace(config, out=out / scenario) for scenario, config in comparisons.items()}
    placed = {scenario: config for scenario, config in every.items() if only is None or scenario in only}
    for scenario, config in placed.items():
        claim(config, results / scenario)
    about, earlier = _about(every, name), _calls(results)

    def record(*calls: dict[str, Any]) -> None:
        content = about | {"calls": [*earlier, *calls]}
        files.write_json(results / kept.ABOUT_FILE, content)

    def kept_now() -> int:
        return sum(len(kept_jobs(config, results / scenario)) for scenario, config in placed.items())

    record()
    total = sum(len(all_jobs(config)) for config in placed.values())
    failed: dict[str, Path] = {}
    for scenario, config in placed.items():
        keep(config, results / scenario)  # of a call that was killed before it came to that
    before = kept_now()
    first = next(iter(every.values()))
    call = Call(record, None if first.ray else len(cores(first)))
    for scenario, config in placed.items():

        def tell(_: int, running: int, __: int, scenario: str = scenario) -> None:
            keep(placed[scenario], results / scenario)
            done = kept_now()
            call.tell(done - before, running)
            if on_change is not None:
                on_change(done, running, total)

        try:
            result = compare(config, tell, elsewhere=kept_jobs(config, results / scenario))
        finally:
            call.close()
        failed |= {f"{scenario}/{job}": log for job, log in result.failed.items()}
    return failed


def _calls(results: Path) -> list[dict[str, Any]]:
    """Of earlier calls."""
    return kept.read_about(results).get("calls", []) if (results / kept.ABOUT_FILE).exists() else []


def kept_jobs(config: CompareConfig, folder: Path) -> list[Job]:
    """Those of the comparison's jobs whose results are in the folder of the kept ones."""
    return [job for job in all_jobs(config) if (folder / job.name / kept.RUN_FILE).exists()]


def keep(config: CompareConfig, folder: Path) -> None:
    """Write what adrl.reproduction.results reads of each job that has ended and is not in the folder yet."""
    there = kept_jobs(config, folder)
    for job in all_jobs(config):
        if job in there or not is_finished(config, job):
            continue
        source, target = config.out / job.name, folder / job.name
        if job.seed is not None:
            write_table(target / kept.CURVE_FILE, _curve(source))
        write_table(target / kept.EPISODES_FILE, _episodes(source))
        if job.seed in (None, config.learner.seed):
            routes = read_table(source / ROUTES_FILE).select(kept.ROUTE_COLUMNS)
            write_table(target / kept.ROUTES_FILE, routes)
        evaluations = [
            {"guidance": run.summary["guidance"]} | {name: run.summary[name] for name in kept.RUN_METRICS}
            for run in read_runs([source])
        ]
        head = {
            "schema_version": SCHEMA_VERSION,
            "method": job.method,
            "seed": job.seed,
            "versions": versions(),
        }
        files.write_json(target / kept.RUN_FILE, head | {"evaluations": evaluations})


def _about(placed: Mapping[str, CompareConfig], name: str) -> dict[str, Any]:
    scenarios = {
        scenario: {
            "title": config.title(),
            "guidance": config.resolved_guidance(),
            "evaluated": list(config.guidance_names),
            "steps": config.learner.steps,
            "seeds": config.seeds,
            "episodes": config.episodes,
            "split": config.split,
            "scenario": config.scenario,
            "robot": config.robot,
            "env": config.env,
            "methods": list(config.method_names),
            "jobs": [job.name for job in all_jobs(config)],
        }
        for scenario, config in placed.items()
    }
    return {"schema_version": SCHEMA_VERSION, "preset": name, "scenarios": scenarios}


def _curve(folder: Path) -> "pa.Table":
    import pyarrow as pa

    log = read_metrics(folder / METRICS_FILE)
    missing = np.full(len(log["wall_s"]), np.nan)
    return pa.table({n: pa.array(log.get(n, missing).astype(np.float32)) for n in kept.CURVE_COLUMNS})


def _episodes(folder: Path) -> "pa.Table":
    """What tables and figures need of each episode."""
    import pyarrow as pa

    table = read_table(folder / EPISODES_FILE)
    kinds = {"task": pa.int16(), "success": pa.bool_(), "collision": pa.bool_()}
    columns = {
        name: table.column(name).cast(kinds.get(name, pa.float32()), safe=False) for name in kept.OUTCOMES
    }
    return pa.table({"guidance": table.column("guidance")} | columns)
