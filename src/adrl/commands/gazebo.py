"""adrl gazebo."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from adrl import api, files
from adrl.commands import gazebo_barn
from adrl.commands.drive_options import PolicyOptions, TasksOptions
from adrl.commands.options import Runner, load_place, parse, subcommand, write_document
from adrl.commands.progress import console, counting_bar, progress_bar
from adrl.errors import ConfigError
from adrl.evaluation.calibration import calibrate
from adrl.evaluation.drives import DriveRecorder
from adrl.evaluation.results import comparison_table, require_results_folder
from adrl.evaluation.transfer import Side, transfer_document, transfer_table
from adrl.integrations.gazebo import Gazebo
from adrl.integrations.gazebo.film import contact_sheet
from adrl.outputs import require_file, require_folder
from adrl.types import RobotConfig
from adrl.worlds import load_robot, task_set
from adrl.worlds.place import Place
from adrl.worlds.sdf_write import save_sdf

TRANSFER_FILE = "transfer.json"


@dataclass(frozen=True, kw_only=True)
class GazeboOptions(TasksOptions):
    """Which policy drives where. Worlds are flattened to their boxes, cylinders and walls."""

    num_envs: int = 8
    """Robots that Gazebo drives side by side, each in a world of its own."""


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(GazeboOptions):
    """What is kept of the drives in Gazebo."""

    drives: Path | None = None
    """CSV file for commands and what the base did, period by period: what adrl calibrate reads."""
    out: Path | None = None
    """Folder for episodes.parquet and summary.json."""
    bag: Path | None = None
    """ROS 1 bag (FILE.bag), or folder of a ROS 2 bag (MCAP), as adrl evaluate has it (extra bags)."""


@dataclass(frozen=True, kw_only=True)
class TransferOptions(GazeboOptions):
    """What is kept of the drives in both simulators."""

    out: Path | None = None
    """Folder for transfer.json, and each simulator's episodes.parquet, summary.json and drives.csv."""


@dataclass(frozen=True, kw_only=True)
class FilmOptions(PolicyOptions):
    """Which drive is filmed, and how."""

    out: Path
    """PNG file for the frames."""
    task: int = 0
    """Number of the task in the split."""
    frames: int = 6
    """Frames to show, evenly over the drive."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Place):
    """Which world."""

    out: Path
    """File for the SDF world."""
    robot: str = "diffbot"
    """The robot that a scenario draws worlds for."""
    split: Literal["train", "validation", "test"] = "test"
    """Split of the scenario's task"""
    task: int = 0
    """and its number."""


def _evaluate(arguments: Sequence[str]) -> int:
    options = parse(EvaluateOptions, arguments, "gazebo evaluate", "Drive a policy on fixed tasks in Gazebo.")
    require_results_folder("--out", options.out)
    require_file("--json", options.json)
    require_file("--drives", options.drives)
    load_place(options)
    side, result = _drive(
        options,
        "Gazebo",
        make_body=partial(Gazebo, num_envs=options.num_envs),
        bag=options.bag,
    )
    console().print(comparison_table([side.summary]))
    if options.out is not None:
        result.save(options.out)
    if options.drives is not None:
        side.drives.save(options.drives)
    write_document(options.json, side.document())
    return 0


def _transfer(arguments: Sequence[str]) -> int:
    options = parse(
        TransferOptions,
        arguments,
        "gazebo transfer",
        "Drive the same tasks in our simulator, in Gazebo, and in our simulator with the base's constants fitted to "
        "Gazebo's drives.",
    )
    require_folder("--out", options.out, TRANSFER_FILE)
    require_file("--json", options.json)
    load_place(options)
    robot = options.driven_robot()
    driven = {
        "gazebo": _drive(options, "Gazebo", robot=robot, make_body=partial(Gazebo, num_envs=options.num_envs))
    }
    fit = calibrate(driven["gazebo"][0].drives, robot)
    driven["native"] = _drive(options, "native", robot=robot)
    # The tasks are those of the robot as configured: the fitted base only drives them.
    driven["calibrated"] = _drive(options, "calibrated", robot=fit.robot, tasks_of=robot)
    document = transfer_document({name: side for name, (side, _) in driven.items()}, fit)
    console().print(transfer_table(document))
    if options.out is not None:
        for name, (side, result) in driven.items():
            result.save(options.out / name)
            side.drives.save(options.out / name / "drives.csv")
        files.write_json(options.out / TRANSFER_FILE, document)
    write_document(options.json, document)
    return 0


