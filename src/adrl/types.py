"""Shared value types: robots, worlds, tasks, policies. SI units, radians, frames as in ROS REP 103."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cached_property
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import CheckpointError, ConfigError
from adrl.geometry import Array, lies_within
from adrl.ranges import Range, check_ranges

ACTION_SIZE = 2
"""Numbers of an action: speed, yaw rate."""
GUIDANCE = ("goal", "replan", "map")
Form = Literal["literal", "corrected"]
"""How an equation of the paper is computed: as printed, or as docs/fidelity.md says it has to be read."""
FORMS: tuple[Form, ...] = get_args(Form)
SPLITS = ("train", "validation", "test")
FULL_CIRCLE_RAD = 2.0 * math.pi + 1e-6
"""And what rounding adds."""
MOST_M = 10.0
"""No corner of a footprint has a greater coordinate."""
BEYOND_SPEED = 2.0
"""Odometry of more than so many times the robot's greatest speeds is a fault."""
SLIP_M, SLIP_RAD = 0.1, 0.2
"""Odometry may jump by so much beyond what the robot can drive."""


def _require(ok: bool, message: str) -> None:
    if not ok:
        raise ConfigError(message)


def without_constants(kind: type, saved: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of the options of a dataclass, and of the dataclasses in it.

    Options that are constants now are left out: files of before name them. Raises CheckpointError where one had another
    value.
    """
    kept = dict(saved)
    for name, hint in get_type_hints(kind).items():
        value = kept.get(name)
        if is_dataclass(hint) and isinstance(hint, type) and isinstance(value, Mapping):
            kept[name] = without_constants(hint, value)
        elif get_origin(hint) is ClassVar and name in kept:
            constant = getattr(kind, name)
            if kept.pop(name) != constant:
                raise CheckpointError(
                    f"{name} of {kind.__name__} was {value!r} and is always {constant!r} now; train anew, or use the "
                    "version of before"
                )
    return kept


def with_defaults(kind: type, saved: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of the options of a dataclass, and of the dataclasses in it; options that came after the file
    was written have their defaults."""
    kept = dict(saved)
    for option in fields(kind):
        default = option.default if option.default_factory is MISSING else option.default_factory()
        nested = is_dataclass(default) and not isinstance(default, type)
        value = kept.get(option.name, {} if nested else default)
        if nested and isinstance(value, Mapping):
            kept[option.name] = with_defaults(type(default), value)
        elif value is not MISSING:
            kept[option.name] = value
    return kept


def require_forms(owner: object, *equations: str) -> None:
    """Each named field of a config is a Form. Raises ConfigError."""
    for equation in equations:
        value = getattr(owner, equation)
        _require(value in FORMS, f"{type(owner).__name__}.{equation} is {value!r}; give literal or corrected")


class _HasNative:
    """Lays itself out for the core as `native`, on first use; a copy, which cannot have it, does so again."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "native"}


@dataclass(frozen=True, kw_only=True)
class LidarConfig:
    """A planar LiDAR fixed to the robot. Beam i points at angle_min_rad + i * angle_increment_rad."""

    num_beams: Annotated[int, Range(1, 2048)] = 180
    """Beams a scan, spread evenly over the field of view; 1 to 2048."""
    fov_rad: Annotated[float, Range(0.001, FULL_CIRCLE_RAD)] = 2.0 * math.pi
    """Field of view, centred on the mount's heading; 0.001 to 6.28319. A full circle does not repeat its first beam."""
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
class RobotConfig(_HasNative):
    """A differential-drive robot with a LiDAR. Give radius_m (a disc) or footprint_m (a convex polygon)."""

    name: str = "diffbot"
    radius_m: Annotated[float, Range(0.01, 10.0)] | None = 0.2
    """Radius of a disc footprint, 0.01 to 10, or None when footprint_m is given."""
    footprint_m: tuple[tuple[float, float], ...] | None = None
    """Corners (x, y) of a convex polygon footprint in the robot's frame, 3 to 16 of them, each coordinate -10 to 10.

    They may be given either way round; they are kept counter-clockwise, without those on a straight edge.
    """
    max_speed_mps: Annotated[float, Range(0.01, 50.0)] = 0.6
    """Greatest forward speed; 0.01 to 50."""
    min_speed_mps: Annotated[float, Range(-50.0, 0.0)] = 0.0
    """Most negative forward speed, -50 to 0: 0 drives forward only, below 0 both ways."""
    max_yaw_rate_radps: Annotated[float, Range(0.01, 50.0)] = 1.5
    """Greatest yaw rate either way; 0.01 to 50."""
    max_acceleration_mps2: Annotated[float, Range(0.01, 1000.0)] = 2.0
    """Greatest change of the speed, braking too; 0.01 to 1000."""
    max_yaw_acceleration_radps2: Annotated[float, Range(0.01, 1000.0)] = 6.0
    """The same of the yaw rate; 0.01 to 1000."""
    lag_s: Annotated[float, Range(0.0, 10.0)] = 0.05
    """Time constant of the first-order lag between commanded and executed twist, 0 to 10; 0 for none."""
    latency_s: Annotated[float, Range(0.0, 10.0)] = 0.0
    """Age of a command when the base starts to act on it, 0 to 10, and at most 15 control periods."""
    odometry_drift: Annotated[float, Range(0.0, 1.0)] = 0.0
    """Standard deviation of the relative error of the wheel odometry, drawn once an episode for v and w; 0 to 1."""
    control_period_s: Annotated[float, Range(0.005, 2.0)] = 0.1
    """Time from one scan and command to the next, 0.005 to 2: 1 / rate of the LiDAR, 0.05 for one of 20 Hz."""
    lidar: LidarConfig = field(default_factory=LidarConfig)

    def __post_init__(self) -> None:
        _require(
            (self.radius_m is None) != (self.footprint_m is None),
            f"robot {self.name!r}: give either radius_m or footprint_m, not both and not neither",
        )
        check_ranges(self, f"robot {self.name!r}: ")
        longest = (_core.MAX_LATENCY_PERIODS - 1) * self.control_period_s
        _require(
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
            (lidar.mount_x_m, lidar.mount_y_m, lidar.mount_yaw_rad),
            lidar.max_range_m,
            self.control_period_s,
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
    def fastest_mps(self) -> float:
        """Greatest speed, forward or backward."""
        return max(self.max_speed_mps, -self.min_speed_mps)

    @property
    def circumscribed_radius_m(self) -> float:
        """Radius of the smallest disc about the robot's origin that holds the footprint."""
        return (
            self.radius_m if self.radius_m is not None else float(np.linalg.norm(self.polygon, axis=1).max())
        )


def outline(corners: Array) -> Array:
    """(V, 2) corners of a convex polygon, either way round -> (W, 2) the same counter-clockwise, as few as it has.

    Raises ConfigError, whose text goes on from what the polygon is called.
    """
    _require(bool((np.abs(corners) <= MOST_M).all()), f"has a corner beyond {-MOST_M:g} to {MOST_M:g} m")
    corners = corners[(corners != np.roll(corners, 1, axis=0)).any(axis=1)]
    if len(corners) >= 3:
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        straight = np.abs(_turns(corners)) <= 1e-9 * lengths * np.roll(lengths, -1)
        corners = corners[~np.roll(straight, 1)]
    _require(
        3 <= len(corners) <= _core.MAX_CORNERS,
        f"has {len(corners)} corners, those on a straight edge left out; give 3 to {_core.MAX_CORNERS}",
    )
    x, y = corners.T
    if float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0:
        corners = np.ascontiguousarray(corners[::-1])
    dents = np.roll(corners, -1, axis=0)[_turns(corners) < 0.0]
    _require(
        len(dents) == 0,
        f"is not convex: it bends inwards at {', '.join(f'({x:g}, {y:g})' for x, y in dents)}; leave such corners out, "
        "which makes it larger",
    )
    _require(
        _winds_once(corners), "crosses itself; give its corners in the order in which they follow each other"
    )
    return corners


def _turns(corners: Array) -> Array:
    """(V, 2) corners -> (V,) cross products of the edges that meet at the following corner: above 0 to the left."""
    # Not np.roll: a world of boxes is checked in half the time.
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    following = np.concatenate([edges[1:], edges[:1]])
    return edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]


def _winds_once(corners: Array) -> bool:
    """Whether the edges turn by one full circle in all, and not by more."""
    edges = np.roll(corners, -1, axis=0) - corners
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    turned = np.remainder(np.roll(headings, -1) - headings, 2.0 * math.pi).sum()
    return abs(turned - 2.0 * math.pi) < 1e-6


def _check_convex_ccw(name: str, corners: Array) -> None:
    _require(
        len(corners) >= 3 and bool(np.isfinite(corners).all()),
        f"{name} needs three or more finite corners",
    )
    _require(
        bool((_turns(corners) > 0.0).all()),
        f"{name} is not convex with its corners counter-clockwise",
    )


@dataclass(frozen=True, kw_only=True)
class OccupancyGrid:
    """A bitmap of solid cells. Row-major [y, x]; cell (0, 0) has its lower left corner at the origin."""

    solid: NDArray[np.uint8]
    """(H, W) 1 where the cell is solid: occupied or unknown."""
    resolution_m: float
    """Side of a cell."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """(x, y, yaw) of the lower left corner of cell (0, 0) in the world."""
    observed_free: NDArray[np.bool_] | None = None
    """(H, W) cells surely seen free; tasks start and end there. None: every cell that is not solid."""


@dataclass(frozen=True, eq=False, kw_only=True)
class World(_HasNative):
    """What exists: the LiDAR sees and the footprint hits this very geometry."""

    bounds: tuple[float, float, float, float]
    """(x_min, y_min, x_max, y_max) of the area where tasks are drawn and planned. Not a wall by itself."""
    circles: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(C, 3) x, y, radius."""
    polygons: tuple[Array, ...] = ()
    """Convex polygons, each (V, 2), corners counter-clockwise."""
    segments: Array = field(default_factory=lambda: np.empty((0, 4)))
    """(S, 4) x1, y1, x2, y2: walls without thickness."""
    discs: Array = field(default_factory=lambda: np.empty((0, 8)))
    """(M, 8) moving discs: x1, y1, x2, y2, radius, speed_mps, phase, stop_s. A disc runs to and fro between
    its two ends; phase in [0, 1) is where in the round trip it is at time 0; it stands still after stop_s
    seconds."""
    grid: OccupancyGrid | None = None

    def __post_init__(self) -> None:
        for name, width in (("circles", 3), ("segments", 4), ("discs", 8)):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64).reshape(-1, width)
            # A disc may never stop: stop_s is the one number that may be infinite.
            checked = np.minimum(array, [math.inf] * 7 + [0.0]) if name == "discs" else array
            _require(bool(np.isfinite(checked).all()), f"world.{name} holds a number that is not finite")
            object.__setattr__(self, name, array)
        for corners in self.polygons:
            _check_convex_ccw("world polygon", corners)
        x_min, y_min, x_max, y_max = self.bounds
        _require(x_min < x_max and y_min < y_max, f"world.bounds {self.bounds} is empty")

    def disc_centres(self, time_s: float) -> Array:
        """(M, 2) where the moving discs are at time_s."""
        return disc_centres(self.discs, time_s)

    def coordinates(self, time_s: float) -> Array:
        """(M, 2) one point an obstacle, its middle: what eq 8 calls its coordinates. Solid cells are one each."""
        points = [self.circles[:, :2], 0.5 * (self.segments[:, :2] + self.segments[:, 2:])]
        points += [corners.mean(axis=0, keepdims=True) for corners in self.polygons]
        points.append(self.disc_centres(time_s))
        return np.concatenate([*points, self.solid_cells])

    @cached_property
    def solid_cells(self) -> Array:
        """(M, 2) middles of the solid cells of the grid."""
        if self.grid is None:
            return np.empty((0, 2))
        x, y = (np.argwhere(self.grid.solid)[:, ::-1].T + 0.5) * self.grid.resolution_m
        x0, y0, yaw = self.grid.origin
        c, s = math.cos(yaw), math.sin(yaw)
        return np.column_stack([x0 + c * x - s * y, y0 + s * x + c * y])

    @cached_property
    def native(self) -> "_core.World":
        """The same geometry, laid out for the kernels."""
        corners = np.concatenate([*self.polygons, np.empty((0, 2))])
        sizes = [len(p) for p in self.polygons]
        offsets = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(np.int32)
        grid = self.grid
        return _core.World(
            self.circles,
            np.ascontiguousarray(corners, dtype=np.float64),
            offsets,
            self.segments,
            self.discs,
            np.ascontiguousarray(grid.solid if grid else np.empty((0, 0)), dtype=np.uint8),
            grid.resolution_m if grid else 1.0,
            grid.origin if grid else (0.0, 0.0, 0.0),
        )


