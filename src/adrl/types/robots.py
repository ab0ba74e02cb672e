"""Robots and their LiDARs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError
from adrl.geometry import Array, Pose, lies_within
from adrl.ranges import Range, check_ranges
from adrl.types.base import HasNative, require
from adrl.types.polygons import outline

FULL_CIRCLE_RAD = 6.28319
"""2 pi in the six digits that messages have: the greatest field of view that may be given."""
ROUNDED_RAD = 5e-7
"""A field of view that is less short of 2 pi was rounded. One of a scan that repeats its first beam is shorter."""
BEYOND_SPEED = 2.0
"""Odometry of more than so many times the robot's greatest speeds is a fault."""
SLIP_M, SLIP_RAD = 0.1, 0.2
"""Odometry may jump by so much beyond what the robot can drive."""
STANDS_MPS = 0.01
"""A robot that is slower stands."""
TURNS_WITHIN_M = 1.0
"""Time limits go by no greater speed than one at which a robot turns on such a radius."""
LEAST_MPS = 0.01
"""No robot has a smaller greatest speed."""


@dataclass(frozen=True, kw_only=True)
class LidarConfig:
    """A planar LiDAR fixed to the robot. Beam i points at angle_min_rad + i * angle_increment_rad."""

    num_beams: Annotated[int, Range(1, 2048)] = 180
    """Beams a scan, spread evenly over the field of view; 1 to 2048."""
    fov_rad: Annotated[float, Range(0.001, FULL_CIRCLE_RAD)] = 2.0 * math.pi
    """Field of view, centred on the mount's heading; 0.001 to 6.28319, which is taken as 2 pi. A full circle
    does not repeat its first beam."""
    max_range_m: Annotated[float, Range(0.05, 1000.0)] = 6.0
    """Range reported when nothing is hit; 0.05 to 1000."""
    noise_std_m: Annotated[float, Range(0.0, 1.0)] = 0.01
    """Standard deviation of the range noise; 0 to 1."""
    dropout_probability: Annotated[float, Range(0.0, 0.99)] = 0.0
    """Chance that a beam reports max_range_m whatever it hit; 0 to 0.99."""
    mount_x_m: Annotated[float, Range(-10.0, 10.0)] = 0.0
    """Where the sensor is, ahead of the robot's origin; -10 to 10."""
    mount_y_m: Annotated[float, Range(-10.0, 10.0)] = 0.0
    """The same to its left; -10 to 10."""
    mount_yaw_rad: Annotated[float, Range(-FULL_CIRCLE_RAD, FULL_CIRCLE_RAD)] = 0.0
    """How far it is turned to the left; -6.28319 to 6.28319."""

    def __post_init__(self) -> None:
        check_ranges(self, "lidar.")
        if self.fov_rad > 2.0 * math.pi - ROUNDED_RAD:
            object.__setattr__(self, "fov_rad", 2.0 * math.pi)

    @property
    def mount(self) -> Pose:
        """The sensor's pose in the robot's frame."""
        return self.mount_x_m, self.mount_y_m, self.mount_yaw_rad

    @property
    def angle_increment_rad(self) -> float:
        """Angle between neighbouring beams."""
        if self.num_beams == 1:
            return 0.0
        full_circle = self.fov_rad >= 2.0 * math.pi - 1e-9
        return self.fov_rad / (self.num_beams if full_circle else self.num_beams - 1)

    @property
    def angle_min_rad(self) -> float:
        """Angle of beam 0 in the sensor's frame."""
        return -0.5 * self.fov_rad if self.num_beams > 1 else 0.0

    @property
    def angles_rad(self) -> Array:
        """(K,) angles of the beams in the sensor's frame."""
        return self.angle_min_rad + self.angle_increment_rad * np.arange(self.num_beams, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class RobotConfig(HasNative):
    """A robot with a LiDAR that turns on the spot, or a car-like one. Give radius_m (a disc) or footprint_m (a convex
    polygon)."""

    name: str = "diffbot"
    radius_m: Annotated[float, Range(0.01, 10.0)] | None = 0.2
    """Radius of a disc footprint, 0.01 to 10, or None when footprint_m is given."""
    footprint_m: tuple[tuple[float, float], ...] | None = None
    """Corners (x, y) of a convex polygon footprint in the robot's frame, 3 to 16 of them, each coordinate -10 to 10.

    They may be given either way round; they are kept counter-clockwise, without those on a straight edge.
    """
    max_speed_mps: Annotated[float, Range(LEAST_MPS, 50.0)] = 0.6
    """Greatest forward speed; 0.01 to 50."""
    min_speed_mps: Annotated[float, Range(-50.0, 0.0)] = 0.0
    """Most negative forward speed, -50 to 0: 0 drives forward only, below 0 both ways."""
    max_yaw_rate_radps: Annotated[float, Range(0.01, 50.0)] = 1.5
    """Greatest yaw rate either way; 0.01 to 50."""
    min_turning_radius_m: Annotated[float, Range(0.0, 10.0)] = 0.0
    """Radius of the tightest curve of a car-like robot, 0 to 10, by its frame's origin, the middle of its rear axle; 0
    turns on the spot. The base turns no faster than the speed over this radius, whatever it is told."""
    max_acceleration_mps2: Annotated[float, Range(0.01, 1000.0)] = 2.0
    """Greatest change of the speed, braking too; 0.01 to 1000."""
    max_yaw_acceleration_radps2: Annotated[float, Range(0.01, 1000.0)] = 6.0
    """The same of the yaw rate; 0.01 to 1000."""
    lag_s: Annotated[float, Range(0.0, 10.0)] = 0.05
    """Time constant of the first-order lag between commanded and executed twist, 0 to 10; 0 for none."""
    latency_s: Annotated[float, Range(0.0, 10.0)] = 0.0
    """Age of a command when the base starts to act on it, 0 to 10, and at most 7 control periods."""
    odometry_drift: Annotated[float, Range(0.0, 1.0)] = 0.0
    """Standard deviation of the relative error of the wheel odometry, drawn once an episode for v and w; 0 to 1."""
    control_period_s: Annotated[float, Range(0.005, 2.0)] = 0.1
    """Time from one scan and command to the next, 0.005 to 2: 1 / rate of the LiDAR, 0.05 for one of 20 Hz."""
    lidar: LidarConfig = field(default_factory=LidarConfig)

    def __post_init__(self) -> None:
        require(
            (self.radius_m is None) != (self.footprint_m is None),
            f"robot {self.name!r}: give either radius_m or footprint_m, not both and not neither",
        )
        check_ranges(self, f"robot {self.name!r}: ")
        longest = (_core.MAX_LATENCY_PERIODS - 1) * self.control_period_s
        require(
            self.latency_s <= longest,
            f"robot {self.name!r}: latency_s is {self.latency_s}; give at most {longest:.2g} s, "
            f"{_core.MAX_LATENCY_PERIODS - 1} control periods",
        )
        if self.footprint_m is not None:
            try:
                corners = outline(self.polygon)
            except ConfigError as error:
                raise ConfigError(f"robot {self.name!r}: footprint_m {error}") from None
            object.__setattr__(self, "footprint_m", tuple((float(x), float(y)) for x, y in corners))

    @property
    def polygon(self) -> Array:
        """(V, 2) corners of the footprint; (0, 2) for a disc."""
        return np.asarray(self.footprint_m or np.empty((0, 2)), dtype=np.float64).reshape(-1, 2)

    @cached_property
    def native(self) -> "_core.Robot":
        """The same robot, laid out for the simulator."""
        lidar = self.lidar
        return _core.Robot(
            self.radius_m or 0.0,
            self.polygon,
            (self.max_speed_mps, self.min_speed_mps, self.max_yaw_rate_radps),
            lidar.num_beams,
            lidar.angle_min_rad,
            lidar.angle_increment_rad,
            lidar.mount,
            lidar.max_range_m,
            self.control_period_s,
            self.min_turning_radius_m,
        )

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """(..., 2) points in the robot's frame -> (...) whether they lie in its footprint, the edge left out."""
        if self.radius_m is not None:
            return np.hypot(points[..., 0], points[..., 1]) < self.radius_m
        return lies_within(self.polygon, points)

    def cannot_have_driven(self, way_m: Any, turn_rad: Any, seconds: Any) -> Any:
        """Whether odometry that tells of such ways and turns in such times has begun anew in another place.

        Numbers or arrays (...). The robot may be faster than it is told to be, and slip.
        """
        too_far = way_m > BEYOND_SPEED * self.fastest_mps * seconds + SLIP_M
        return too_far | (abs(turn_rad) > BEYOND_SPEED * self.max_yaw_rate_radps * seconds + SLIP_RAD)

    @property
    def is_car(self) -> bool:
        """Whether it cannot turn on the spot."""
        return self.min_turning_radius_m > 0.0

    def steerable(self, twist: tuple[float, float]) -> tuple[float, float]:
        """A speed and yaw rate with no tighter a turn than a car can steer: the speed is kept, as the base does."""
        speed, yaw_rate = twist
        if not self.is_car:
            return twist
        most = abs(speed) / self.min_turning_radius_m
        return speed, min(max(yaw_rate, -most), most)

    @property
    def fastest_mps(self) -> float:
        """Greatest speed, forward or backward."""
        return max(self.max_speed_mps, -self.min_speed_mps)

    @property
    def stop_time_s(self) -> float:
        """From full speed ahead, after the command to stop was given, until it stands.

        As core/drive has it: the speed follows its command with a lag, no faster than the acceleration allows.
        """
        tail = self._tail_mps
        time_s = self.latency_s + (self.max_speed_mps - tail) / self.max_acceleration_mps2
        return time_s + (self.lag_s * math.log(tail / STANDS_MPS) if tail > STANDS_MPS else 0.0)

    @property
    def stop_distance_m(self) -> float:
        """The way that it goes in that time."""
        speed, tail = self.max_speed_mps, self._tail_mps
        braking_m = (speed**2 - tail**2) / (2.0 * self.max_acceleration_mps2)
        return speed * self.latency_s + braking_m + tail * self.lag_s

    @property
    def turn_limited_speed_mps(self) -> float:
        """Greatest forward speed, or that at which it turns within a metre: faster it follows no wall."""
        return min(self.max_speed_mps, TURNS_WITHIN_M * self.max_yaw_rate_radps)

    def slowed(self, stop_within_m: float) -> Self:
        """The same robot, told no more than the speeds from which it stops within so many metres, and at which its yaw
        rate turns it within twice as many; itself where it does at its own."""
        turning = 2.0 * stop_within_m * self.max_yaw_rate_radps
        speed = max(min(turning, self._speed_to_stop_within(stop_within_m)), LEAST_MPS)
        if speed >= self.fastest_mps:
            return self
        return replace(
            self,
            max_speed_mps=min(self.max_speed_mps, speed),
            min_speed_mps=max(self.min_speed_mps, -speed),
        )

    def _speed_to_stop_within(self, way_m: float) -> float:
        """stop_distance_m, solved for the speed."""
        lag, latency, brake = self.lag_s, self.latency_s, self.max_acceleration_mps2
        speed = way_m / (latency + lag) if latency + lag > 0.0 else math.inf
        if speed > brake * lag:  # it does not stop by the lag alone: v^2 / 2 b + v latency + b lag^2 / 2
            braking_m = way_m - 0.5 * brake * lag**2
            speed = brake * (math.sqrt(latency**2 + 2.0 * braking_m / brake) - latency)
        return speed

    @property
    def _tail_mps(self) -> float:
        """Below this speed the lag is what holds a stop back."""
        return min(self.max_speed_mps, self.max_acceleration_mps2 * self.lag_s)

    @property
    def circumscribed_radius_m(self) -> float:
        """Radius of the smallest disc about the robot's origin that holds the footprint."""
        return (
            self.radius_m if self.radius_m is not None else float(np.linalg.norm(self.polygon, axis=1).max())
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotRows:
    """Numbers of N robots of several kinds, arrays (N,) that have the names of RobotConfig's numbers.

    What takes a RobotConfig for N robots of one kind takes this for those of several. rows[indices] are some of them.
    """

    max_speed_mps: Array
    min_speed_mps: Array
    max_yaw_rate_radps: Array
    control_period_s: Array
    circumscribed_radius_m: Array
    max_range_m: Array
    """The LiDAR's."""

    @classmethod
    def of(cls, robots: Sequence[RobotConfig]) -> Self:
        """A row a robot."""
        names = [field.name for field in fields(cls) if field.name != "max_range_m"]
        columns = {name: np.array([getattr(robot, name) for robot in robots]) for name in names}
        return cls(**columns, max_range_m=np.array([robot.lidar.max_range_m for robot in robots]))

    @property
    def fastest_mps(self) -> Array:
        """Greatest speed, forward or backward."""
        return np.maximum(self.max_speed_mps, -self.min_speed_mps)

    def __getitem__(self, rows: Any) -> Self:
        return type(self)(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})