def _film(arguments: Sequence[str]) -> int:
    options = parse(FilmOptions, arguments, "gazebo film", "Film one task in Gazebo from above.")
    require_file("--out", options.out)
    if options.frames < 1:
        raise ConfigError(f"frames is {options.frames}; give 1 or more")
    place, robot = load_place(options), options.driven_robot()
    tasks = task_set(place, robot, options.split, 1, first=options.task)
    pictures: list[bytes] = []

    @contextmanager
    def filmed(robot: RobotConfig) -> Iterator[Gazebo]:
        with Gazebo(robot, film=tasks[0].world) as gazebo:
            yield gazebo
            pictures.extend(gazebo.frames())

    with progress_bar("filming"):
        result = api.evaluate(
            options.policy,
            scenario=place,
            robot=robot,
            guidance=options.guidance,
            tasks=tasks,
            make_body=filmed,
        )
    files.atomic_write_bytes(options.out, contact_sheet(pictures, options.frames))
    arrived = "arrived" if result.summary["success"] else "did not arrive"
    console().print(f"{arrived}; {len(pictures)} frames, a second of simulated time apart")
    print(options.out)
    return 0


def _export(arguments: Sequence[str]) -> int:
    options = parse(
        ExportOptions, arguments, "gazebo export", "Write a world that Gazebo reads, without a robot."
    )
    require_file("--out", options.out)
    task = task_set(load_place(options), load_robot(options.robot), options.split, 1, first=options.task)[0]
    save_sdf(options.out, task.world)
    x, y, yaw = task.start
    console().print(f"start {x:.3f} {y:.3f} {yaw:.3f}, goal {task.goal[0]:.3f} {task.goal[1]:.3f}")
    print(options.out)
    return 0


def _drive(
    options: EvaluateOptions | TransferOptions,
    name: str,
    *,
    robot: RobotConfig | None = None,
    tasks_of: RobotConfig | None = None,
    make_body: Callable[[RobotConfig], Any] | None = None,
    bag: Path | None = None,
) -> tuple[Side, api.Evaluation]:
    """One simulator's part, with a bar."""
    place, recorder = options.load(), DriveRecorder()
    tasks = None if tasks_of is None else task_set(place, tasks_of, options.split, options.episodes)
    with counting_bar(f"{options.policy}, {name}", "episodes") as show:
        result = api.evaluate(
            options.policy,
            scenario=place,
            robot=robot or options.robot,
            guidance=options.guidance,
            split=options.split,
            episodes=options.episodes,
            seed=options.seed,
            tasks=tasks,
            make_body=make_body,
            on_drive=recorder,
            traces=options.out is not None,
            bag=bag,
            on_step=show,
        )
    side = Side(
        summary=result.summary | {"split": options.split},
        episodes=result.rollout.episodes,
        drives=recorder.drives(),
    )
    return side, result


WHAT: dict[str, tuple[str, Runner]] = {
    "evaluate": ("drive a policy on fixed tasks in Gazebo", _evaluate),
    "transfer": ("the same tasks in our simulator and in Gazebo, and the gap between them", _transfer),
    "barn": ("the BARN benchmark as it was published, with a Jackal on four driven wheels", gazebo_barn.main),
    "film": ("one task in Gazebo, as its camera sees it", _film),
    "export": ("write a scenario's world, or a map, as a Gazebo world without a robot", _export),
}


def main(arguments: Sequence[str]) -> int:
    """Run one of WHAT."""
    return subcommand("gazebo", "Gazebo command", WHAT, arguments, " scripts/gazebo-chroot sets Gazebo up.")
