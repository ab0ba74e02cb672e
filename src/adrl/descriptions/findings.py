"""What the places of several sources say of a robot's fields, and what they come to together."""

import math
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import IntEnum
from typing import Any

import numpy as np

from adrl.errors import ConfigError, brief
from adrl.ranges import ranges
from adrl.types import LidarConfig, RobotConfig, outline

SHAPE = ("radius_m", "footprint_m")
"""A robot has one of them."""
NEEDED = (
    *("max_speed_mps", "min_speed_mps", "max_yaw_rate_radps", "max_acceleration_mps2"),
    *("max_yaw_acceleration_radps2", "control_period_s", "lidar.num_beams", "lidar.fov_rad"),
    *("lidar.max_range_m", "lidar.mount_x_m", "lidar.mount_y_m", "lidar.mount_yaw_rad"),
)
"""And all of these."""
TURNING_RADIUS = "min_turning_radius_m"
"""Of a car-like robot, and only such are asked for it; others turn on the spot."""
ASSUMED = ("lag_s", "latency_s", "odometry_drift", "lidar.noise_std_m", "lidar.dropout_probability")
"""Hardly any source says them: their defaults hold, and it is said that they do."""
TOPICS = (
    *("scan_topic", "odom_topic", "odom_frame", "map_frame", "base_frame", "stamped", "ros"),
    "sensor_yaw_rad",
)
"""No fields of a robot, but what the command that drives it needs."""
CAR = "car"
"""No field of a robot either: what says that it is car-like."""
UNITS = {
    "radps2": "rad/s^2",
    "radps": "rad/s",
    "mps2": "m/s^2",
    "mps": "m/s",
    "rad": "rad",
    "m": "m",
    "s": "s",
}

OMNI = (
    "an omni-directional robot, and ADRL never moves sideways; to have it driven as a differential one, set its y "
    "speeds to 0 and its motion models to differential ones"
)
"""Why a robot is refused; goes on from "that is"."""

SAME = {"lidar.mount_x_m": 0.02, "lidar.mount_y_m": 0.02, "lidar.mount_yaw_rad": 0.02, "lidar.fov_rad": 0.02}
"""m, rad by which two sources may differ;"""
SAME_SHARE = {"control_period_s": 0.1}
"""of other fields the share,"""
SAME_SHARE_ELSE = 0.01
SAME_CORNERS_M = 0.005
AHEAD_RAD = 1e-3
OVERSHOOT = (1.1, 0.02)
"""What was seen may exceed what is said by this factor and so much."""


class Standing(IntEnum):
    """How much a finding counts, the first most."""

    GIVEN = 0
    """By the user: nothing contradicts it."""
    SAID = 1
    """It is so. Two that differ contradict each other."""
    LIMIT = 2
    """It is no more: the tightest of all holds."""
    SEEN = 3
    """It was at least so: more than what is said contradicts that."""
    HINT = 4
    """It may be so, and contradicts nothing."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What one place says of a field."""

    field: str
    """Of RobotConfig, "lidar." before one of LidarConfig, or of TOPICS."""
    value: Any
    place: str
    """The file and where in it."""
    standing: Standing = Standing.SAID

    @property
    def told(self) -> str:
        """For people."""
        return f"{self.field} is {shown(self.value)} ({self.place})"

    @property
    def option(self) -> str:
        """What makes it the one that holds."""
        return "--set " + shlex.quote(f"{self.field}={shown(self.value).replace(' ', '')}")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What a source says."""

    findings: list[Finding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What was passed over, and why, for people."""

    def add(self, name: str, value: Any, place: str, standing: Standing = Standing.SAID) -> None:
        """Nine digits are kept: what is beyond them is of arithmetic."""
        if isinstance(value, float):
            value = round(value, 9) + 0.0
        self.findings.append(Finding(field=name, value=value, place=place, standing=standing))


@dataclass(frozen=True, kw_only=True)
class Settled:
    """What the findings come to."""

    chosen: Mapping[str, Finding]
    """Field -> the finding that holds."""
    faults: tuple[str, ...]
    """Contradictions, and values that no robot has: a line each that says what to give."""
    missing: tuple[str, ...]
    """Fields that no source says; "radius_m" stands for either shape."""


