"""The kept results of `adrl reproduce`: small files from which every figure and table is made, without a checkpoint.

about.json                       the preset: scenarios, budgets, and its jobs; the calls that ran them
SCENARIO/settings.json           what all results of the scenario share; see adrl.comparison.compare.claim
SCENARIO/JOB/run.json            method, seed, versions, and the metrics of each evaluation; written last
SCENARIO/JOB/curve.parquet       rows of the training log
SCENARIO/JOB/episodes.parquet    endings, distances and times of the test episodes
SCENARIO/JOB/routes.parquet      routes on the first tasks: of the planner and each method's first seed

A job's folder is written when it has ended and holds all that is kept of it: whoever has these files need not run the
job again.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NotRequired, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from adrl.errors import CheckpointError, FileError
from adrl.evaluation.results import read_table
from adrl.json_files import checked, read_json

Array = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

ABOUT_FILE, RUN_FILE = "about.json", "run.json"
CURVE_FILE, EPISODES_FILE, ROUTES_FILE = "curve.parquet", "episodes.parquet", "routes.parquet"
CURVE_COLUMNS = (
    *("wall_s", "env_steps", "episode", "updates", "q_mean", "return_mean", "success"),
    *("q_start", "return_start", "S", "alpha", "lambda_bc"),
)
"""What is kept of a training log; see `adrl train` for their meaning. NaN where a row or a method has none."""


class RunMetrics(TypedDict):
    """What is kept of an evaluation; None where undefined."""

    success: float | None
    collision: float | None
    timeout: float | None
    distance_m: float | None
    time_s: float | None
    optimality: float | None
    spl: float | None
    train_seconds: float | None
    env_steps: float | None
    gradient_updates: float | None


RUN_METRICS = tuple(RunMetrics.__annotations__)
OUTCOMES = ("task", "success", "collision", "distance_m", "time_s", "shortest_m")
"""What is kept of an episode, beside the guidance."""
ROUTE_COLUMNS = ("guidance", "task", "x_m", "y_m")
NO_SEED = -1
"""Seed of the planner."""


FileName = Annotated[str, Meta(max_length=100, pattern=r"^[\w.-]*\w[\w.-]*$")]


class _Preset(TypedDict):
    title: str
    guidance: str
    evaluated: list[str]
    steps: int | None
    seeds: int
    split: str
    robot: str
    jobs: list[FileName]
    scenario: NotRequired[str]
    """The place's own name in results of before."""
    env: NotRequired[str]
    methods: NotRequired[list[str]]


class _Call(TypedDict):
    wall_s: float
    jobs: int
    cores: int | None
    machine: str
    versions: dict[str, str]
    commit: str | None
    measured_by: str


class _About(TypedDict):
    preset: str
    scenarios: dict[FileName, _Preset]
    calls: NotRequired[list[_Call]]


class _Evaluation(RunMetrics):
    guidance: str


class _Run(TypedDict):
    method: str
    seed: int | None
    versions: dict[str, str]
    evaluations: list[_Evaluation]


@dataclass(frozen=True, eq=False)
class Results:
    """All that was kept, in memory."""

    about: dict[str, Any]
    runs: list[dict[str, Any]]
    """One evaluation each: scenario, method, seed (None: planner), guidance, RUN_METRICS."""
    curves: dict[tuple[str, str, int], dict[str, Array]]
    """(scenario, method, seed) -> columns of its log."""
    episodes: dict[tuple[str, str, str], dict[int, Columns]]
    """(scenario, method, guidance) -> seed -> columns OUTCOMES of its test episodes, in the order of the tasks."""
    routes: dict[tuple[str, str, str], Columns]
    """(scenario, method, guidance) -> columns task, x_m, y_m of each position."""
    missing: dict[str, list[str]]
    """Scenario -> its jobs that have no result yet."""
    versions: list[dict[str, str]]
    """Of the software that made them, each set of versions once."""

    @property
    def scenarios(self) -> tuple[str, ...]:
        """The scenarios that have results, in the order they are run."""
        found = {run["scenario"] for run in self.runs}
        return tuple(name for name in self.about["scenarios"] if name in found)

    def scenario_of(self, place: str) -> str:
        """Name of the scenario whose worlds a place has."""
        return self.about["scenarios"][place].get("scenario", place)

    def lacks(self, place: str, methods: Collection[str]) -> bool:
        """Whether one of these methods is not meant to be run in a place."""
        meant = self.about["scenarios"][place].get("methods")
        return meant is not None and not set(methods) <= {*meant, *self.untrained(place)}

    def untrained(self, place: str) -> dict[str, list[str]]:
        """Planner -> guidance of each of its runs in a place, in the order they were run."""
        found: dict[str, list[str]] = {}
        for run in self.runs:
            if run["scenario"] == place and run["seed"] is None:
                found.setdefault(run["method"], []).append(run["guidance"])
        return found

    def trained_with(self, scenario: str) -> str:
        """Guidance of the training in a scenario."""
        return self.about["scenarios"][scenario]["guidance"]

    def seeds(self, scenario: str, method: str) -> int:
        """How many trainings of a method there are."""
        return len(self.curves_of(scenario, method))

    def curves_by_seed(self, scenario: str, method: str) -> dict[int, dict[str, Array]]:
        """Seed -> its log, in the order of the seeds."""
        found = {key[2]: curve for key, curve in self.curves.items() if key[:2] == (scenario, method)}
        return dict(sorted(found.items()))

    def curves_of(self, scenario: str, method: str) -> list[dict[str, Array]]:
        """The logs of a method's seeds, in their order."""
        return list(self.curves_by_seed(scenario, method).values())

    def methods_of(self, scenario: str, methods: Sequence[str]) -> list[str]:
        """Those of the methods that have a log in the scenario."""
        return [method for method in methods if self.curves_of(scenario, method)]

    def values(self, scenario: str, method: str, guidance: str, metric: str) -> list[float]:
        """A metric of each seed's evaluation, without the seeds where it is undefined."""
        rows = [
            run
            for run in self.runs
            if (run["scenario"], run["method"], run["guidance"]) == (scenario, method, guidance)
        ]
        return [float(run[metric]) for run in rows if run[metric] is not None]

    def outcomes(self, scenario: str, method: str, guidance: str) -> dict[int, Columns]:
        """seed -> columns OUTCOMES of its test episodes, in the order of the tasks."""
        return self.episodes.get((scenario, method, guidance), {})


