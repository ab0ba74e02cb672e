"""adrl demo: the main job in one go, as commands that anyone may type."""

import re
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from adrl import api, extras
from adrl.agents import checkpoint
from adrl.agents.metrics import METRICS_FILE, TENSORBOARD_FOLDER
from adrl.commands import evaluate, train
from adrl.commands.options import parse
from adrl.commands.progress import console
from adrl.deploy.policy import CONFIG_FILE, WEIGHTS_FILE
from adrl.errors import ConfigError, brief
from adrl.evaluation.metrics import RATES, Episodes
from adrl.evaluation.results import EPISODES_FILE, ROBOTS_FILE, SUMMARY_FILE, TRACES_FILE, comparison_table
from adrl.outputs import LOCK_FILE, require_folder
from adrl.report.figures import RoutePanel, learning_curve, routes
from adrl.report.html import write_report
from adrl.report.source import read_source
from adrl.runs.train import VERSIONS_FILE

RUN, DRAWN = Path("runs/demo"), Path("runs/demo-robots")
MARK = ".demo"
"""File that says that a demo made the folder."""
OF_TRAINING = (
    *(LOCK_FILE, VERSIONS_FILE, METRICS_FILE, TENSORBOARD_FOLDER, checkpoint.FOLDER),
    *(WEIGHTS_FILE, CONFIG_FILE, "evaluation", "astar-dwa", "routes.png", "learning_curve.png"),
)
OF_EVALUATION = (SUMMARY_FILE, EPISODES_FILE, ROBOTS_FILE, TRACES_FILE, "robots.png")
LEFT = {MARK, *OF_TRAINING, *OF_EVALUATION, "report.html", "figures"}
"""What a demo leaves in its folders, and the next one deletes."""
HALF_WRITTEN = re.compile(r"\..+\.[0-9a-f]{32}\.tmp")
"""Names of files that were being written, see adrl.files."""
ROUTES = 6
EVALUATE_EVERY = 32_000
"""Environment steps between validations: enough points for a curve, little of the minute spent on it."""
LOG_EVERY = 1_600
"""Environment steps between points of the other curves: a slow machine makes a few thousand in a minute."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """How long it may take."""

    seconds: float = 60.0
    """Time to train (s), set-up included."""


def main(arguments: Sequence[str]) -> int:
    """Drive drawn robots with policy default; train, evaluate, compare and draw where the extra train is there."""
    options = parse(
        DemoOptions,
        arguments,
        "demo",
        "With policy default drive robots that no training has seen. Then train one for a minute (extra train), "
        "evaluate it beside A*+DWA on unseen worlds, and draw what happened.",
    )
    if not options.seconds > 0.0:
        raise ConfigError(f"seconds is {options.seconds:g}; give more than 0")
    for folder in (RUN, DRAWN):
        _require_own(folder)
    for folder in (RUN, DRAWN):
        _delete(folder)
    _claim(DRAWN)
    _run(evaluate, "--robot", "any", "--robots", 20, "--episodes", 5, "--out", DRAWN)
    if extras.installed("train"):
        _claim(RUN)
        _train(options.seconds)
    _tell(RUN if RUN.exists() else DRAWN)
    return 0


def _require_own(folder: Path) -> None:
    """What a demo of before has left, one that was killed too, is deleted; anything else is not. Raises ConfigError."""
    require_folder("folder", folder)
    if folder.is_symlink():
        raise ConfigError(f"{folder} is a link, and the demo would delete it; move it, or delete it")
    held = {entry.name for entry in folder.iterdir()} if folder.exists() else set()
    half_written = {name for name in held if HALF_WRITTEN.fullmatch(name)}
    others = held - LEFT - half_written if MARK in held else held
    if others:
        raise ConfigError(
            f"{folder} holds what no demo of this version has left ({brief(', '.join(sorted(others)))}), and the demo "
            "would delete it; move it, or delete it"
        )


def _delete(folder: Path) -> None:
    """The mark last: a demo that is killed meanwhile leaves what the next one knows."""
    for entry in folder.iterdir() if folder.exists() else ():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        elif entry.name != MARK:
            entry.unlink()
    if folder.exists():
        shutil.rmtree(folder)


def _claim(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / MARK).touch()


def _run(command: ModuleType, *arguments: object) -> None:
    """One of the other commands, shown as it is typed."""
    name = command.__name__.rpartition(".")[2]
    words = [str(word) for word in arguments]
    console().print(f"\n$ adrl {name} {shlex.join(words)}", style="bold")
    command.main(words)


def _train(seconds: float) -> None:
    """A run of its own, beside the planner, with pictures of both."""
    budget = ["--max-seconds", f"{seconds:g}", "--eval-interval-steps", EVALUATE_EVERY]
    _run(train, "--scenario", "clutter", *budget, "--log-interval-steps", LOG_EVERY, "--out", RUN)
    results = {
        "ADRL": api.evaluate(RUN, record=ROUTES, out=RUN / "evaluation"),
        "A*+DWA": api.evaluate(api.PLANNER, record=ROUTES, out=RUN / "astar-dwa"),
    }
    console().print(comparison_table([result.summary | {"policy": name} for name, result in results.items()]))
    routes(panels(results), RUN / "routes.png")
    learning_curve({"ADRL": RUN / "metrics.jsonl"}, RUN / "learning_curve.png")
    print(f"pictures: {RUN / 'routes.png'}, {RUN / 'learning_curve.png'}")


def _tell(folder: Path) -> None:
    """The addresses to look at."""
    page = folder / "report.html"
    write_report(read_source(folder), page)
    print(f"replays:  {page.resolve().as_uri()}")
    print(f"live:     adrl view{f' {RUN}' if folder == RUN else ''}")
    if folder != RUN:
        print("train a policy of your own in a minute: pip install 'adrl[train]', then adrl demo")


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