def settle(findings: Iterable[Finding]) -> Settled:
    """What holds of all fields. Earlier findings count before later ones of the same standing."""
    by_field: dict[str, list[Finding]] = {}
    findings = list(findings)
    is_car = any(finding.field == CAR for finding in findings)
    for finding in findings:
        if finding.field == TURNING_RADIUS and finding.standing is Standing.HINT and not is_car:
            continue  # planners have one for robots that turn on the spot, too
        name = SHAPE[0] if finding.field in SHAPE else finding.field
        by_field.setdefault(name, []).append(finding)
    chosen: dict[str, Finding] = {}
    faults = []
    for name, found in by_field.items():
        best, wrong = _best(name, sorted(found, key=lambda finding: finding.standing))
        faults += wrong
        if not wrong:
            chosen[best.field] = best
    needed = (SHAPE[0], *NEEDED, *((TURNING_RADIUS,) if CAR in by_field else ()))
    missing = [name for name in needed if name not in by_field]
    return Settled(chosen=chosen, faults=tuple(faults), missing=tuple(missing))


def _best(name: str, found: list[Finding]) -> tuple[Finding, list[str]]:
    """Of findings of one field, ordered by standing, the one that holds, and what is wrong."""
    best = found[0]
    if best.standing is Standing.GIVEN or name in TOPICS[1:] or name == CAR:
        return best, []
    said = [finding for finding in found if finding.standing is Standing.SAID]
    if wrong := [line for finding in found for line in _shape_faults(finding)]:
        return best, wrong
    other = next((finding for finding in said[1:] if not _agree(said[0], finding)), None)
    if other is not None:
        return best, [_contradiction(said[0], other)]
    best = _tightest(best, [finding for finding in found if finding.standing is Standing.LIMIT])
    seen = [finding for finding in found if finding.standing is Standing.SEEN]
    if best.standing is Standing.SEEN:
        best = max(seen, key=lambda finding: abs(finding.value))
    elif beyond := next((s for s in seen if _beyond(s, best)), None):
        return best, [_contradiction(best, beyond)]
    fault = None if name in TOPICS else value_fault(best.field, best.value)
    return best, [f"{best.told}; {fault}: --set {best.field}={example(best.field)}"] if fault else []


def _tightest(best: Finding, limits: list[Finding]) -> Finding:
    if not limits:
        return best
    least = min(limits, key=lambda finding: abs(finding.value))
    if best.standing is Standing.LIMIT:
        return least
    if best.standing > Standing.LIMIT or abs(least.value) >= abs(best.value):
        return best
    place = f"{least.place}, within {shown(best.value)} of {best.place}"
    return Finding(field=best.field, value=least.value, place=place)


def _beyond(seen: Finding, best: Finding) -> bool:
    factor, more = OVERSHOOT
    return abs(seen.value) > factor * abs(best.value) + more


def _contradiction(one: Finding, other: Finding) -> str:
    if one.field == "scan_topic":
        choices = f"--scan-topic {one.value}, or --scan-topic {other.value}"
    else:
        choices = f"{one.option}, or {other.option}"
    return f"{one.told} and {other.told}; say which: {choices}"


def _agree(one: Finding, other: Finding) -> bool:
    if one.field != other.field:
        return False
    a, b = one.value, other.value
    if one.field == "footprint_m":
        return _same_outline(a, b)
    if isinstance(a, str) or isinstance(b, str):
        return bool(a == b)
    apart = float(abs(a - b))
    if one.field == "lidar.mount_yaw_rad":
        apart = abs(math.remainder(a - b, 2.0 * math.pi))
    share = SAME_SHARE.get(one.field, SAME_SHARE_ELSE)
    return apart <= SAME.get(one.field, share * float(max(abs(a), abs(b))))


def _same_outline(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]]) -> bool:
    """Whether they have the same corners, whichever way round and whichever first."""
    one, other = outline(np.array(a, dtype=float)), outline(np.array(b, dtype=float))
    if len(one) != len(other):
        return False
    turned = [np.roll(other, k, axis=0) for k in range(len(other))]
    return any(bool((np.abs(one - each) <= SAME_CORNERS_M).all()) for each in turned)


