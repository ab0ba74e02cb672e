"""The kept results of `adrl reproduce`: small files from which every figure and table is made, without a checkpoint.

about.json         presets, budgets, versions, wall clock
runs.json          one evaluation a row: scenario, method, seed, guidance and its metrics
curves.parquet     rows of the training logs of all runs
episodes.parquet   endings, distances and times of all test episodes
routes.parquet     routes of the first seed on the first tasks
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import CheckpointError

Array = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

ABOUT_FILE, RUNS_FILE = "about.json", "runs.json"
CURVES_FILE, EPISODES_FILE, ROUTES_FILE = "curves.parquet", "episodes.parquet", "routes.parquet"
CURVE_COLUMNS = (
    *("wall_s", "env_steps", "episode", "updates", "q_mean", "return_mean", "success"),
    *("q_start", "return_start", "S", "alpha", "lambda_bc"),
)
"""What is kept of a training log; see `adrl train` for their meaning. NaN where a row or a method has none."""
RUN_METRICS = (
    *("success", "collision", "timeout", "distance_m", "time_s", "optimality", "spl"),
    *("train_seconds", "env_steps", "gradient_updates"),
)
"""What is kept of an evaluation; None where undefined."""
OUTCOMES = ("task", "success", "collision", "distance_m", "time_s", "shortest_m")
NO_SEED = -1
"""Seed of the planner in the tables."""


@dataclass(frozen=True, eq=False)
class Results:
    """All that was kept, in memory."""

    about: dict[str, Any]
    runs: list[dict[str, Any]]
    curves: dict[tuple[str, str, int], dict[str, Array]]
    """(scenario, method, seed) -> columns of its log."""
    episodes: Columns
    """scenario, method, seed, guidance, task, success, collision, distance_m, time_s, shortest_m of each episode."""
    routes: Columns
    """scenario, method, guidance, task, x_m, y_m of each position."""

    @property
    def scenarios(self) -> tuple[str, ...]:
        """The scenarios, in the order they were run."""
        return tuple(self.about["scenarios"])

    def trained_with(self, scenario: str) -> str:
        """Guidance of the training in a scenario."""
        return self.about["scenarios"][scenario]["guidance"]

    def curves_of(self, scenario: str, method: str) -> list[dict[str, Array]]:
        """The logs of a method's seeds, in their order."""
        found = [(key[2], curve) for key, curve in self.curves.items() if key[:2] == (scenario, method)]
        return [curve for _, curve in sorted(found, key=lambda entry: entry[0])]

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

    def outcomes(self, scenario: str, method: str, guidance: str) -> "dict[int, Columns]":
        """seed -> columns OUTCOMES of its test episodes, in the order of the tasks."""
        return self._outcomes.get((scenario, method, guidance), {})

    @cached_property
    def _outcomes(self) -> dict[tuple[str, str, str], dict[int, Columns]]:
        found: dict[tuple[str, str, str], dict[int, Columns]] = {}
        for (scenario, method, guidance, seed), rows in _groups(
            self.episodes, ("scenario", "method", "guidance", "seed")
        ):
            part = {name: self.episodes[name][rows] for name in OUTCOMES}
            order = np.argsort(part["task"], kind="stable")
            by_seed = found.setdefault((scenario, method, guidance), {})
            by_seed[int(seed)] = {name: column[order] for name, column in part.items()}
        return found


def load(folder: Path) -> Results:
    """Read the files of a results folder. Raises CheckpointError naming one that is missing or malformed."""
    about, runs = (_json(folder / name) for name in (ABOUT_FILE, RUNS_FILE))
    curves = _table(folder / CURVES_FILE)
    logs = {}
    for (scenario, method, seed), rows in _groups(curves, ("scenario", "method", "seed")):
        logs[scenario, method, int(seed)] = {
            name: curves[name][rows].astype(np.float64) for name in CURVE_COLUMNS
        }
    return Results(
        about=about,
        runs=runs["runs"],
        curves=logs,
        episodes=_table(folder / EPISODES_FILE),
        routes=_table(folder / ROUTES_FILE),
    )


def _groups(columns: Columns, keys: Sequence[str]) -> list[tuple[tuple[Any, ...], NDArray[np.intp]]]:
    """Row numbers of each combination of the key columns, in the order in which they first appear."""
    rows: dict[tuple[Any, ...], list[int]] = {}
    for number, key in enumerate(zip(*(columns[name].tolist() for name in keys), strict=True)):
        rows.setdefault(key, []).append(number)
    return [(key, np.array(numbers)) for key, numbers in rows.items()]


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file; run adrl reproduce first") from None
    except (OSError, ValueError) as error:
        raise CheckpointError(
            f"{path}: not a readable JSON file ({error}); run adrl reproduce again"
        ) from None


def _table(path: Path) -> Columns:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with open(path, "rb") as stream:
            table = pq.read_table(pa.py_buffer(stream.read()))
    except FileNotFoundError:
        raise CheckpointError(f"{path}: no such file; run adrl reproduce first") from None
    except (pa.ArrowException, OSError) as error:
        raise CheckpointError(
            f"{path}: not a readable Parquet file ({error}); run adrl reproduce again"
        ) from None
    return {name: table.column(name).to_numpy(zero_copy_only=False) for name in table.column_names}


def finite(value: float | None) -> float | None:
    """None for NaN and infinity, which JSON does not have."""
    return None if value is None or not math.isfinite(value) else float(value)
