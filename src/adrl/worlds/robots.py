"""The robots we know, and robots from TOML files."""

import dataclasses
import math
import os
import re
from pathlib import Path

from adrl.errors import ConfigError
from adrl.registry import look_up
from adrl.types import SPLITS, LidarConfig, RobotConfig
from adrl.worlds.families import RobotFamily, family_from_table
from adrl.worlds.robot_files import read_toml, robot_from_fields

# TurtleBot3: speeds and the LDS-01 (360 beams, 3.5 m) from ROBOTIS' specification, accelerations and the
# period from the turtlebot3_navigation DWA parameters, sensor mounts and noise from turtlebot3_description.
_LDS_01 = LidarConfig(num_beams=360, max_range_m=3.5, noise_std_m=0.01, mount_x_m=-0.032)

DRAWN = re.compile(rf"(.+):({'|'.join(SPLITS)}):(\d+)")
"""A robot of a family: FAMILY:SPLIT:NUMBER."""

ROBOTS: dict[str, RobotConfig] = {
    "diffbot": RobotConfig(),
    "turtlebot3_burger": RobotConfig(
        name="turtlebot3_burger",
        radius_m=0.105,
        max_speed_mps=0.22,
        max_yaw_rate_radps=2.84,
        max_acceleration_mps2=2.5,
        max_yaw_acceleration_radps2=3.2,
        lidar=_LDS_01,
    ),
    # A disc about the wheel axis that holds the whole 281 x 306 mm base, as Nav2's parameters for it use.
    "turtlebot3_waffle": RobotConfig(
        name="turtlebot3_waffle",
        radius_m=0.22,
        max_speed_mps=0.26,
        max_yaw_rate_radps=1.82,
        max_acceleration_mps2=2.5,
        max_yaw_acceleration_radps2=3.2,
        lidar=dataclasses.replace(_LDS_01, mount_x_m=-0.064),
    ),
    # Clearpath Jackal: 508 x 430 mm and 2.0 m/s from its data sheet. Its wheel controller takes 4.0 rad/s, 20
    # m/s^2 and 25 rad/s^2 (jackal_control), which the tyres do not deliver: 2.0 rad/s is what
    # jackal_navigation plans with, and the accelerations are ours, well inside what a skid-steered 17 kg base
    # does without slipping. The LiDAR is jackal_description's Hokuyo UST-10LX, which the BARN benchmark uses
    # too.
    "jackal": RobotConfig(
        name="jackal",
        radius_m=None,
        footprint_m=((0.254, 0.215), (-0.254, 0.215), (-0.254, -0.215), (0.254, -0.215)),
        max_speed_mps=2.0,
        max_yaw_rate_radps=2.0,
        max_acceleration_mps2=3.0,
        max_yaw_acceleration_radps2=6.0,
        lidar=LidarConfig(
            num_beams=720, fov_rad=1.5 * math.pi, max_range_m=30.0, noise_std_m=0.01, mount_x_m=0.12
        ),
    ),
}

# As the DynaBARN benchmark drives it.
ROBOTS["jackal_dynabarn"] = dataclasses.replace(ROBOTS["jackal"], name="jackal_dynabarn", max_speed_mps=0.5)

FAMILIES: dict[str, RobotFamily] = {"any": RobotFamily()}


def load_robot(robot: str | os.PathLike[str] | RobotConfig) -> RobotConfig:
    """A robot by name (ROBOTS, or an entry point of group "adrl.robots"), from a TOML file, or itself.

    Text that ends in ".toml" or holds a path separator is a file. It has the fields of RobotConfig with the
    same names and units, and a table [lidar] with those of LidarConfig; what it leaves out keeps its default,
    except that footprint_m takes the place of radius_m and name is the file's stem:

        name = "carrier"
        footprint_m = [[0.4, 0.25], [-0.4, 0.25], [-0.4, -0.25], [0.4, -0.25]]
        max_speed_mps = 1.2

        [lidar]
        num_beams = 270
        fov_rad = 4.712

    FAMILY:SPLIT:NUMBER, as any:test:17, is that robot of a family. Raises UnknownName for a name no one knows,
    ConfigError for a file that is missing, malformed or out of domain, and for a family.
    """
    found = load_robots(robot)
    if isinstance(found, RobotFamily):
        raise ConfigError(
            f"robot {os.fspath(robot)!r} is a family of robots, and this takes one: give one of it, such as "  # pyright: ignore
            f"{os.fspath(robot)}:test:0"  # pyright: ignore
        )
    return found


def load_robots(robot: str | os.PathLike[str] | RobotConfig | RobotFamily) -> RobotConfig | RobotFamily:
    """A robot as load_robot takes it, or a family: by name (FAMILIES, or an entry point of group "adrl.robots"), from
    a TOML file, or itself.

    A file with a table [family] is a family: a number there is fixed, [low, high] is a range. What it leaves out is as
    in family any, and name is the file's stem:

        [family]
        radius_m = [0.15, 0.3]
        disc_share = 1.0
        max_speed_mps = 0.8

        [family.lidar]
        num_beams = [180, 720]

    Raises UnknownName and ConfigError.
    """
    if isinstance(robot, RobotConfig | RobotFamily):
        return robot
    text = os.fspath(robot)
    drawn = DRAWN.fullmatch(text)
    if drawn is not None:
        return _family(drawn[1]).draw(drawn[2], int(drawn[3]))
    if isinstance(robot, os.PathLike) or text.endswith(".toml") or os.sep in text:
        return _read(Path(text))
    found = look_up("robot", text, ROBOTS | FAMILIES)
    if not isinstance(found, RobotConfig | RobotFamily):
        raise ConfigError(
            f"robot {text!r}: its entry point gives {found!r}, not a RobotConfig or RobotFamily"
        )
    return found


def _family(text: str) -> RobotFamily:
    """Raises UnknownName, ConfigError."""
    found = load_robots(text)
    if not isinstance(found, RobotFamily):
        raise ConfigError(
            f"robot {text!r} is one robot, no family to draw from; leave out what follows its name"
        )
    return found


def _read(path: Path) -> RobotConfig | RobotFamily:
    table = {"name": path.stem} | read_toml(path, ", ".join((*ROBOTS, *FAMILIES)))
    try:
        if "family" not in table:
            return robot_from_fields(table)
        return family_from_table(table)
    except ConfigError as error:
        raise ConfigError(f"robot file {path}: {error}") from None
