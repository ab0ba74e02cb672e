"""What the kept results of `adrl reproduce` say in numbers: Table I, success of every method, learning times."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.learning_time import (
    STEADY_ROWS,
    median_seconds_to_level,
    seconds_to_level,
    steady_from,
)
from adrl.evaluation.metrics import COMMON, OVER_SUCCESSES, means_on_common_tasks
from adrl.evaluation.statistics import (
    Interval,
    entry,
    finite,
    probability_of_improvement,
    seed_iqm,
    seed_mean,
)
from adrl.reproduction.pairs import difference, planner_interval, success_interval
from adrl.reproduction.reported import METHODS, OURS, PLANNER, TABLE_I
from adrl.reproduction.results import NO_SEED, Array, Columns, Results

LEVELS = (0.8, 0.95)
"""Success whose learning time is told."""
HARD_SHARE = 0.05
"""Share of the test worlds that count as the worst."""
Curve = Mapping[str, Array]


def table_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """Our side of Table I in a scenario: a row for each method and guidance, means over seeds with 95 % intervals.

    Planners have no seeds: their intervals are over episodes. A learned method's row also has what beside_planner
    says.
    """
    rows = []
    planners = results.untrained(scenario)
    for method in (*planners, *(name for name in TABLE_I if name != PLANNER)):
        evaluated = planners.get(method) or results.about["scenarios"][scenario]["evaluated"]
        for guidance in evaluated:
            success = results.values(scenario, method, guidance, "success")
            if not success:
                continue
            row: dict[str, Any] = {"scenario": scenario, "method": method, "guidance": guidance}
            row["seeds"] = None if method in planners else len(success)
            row |= entry("success", success_interval(results, scenario, method, guidance))
            for metric in ("collision", "timeout"):
                row |= entry(metric, seed_mean(results.values(scenario, method, guidance, metric)))
            if method in planners:
                run = results.outcomes(scenario, method, guidance)[NO_SEED]
                row |= _entries({metric: planner_interval(run, metric) for metric in OVER_SUCCESSES})
            else:
                means = {m: results.values(scenario, method, guidance, m) for m in OVER_SUCCESSES}
                row |= _entries({metric: seed_mean(values) for metric, values in means.items()})
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


def success_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """Success of every trained method in each evaluation, with intervals over seeds, and the planner's over episodes.

    `success_GUIDANCE`, and the means `collision_GUIDANCE` and `timeout_GUIDANCE`. Where a method was driven without the
    replanner and with it, also `gain`: with it less without it, seed by seed; `freed`: of its timeouts without it, the
    share that it solved with it.
    """
    rows = []
    planners = results.untrained(scenario)
    for method in (*METHODS, *planners):
        evaluated = planners.get(method) or results.about["scenarios"][scenario]["evaluated"]
        runs = {guidance: results.outcomes(scenario, method, guidance) for guidance in evaluated}
        if not any(runs.values()):
            continue
        row: dict[str, Any] = {"scenario": scenario, "method": method}
        row["seeds"] = None if method in planners else max(len(by_seed) for by_seed in runs.values())
        for guidance in evaluated:
            row |= entry(f"success_{guidance}", success_interval(results, scenario, method, guidance))
            for ending in ("collision", "timeout"):
                values = results.values(scenario, method, guidance, ending)
                row[f"{ending}_{guidance}"] = finite(float(np.mean(values))) if values else None
        if method not in planners and {"goal", "replan"} <= set(evaluated):
            without, with_it = (
                {seed: float(run["success"].mean()) for seed, run in runs[guidance].items()}
                for guidance in ("goal", "replan")
            )
            row |= entry("gain", difference(with_it, without))
            row |= entry("freed", seed_mean(_freed(runs["goal"], runs["replan"])))
        rows.append(row)
    return rows


def _freed(without: Mapping[int, Columns], with_it: Mapping[int, Columns]) -> list[float]:
    """Of the tasks that ran out of time without the replanner, the share solved with it: of each seed that has any."""
    stuck = {seed: ~run["success"] & ~run["collision"] for seed, run in without.items()}
    return [
        float(with_it[seed]["success"][rows].mean())
        for seed, rows in stuck.items()
        if rows.any() and seed in with_it
    ]


def _entries(intervals: Mapping[str, Interval]) -> dict[str, float | None]:
    return {
        key: value for name, interval in intervals.items() for key, value in entry(name, interval).items()
    }


def summary_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """One row a trained method, evaluated as trained: what matters more than mean Q."""
    guidance = results.trained_with(scenario)
    ours = results.values(scenario, OURS, guidance, "success")
    hard = hard_worlds(results, scenario)
    rows = []
    for method in results.methods_of(scenario, METHODS):
        success = results.values(scenario, method, guidance, "success")
        row: dict[str, Any] = {"scenario": scenario, "method": method, "seeds": len(success)}
        row |= entry("success", seed_mean(success)) | entry("success_iqm", seed_iqm(success))
        row |= entry("hard_success", seed_mean(success_on(results, scenario, method, hard)))
        rival = None if method == OURS else probability_of_improvement(ours, success)
        row |= entry("improvement", rival)
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


def oscillation(curve: Curve) -> float:
    """Mean |Q - trailing mean of Q| over the last half of a log, as a share of Q's range. NaN for a short log."""
    values = curve["q_mean"][np.isfinite(curve["q_mean"])]
    if len(values) < 2 * STEADY_ROWS or np.ptp(values) == 0.0:
        return math.nan
    smooth = np.convolve(values, np.full(STEADY_ROWS, 1.0 / STEADY_ROWS), mode="valid")
    rest = np.abs(values[STEADY_ROWS - 1 :] - smooth)
    return float(rest[len(rest) // 2 :].mean() / np.ptp(values))


def late_growth(curve: Curve) -> float:
    """Mean Q of the last tenth of a log less that of the tenth at its middle, as a share of Q's range.

    NaN for a log of fewer than ten rows.
    """
    values = curve["q_mean"][np.isfinite(curve["q_mean"])]
    tenth, middle = len(values) // 10, len(values) // 2
    if not tenth or np.ptp(values) == 0.0:
        return math.nan
    return float((values[-tenth:].mean() - values[middle : middle + tenth].mean()) / np.ptp(values))


def promised_too_much(curve: Curve) -> float:
    """What a critic promises from validation starts less the return that came, mean of the first quarter of the rows.

    NaN without a row that has both.
    """
    over = curve["q_start"] - curve["return_start"]
    over = over[np.isfinite(over)]
    return float(over[: max(1, len(over) // 4)].mean()) if len(over) else math.nan
