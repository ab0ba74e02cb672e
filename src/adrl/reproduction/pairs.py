"""One method against another in the kept results, and whether ADRL is above its baselines as the project asks.

Seed s of one method is paired with seed s of the other, on the same test tasks; the pairs are what the bootstrap
resamples. The planner has no seeds: its one run is every seed's partner.
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
from adrl.reproduction.reported import LABELS, METHODS, OURS, PLANNER
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


def paired_rows(results: Results, scenario: str) -> list[dict[str, Any]]:
    """For each evaluation and each other method, ADRL less that method: PAIRED with `_low` and `_high`, and the means.

    seeds: pairs of them; common_tasks: mean over them of the tasks that both reached.
    """
    rows = []
    for guidance in results.about["scenarios"][scenario]["evaluated"]:
        for rival in (*(name for name in METHODS if name != OURS), PLANNER):
            theirs = (rival, "map" if rival == PLANNER else guidance)
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
    """Success above every baseline's with intervals that do not overlap; time and optimality no worse than A*+DWA's.

    The three of each evaluation in which ADRL and one of the baselines were driven.
    """
    rows = paired_rows(results, scenario)
    found = []
    for guidance in results.about["scenarios"][scenario]["evaluated"]:
        rivals = {row["rival"]: row for row in rows if row["guidance"] == guidance}
        if rivals:
            found.append(_success_criterion(results, scenario, guidance, rivals))
        if PLANNER in rivals:
            found.append(_no_worse(rivals[PLANNER], "time_s", "time", 2, " s"))
            found.append(_no_worse(rivals[PLANNER], "optimality", "optimality", 3))
    return found


def _success_criterion(
    results: Results, scenario: str, guidance: str, rivals: Mapping[str, Mapping[str, Any]]
) -> Criterion:
    ours = success_interval(results, scenario, OURS, guidance)
    groups: dict[str, list[str]] = {"above, apart": [], "intervals overlap": [], "below, apart": []}
    for rival, row in rivals.items():
        theirs = success_interval(results, scenario, rival, "map" if rival == PLANNER else guidance)
        apart = "above, apart" if ours.low > theirs.high else "below, apart"
        group = apart if ours.low > theirs.high or ours.high < theirs.low else "intervals overlap"
        groups[group].append(f"{LABELS[rival]} ({percent(theirs)}; {points(row)})")
    listed = "; ".join(f"{group}: {', '.join(names)}" for group, names in groups.items() if names)
    holds = not groups["intervals overlap"] and not groups["below, apart"]
    return Criterion(
        scenario,
        guidance,
        "is ADRL's success above every baseline's, with intervals that do not overlap?",
        "yes" if holds else "no",
        f"ADRL {percent(ours)} %; {listed}",
    )


def _no_worse(row: Mapping[str, Any], metric: str, name: str, decimals: int, unit: str = "") -> Criterion:
    estimate, low, high = (row[metric + end] for end in ("", "_low", "_high"))
    verdict = "undecided"
    if low is not None and (high <= 0.0 or low > 0.0):
        verdict = "yes" if high <= 0.0 else "no"
    ends = "" if low is None else f" [{low:+.{decimals}f}, {high:+.{decimals}f}]"
    number = "no task in common" if estimate is None else f"{estimate:+.{decimals}f}{unit}{ends}"
    return Criterion(
        row["scenario"],
        row["guidance"],
        f"is ADRL's {name} no worse than A*+DWA's, on the tasks that both reached?",
        verdict,
        f"ADRL - A*+DWA {number}",
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
