"""One method against another in the kept results, and whether ADRL is above its baselines as the project asks.

Seed s of one method is paired with seed s of the other, on the same test tasks; the pairs are what the bootstrap
resamples. A planner has no seeds: its one run is every seed's partner.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from adrl.evaluation.metrics import OVER_SUCCESSES, means_on_common_tasks
from adrl.evaluation.statistics import (
    UNDEFINED,
    Interval,
    bootstrap_mean,
    entry,
    paired_difference,
    seed_mean,
    wilson_interval,
)
from adrl.reproduction.reported import METHODS, OURS, OWN_MAP, PLANNER, label
from adrl.reproduction.results import NO_SEED, Columns, Results

PAIRED = ("success", *OVER_SUCCESSES)
"""What is compared. All but success on the tasks that both reached: a mean over easy tasks alone is short."""
EVALUATIONS = {"goal": "without the replanner", "replan": "with the replanner", "map": "on the known map"}
"""Guidance of an evaluation, in words."""
Seeds = Mapping[int, float]
"""Training seed -> a number of it."""


def difference(ours: Seeds, theirs: Seeds) -> Interval:
    """Mean over the seeds that both have of ours - theirs, with a bootstrap interval; one such seed: no ends."""
    common = [
        seed
        for seed in sorted(ours.keys() & theirs.keys())
        if math.isfinite(ours[seed]) and math.isfinite(theirs[seed])
    ]
    return paired_difference([ours[s] for s in common], [theirs[s] for s in common]) if common else UNDEFINED


def pairs(
    results: Results, scenario: str, ours: tuple[str, str], theirs: tuple[str, str]
) -> dict[str, tuple[dict[int, float], dict[int, float]]]:
    """A metric of PAIRED -> seed -> its mean, of ours and of theirs; also how many common_tasks (the same in both).

    ours, theirs: method and guidance. NaN for a seed without a task that both reached.
    """
    own, other = results.outcomes(scenario, *ours), results.outcomes(scenario, *theirs)
    if NO_SEED in other:
        other = dict.fromkeys(own, other[NO_SEED])
    elif NO_SEED in own:
        own = dict.fromkeys(other, own[NO_SEED])
    found = {metric: ({}, {}) for metric in (*PAIRED, "common_tasks")}
    for seed in sorted(own.keys() & other.keys()):
        means = means_on_common_tasks(own[seed], other[seed])
        for metric in OVER_SUCCESSES:
            found[metric][0][seed] = means[f"{metric}_common"]
            found[metric][1][seed] = means[f"reference_{metric}_common"]
        for side, run in enumerate((own[seed], other[seed])):
            found["success"][side][seed] = float(run["success"].mean())
            found["common_tasks"][side][seed] = means["common_tasks"]
    return found


def untrained_rivals(results: Results, scenario: str, guidance: str) -> dict[str, tuple[str, str]]:
    """Name -> method and guidance of what ADRL is held against that was not trained, where ADRL has this guidance.

    One that knows the map is held against every evaluation of ADRL's, one on its own map against that with the
    replanner: what it sees is the same.
    """
    return {
        method + (OWN_MAP if driven == "replan" else ""): (method, driven)
        for method, several in results.untrained(scenario).items()
        for driven in several
        if driven in ("map", guidance)
    }


def rivals(results: Results, scenario: str, guidance: str) -> dict[str, tuple[str, str]]:
    """Name -> method and guidance of all that ADRL is held against where it has this guidance."""
    trained = {name: (name, guidance) for name in METHODS if name != OURS}
    return trained | untrained_rivals(results, scenario, guidance)


def paired_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """For each evaluation and each of its rivals, ADRL less that rival: PAIRED with `_low` and `_high`, and the means.

    seeds: pairs of them; common_tasks: mean over them of the tasks that both reached.
    """
    rows = []
    for guidance in results.about["scenarios"][scenario]["evaluated"]:
        for rival, theirs in rivals(results, scenario, guidance).items():
            found = pairs(results, scenario, (OURS, guidance), theirs)
            if not (seeds := len(found["success"][0])):
                continue
            row: dict[str, Any] = {"scenario": scenario, "guidance": guidance, "rival": rival, "seeds": seeds}
            for metric in PAIRED:
                row |= entry(metric, difference(*found[metric]))
            row["common_tasks"] = float(np.mean(list(found["common_tasks"][0].values())))
            rows.append(row)
    return rows


def success_interval(results: Results, scenario: str, method: str, guidance: str) -> Interval:
    """Mean over seeds with its bootstrap interval; of a planner, which has none, Wilson's over its episodes."""
    runs = results.outcomes(scenario, method, guidance)
    if NO_SEED in runs:
        flags = runs[NO_SEED]["success"]
        return wilson_interval(int(flags.sum()), len(flags))
    return seed_mean(results.values(scenario, method, guidance, "success"))


def planner_interval(run: Columns, metric: str) -> Interval:
    """One of OVER_SUCCESSES of the planner's run, with a bootstrap interval over the tasks that it reached."""
    reached = run["success"] & ((run["shortest_m"] > 0.0) | (metric != "optimality"))
    if metric == "optimality":
        return bootstrap_mean(run["distance_m"][reached] / run["shortest_m"][reached])
    return bootstrap_mean(run[metric][reached])


