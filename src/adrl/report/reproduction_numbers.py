"""What the kept results of `adrl reproduce` say in numbers: Table I, learning times, the paper's claims."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.learning_time import (
    STEADY_ROWS,
    median_seconds_to_level,
    seconds_to_level,
    steady_from,
    steady_level,
)
from adrl.evaluation.metrics import COMMON, means_on_common_tasks
from adrl.evaluation.statistics import Interval, probability_of_improvement, seed_iqm, seed_mean
from adrl.report.reported import ABLATIONS, LABELS, METHODS, RIVALS, TABLE_I
from adrl.report.reported import METRICS as PAPER_METRICS
from adrl.report.reproduction import NO_SEED, Array, Results, finite

LEVELS = (0.8, 0.95)
"""Success whose learning time is told."""
HARD_SHARE = 0.05
"""Share of the test worlds that count as the worst."""
OURS, PLANNER = "adrl", "astar-dwa"


def table_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """Our side of Table I in a scenario: a row for each method and guidance, means over seeds with 95 % intervals.

    A learned method's also has what beside_planner says.
    """
    rows = []
    for method in TABLE_I:
        for guidance in ("map",) if method == PLANNER else results.about["scenarios"][scenario]["evaluated"]:
            success = results.values(scenario, method, guidance, "success")
            if not success:
                continue
            row: dict[str, Any] = {"scenario": scenario, "method": method, "guidance": guidance}
            row["seeds"] = None if method == PLANNER else len(success)
            for metric in (*PAPER_METRICS, "collision", "timeout"):
                row |= _entry(metric, seed_mean(results.values(scenario, method, guidance, metric)))
            if method != PLANNER:
                row |= beside_planner(results, scenario, method, guidance)
            rows.append(row)
    return rows


def beside_planner(results: Results, scenario: str, method: str, guidance: str) -> dict[str, float | None]:
    """means_on_common_tasks with the planner as the reference, averaged over seeds; None without a common task."""
    planner = results.outcomes(scenario, PLANNER, "map").get(NO_SEED)
    runs = results.outcomes(scenario, method, guidance).values()
    means = [] if planner is None else [means_on_common_tasks(run, planner) for run in runs]
    known = [entry for entry in means if entry["common_tasks"]]
    return {key: finite(float(np.mean([e[key] for e in known]))) if known else None for key in COMMON}


def summary_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """One row a trained method, evaluated as trained: what matters more than mean Q."""
    guidance = results.trained_with(scenario)
    ours = results.values(scenario, OURS, guidance, "success")
    hard = hard_worlds(results, scenario)
    rows = []
    for method in results.methods_of(scenario, METHODS):
        success = results.values(scenario, method, guidance, "success")
        row: dict[str, Any] = {"scenario": scenario, "method": method, "seeds": len(success)}
        row |= _entry("success", seed_mean(success)) | _entry("success_iqm", seed_iqm(success))
        row |= _entry("hard_success", seed_mean(success_on(results, scenario, method, hard)))
        rival = None if method == OURS else probability_of_improvement(ours, success)
        row |= _entry("improvement", rival)
        for metric in ("env_steps", "gradient_updates", "train_seconds"):
            values = results.values(scenario, method, guidance, metric)
            row[metric] = finite(float(np.mean(values))) if values else None
        for level in LEVELS:
            for column, name in (("wall_s", "seconds"), ("env_steps", "steps")):
                times = times_to(results, scenario, method, level, column)
                row[f"{name}_to_{round(100 * level)}"] = finite(median_seconds_to_level(times))
                row[f"seeds_to_{round(100 * level)}"] = int(np.isfinite(times).sum())
        episodes = steady_episodes(results, scenario, method)
        row["episodes_to_steady"] = finite(median_seconds_to_level(episodes))
        row["seeds_to_steady"] = int(np.isfinite(episodes).sum())
        rows.append(row)
    return rows


def times_to(results: Results, scenario: str, method: str, level: float, column: str) -> list[float]:
    """wall_s or env_steps at which each seed reached the level; infinite where it never did."""
    return [
        seconds_to_level(curve[column], curve["success"], level=level)
        for curve in results.curves_of(scenario, method)
    ]


def steady_episodes(results: Results, scenario: str, method: str) -> list[float]:
    """Episodes after which each seed's mean Q is steady (Fig. 6); see steady_from for the criterion."""
    return [steady_from(curve["episode"], curve["q_mean"]) for curve in results.curves_of(scenario, method)]


def hard_worlds(results: Results, scenario: str) -> NDArray[np.intp]:
    """Tasks in which all trained methods together succeed least: HARD_SHARE of them, the same for every method."""
    guidance = results.trained_with(scenario)
    flags = [
        run["success"]
        for method in results.methods_of(scenario, METHODS)
        for run in results.outcomes(scenario, method, guidance).values()
    ]
    if not flags:
        return np.empty(0, np.intp)
    rate = np.mean(flags, axis=0)
    return np.argsort(rate, kind="stable")[: max(1, math.ceil(HARD_SHARE * len(rate)))]


def success_on(results: Results, scenario: str, method: str, tasks: NDArray[np.intp]) -> list[float]:
    """Success of each seed on these tasks."""
    runs = results.outcomes(scenario, method, results.trained_with(scenario))
    return [float(run["success"][tasks].mean()) for _, run in sorted(runs.items())]


