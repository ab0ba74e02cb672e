"""adrl evaluate."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from adrl import api
from adrl.commands.drive_options import DrivesOptions
from adrl.commands.options import as_words, load_place, parse, refuse, write_document
from adrl.commands.progress import console, counting_bar
from adrl.errors import ConfigError
from adrl.evaluation.metrics import RATES
from adrl.evaluation.over_robots import Columns, robots_table, worst_first
from adrl.evaluation.results import Summary, comparison_table, require_results_folder
from adrl.outputs import require_file
from adrl.types import Scenario, Task
from adrl.worlds import RobotFamily, load_robots, single_task
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.people import Peopled
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(DrivesOptions):
    """Which policy drives where, and what is kept of it."""

    episodes: int | None = None
    """Tasks to drive, one episode each: 500, or 20 of each robot of a family."""
    robots: int | None = None
    """Robots of a family to drive with, the first of the split: 100 when left out. For --robot any, or a TOML file with
    ranges."""
    paper_literal: bool = False
    """Guidance replan computes eqs 18, 20 and 21/23 exactly as printed; docs/fidelity.md lists the differences."""
    start: tuple[float, float, float] | None = None
    """x (m), y (m) and yaw (rad) of one task of your own on --map or --world; needs --goal."""
    goal: tuple[float, float] | None = None
    """x (m) and y (m) of that task's goal."""
    supervised: bool = False
    """Drive as on a robot: behind the runtime's supervisor. Replays say what it held the robot for."""
    threads: int = 0
    """Threads of the simulator; 0 takes one per core."""
    out: Path | None = None
    """Folder for episodes.parquet, summary.json and traces.safetensors, which adrl report reads."""
    bag: Path | None = None
    """ROS 1 bag (FILE.bag), or folder of a ROS 2 bag (MCAP), for what the robot saw, was told and did (extra bags)."""
    bag_tasks: tuple[int, ...] = ()
    """Numbers of the tasks that go into the bag; all when left out."""


def main(arguments: Sequence[str]) -> int:
    """Evaluate and print a table."""
    options = parse(
        EvaluateOptions, arguments, "evaluate", "Drive a policy on fixed tasks and report how it did."
    )
    require_results_folder("--out", options.out)
    require_file("--json", options.json)
    # Before the bar: what cannot be read is told in one line.
    place, robot = load_place(options), None if options.robot is None else load_robots(options.robot)
    if isinstance(robot, RobotFamily):
        return _over_robots(options, place, robot)
    if options.robots is not None:
        raise ConfigError("--robots draws robots of a family; give --robot any, or a TOML file with ranges")
    with counting_bar(f"evaluating {options.policy}", "episodes") as show:
        result = api.evaluate(
            options.policy,
            scenario=place,
            robot=robot,
            guidance=options.guidance,
            paper_literal=options.paper_literal,
            split=options.split,
            episodes=api.EPISODES if options.episodes is None else options.episodes,
            seed=options.seed,
            num_threads=options.threads,
            tasks=_own_task(options),
            traces=options.out is not None,
            bag=options.bag,
            bag_tasks=options.bag_tasks or None,
            supervised=options.supervised,
            on_step=show,
        )
    console().print(comparison_table([result.summary]))
    _tell(_in_words(result.summary, options))
    if options.out is not None:
        result.save(options.out)
    write_document(options.json, result.summary)
    return 0


def _over_robots(options: EvaluateOptions, place: Scenario, family: RobotFamily) -> int:
    """The same with many robots."""
    of_one = {"paper_literal", "start", "goal", "bag", "bag_tasks", "supervised"}
    refuse(
        options,
        of_one,
        f"is for one robot, and {family.name} is a family; give one, as {options.robot}:test:0",
    )
    with counting_bar(f"evaluating {options.policy}", "episodes") as show:
        result = api.evaluate_family(
            options.policy,
            family=family,
            scenario=place,
            guidance=options.guidance,
            split=options.split,
            robots=api.ROBOTS if options.robots is None else options.robots,
            episodes=api.TASKS if options.episodes is None else options.episodes,
            seed=options.seed,
            num_threads=options.threads,
            traces=options.out is not None,
            on_step=show,
        )
    console().print(comparison_table([result.summary]))
    console().print(robots_table(result.robots, result.summary, str(options.robot)))
    _tell(_in_words(result.summary, options))
    _tell(f"drive the worst again: {again(result.robots, options)}")
    if options.out is not None:
        from adrl.report.figures import save
        from adrl.report.over_robots import over_robots_figure

        result.save(options.out)
        save(over_robots_figure(result.robots), options.out / "robots.png")
    write_document(options.json, result.summary)
    return 0


def _tell(line: str) -> None:
    console().print(line, markup=False, highlight=False, soft_wrap=True)


def _in_words(summary: Summary, options: EvaluateOptions) -> str:
    """The table's first columns for who reads one for the first time, and where to see the drives."""
    drives = summary["episodes"]
    arrived, touched, late = (round(summary[name] * drives) for name in RATES)
    low, high = (100.0 * summary[f"success_{end}"] for end in ("low", "high"))
    see = (
        "--out FOLDER keeps them for adrl report FOLDER"
        if options.out is None
        else shlex.join(["adrl", "report", str(options.out)]) + " shows them, failures first"
    )
    return (
        f"of {drives} drives {arrived} arrived, {touched} touched something, {late} ran out of time; of all such "
        f"drives {low:.1f} to {high:.1f} % arrive (95 % confidence). {see}"
    )


def again(robots: Columns, options: EvaluateOptions) -> str:
    """A command for the worst robot of a family."""
    worst = int(robots["robot"][worst_first(robots)[0]])
    place = {option.name for option in fields(Place)}
    words = ["adrl", "evaluate", "--policy", options.policy]
    words += ["--robot", f"{options.robot}:{options.split}:{worst}"]
    words += as_words(options, place | {"guidance", "split", "seed"})
    return shlex.join(words)


def _own_task(options: EvaluateOptions) -> list[Task] | None:
    if options.start is None and options.goal is None:
        return None
    if options.start is None or options.goal is None:
        raise ConfigError("--start and --goal go together")
    refuse(
        options,
        {"episodes", "split"},
        "chooses among drawn tasks, and --start and --goal are one of your own; leave it out",
    )
    scenario, robot = options.load(), options.driven_robot()
    place = scenario.place if isinstance(scenario, Peopled) else scenario
    if not isinstance(place, FixedWorld):
        raise ConfigError(
            f"--start and --goal need --map or --world; scenario {place.name!r} has many worlds"
        )
    task = single_task(place.world, options.start, options.goal, robot)
    return [scenario.with_people(task, robot) if isinstance(scenario, Peopled) else task]
