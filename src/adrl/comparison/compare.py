"""The comparison from nothing, or from where it was stopped, to its tables."""

import json
from collections.abc import Callable, Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from adrl import extras, files
from adrl.agents.budget import require_end
from adrl.agents.saved_run import learner_of_before
from adrl.baselines import SB3_METHODS, require_sb3
from adrl.comparison.config import DRIVING, CompareConfig, differences
from adrl.comparison.jobs import EPISODES_FILE, Job, all_jobs, concatenated, is_finished
from adrl.comparison.pool import log_path, run_all
from adrl.comparison.ray_pool import run_on_ray
from adrl.comparison.results import markdown, method_rows, read_runs
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.evaluation.results import write_table
from adrl.json_files import read_json
from adrl.outputs import locked, require_folder
from adrl.runs import Run
from adrl.types import with_defaults, without_constants

SCHEMA_VERSION = 1
SETTINGS_FILE = "settings.json"


@dataclass(frozen=True)
class Comparison:
    """The results, and what is missing of them."""

    rows: list[dict[str, Any]]
    """As in results.json: one a method, and one for each guidance of the evaluation where there are several."""
    failed: dict[str, Path]
    """Jobs whose process failed: name -> its log."""


def compare(
    config: CompareConfig,
    on_change: Callable[[int, int, int], None] | None = None,
    elsewhere: Container[Job] = (),
) -> Comparison:
    """Train and evaluate every method with every seed that is not done yet, and write the tables.

    on_change(done, running, total) is told the progress. elsewhere: jobs that are not run, for their results are
    kept in another place; they are not in the tables either. Leaves in config.out: settings.json and a folder
    METHOD-sSEED with each result, which suffice to go on; episodes.parquet, results.json, table.md; the training runs
    in runs/. Raises AdrlError, before any work, for settings that cannot be or that differ from those of the results in
    the folder.
    """
    require_end(config.learner)
    extras.require("train", "a comparison")
    if set(config.method_names) & SB3_METHODS.keys():
        require_sb3()
    if config.ray is not None:
        extras.require("ray", "--ray")
    for method in config.method_names:
        Run.of(config.run(method, config.learner.seed, config.out))
    with locked(config.out):
        claim(config, config.out)
        return _run(config, on_change, elsewhere)


def _run(
    config: CompareConfig, on_change: Callable[[int, int, int], None] | None, elsewhere: Container[Job]
) -> Comparison:
    """The jobs that wait, and the tables."""
    jobs = all_jobs(config)
    waiting = [job for job in jobs if job not in elsewhere and not is_finished(config, job)]
    done = len(jobs) - len(waiting)

    def tell(ended: int, running: int) -> None:
        if on_change is not None:
            on_change(done + ended, running, len(jobs))

    try:
        failed = (run_all if config.ray is None else run_on_ray)(config, waiting, tell)
    finally:
        rows = _write_tables(config, jobs)
    return Comparison(rows, {job.name: log_path(config, job) for job in failed})


class _Claimed(TypedDict):
    driving: NotRequired[int]
    """Absent before it was recorded: 1."""
    settings: dict[str, Any]
    methods: dict[str, dict[str, Any]]


def claim(config: CompareConfig, folder: Path) -> None:
    """Write what a folder's results share, and what its methods are; methods may be added.

    Raises ConfigError where it has results of something else, or ones that were driven otherwise than today.
    """
    methods = config.method_settings()
    known: dict[str, Any] = {}
    if (claimed := _claimed(config, folder)) is not None:
        if (driving := claimed.get("driving", 1)) != DRIVING:
            raise ConfigError(
                f"{folder} was begun when planners, demonstrations or waypoints were others (driving {driving} there, "
                f"{DRIVING} here); finish it with the version that began it, or give another --out"
            )
        _require_same(config, folder, claimed)
        known = claimed["methods"]
    if methods.keys() - known.keys():
        content = {"schema_version": SCHEMA_VERSION, "driving": DRIVING, "settings": config.settings()}
        files.write_json(folder / SETTINGS_FILE, content | {"methods": known | methods})


def require_same(config: CompareConfig, folder: Path) -> None:
    """For reading results that are complete, whatever drove then. Raises ConfigError as claim does, but for that."""
    if (claimed := _claimed(config, folder)) is not None:
        _require_same(config, folder, claimed)


def _claimed(config: CompareConfig, folder: Path) -> _Claimed | None:
    """What a folder's results share, with the names and options of today; None of a folder without results."""
    path = folder / SETTINGS_FILE
    if not path.exists():
        require_folder("out", folder, SETTINGS_FILE)
        return None
    try:
        content = read_json(path, _Claimed)
    except FileError as error:
        raise CheckpointError(
            f"{path} {error}; these are not the settings of a comparison: give another folder"
        ) from None
    told = without_constants(CompareConfig, content["settings"])
    filled: dict[str, Any] = json.loads(json.dumps(with_defaults(CompareConfig, told), default=str))
    shared = told.keys() | config.settings().keys()
    settings = {name: value for name, value in filled.items() if name in shared}
    if isinstance(told.get("learner"), dict):
        settings["learner"] = learner_of_before(told["learner"])
    if config.given:  # a folder of before does not say what stood in the files: as today
        settings["given"] = config.given | told.get("given", {})
    methods = {name: learner_of_before(learner) for name, learner in content["methods"].items()}
    return {**content, "settings": settings, "methods": methods}


def _require_same(config: CompareConfig, folder: Path, claimed: _Claimed) -> None:
    if lines := differences(claimed["settings"], config.settings()):
        raise ConfigError(
            f"{folder} holds results of other settings ({'; '.join(lines)}); "
            "give another folder, or the settings of before"
        )
    known, methods = claimed["methods"], config.method_settings()
    asked_again = {name: methods[name] for name in known.keys() & methods.keys()}
    if lines := differences(known, known | asked_again):
        raise ConfigError(
            f"{folder} holds results of methods that are others today ({'; '.join(lines)}); "
            "give another folder, or the version of before"
        )


def _write_tables(config: CompareConfig, jobs: list[Job]) -> list[dict[str, Any]]:
    """Tables of the results there are; also of a comparison that was stopped."""
    import pyarrow.parquet as pq

    finished = [job for job in jobs if is_finished(config, job)]
    if not finished:
        return []
    tables = [pq.ParquetFile(config.out / job.name / EPISODES_FILE).read() for job in finished]
    write_table(config.out / EPISODES_FILE, concatenated(tables))
    rows = method_rows(read_runs([config.out / job.name for job in finished]))
    missing = [job.name for job in jobs if job not in finished]
    content = {"schema_version": SCHEMA_VERSION, "settings": config.settings(), "missing": missing}
    files.write_json(config.out / "results.json", content | {"rows": rows})
    files.atomic_write_text(config.out / "table.md", markdown(rows, config.title(), missing))
    return rows
