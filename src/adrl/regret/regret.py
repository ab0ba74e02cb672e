"""The protocol of `adrl regret`: a comparison in each cell, and what they say together."""

import contextlib
import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypedDict

import numpy as np
from msgspec import Meta

from adrl import files
from adrl.comparison.compare import claim, compare, require_same
from adrl.comparison.config import CompareConfig
from adrl.comparison.jobs import Job, all_jobs, is_finished
from adrl.comparison.results import outcomes
from adrl.errors import CheckpointError, FileError, UnknownName
from adrl.json_files import read_json
from adrl.registry import listed_option, look_up
from adrl.regret.cells import CELLS
from adrl.regret.numbers import Array, Scores
from adrl.types import GOAL_TOLERANCE_M, RobotConfig
from adrl.worlds.tasks import time_limit_s

LOG = logging.getLogger("adrl.regret")
METHODS = (
    *("adrl", "adrl-state", "adrl-arrivals", "adrl-clock", "td3", "rl-bc", "td3bc", "q-filter"),
    *("rlpd", "rlpd-cloned", "adaptive-bc", "spread", "ibrl", "jsrl"),
)
"""What is compared when nothing else is said; the others are paired with the first."""
ENOUGH_SEEDS = 10
"""Seeds from which on a comparison says something."""
COLUMNS = ("success", "time_s", "shortest_m")
"""What is needed of an episode."""
QUICK_STEPS, QUICK_EPISODES, QUICK_SEEDS = 4096, 20, 2
SCORES_FILE, SCORES_VERSION = "scores.json", 1

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Seconds = Annotated[float, Meta(ge=0.0)]


class CellScores(TypedDict):
    """What the runs of one complete cell measured, as it stands in its SCORES_FILE: M methods, S seeds."""

    schema_version: Literal[1]
    methods: list[str]
    seeds: int
    success: list[list[Share]]
    """(M, S) share of the test tasks solved."""
    time_s: list[list[Seconds]]
    """(M, S) mean time a task, the time limit where it was not solved."""
    common_time_s: list[Seconds | None]
    """(M,) mean time over the tasks that all these runs solved; None where there is no such task."""


def preset(
    out: str | os.PathLike[str],
    *,
    cells: str = "",
    methods: str = "",
    seeds: int = ENOUGH_SEEDS,
    quick: bool = False,
) -> dict[str, CompareConfig]:
    """cell -> its comparison. cells, methods: names with commas between; all cells and METHODS when left out.

    quick: every cell with QUICK_STEPS and few tasks, which shows that everything works. Raises UnknownName,
    and ConfigError for a text that names none.
    """
    names = listed_option("cells", cells) if cells else tuple(CELLS)
    chosen = [look_up("cell", name, CELLS) for name in names]
    comparisons = {
        cell.name: cell.comparison(methods or ",".join(METHODS), seeds, Path(out)) for cell in chosen
    }
    return {name: _quick(config) for name, config in comparisons.items()} if quick else comparisons


def _quick(config: CompareConfig) -> CompareConfig:
    learner = replace(config.learner, steps=QUICK_STEPS, eval_interval_steps=QUICK_STEPS)
    return replace(config, episodes=QUICK_EPISODES, demonstration_steps=QUICK_STEPS, learner=learner)


def regret(
    comparisons: Mapping[str, CompareConfig], on_change: Callable[[int, int, int], None] | None = None
) -> dict[str, Path]:
    """Run every job of every cell that has no result yet; see adrl.comparison.compare.compare, which does it.

    on_change(done, running, total) is told the progress over all cells. Returns the jobs whose process failed:
    cell/name -> its log. Raises AdrlError before any work where one of the cells cannot be run, or has results of
    other settings.
    """
    for config in comparisons.values():
        claim(config, config.out)
    jobs = {cell: all_jobs(config) for cell, config in comparisons.items()}
    known = {cell for cell, config in comparisons.items() if kept(config) is not None}
    total = sum(map(len, jobs.values()))
    failed: dict[str, Path] = {}
    for cell, config in comparisons.items():
        if cell in known:
            continue
        elsewhere = sum(
            name in known or is_finished(comparisons[name], job)
            for name in jobs
            if name != cell
            for job in jobs[name]
        )

        def tell(done: int, running: int, _: int, elsewhere: int = elsewhere) -> None:
            if on_change is not None:
                on_change(elsewhere + done, running, total)

        result = compare(config, tell)
        failed |= {f"{cell}/{job}": log for job, log in result.failed.items()}
        _keep(config)
    return failed


def _keep(config: CompareConfig) -> None:
    """Write the scores of a complete cell, and with them those that were kept before, if their runs are there still.

    A file that tells of a method or seed whose runs are gone stays as it is.
    """
    path = config.out / SCORES_FILE
    if path.exists():
        before = _read(path)
        methods = ",".join(dict.fromkeys((*before["methods"], *config.method_names)))
        try:
            config = replace(config, methods=methods, seeds=max(before["seeds"], config.seeds))
        except UnknownName as error:  # a method that an installed package offered
            LOG.warning("%s stays as it is: %s", path, error)
            return
    if lacking := _without_result(config):
        if path.exists():
            LOG.warning(
                "%s stays as it is: to tell of more, it needs %s too; keep these runs",
                path,
                ", ".join(lacking[:3]),
            )
        return
    with contextlib.suppress(CheckpointError):  # of a broken run: whoever makes the tables is told
        files.write_json(path, _measured(config))


