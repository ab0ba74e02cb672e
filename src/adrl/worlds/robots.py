"""The robots we know, and robots from TOML files."""

import dataclasses
import json
import math
import os
import re
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from adrl.errors import ConfigError, FileError, brief
from adrl.files import read_text
from adrl.registry import look_up
from adrl.types import LidarConfig, RobotConfig

# TurtleBot3: speeds and the LDS-01 (360 beams, 3.5 m) from ROBOTIS' specification, accelerations and the
# period from the turtlebot3_navigation DWA parameters, sensor mounts and noise from turtlebot3_description.
_LDS_01 = LidarConfig(num_beams=360, max_range_m=3.5, noise_std_m=0.01, mount_x_m=-0.032)

MAX_BYTES = 2**16
BEYOND_FLOAT = re.compile(r"(?<![\w.])[+]?\d[\d_]{308,}(?![\w.])")
"""A number that no float holds."""

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

    Raises UnknownName for a name no one knows, ConfigError for a file that is missing, malformed or out of
    domain.
    """
    if isinstance(robot, RobotConfig):
        return robot
    text = os.fspath(robot)
    if isinstance(robot, os.PathLike) or text.endswith(".toml") or os.sep in text:
        return _read_robot(Path(text))
    found = look_up("robot", text, ROBOTS)
    if not isinstance(found, RobotConfig):
        raise ConfigError(f"robot {text!r}: its entry point gives {found!r}, not a RobotConfig")
    return found


def _read_robot(path: Path) -> RobotConfig:
    try:
        text = read_text(path, MAX_BYTES)
    except FileError as error:
        raise ConfigError(
            f"robot file {path} {error}; give a TOML file or one of {', '.join(ROBOTS)}"
        ) from None
    try:
        # Python reads no integer of more than 4300 digits, and does not say where it stands.
        table = tomllib.loads(BEYOND_FLOAT.sub("inf", text))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"robot file {path} is not valid TOML: {brief(error)}") from None
    try:
        return robot_from_fields({"name": path.stem} | table)
    except ConfigError as error:
        raise ConfigError(f"robot file {path}: {error}") from None


def robot_toml(robot: RobotConfig) -> str:
    """The robot as a TOML file that load_robot reads."""
    fields = dataclasses.asdict(robot)
    lidar = fields.pop("lidar")

    def lines(table: Mapping[str, Any]) -> list[str]:
        given = {key: value for key, value in table.items() if value is not None}
        # JSON's texts, numbers and lists are TOML's.
        return [f"{key} = {json.dumps(value)}" for key, value in given.items()]

    return "\n".join([*lines(fields), "", "[lidar]", *lines(lidar)]) + "\n"


def robot_from_fields(table: Mapping[str, Any]) -> RobotConfig:
    """A robot from its fields as TOML or JSON give them. Raises ConfigError naming the wrong field."""
    table = {key: value for key, value in table.items() if value is not None}
    if "footprint_m" in table:
        table.setdefault("radius_m", None)
    fields = _checked(table, RobotConfig, "")
    if "lidar" in table:
        fields["lidar"] = LidarConfig(**_checked(table["lidar"], LidarConfig, "lidar."))
    return RobotConfig(**fields)


def _checked(table: Any, config: type, prefix: str) -> dict[str, Any]:
    """The table's values, each of its field's type. Raises ConfigError naming the key."""
    if not isinstance(table, dict):
        raise ConfigError(f"{prefix.rstrip('.')} must be a table, [{prefix.rstrip('.')}]")
    kinds = {field.name: str(field.type) for field in dataclasses.fields(config)}
    for key in table:
        if key not in kinds:
            nearest = get_close_matches(key, kinds, n=1, cutoff=0.4)
            hint = f"did you mean {nearest[0]!r}? " if nearest else ""
            raise ConfigError(f"unknown key {brief(prefix + key)!r}: {hint}known: {', '.join(kinds)}")
    return {key: _convert(prefix + key, value) for key, value in table.items() if key != "lidar"}


def _convert(key: str, value: Any) -> Any:
    """One TOML value as its field wants it, told by the field's name."""
    if key == "name":
        if not isinstance(value, str) or not value:
            raise ConfigError(f"name is {value!r}; give a text")
        return value
    if key == "radius_m" and value is None:
        return None
    if key == "footprint_m":
        return _corners(value)
    return value if key == "lidar.num_beams" else _number(key, value)


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{key} is {str(value)[:40]!r}; give a number")
    try:
        return float(value)
    except OverflowError:
        return math.copysign(math.inf, value)


def _corners(value: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list | tuple) or not all(
        isinstance(p, list | tuple) and len(p) == 2 for p in value
    ):
        raise ConfigError("footprint_m must be a list of corners [x, y] in metres")
    return tuple((_number("footprint_m", x), _number("footprint_m", y)) for x, y in value)
