"""Families of robots: ranges from which robots are drawn, so that one policy learns to drive them all."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, get_type_hints
from zlib import crc32

import numpy as np

from adrl.errors import ConfigError, UnknownName, brief
from adrl.geometry import wrapped
from adrl.ranges import Range, ranges
from adrl.types import SPLITS, LidarConfig, RobotConfig
from adrl.types.robots import FULL_CIRCLE_RAD
from adrl.worlds.robot_files import known_fields

Span = tuple[float, float]
"""Least and greatest; both ends belong to it."""
TRIES = 1000
"""Robots drawn for one that is sound."""
BY_RATIO = frozenset({"max_speed_mps", "num_beams", "max_range_m"})
"""Drawn evenly by their logarithm: as many from 0.2 to 0.4 m/s as from 1 to 2. The others are drawn evenly."""
SHARE, TIME = Range(0.0, 1.0), Range(0.001, 60.0)


def _of(config: type, name: str) -> Range:
    """The domain of a robot's number."""
    return ranges(config)[name][0]


@dataclass(frozen=True, kw_only=True)
class LidarFamily:
    """Ranges of a planar LiDAR's numbers, [lidar] of a family."""

    num_beams: Annotated[Span, _of(LidarConfig, "num_beams")] = (60, 1440)
    """Beams a scan, whole numbers; as many are drawn from 60 to 120 as from 600 to 1200."""
    full_circle_share: Annotated[float, SHARE] = 0.4
    """Share of LiDARs that see all around, where fov_rad goes up to a full circle; the others are drawn from it."""
    fov_rad: Annotated[Span, _of(LidarConfig, "fov_rad")] = (0.5 * math.pi, 2.0 * math.pi)
    """Field of view: 90 to 360 degrees."""
    max_range_m: Annotated[Span, _of(LidarConfig, "max_range_m")] = (3.0, 30.0)
    """As many are drawn from 3 to 6 m as from 15 to 30 m."""
    noise_std_m: Annotated[Span, _of(LidarConfig, "noise_std_m")] = (0.0, 0.03)
    dropout_probability: Annotated[Span, _of(LidarConfig, "dropout_probability")] = (0.0, 0.02)
    mount_x_share: Annotated[Span, Range(-1.0, 1.0)] = (-0.9, 0.9)
    """Where on the body the sensor is: -1 its rear edge, 0 the middle, 1 its front edge."""
    mount_y_share: Annotated[Span, Range(-1.0, 1.0)] = (-0.9, 0.9)
    """The same across: -1 the right edge, 1 the left one. A disc's rim is nearer there; the sensor is on the disc."""
    mount_yaw_rad: Annotated[Span, _of(LidarConfig, "mount_yaw_rad")] = (-0.8, 0.8)
    """How far it is turned to the left."""

    def __post_init__(self) -> None:
        _check(self, "lidar.")
        if any(not float(end).is_integer() for end in self.num_beams):
            raise ConfigError(f"lidar.num_beams is {list(self.num_beams)}; give whole numbers")


