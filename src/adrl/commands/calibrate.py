"""adrl calibrate."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from adrl import files
from adrl.commands.options import console, parse, require_file
from adrl.evaluation.calibration import calibrate
from adrl.evaluation.drives import read_drives
from adrl.worlds.robots import load_robot, robot_toml


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """What was driven, and by which robot."""

    drives: Annotated[Path, tyro.conf.Positional]
    """CSV file with the columns drive, time_s, command_mps, command_radps, speed_mps, yaw_rate_radps: a row a control
    period, with the command given in it and the speeds at its end."""
    robot: str = "diffbot"
    """The robot that drove: a name (adrl list) or a TOML file. Its constants are where the search begins."""
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
    fit = calibrate(read_drives(options.drives), load_robot(options.robot))
    print(files.to_json(fit.summary()))
    if options.out is not None:
        files.atomic_write_text(options.out, robot_toml(fit.robot))
        console().print(f"the fitted robot: {options.out}")
    return 0
