"""The main job in one go: train for a minute, evaluate beside A*+DWA on unseen worlds, draw what happened."""

import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from adrl import api
from adrl.commands import train
from adrl.commands.progress import console
from adrl.evaluation.metrics import RATES, Episodes
from adrl.evaluation.results import comparison_table
from adrl.report.figures import RoutePanel, learning_curve, routes

RUN = Path("runs/demo")
ROUTES = 6
SECONDS = 60.0
EVALUATE_EVERY = 32_000
"""Environment steps between validations: enough points for a curve, little of the minute spent on it."""
LOG_EVERY = 1_600
"""Environment steps between points of the other curves: a slow machine makes a few thousand in a minute."""


def main() -> int:
    """Train, evaluate, compare, draw. The only argument, if any, is the time to train in seconds."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    shutil.rmtree(RUN, ignore_errors=True)
    budget = ["--max-seconds", str(seconds), "--eval-interval-steps", str(EVALUATE_EVERY)]
    budget += ["--log-interval-steps", str(LOG_EVERY)]
    train.main(["--scenario", "clutter", *budget, "--out", str(RUN)])
    results = {
        "ADRL": api.evaluate(RUN, record=ROUTES, out=RUN / "evaluation"),
        "A*+DWA": api.evaluate(api.PLANNER, record=ROUTES, out=RUN / "astar-dwa"),
    }
    console().print(comparison_table([result.summary | {"policy": name} for name, result in results.items()]))
    routes(panels(results), RUN / "routes.png")
    learning_curve({"ADRL": RUN / "metrics.jsonl"}, RUN / "learning_curve.png")
    print(f"pictures: {RUN / 'routes.png'}, {RUN / 'learning_curve.png'}")
    return 0


def panels(results: Mapping[str, api.Evaluation]) -> list[RoutePanel]:
    """A panel for each recorded task, with the routes of all policies. All results are of the same tasks."""
    first = next(iter(results.values()))
    return [
        RoutePanel(
            world=task.world,
            start=task.start,
            goal=task.goal,
            goal_tolerance_m=task.goal_tolerance_m,
            path=task.path,
            trajectories={name: result.rollout.routes[i] for name, result in results.items()},
            endings={name: _ending(result.rollout.episodes, i) for name, result in results.items()},
            title=f"test task {i}",
        )
        for i, task in enumerate(first.tasks[: len(first.rollout.routes)])
    ]


def _ending(episodes: Episodes, index: int) -> str:
    return next(name for name in RATES if getattr(episodes, name)[index])


if __name__ == "__main__":
    sys.exit(main())