def load(folder: Path) -> Results:
    """Read a results folder, however many jobs are in it. Raises CheckpointError naming a file that is malformed."""
    about = read_about(folder)
    results = Results(about, [], {}, {}, {}, {}, [])
    for scenario, preset in about["scenarios"].items():
        kept = [name for name in preset["jobs"] if (folder / scenario / name / RUN_FILE).exists()]
        results.missing[scenario] = [name for name in preset["jobs"] if name not in kept]
        for name in kept:
            _add_job(results, scenario, folder / scenario / name)
    if not results.runs:
        raise CheckpointError(f"{folder}: no job has ended yet; run adrl reproduce for longer")
    return results


def read_about(folder: Path) -> dict[str, Any]:
    """The preset and its calls. Raises CheckpointError."""
    return _json(folder / ABOUT_FILE, _About)


def _add_job(results: Results, scenario: str, folder: Path) -> None:
    run = _json(folder / RUN_FILE, _Run)
    method, seed = run["method"], run["seed"]
    whose = {"scenario": scenario, "method": method, "seed": seed}
    results.runs.extend(whose | evaluation for evaluation in run["evaluations"])
    if run["versions"] not in results.versions:
        results.versions.append(run["versions"])
    number = NO_SEED if seed is None else seed
    if seed is not None:
        curve = _table(folder / CURVE_FILE, CURVE_COLUMNS)
        results.curves[scenario, method, number] = {n: curve[n].astype(np.float64) for n in CURVE_COLUMNS}
    for guidance, part in _by_guidance(_table(folder / EPISODES_FILE, OUTCOMES, ("guidance",))):
        order = np.argsort(part["task"], kind="stable")
        by_seed = results.episodes.setdefault((scenario, method, guidance), {})
        by_seed[number] = {name: part[name][order] for name in OUTCOMES}
    if (folder / ROUTES_FILE).exists():
        for guidance, part in _by_guidance(
            _table(folder / ROUTES_FILE, ROUTE_COLUMNS[1:], ROUTE_COLUMNS[:1])
        ):
            results.routes[scenario, method, guidance] = part


def _by_guidance(columns: Columns) -> Iterator[tuple[str, Columns]]:
    for guidance in dict.fromkeys(columns["guidance"].tolist()):
        rows = columns["guidance"] == guidance
        yield guidance, {name: column[rows] for name, column in columns.items()}


def _json(path: Path, kind: type) -> dict[str, Any]:
    """A JSON object of at least this kind. Raises CheckpointError."""
    try:
        content = read_json(path, dict[str, Any])
        checked(content, kind)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; delete it and run adrl reproduce again") from None
    return content


def _table(path: Path, numbers: Sequence[str], texts: Sequence[str] = ()) -> Columns:
    """These columns. Raises CheckpointError."""
    import pyarrow.types as kinds

    table = read_table(path)
    for name in (*numbers, *texts):
        column = table.column(name) if name in table.column_names else None
        wanted = kinds.is_string if name in texts else lambda kind: kinds.is_primitive(kind)
        if column is None or column.null_count or not wanted(column.type):
            raise CheckpointError(
                f"{path}: has no column {name} as adrl reproduce writes it; delete its folder and run adrl reproduce"
            )
    return {name: table.column(name).to_numpy() for name in (*numbers, *texts)}
