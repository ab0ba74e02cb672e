"""Tunes the classical planners on validation tasks.

    python docs/tune_planners.py --planner astar-mppi --trials 61

One set of constants for every robot and place. A trial drives all of CELLS. The first trial has the constants that
stand in the core. Every trial is written to docs/results/classical.json when it ends; the same command goes on until
there are so many. The best ones are copied by hand to the headers in core/control.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import tyro
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.trial import create_trial

import adrl
from adrl import files
from adrl.baselines.planners import PLANNERS
from adrl.types import RobotConfig
from adrl.worlds.robots import load_robot

RESULTS = Path(__file__).parent / "results" / "classical.json"
CELLS = (
    ("jackal", "complex", "map", 32),
    ("jackal", "rooms", "map", 8),
    ("jackal", "clutter", "map", 8),
    ("diffbot", "complex", "map", 8),
    ("diffbot", "clutter", "map", 8),
    ("diffbot", "dynamic", "map", 24),
    ("jackal", "dynamic", "map", 16),
)
"""Robot, scenario, guidance, and how many validation tasks: more where planners fail.

All with the true map (`map`). On a map of its own (`replan`) a planner has the same constants; none is tuned there.
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to tune, and for how long."""

    planner: str
    """One of adrl list."""
    trials: int = 60
    """Trials in all, those of before included."""
    max_seconds: float | None = None
    """Start no trial after so many s; no limit when left out."""


def log(low: float, high: float) -> FloatDistribution:
    """A constant that may be anywhere between, in proportion."""
    return FloatDistribution(low, high, log=True)


SPACES: dict[str, dict[str, BaseDistribution]] = {
    "astar-dwa": {
        "lookahead_share": FloatDistribution(0.4, 1.2),
        "horizon_s": FloatDistribution(0.7, 2.0),
        "margin_m": FloatDistribution(0.02, 0.08),
        "comfort_m": FloatDistribution(0.05, 0.3),
        "comfort_weight": log(0.01, 0.5),
        "heading_weight": log(0.01, 1.0),
        "hit_weight": log(0.2, 3.0),
    },
    "astar-pursuit": {
        "lookahead_time": FloatDistribution(0.4, 1.5),
        "min_lookahead_dist": FloatDistribution(0.2, 0.8),
        "rotate_to_heading_min_angle": FloatDistribution(0.4, 1.5),
        "regulated_linear_scaling_min_radius": log(0.1, 1.0),
        "regulated_linear_scaling_min_speed": log(0.05, 0.6),
        "cost_scaling_dist": log(0.03, 0.3),
        "max_allowed_time_to_collision": FloatDistribution(0.3, 2.0),
        "margin_m": FloatDistribution(0.02, 0.08),
    },
    "astar-mppi": {
        "temperature": log(0.02, 1.0),
        "vx_std": FloatDistribution(0.1, 0.6),
        "wz_std": FloatDistribution(0.2, 1.0),
        "noise_correlation": FloatDistribution(0.0, 0.95),
        "collision_margin_m": FloatDistribution(0.03, 0.1),
        "inflation_m": FloatDistribution(0.1, 0.6),
        "repulsion_weight": log(0.2, 5.0),
        "path_align_weight": log(0.5, 20.0),
        "path_follow_weight": log(1.0, 20.0),
        "path_follow_offset_m": FloatDistribution(0.1, 1.5),
        "path_angle_weight": log(0.5, 10.0),
    },
}
"""Planner -> constants to tune, and from what. lookahead_share: of the robot's own lookahead."""


def main(options: Options) -> None:
    """Run trials until there are as many as asked for."""
    results: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    cells = [list(cell) for cell in CELLS]
    kept = results.get(options.planner)
    if kept is None or kept["cells"] != cells:  # other tasks: values are not comparable
        kept = results[options.planner] = {"cells": cells, "trials": []}
    rows = kept["trials"]
    space = SPACES[options.planner]
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=0))
    for row in rows:
        if row["constants"]:
            study.add_trial(create_trial(params=row["constants"], distributions=space, value=row["value"]))
    began_s = time.monotonic()
    while len(rows) < options.trials:
        if options.max_seconds is not None and time.monotonic() - began_s > options.max_seconds:
            break
        # The first trial has the constants as they stand, which need not lie in the space.
        trial = study.ask(space) if rows else None
        row = measure(options.planner, {} if trial is None else trial.params)
        if trial is not None:
            study.tell(trial, row["value"])
        rows.append(row)
        files.write_json(RESULTS, results)
        print(len(rows), round(row["value"], 3), row["cells"], flush=True)


def measure(planner: str, constants: dict[str, float]) -> dict[str, Any]:
    """One trial: mean over cells of success less a tenth of the time it takes over that of a straight drive."""
    started_s = time.monotonic()
    cells, values = {}, []
    for robot_name, scenario, guidance, episodes in CELLS:
        robot = load_robot(robot_name)
        summary = adrl.evaluate(
            with_constants(planner, constants),
            robot=robot,
            scenario=scenario,
            guidance=guidance,
            split="validation",
            episodes=episodes,
            num_threads=1,
        ).summary
        time_s, success = summary["time_s"], summary["success"]
        slow = (
            3.0
            if time_s is None
            else time_s * robot.max_speed_mps / summary["distance_m"] * summary["optimality"]
        )
        values.append(success - 0.1 * min(slow, 3.0))
        cells[f"{robot_name}, {scenario}, {guidance}"] = [success, time_s]
    seconds = time.monotonic() - started_s
    return {
        "constants": constants,
        "value": float(np.mean(values)),
        "cells": cells,
        "seconds": round(seconds, 1),
    }


def with_constants(planner: str, constants: dict[str, float]) -> Any:
    """The planner with other constants."""
    base: Any = PLANNERS[planner]

    def controller(robot: RobotConfig) -> Any:
        config = base.controller(robot)
        for name, value in constants.items():
            if name == "lookahead_share":
                config.lookahead_m *= value
            else:
                setattr(config, name, value)
        return config

    return type("Tuned", (base,), {"controller": staticmethod(controller)})()


if __name__ == "__main__":
    main(tyro.cli(Options))