def missing(comparisons: Mapping[str, CompareConfig]) -> dict[str, list[str]]:
    """cell -> its trainings that have no result; no entry for a complete cell."""
    return {
        cell: names
        for cell, config in comparisons.items()
        if (names := _without_result(config)) and kept(config) is None
    }


def _without_result(config: CompareConfig) -> list[str]:
    return [job.name for job in _trainings(config) if not is_finished(config, job)]


def _trainings(config: CompareConfig) -> list[Job]:
    return [job for job in all_jobs(config) if job.seed is not None]


def kept(config: CompareConfig) -> CellScores | None:
    """The scores that stand in the cell's folder, whose runs may be gone; None where it has not all of them.

    Where it has those of more methods or seeds too, tasks that all runs solved are not known: common_time_s is None.
    Raises CheckpointError for a broken file.
    """
    path = config.out / SCORES_FILE
    if not path.exists():
        return None
    content, methods, seeds = _read(path), list(config.method_names), config.seeds
    if (content["methods"], content["seeds"]) == (methods, seeds):
        return content
    if content["seeds"] < seeds or not set(methods) <= set(content["methods"]):
        return None
    rows = [content["methods"].index(method) for method in methods]
    same = content["seeds"] == seeds and len(methods) == len(content["methods"])
    return CellScores(
        schema_version=SCORES_VERSION,
        methods=methods,
        seeds=seeds,
        success=[content["success"][row][:seeds] for row in rows],
        time_s=[content["time_s"][row][:seeds] for row in rows],
        common_time_s=[content["common_time_s"][row] if same else None for row in rows],
    )


def _read(path: Path) -> CellScores:
    """Raises CheckpointError."""
    try:
        content = read_json(path, CellScores)
        count = len(content["methods"])
        for name in ("success", "time_s", "common_time_s"):
            if len(content[name]) != count:
                raise FileError(f"has {len(content[name])} rows of {name} for {count} methods")
        for name in ("success", "time_s"):
            if any(len(row) != content["seeds"] for row in content[name]):
                raise FileError(f"has not {content['seeds']} seeds of each method in {name}")
    except FileError as error:
        raise CheckpointError(
            f"{path} {error}; delete it, and it is made anew from the cell's runs"
        ) from None
    return content


def scores(comparisons: Mapping[str, CompareConfig]) -> tuple[Scores, dict[str, list[float | None]]] | None:
    """What the complete cells measured, and cell -> each method's Av.T over the tasks that all runs of the cell solved.

    A cell counts when every method has every seed: a part would compare methods over different seeds. None where no
    cell is complete. Raises CheckpointError for a broken file, and ConfigError for results of other settings.
    """
    lacking = missing(comparisons)
    complete = {cell: config for cell, config in comparisons.items() if cell not in lacking}
    if not complete:
        return None
    found: dict[str, CellScores] = {}
    for cell, config in complete.items():
        require_same(config, config.out)
        # The runs first: what was kept of them is only a copy.
        stored = kept(config) if _without_result(config) else None
        found[cell] = stored or _measured(config)
    together = Scores(
        cells=tuple(complete),
        methods=next(iter(complete.values())).method_names,
        success=np.array([cell["success"] for cell in found.values()]),
        time_s=np.array([cell["time_s"] for cell in found.values()]),
    )
    return together, {cell: content["common_time_s"] for cell, content in found.items()}


def _measured(config: CompareConfig) -> CellScores:
    """Of a complete cell, from the episodes of its runs. Raises CheckpointError."""
    runs = _columns(config)
    solved = runs["success"].all(axis=(0, 1))
    return CellScores(
        schema_version=SCORES_VERSION,
        methods=list(config.method_names),
        seeds=config.seeds,
        success=runs["success"].mean(axis=2).tolist(),
        time_s=penalised_time_s(runs, config.one_robot).mean(axis=2).tolist(),
        common_time_s=(
            runs["time_s"][:, :, solved].mean(axis=(1, 2)).tolist()
            if solved.any()
            else [None] * len(config.method_names)
        ),
    )


def _columns(config: CompareConfig) -> dict[str, Array]:
    """Columns of the episodes of all runs, (M methods, S seeds, E tasks), in the order of the tasks."""
    runs = [_run(config, job) for job in _trainings(config)]
    shape = (config.seeds, len(config.method_names), config.shared_tasks["episodes"])  # jobs are seed-major
    return {name: np.array([run[name] for run in runs]).reshape(shape).swapaxes(0, 1) for name in COLUMNS}


def _run(config: CompareConfig, job: Job) -> dict[str, Array]:
    """COLUMNS of the episodes of one run, in the order of the tasks. Raises CheckpointError."""
    folder = config.out / job.name
    try:
        run = outcomes(folder)[config.resolved_guidance()]
        order = np.argsort(run["task"], kind="stable")
        count = config.shared_tasks["episodes"]
        if not np.array_equal(run["task"][order], np.arange(count)):
            raise KeyError(f"not tasks 0 to {count - 1}")
        return {name: run[name][order] for name in COLUMNS}
    except KeyError as error:
        raise CheckpointError(
            f"{folder}: its episodes are of another evaluation ({error}); delete it and the cell's {SCORES_FILE}, "
            "and run again"
        ) from None


def penalised_time_s(columns: Mapping[str, Array], robot: RobotConfig) -> Array:
    """Time of each episode; of one that did not reach the goal, its task's time limit."""
    to_goal_m = columns["shortest_m"] + GOAL_TOLERANCE_M  # episodes end in the goal's disc
    limit_s = np.reshape([time_limit_s(m, robot) for m in to_goal_m.flat], to_goal_m.shape)
    return np.where(columns["success"], columns["time_s"], limit_s)
