"""What a policy does on many robots, robot by robot, and summed up with the robot as the unit."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.metrics import RATES, SAMPLES, Episodes
from adrl.evaluation.results import RunMeta, Summary, about_run, interval_entry, plain_table, training_of
from adrl.evaluation.statistics import bootstrap_mean, clustered_rate, wilson_interval, worst_decile
from adrl.types import LidarConfig, RobotConfig

if TYPE_CHECKING:
    from rich.table import Table

Columns = dict[str, NDArray[Any]]
WORST = 5
"""Robots that a table names."""
DERIVED = ("circumscribed_radius_m", "stop_time_s", "stop_distance_m")
"""What follows from a robot's numbers and stands beside them."""


def by_robot(
    robots: Sequence[RobotConfig], numbers: NDArray[np.int64], episodes: Episodes, whose: NDArray[np.int64]
) -> Columns:
    """A row a robot (R,): name and number, how many episodes and their rates, means of other metrics, and its numbers.

    whose: (E,) number of the robot that drove each episode. NaN for a mean of nothing, and for a rectangle's radius.
    """
    own = [episodes.select(whose == number) for number in numbers]
    columns: Columns = {
        "robot": numbers,
        "name": np.array([robot.name for robot in robots]),
        "episodes": np.array([len(part) for part in own]),
    }
    columns |= {name: np.array([getattr(part, name).mean() for part in own]) for name in RATES}
    columns |= {name: np.array([_mean(samples(part)) for part in own]) for name, samples in SAMPLES.items()}
    for kind, holders, prefix in (
        (RobotConfig, robots, ""),
        (LidarConfig, [robot.lidar for robot in robots], "lidar."),
    ):
        for field in (f.name for f in fields(kind) if f.name not in ("name", "footprint_m", "lidar")):
            values = [getattr(holder, field) for holder in holders]
            columns[prefix + field] = np.array([np.nan if value is None else value for value in values])
    return columns | {name: np.array([getattr(robot, name) for robot in robots]) for name in DERIVED}


def summarise_robots(columns: Columns, meta: RunMeta, left_out: Mapping[str, str]) -> Summary:
    """The JSON document of an evaluation on many robots: that of one on one robot, with robots as the unit.

    Rates have Wilson intervals that allow for how much the robots differ, means are over robots, of each its mean, with
    bootstrap intervals. Beside them: robots, worst_decile (the success that nine of ten robots reach at least),
    worst_robot with its Wilson interval, and robots_left_out with why.
    """
    trials, summary = columns["episodes"], about_run(meta)
    summary |= {"episodes": int(trials.sum()), "robots": len(trials), "robots_left_out": dict(left_out)}
    for ending in RATES:
        summary |= interval_entry(ending, clustered_rate(np.rint(columns[ending] * trials), trials))
    for name in SAMPLES:
        known = columns[name][np.isfinite(columns[name])]
        summary |= interval_entry(name, bootstrap_mean(known))
    summary |= interval_entry("worst_decile", worst_decile(columns["success"]))
    worst = int(worst_first(columns)[0])
    successes = round(float(columns["success"][worst] * trials[worst]))
    summary |= {
        "worst_robot": {
            "robot": str(columns["name"][worst]),
            "episodes": int(trials[worst]),
            **{name: float(columns[name][worst]) for name in RATES},
            **interval_entry("success", wilson_interval(successes, int(trials[worst]))),
        }
    }
    return summary | training_of(meta)


def worst_first(columns: Columns) -> NDArray[np.intp]:
    """Rows by success, the worst first; of equal ones that with more collisions."""
    return np.lexsort((columns["robot"], -columns["collision"], columns["success"]))


def robots_table(columns: Columns, summary: Summary, name: str) -> "Table":
    """The worst decile, and the worst robots with what draws them again. name: of the family, as the user gave it."""
    low, high = (summary[f"worst_decile_{end}"] for end in ("low", "high"))
    decile = f"worst decile {100.0 * summary['worst_decile']:.1f} %"
    interval = "" if low is None else f" ({100.0 * low:.1f}-{100.0 * high:.1f})"
    note = "nine of ten robots reach the worst decile; adrl robot NAME draws one"
    table = plain_table(f"{decile}{interval}, and the worst of {summary['robots']} robots", note)
    for heading in ("robot", "success %", "collision %", "m/s", "radius m", "view deg", "stops s"):
        table.add_column(heading, justify="left" if heading == "robot" else "right", no_wrap=True)
    for row in worst_first(columns)[:WORST]:
        c = {key: values[row] for key, values in columns.items()}
        table.add_row(
            f"{name}:{summary['split']}:{c['robot']}",
            f"{100.0 * c['success']:.0f}",
            f"{100.0 * c['collision']:.0f}",
            f"{c['max_speed_mps']:.2f}",
            f"{c['circumscribed_radius_m']:.2f}",
            f"{np.degrees(c['lidar.fov_rad']):.0f}",
            f"{c['stop_time_s']:.2f}",
        )
    return table


def _mean(samples: NDArray[np.float64]) -> float:
    return float(samples.mean()) if len(samples) else float("nan")