@dataclass(frozen=True)
class Criterion:
    """What is asked of ADRL in an evaluation, and whether it is so."""

    scenario: str
    guidance: str
    question: str
    verdict: str
    """yes, no or undecided."""
    numbers: str

    def sentence(self) -> str:
        """The verdict with its numbers."""
        where = f"`{self.scenario}`, {EVALUATIONS[self.guidance]}"
        return f"{where}: {self.question} {self.verdict.capitalize()}: {self.numbers}."


def criteria(results: Results, scenario: str) -> list[Criterion]:
    """What is asked of ADRL in each evaluation in which it and one of its rivals were driven.

    Success above every rival's with intervals that do not overlap; time and optimality no worse than A*+DWA's, as the
    paper has it; and each planner's success or time, one of them beaten and ADRL no worse in the other.
    """
    rows = paired_rows(results, scenario)
    found = []
    for guidance in results.about["scenarios"][scenario]["evaluated"]:
        met = {row["rival"]: row for row in rows if row["guidance"] == guidance}
        if met:
            found.append(_success_criterion(results, scenario, guidance, met))
        if PLANNER in met:
            found.append(_no_worse(met[PLANNER], "time_s", "time", 2, " s"))
            found.append(_no_worse(met[PLANNER], "optimality", "optimality", 3))
        for rival, theirs in untrained_rivals(results, scenario, guidance).items():
            if rival in met:
                found.append(_success_or_time(results, met[rival], theirs))
    return found


def _apart(results: Results, scenario: str, ours: tuple[str, str], theirs: tuple[str, str]) -> int:
    """1 where our success is above theirs and the intervals do not overlap, -1 where it is below so, else 0."""
    own, other = (success_interval(results, scenario, *whose) for whose in (ours, theirs))
    return int(own.low > other.high) - int(own.high < other.low)


def _success_criterion(
    results: Results, scenario: str, guidance: str, met: Mapping[str, Mapping[str, Any]]
) -> Criterion:
    words = {1: "above, apart", 0: "intervals overlap", -1: "below, apart"}
    groups: dict[int, list[str]] = {side: [] for side in words}
    driven = rivals(results, scenario, guidance)
    for rival, row in met.items():
        theirs = success_interval(results, scenario, *driven[rival])
        side = _apart(results, scenario, (OURS, guidance), driven[rival])
        groups[side].append(f"{label(rival)} ({percent(theirs)}; {points(row)})")
    listed = "; ".join(f"{words[side]}: {', '.join(names)}" for side, names in groups.items() if names)
    return Criterion(
        scenario,
        guidance,
        "is ADRL's success above every baseline's, with intervals that do not overlap?",
        "no" if groups[0] or groups[-1] else "yes",
        f"ADRL {percent(success_interval(results, scenario, OURS, guidance))} %; {listed}",
    )


def _success_or_time(results: Results, row: Mapping[str, Any], theirs: tuple[str, str]) -> Criterion:
    """Above in success where the two intervals are apart, as everywhere; all else is of the paired differences."""
    scenario, guidance, name = row["scenario"], row["guidance"], label(row["rival"])
    verdict = "undecided"
    if row["success_low"] is not None and row["time_s_low"] is not None:
        more_success = _apart(results, scenario, (OURS, guidance), theirs) == 1
        less_time = row["time_s_high"] < 0.0
        if row["success_high"] < 0.0 or row["time_s_low"] > 0.0:
            verdict = "no"
        elif (more_success and row["time_s_high"] <= 0.0) or (less_time and row["success_low"] >= 0.0):
            verdict = "yes"
    return Criterion(
        scenario,
        guidance,
        f"is ADRL above {name} in success or in time, with intervals apart, and no worse in the other?",
        verdict,
        f"ADRL - {name} {points(row)}, {_signed(row, 'time_s', 2, ' s')}",
    )


def _no_worse(row: Mapping[str, Any], metric: str, name: str, decimals: int, unit: str = "") -> Criterion:
    low, high = (row[metric + end] for end in ("_low", "_high"))
    verdict = "undecided"
    if low is not None and (high <= 0.0 or low > 0.0):
        verdict = "yes" if high <= 0.0 else "no"
    return Criterion(
        row["scenario"],
        row["guidance"],
        f"is ADRL's {name} no worse than A*+DWA's, on the tasks that both reached?",
        verdict,
        f"ADRL - A*+DWA {_signed(row, metric, decimals, unit)}",
    )


def _signed(row: Mapping[str, Any], metric: str, decimals: int, unit: str) -> str:
    """A difference with its interval."""
    estimate, low, high = (row[metric + end] for end in ("", "_low", "_high"))
    if estimate is None:
        return "no task in common"
    return f"{estimate:+.{decimals}f}{unit}" + (
        "" if low is None else f" [{low:+.{decimals}f}, {high:+.{decimals}f}]"
    )


def percent(interval: Interval) -> str:
    """A share as "95.8 [93.6, 97.7]", in per cent."""
    estimate, low, high = (100.0 * value for value in interval)
    return f"{estimate:.1f}" + ("" if math.isnan(low) else f" [{low:.1f}, {high:.1f}]")


def points(row: Mapping[str, Any]) -> str:
    """How far ADRL's success is above a rival's, in points."""
    low, high = row["success_low"], row["success_high"]
    ends = "" if low is None else f" [{100 * low:+.1f}, {100 * high:+.1f}]"
    return f"{100 * row['success']:+.1f}{ends} points"