def oscillation(curve: Mapping[str, Array]) -> float:
    """Mean |Q - trailing mean of Q| over the last half of a log, as a share of Q's range. NaN for a short log."""
    values = curve["q_mean"][np.isfinite(curve["q_mean"])]
    if len(values) < 2 * STEADY_ROWS or np.ptp(values) == 0.0:
        return math.nan
    smooth = np.convolve(values, np.full(STEADY_ROWS, 1.0 / STEADY_ROWS), mode="valid")
    rest = np.abs(values[STEADY_ROWS - 1 :] - smooth)
    return float(rest[len(rest) // 2 :].mean() / np.ptp(values))


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper that a ranking of our numbers can carry or not."""

    where: str
    """Table or figure, and our scenario."""
    text: str
    methods: tuple[str, ...]
    """The methods it is about."""
    best: str
    """max or min: what one of theirs must be among all."""
    values: dict[str, float]
    """Method -> mean or median over seeds. Infinite: never."""
    unit: str

    @property
    def holds(self) -> bool | None:
        """Whether one of theirs lies beyond all others; a tie does not. None where it was not measured."""
        known = {name: value for name, value in self.values.items() if not math.isnan(value)}
        theirs = [value for name, value in known.items() if name in self.methods]
        others = [value for name, value in known.items() if name not in self.methods]
        if not theirs or not others:
            return None
        return max(theirs) > max(others) if self.best == "max" else min(theirs) < min(others)

    def sentence(self) -> str:
        """The verdict with its numbers."""
        verdict = {True: "reproduces", False: "does not reproduce", None: "was not measured"}[self.holds]
        ordered = sorted(self.values.items(), key=lambda item: item[1], reverse=self.best == "max")
        numbers = ", ".join(f"{LABELS[name]} {_number(value)}" for name, value in ordered)
        return f'{self.where}: "{self.text}" {verdict} ({self.unit}: {numbers}).'


def claims(results: Results) -> list[Claim]:
    """What the paper says of its table and figures, held against our means and medians over seeds."""
    found = []
    for scenario in results.scenarios:
        found += _curve_claims(results, scenario)
    scenario = results.scenarios[-1]
    for guidance in results.about["scenarios"][scenario]["evaluated"]:
        found += _table_claims(results, scenario, guidance)
    return found


def _curve_claims(results: Results, scenario: str) -> list[Claim]:
    def steady(methods: Sequence[str]) -> dict[str, float]:
        return _means(results, scenario, methods, lambda curve: steady_level(curve["q_mean"]))

    episodes = {
        name: median_seconds_to_level(steady_episodes(results, scenario, name))
        for name in results.methods_of(scenario, RIVALS)
    }
    swing = _means(results, scenario, RIVALS, oscillation)
    ours, classics = (OURS,), ("sb3-sac", "sb3-ppo")
    entries = [
        (
            "Fig. 4",
            "ADRL has the highest steady-state mean Q of the ablations",
            ours,
            "max",
            steady(ABLATIONS),
        ),
        ("Fig. 4", "the pure RL baseline has the lowest mean Q", ("td3",), "min", steady(ABLATIONS)),
        ("Fig. 5", "ADRL has the highest steady-state mean Q of the methods", ours, "max", steady(RIVALS)),
        ("Fig. 5", "ADRL oscillates least", ours, "min", swing),
        ("Fig. 6", "ADRL needs the fewest episodes to steady-state mean Q", ours, "min", episodes),
        ("Fig. 6", "PPO or SAC converges slowest", classics, "max", episodes),
    ]
    units = {"Fig. 6": "median episodes"}
    return [
        Claim(f"{where}, {scenario}", text, methods, best, values, units.get(where, "mean over seeds"))
        for where, text, methods, best, values in entries
    ]


SHARE = "as a share of A*+DWA's, on the tasks that both reached"


def _table_claims(results: Results, scenario: str, guidance: str) -> list[Claim]:
    success = {
        name: float(np.mean(values)) if values else math.nan
        for name in TABLE_I
        for values in [results.values(scenario, name, "map" if name == PLANNER else guidance, "success")]
    }

    def share(metric: str) -> dict[str, float]:
        """A mean as a share of the planner's, on the tasks that both reached: a mean over easy tasks alone is short."""
        shares = {PLANNER: 1.0}
        for name in RIVALS:
            means = beside_planner(results, scenario, name, guidance)
            own, planners = means[f"{metric}_common"], means[f"reference_{metric}_common"]
            shares[name] = math.nan if own is None or not planners else own / planners
        return shares

    where = f"Table I, {scenario}, guidance {guidance}"
    entries = (
        ("ADRL has the highest success rate", "max", success, "success"),
        ("ADRL has the shortest navigation time", "min", share("time_s"), f"Av.T {SHARE}"),
        ("ADRL has the best path quality", "min", share("optimality"), f"optimality {SHARE}"),
    )
    return [Claim(where, text, (OURS,), best, values, unit) for text, best, values, unit in entries]


def _means(results: Results, scenario: str, methods: Sequence[str], of: Any) -> dict[str, float]:
    means = {}
    for method in results.methods_of(scenario, methods):
        values = [of(curve) for curve in results.curves_of(scenario, method)]
        known = [value for value in values if math.isfinite(value)]
        means[method] = float(np.mean(known)) if known else math.nan
    return means


def _number(value: float) -> str:
    if math.isnan(value):
        return "unknown"
    return "never" if math.isinf(value) else f"{value:.4g}"


def _entry(name: str, interval: Interval | None) -> dict[str, float | None]:
    values = (None, None, None) if interval is None else interval
    return {name + end: finite(value) for end, value in zip(("", "_low", "_high"), values, strict=True)}
