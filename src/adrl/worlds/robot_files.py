"""Robots as TOML and JSON have them: the fields of RobotConfig, with the same names and units."""

import dataclasses
import json
import math
import re
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from adrl.errors import ConfigError, FileError, brief
from adrl.files import read_text
from adrl.types import LidarConfig, RobotConfig

MAX_BYTES = 2**16
BEYOND_FLOAT = re.compile(r"(?<![\w.])[+]?\d[\d_]{308,}(?![\w.])")
"""A number that no float holds."""


def read_toml(path: Path, known: str) -> dict[str, Any]:
    """The content of a robot's file. known: names that could be given instead. Raises ConfigError."""
    try:
        text = read_text(path, MAX_BYTES)
    except FileError as error:
        raise ConfigError(f"robot file {path} {error}; give a TOML file or one of {known}") from None
    try:
        # Python reads no integer of more than 4300 digits, and does not say where it stands.
        return tomllib.loads(BEYOND_FLOAT.sub("inf", text))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"robot file {path} is not valid TOML: {brief(error)}") from None


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
    fields = _converted(known_fields(table, RobotConfig, ""), "")
    if "lidar" in table:
        fields["lidar"] = LidarConfig(
            **_converted(known_fields(table["lidar"], LidarConfig, "lidar."), "lidar.")
        )
    return RobotConfig(**fields)


def known_fields(table: Any, config: type, prefix: str) -> dict[str, Any]:
    """The table, every key of which is a field of the dataclass. Raises ConfigError naming the key."""
    if not isinstance(table, dict):
        raise ConfigError(f"{prefix.rstrip('.')} must be a table, [{prefix.rstrip('.')}]")
    known = [field.name for field in dataclasses.fields(config)]
    for key in table:
        if key not in known:
            nearest = get_close_matches(key, known, n=1, cutoff=0.4)
            hint = f"did you mean {nearest[0]!r}? " if nearest else ""
            raise ConfigError(f"unknown key {brief(prefix + key)!r}: {hint}known: {', '.join(known)}")
    return table


def _converted(table: dict[str, Any], prefix: str) -> dict[str, Any]:
    """The table's values but the LiDAR's, each of its field's type. Raises ConfigError naming the key."""
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
    return value if key == "lidar.num_beams" else number(key, value)


def number(key: str, value: Any) -> float:
    """A number of TOML or JSON. Raises ConfigError naming the key."""
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
    return tuple((number("footprint_m", x), number("footprint_m", y)) for x, y in value)
