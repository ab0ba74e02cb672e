"""adrl calibrate."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from adrl import files
from adrl.bags.reader import COMMAND_TOPIC, ODOMETRY_TOPIC
from adrl.commands.options import parse
from adrl.commands.progress import console
from adrl.evaluation.calibration import calibrate
from adrl.evaluation.drive_bags import read_bag
from adrl.evaluation.drives import read_drives
from adrl.outputs import require_file
from adrl.worlds.robot_files import robot_toml
from adrl.worlds.robots import load_robot


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """What was driven, and by which robot."""

    drives: Annotated[Path, tyro.conf.Positional]
    """A ROS 1 or ROS 2 bag (extra bags), or a CSV file with the columns drive, time_s, command_mps, command_radps,
    speed_mps, yaw_rate_radps: a row a control period, with the command given in it and the speeds at its end."""
    robot: str = "diffbot"
    """The robot that drove: a name (adrl list) or a TOML file. Its constants are where the search begins."""
    command_topic: str = COMMAND_TOPIC
    """Topic of a bag's commands, Twist or TwistStamped."""
    odometry_topic: str = ODOMETRY_TOPIC
    """Topic of a bag's odometry."""
    out: Path | None = None
    """TOML file for the robot with the fitted constants, which every --robot takes."""


def main(arguments: Sequence[str]) -> int:
    """Fit, print, and write the robot."""
    options = parse(
        CalibrateOptions,
        arguments,
        "calibrate",
        "Fit lag, acceleration and latency of our simulator's base to drives recorded elsewhere.",
    )
    require_file("--out", options.out)
    robot = load_robot(options.robot)
    if options.drives.suffix == ".csv":
        drives = read_drives(options.drives)
    else:
        topics = (options.command_topic, options.odometry_topic)
        drives = read_bag(options.drives, robot.control_period_s, *topics)
    for note in drives.notes:
        console().print(f"{options.drives}: {note}")
    fit = calibrate(drives, robot)
    print(files.to_json(fit.summary()))
    if options.out is not None:
        files.atomic_write_text(options.out, robot_toml(fit.robot))
        console().print(f"the fitted robot: {options.out}")
    return 0