def _shape_faults(finding: Finding) -> list[str]:
    if finding.field != "footprint_m":
        return []
    fault = value_fault("footprint_m", finding.value)
    return [f"{finding.told} {fault}: --set footprint_m={example('footprint_m')}"] if fault else []


def value_fault(name: str, value: Any) -> str | None:
    """What to do about a value that the field cannot have; None for one that it can."""
    if name == "footprint_m":
        try:
            outline(np.array(value, dtype=float).reshape(len(value), 2))
        except ConfigError as error:
            return str(error)
        except (TypeError, ValueError):
            return "give a list of corners [x, y]"
        return None
    kind = LidarConfig if name.startswith("lidar.") else RobotConfig
    span, whole, _ = ranges(kind)[name.removeprefix("lidar.")]
    number = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
    if number and span.low <= value <= span.high:
        return None
    return f"give {span}{', a whole number' if whole else ''}"


def unit(name: str) -> str:
    """Of a field, by its suffix; "" for a number without one."""
    return UNITS.get(name.rpartition("_")[2], "")


def span_text(name: str) -> str:
    """A field's range with its unit."""
    kind = LidarConfig if name.startswith("lidar.") else RobotConfig
    span, whole, _ = ranges(kind)[name.removeprefix("lidar.")]
    return f"{span} {unit(name)}".rstrip() + (", a whole number" if whole else "")


def example(name: str) -> str:
    """What stands for a value in an option."""
    return "[[X,Y],...]" if name == "footprint_m" else "NUMBER"


def shown(value: Any) -> str:
    """A value in as few digits as it has."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(shown, value))}]"
    return brief(value)


def given_fields(settings: Iterable[str]) -> list[Finding]:
    """Of NAME=VALUE, values as in TOML. Raises ConfigError for a name that is no field, and a value it cannot have."""
    found = []
    for text in settings:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise ConfigError(f"--set {brief(text)} is no NAME=VALUE, such as max_speed_mps=0.5")
        known = (*SHAPE, *NEEDED, TURNING_RADIUS, *ASSUMED)
        if name not in known:
            nearest = get_close_matches(name, known, n=1, cutoff=0.4)
            hint = f"did you mean {nearest[0]!r}? " if nearest else ""
            raise ConfigError(
                f"--set {brief(name)!r} is no field of a robot: {hint}known: {', '.join(known)}"
            )
        content: Any = None
        with suppress(ValueError, RecursionError):
            (content,) = tomllib.loads(f"value = {value}").values()
        fault = value_fault(name, content)
        if fault is not None:
            raise ConfigError(f"--set {name}={brief(value)}: {fault} {unit(name)}".rstrip())
        if isinstance(content, list):
            content = tuple(tuple(map(float, corner)) for corner in content)
        whole = name == "lidar.num_beams"
        found.append(
            Finding(
                field=name,
                value=content if whole or isinstance(content, tuple) else float(content),
                place="--set",
                standing=Standing.GIVEN,
            )
        )
    names = [SHAPE[0] if finding.field in SHAPE else finding.field for finding in found]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ConfigError(
            f"--set gives {' or '.join(SHAPE) if twice in SHAPE else twice} twice; give it once"
        )
    return found


def beams_of(reading: Reading, count: int, first: float, last: float, place: str) -> float:
    """Add beams and field of view of a scan; returns its middle in the sensor's frame.

    first, last: angles (rad) of beam 0 and of the last. A scan that goes all round has no middle of its own: 0, as for
    one that looks ahead but for a rounding.
    """
    span = abs(last - first)
    increment = span / max(count - 1, 1)
    full = 2.0 * math.pi
    all_round = count > 1 and span + 1.5 * increment > full
    if all_round:
        # Such as does not repeat its first beam is a full circle; another leaves out what its last beam repeats.
        span = full if span + 0.5 * increment < full else min(span, full - 1e-6)
    reading.add("lidar.num_beams", count, place)
    reading.add("lidar.fov_rad", span if count > 1 else full, place)
    middle = 0.5 * (first + last)
    return 0.0 if all_round or abs(middle) < AHEAD_RAD else middle
