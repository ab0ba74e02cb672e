"""Regret: how much worse a method is than the best one of its cell.

C cells, M methods, S seeds. A loss is what a run costs: `success`, the share of the test tasks that it did not solve;
`time`, the mean time a task took it, one that was not solved counting with its time limit (the penalised average of
the field of algorithm selection), as a share of the mean of the cell's best method. Both are numbers of one run alone,
so that a method's regret does not depend on what else is compared, but for the best. A mean over the tasks that all
methods solve would.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.statistics import Interval, entry, finite, holm, paired_p_value, seed_mean

Array = NDArray[np.float64]
OUTCOMES = ("success", "time")


@dataclass(frozen=True, eq=False, kw_only=True)
class Scores:
    """What the runs of complete cells measured."""

    cells: tuple[str, ...]
    methods: tuple[str, ...]
    """The first is the one that the others are paired with."""
    success: Array
    """(C, M, S) share of the test tasks solved."""
    time_s: Array
    """(C, M, S) mean time a task, the time limit where it was not solved."""


def losses(scores: Scores) -> dict[str, Array]:
    """Outcome -> (C, M, S), the less the better."""
    least_s = scores.time_s.mean(axis=2).min(axis=1)
    return {"success": 1.0 - scores.success, "time": scores.time_s / least_s[:, None, None]}


def regrets(loss: Array) -> Array:
    """(C, M, S) by how much each run of a method is worse than its partner, that seed's run of the cell's best method.

    The best has the least mean loss over seeds: its regrets are 0, and every method's mean over seeds is 0 or more. It
    stays the best in resamples of the seeds, too: one chosen anew in each would add the luck of the choice.
    """
    best = loss.mean(axis=2).argmin(axis=1)
    return loss - loss[np.arange(len(loss)), best][:, None, :]


class Pair(NamedTuple):
    """A method's loss less that of the first one, over all cells: above 0 the first is better."""

    difference: Interval
    p: float


def pair(loss: Array, ours: int, theirs: int) -> Pair:
    """Seed s is paired with seed s in each cell; the bootstrap resamples pairs within cells, the test flips them."""
    difference = seed_mean((loss[:, theirs] - loss[:, ours]).T)
    return Pair(difference, paired_p_value(loss[:, theirs].ravel(), loss[:, ours].ravel()))


def method_rows(scores: Scores) -> list[dict[str, Any]]:
    """A row a method: its mean regret over cells in each outcome with a 95 % interval, and the greatest of a cell.

    For all but the first method also by how much it is worse than the first, `less_first_OUTCOME` with its interval,
    `p_OUTCOME`, and `p_holm_OUTCOME`, corrected for the number of methods.
    """
    rows: list[dict[str, Any]] = [{"method": method} for method in scores.methods]
    for outcome, loss in losses(scores).items():
        by_seed = regrets(loss)
        pairs = [pair(loss, 0, m) for m in range(1, len(rows))]
        corrected = holm([found.p for found in pairs])
        for m, row in enumerate(rows):
            # Every score is a training of its own: seeds are resampled within each cell.
            row |= entry(f"regret_{outcome}", seed_mean(by_seed[:, m].T))
            row[f"worst_{outcome}"] = finite(float(by_seed[:, m].mean(axis=1).max()))
            first = m == 0
            row |= entry(f"less_first_{outcome}", None if first else pairs[m - 1].difference)
            row[f"p_{outcome}"] = None if first else finite(pairs[m - 1].p)
            row[f"p_holm_{outcome}"] = None if first else finite(corrected[m - 1])
    return rows


def cell_rows(scores: Scores, common_s: Mapping[str, Sequence[float | None]]) -> list[dict[str, Any]]:
    """A row a cell and method: its means with intervals over seeds, its regret, and its pair with the first method.

    common_s: cell -> each method's mean time, in the order of the methods, over the tasks that all runs of the cell
    solved.
    """
    found = losses(scores)
    by_seed = {outcome: regrets(loss) for outcome, loss in found.items()}
    rows = []
    for c, cell in enumerate(scores.cells):
        for m, method in enumerate(scores.methods):
            row: dict[str, Any] = {"cell": cell, "method": method}
            row |= entry("success", seed_mean(scores.success[c, m]))
            row |= entry("time_s", seed_mean(scores.time_s[c, m]))
            row["common_time_s"] = common_s[cell][m]
            for outcome, loss in found.items():
                row[f"regret_{outcome}"] = finite(float(by_seed[outcome][c, m].mean()))
                difference = None if m == 0 else seed_mean(loss[c, m] - loss[c, 0])
                row |= entry(f"less_first_{outcome}", difference)
            rows.append(row)
    return rows