@dataclass(frozen=True, kw_only=True)
class RobotFamily:
    """Ranges of robots. A single number in place of a range stands for itself."""

    name: str = "any"
    disc_share: Annotated[float, SHARE] = 0.5
    """Share of discs; the others are rectangles."""
    radius_m: Annotated[Span, _of(RobotConfig, "radius_m")] = (0.1, 0.5)
    """Of the discs."""
    length_m: Annotated[Span, Range(0.02, 10.0)] = (0.2, 1.0)
    """Of the rectangles, along x."""
    width_m: Annotated[Span, Range(0.02, 10.0)] = (0.2, 0.7)
    """Of the rectangles, along y; they are symmetric about the x axis."""
    origin_share: Annotated[Span, Range(-1.0, 1.0)] = (-0.8, 0.8)
    """Where a rectangle's origin is, about which it turns: -1 its rear edge, 0 the middle, 1 its front edge."""
    max_speed_mps: Annotated[Span, _of(RobotConfig, "max_speed_mps")] = (0.2, 2.0)
    """As many are drawn from 0.2 to 0.4 m/s as from 1 to 2 m/s."""
    forward_only_share: Annotated[float, SHARE] = 0.5
    """Share of robots that drive forward only; the others drive both ways."""
    reverse_share: Annotated[Span, Range(0.01, 1.0)] = (0.2, 1.0)
    """Greatest backward speed of those, as a share of the forward one."""
    max_yaw_rate_radps: Annotated[Span, _of(RobotConfig, "max_yaw_rate_radps")] = (0.5, 3.0)
    braking_s: Annotated[Span, TIME] = (0.05, 1.2)
    """Time from full speed to standing: max_speed_mps / max_acceleration_mps2. Lag and latency come on top."""
    yaw_braking_s: Annotated[Span, TIME] = (0.05, 1.2)
    """The same of the yaw rate: max_yaw_rate_radps / max_yaw_acceleration_radps2."""
    lag_s: Annotated[Span, _of(RobotConfig, "lag_s")] = (0.0, 0.3)
    latency_s: Annotated[Span, _of(RobotConfig, "latency_s")] = (0.0, 0.2)
    """At most 7 control periods of the same robot."""
    odometry_drift: Annotated[Span, _of(RobotConfig, "odometry_drift")] = (0.0, 0.0)
    """None: after 20 m at 3 % nobody who drives by odometry alone finds the goal, and success would measure that."""
    control_period_s: Annotated[Span, _of(RobotConfig, "control_period_s")] = (0.05, 0.2)
    """5 to 20 Hz."""
    car_share: Annotated[float, SHARE] = 0.2
    """Share of rectangles that steer like a car, and drive both ways; the others turn on the spot."""
    min_turning_radius_m: Annotated[Span, _of(RobotConfig, "min_turning_radius_m")] = (0.5, 1.5)
    """Of those."""
    lidar: LidarFamily = field(default_factory=LidarFamily)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ConfigError(f"name is {self.name!r}; give a text")
        _check(self, "")

    def draw(self, split: str, index: int) -> RobotConfig:
        """Robot `index` of a split, called NAME:SPLIT:INDEX: the same for ever.

        Splits are disjoint: each robot has a random stream of its own, keyed by the family's name, split and index. A
        robot that is unsound (see `unsound`) is drawn anew. Raises UnknownName for a split that is not in SPLITS,
        ConfigError for a negative number and where none of many robots is sound.
        """
        if split not in SPLITS:
            raise UnknownName("split", split, SPLITS)
        if index < 0:
            raise ConfigError(f"robot {index} of family {self.name}; give 0 or more")
        entropy, reason = crc32(self.name.encode()), ""
        for attempt in range(TRIES):
            seed = np.random.SeedSequence(entropy, spawn_key=(SPLITS.index(split), index, attempt))
            try:
                robot = self._drawn(seed, f"{self.name}:{split}:{index}")
                reason = unsound(robot)
            except ConfigError as error:  # a latency of more than 7 periods
                reason = str(error)
            else:
                if reason is None:
                    return robot
        raise ConfigError(
            f"none of {TRIES} robots drawn from family {self.name} can drive; the last one: {reason}"
        )

    def outside(self, robot: RobotConfig) -> tuple[str, ...]:
        """What of a robot the family does not have, a line each with field, number and range; () where it covers it."""
        lines = [
            f"{name} {_text(value)}{f': {what}' if what else ''}; the family has {_text(low)} to {_text(high)}"
            for name, value, what, (low, high) in self._measures(robot)
            if not low - 1e-6 * abs(low) <= value <= high + 1e-6 * abs(high)
        ]
        lines += [line for line, holds in self._kinds(robot).items() if holds]
        reason = unsound(robot)
        return (*lines, *([] if reason is None else [reason]))

    def _kinds(self, robot: RobotConfig) -> dict[str, bool]:
        """What kinds of robots the family does not have, and whether this is one of them."""
        disc, reverse, radius = robot.radius_m is not None, robot.min_speed_mps, robot.min_turning_radius_m
        back, curve = f"min_speed_mps {_text(reverse)}", f"min_turning_radius_m {_text(radius)}"
        cars = self.car_share > 0.0 and self.disc_share < 1.0
        return {
            f"radius_m {_text(robot.radius_m or 0.0)}; the family has rectangles only": disc
            and self.disc_share == 0.0,
            "footprint_m; the family has discs only": not disc and self.disc_share == 1.0,
            f"{back}; the family drives both ways": reverse == 0.0 and self.forward_only_share == 0.0,
            f"{back}; the family drives forward only": reverse < 0.0
            and self.forward_only_share == 1.0
            and not robot.is_car,
            f"{curve}; the family turns on the spot": robot.is_car and not cars,
            f"{curve}; the family's cars are rectangles": robot.is_car and cars and disc,
            f"{back}; the family's cars drive both ways": robot.is_car and cars and reverse == 0.0,
            f"{curve}; the family's rectangles are cars": not (robot.is_car or disc)
            and self.car_share == 1.0,
        }

    def _drawn(self, seed: np.random.SeedSequence, name: str) -> RobotConfig:
        """One robot, sound or not. Raises ConfigError."""
        of_robot, of_lidar = seed.spawn(2)
        at, draw = _Draws(self, of_robot), _Draws(self.lidar, of_lidar)
        body: dict[str, Any]
        if at("disc_share") < self.disc_share:
            radius = at("radius_m")
            body = {"radius_m": radius}
            middle, half = 0.0, (radius, radius)
        else:
            half = (0.5 * at("length_m"), 0.5 * at("width_m"))
            middle = -half[0] * at("origin_share")
            corners = [(middle + x * half[0], y * half[1]) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
            body = {"radius_m": None, "footprint_m": tuple(corners)}
        speed, turn = at("max_speed_mps"), at("max_yaw_rate_radps")
        is_car = body["radius_m"] is None and at("car_share") < self.car_share
        both_ways = is_car or at("forward_only_share") >= self.forward_only_share
        fov = draw("fov_rad")
        if (
            draw("full_circle_share") < self.lidar.full_circle_share
            and self.lidar.fov_rad[1] > FULL_CIRCLE_RAD - 1e-3
        ):
            fov = 2.0 * math.pi
        return RobotConfig(
            name=name,
            **body,
            max_speed_mps=speed,
            min_speed_mps=-speed * at("reverse_share") if both_ways else 0.0,
            max_yaw_rate_radps=turn,
            min_turning_radius_m=at("min_turning_radius_m") if is_car else 0.0,
            max_acceleration_mps2=speed / at("braking_s"),
            max_yaw_acceleration_radps2=turn / at("yaw_braking_s"),
            lag_s=at("lag_s"),
            latency_s=at("latency_s"),
            odometry_drift=at("odometry_drift"),
            control_period_s=at("control_period_s"),
            lidar=LidarConfig(
                num_beams=round(draw("num_beams")),
                fov_rad=fov,
                max_range_m=draw("max_range_m"),
                noise_std_m=draw("noise_std_m"),
                dropout_probability=draw("dropout_probability"),
                mount_x_m=middle + half[0] * draw("mount_x_share"),
                mount_y_m=half[1] * draw("mount_y_share"),
                mount_yaw_rad=draw("mount_yaw_rad"),
            ),
        )

    def _measures(self, robot: RobotConfig) -> Iterator[tuple[str, float, str, Span]]:
        """Field of the robot, its number, what that is where the field does not say, and the family's range of it."""
        lidar, ours = robot.lidar, self.lidar
        if robot.radius_m is not None:
            middle, half = (0.0, 0.0), (robot.radius_m, robot.radius_m)
            yield "radius_m", robot.radius_m, "", self.radius_m
        else:
            low, high = robot.polygon.min(axis=0), robot.polygon.max(axis=0)
            middle, half = tuple((0.5 * (low + high)).tolist()), tuple((0.5 * (high - low)).tolist())
            yield "footprint_m", 2.0 * half[0], "its length in m", self.length_m
            yield "footprint_m", 2.0 * half[1], "its width in m", self.width_m
            yield (
                "footprint_m",
                -middle[0] / half[0],
                "the origin, of the way from its middle to its front",
                self.origin_share,
            )
            yield (
                "footprint_m",
                middle[1] / half[1],
                "its middle to the left of the origin, of half its width",
                (-0.05, 0.05),
            )
        yield "max_speed_mps", robot.max_speed_mps, "", self.max_speed_mps
        if robot.min_speed_mps < 0.0:
            share = -robot.min_speed_mps / robot.max_speed_mps
            yield "min_speed_mps", share, "backward speed, as a share of the forward one", self.reverse_share
        if robot.is_car and self.car_share > 0.0:
            yield "min_turning_radius_m", robot.min_turning_radius_m, "", self.min_turning_radius_m
        yield "max_yaw_rate_radps", robot.max_yaw_rate_radps, "", self.max_yaw_rate_radps
        stop_s = robot.max_speed_mps / robot.max_acceleration_mps2
        yield "max_acceleration_mps2", stop_s, "seconds from full speed to standing", self.braking_s
        turn_s = robot.max_yaw_rate_radps / robot.max_yaw_acceleration_radps2
        yield (
            "max_yaw_acceleration_radps2",
            turn_s,
            "seconds from the full yaw rate to none",
            self.yaw_braking_s,
        )
        for name in ("lag_s", "latency_s", "control_period_s"):  # no policy is told how its odometry drifts
            yield name, getattr(robot, name), "", getattr(self, name)
        for name in ("num_beams", "fov_rad", "max_range_m", "noise_std_m", "dropout_probability"):
            yield f"lidar.{name}", getattr(lidar, name), "", getattr(ours, name)
        if lidar.fov_rad < FULL_CIRCLE_RAD - 1e-3:  # how a full circle is turned makes no difference
            yield "lidar.mount_yaw_rad", float(wrapped(np.array(lidar.mount_yaw_rad))), "", ours.mount_yaw_rad


def unsound(robot: RobotConfig) -> str | None:
    """Why a robot cannot see what it would hit, or None.

    Its LiDAR has to be on its body, and to see the whole width of what lies straight ahead where the robot comes to
    stand when it stops from full speed, a scan late. Backward it may be blind: many robots are.
    """
    lidar, at = robot.lidar, np.array([robot.lidar.mount_x_m, robot.lidar.mount_y_m])
    if not robot.covers(at):
        return f"lidar.mount_x_m {_text(at[0])}, mount_y_m {_text(at[1])}: the LiDAR is not on the body"
    corners = robot.polygon
    radius = robot.radius_m or 0.0
    front = float(corners[:, 0].max()) if len(corners) else radius
    sides = (corners[:, 1].min(), corners[:, 1].max()) if len(corners) else (-radius, radius)
    stop_m = robot.stop_distance_m + robot.max_speed_mps * robot.control_period_s
    ahead = np.array([(front + stop_m, side) for side in sides]) - at
    if float(np.hypot(*ahead.T).max()) > lidar.max_range_m:
        return f"lidar.max_range_m {_text(lidar.max_range_m)}: its stop takes {stop_m:.2f} m, which it cannot see"
    away = np.abs(wrapped(np.arctan2(ahead[:, 1], ahead[:, 0]) - lidar.mount_yaw_rad))
    if float(away.max()) > 0.5 * lidar.fov_rad + 1e-6:
        view = f"lidar.fov_rad {_text(lidar.fov_rad)}, mount_yaw_rad {_text(lidar.mount_yaw_rad)}"
        return f"{view}: it does not see its whole width {stop_m:.2f} m ahead, where it comes to stand"
    return None


def family_from_fields(table: Mapping[str, Any]) -> RobotFamily:
    """A family from its fields as TOML or JSON give them; what is left out is as in family any.

    Raises ConfigError naming the wrong field.
    """
    fields = dict(known_fields(dict(table), RobotFamily, ""))
    if "lidar" in fields:
        fields["lidar"] = LidarFamily(**known_fields(fields["lidar"], LidarFamily, "lidar."))
    return RobotFamily(**fields)


def family_from_table(table: Mapping[str, Any]) -> RobotFamily:
    """A family from its file: name, and the table [family]. Raises ConfigError naming the wrong key, and where
    no robot of it is sound.
    """
    beside = [key for key in table if key not in ("name", "family")]
    if beside:
        raise ConfigError(
            f"{brief(beside[0])!r} is beside [family]; what holds for a family's robots stands in it"
        )
    known_fields(table["family"], RobotFamily, "family.")
    family = family_from_fields({"name": table["name"]} | table["family"])
    family.draw(SPLITS[0], 0)  # or there is none to draw
    return family


class _Draws:
    """Numbers of one robot: each field of the family has its own, in the order in which they are declared."""

    def __init__(self, family: Any, seed: np.random.SeedSequence) -> None:
        names = [name for name, _ in _domains(type(family))]
        self._family = family
        # A field that comes later stands last, so that robots of before stay as they are.
        self._shares = dict(zip(names, np.random.default_rng(seed).random(len(names)).tolist(), strict=True))

    def __call__(self, name: str) -> float:
        """Within the field's range; for one that is a share itself, evenly from 0 to 1."""
        span, share = getattr(self._family, name), self._shares[name]
        if not isinstance(span, tuple):
            return share
        low, high = span
        if name in BY_RATIO:
            return min(max(low * (high / low) ** share, low), high)
        return low + (high - low) * share


@cache
def _domains(kind: type) -> list[tuple[str, Range]]:
    """Numbers of a family, in order, with the domain of each."""
    hints = get_type_hints(kind, include_extras=True)
    names = [f.name for f in dataclasses.fields(kind) if hasattr(hints[f.name], "__metadata__")]
    return [(name, hints[name].__metadata__[0]) for name in names]


def _check(config: Any, prefix: str) -> None:
    """Each range as a pair of floats, within its domain. Raises ConfigError."""
    for name, domain in _domains(type(config)):
        given, default = (
            getattr(config, name),
            next(f.default for f in dataclasses.fields(config) if f.name == name),
        )
        many = isinstance(default, tuple)
        ends = tuple(given) if many and isinstance(given, list | tuple) else (given,)
        forms = "a number, or [low, high]" if many else "a number"
        whole = f"{prefix}{name} is {_shown(given)}"
        if len(ends) not in (1, 2) or (len(ends) == 1 and isinstance(given, list | tuple)):
            raise ConfigError(f"{whole}; give {forms}")
        if any(isinstance(end, bool) or not isinstance(end, int | float) for end in ends):
            raise ConfigError(f"{whole}; give {forms}")
        if any(not domain.low <= end <= domain.high for end in ends):
            raise ConfigError(f"{whole}; give {forms}, each from {domain}")
        if ends[0] > ends[-1]:
            raise ConfigError(f"{whole}: its ends are crossed; give [low, high]")
        ends = (float(ends[0]), float(ends[-1]))
        object.__setattr__(config, name, ends if many else ends[0])


def _shown(value: Any) -> str:
    return str(list(value) if isinstance(value, tuple) else value)[:60]


def _text(value: float) -> str:
    return f"{value:.4g}"