def disc_centres(discs: Array, time_s: float) -> Array:
    """(M, 8) rows of World.discs -> (M, 2) where they are at time_s; the kernels' MovingDisc::at is the same."""
    ends, speed, phase, stop_s = discs[:, :4], discs[:, 5], discs[:, 6], discs[:, 7]
    run = np.hypot(*(ends[:, 2:] - ends[:, :2]).T)
    rounds = phase + speed * np.minimum(time_s, stop_s) / np.maximum(2.0 * run, 1e-9)
    share = 1.0 - np.abs(1.0 - 2.0 * np.remainder(rounds, 1.0))
    return ends[:, :2] + share[:, None] * (ends[:, 2:] - ends[:, :2])


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(_HasNative):
    """One episode: a world, where the robot starts and where it must go."""

    world: World
    start: tuple[float, float, float]
    """(x, y, yaw)."""
    goal: tuple[float, float]
    path: Array
    """(P, 2) shortened A* path for this robot, start and goal included."""
    shortest_m: float
    """Length of the shortest feasible path of the inflated footprint: the reference of optimality and SPL."""
    time_limit_s: float
    goal_tolerance_m: float = 0.3

    @cached_property
    def native(self) -> "_core.Task":
        """The same task, laid out for the simulator."""
        path = np.ascontiguousarray(self.path, dtype=np.float64)
        return _core.Task(self.world.native, self.start, self.goal, self.goal_tolerance_m, path)


@runtime_checkable
class Scenario(Protocol):
    """A family of worlds. Register in adrl.worlds.SCENARIOS or pass the object itself."""

    @property
    def name(self) -> str:
        """What it is called; its tasks are seeded by it."""
        ...

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal for this robot."""
        ...


@runtime_checkable
class Policy(Protocol):
    """Maps observations to normalised actions. What it may have besides act, all of it optional:

    name: in tables and files; that of its class by default. guidance: "goal" by default. robot: a RobotConfig, or the
    name of one: the robot it is made for, and drives where none is asked for. encoder: an EncoderConfig, or an
    adrl.observation.Encoder of its own; EncoderConfig() by default. reset(rows): episodes of robots rows (M,) begin,
    for a policy with memory. training_worlds: fingerprints of the given worlds that it has learned from, () for one
    that learns nothing; unknown by default. See docs/guide/policy.md.
    """

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, D) observations -> (N, 2) actions in [-1, 1]: speed, yaw rate."""
        ...
