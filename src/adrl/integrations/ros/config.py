"""Settings of the nodes. Each is an option of the command and a parameter of the node, with the same name."""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from adrl.deploy import Navigator, Pose, SupervisorConfig
from adrl.deploy.driver import Driver, Source
from adrl.deploy.frames import Frames
from adrl.deploy.navigator import PATH
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import DEFAULT
from adrl.errors import ConfigError
from adrl.simulators import NATIVE, find_simulator
from adrl.types import GOAL_TOLERANCE_M
from adrl.worlds import load_map, load_robot
from adrl.worlds.place import Place
from adrl.worlds.ros_map import Unknown

LOG = logging.getLogger("adrl.driver")

Config = TypeVar("Config", "DriveConfig", "ControllerConfig", "SimConfig")
Parameter = str | bool | int | float | list[float] | list[str]

NUMBERS = {"mount": 3, "start": 3, "heights": 2}
"""Settings that are None or so many numbers."""


@dataclass(frozen=True, kw_only=True)
class RuntimeConfig(ABC):
    """A policy that drives a robot: what the driving nodes have in common."""

    policy: str = DEFAULT
    """A shipped policy (adrl list), a run folder, model.onnx, an SB3 model.zip, or module:object of your own."""
    robot: str | None = None
    """The robot that is driven, a name (adrl list) or a TOML file, where the policy was trained for another:
    supervisor, LiDAR mount and recovery are this one's. As trained when left out."""
    odom_frame: str = "odom"
    """Frame of the odometry."""
    map_frame: str = "map"
    """Frame of the map."""
    base_frame: str = "base_link"
    """Frame of the robot: stamped commands are in it, and the LiDAR's mount is given in it."""
    transform_tolerance: float = 0.5
    """With tf: seconds for which the newest transform still holds after its stamp."""
    mount: tuple[float, float, float] | None = None
    """x (m), y (m), yaw (rad) of the LiDAR on the robot; when left out, with tf by the transform to the scan's frame,
    else the robot's own."""
    heights: tuple[float, float] | None = None
    """A sensor_msgs/PointCloud2 on topic cloud is the scan: its points between these two heights (m) above the robot's
    frame. Needs tf."""
    zero_is_free: bool = False
    """A range of 0 means nothing in reach, as the LDS-01 has it."""
    nan_is_free: bool = False
    """A range of NaN means nothing in reach."""
    watchdog_periods: float = 2.0
    """Control periods without a command after which the base stops by itself; the braking check allows for them."""
    recovery: bool = True
    """A robot that an obstacle holds for long turns to a free way by itself."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.transform_tolerance <= 60.0:
            raise ConfigError(f"transform_tolerance is {self.transform_tolerance}; give 0 to 60 seconds")
        if self.heights is not None and not self.heights[0] < self.heights[1]:
            raise ConfigError(f"heights are {self.heights}; give the lower one first")
        if self.heights is not None and self.source != "tf":
            raise ConfigError("heights need tf, which tells where the sensor is: give --localisation tf")
        if self.heights is not None and self.mount is not None:
            raise ConfigError("with heights, tf tells where the sensor is; leave mount out")

    @property
    @abstractmethod
    def source(self) -> Source:
        """Where the place on the map comes from."""

    @property
    @abstractmethod
    def commands_are_stamped(self) -> bool:
        """Whether they are TwistStamped instead of Twist."""

    @abstractmethod
    def navigator(self, mount: Pose | None = None) -> Navigator:
        """Load it. mount: of the LiDAR, as transforms tell it. Raises AdrlError."""

    def driver(self, frames: Frames | None = None) -> Driver:
        """Load all of it. frames: those that transforms are told to. Raises AdrlError."""
        navigator = self.navigator()
        if navigator.other_robot is not None:
            LOG.warning("%s", navigator.other_robot)
        return Driver(
            navigator,
            odom_frame=self.odom_frame,
            map_frame=self.map_frame,
            localisation=self.source,
            frames=frames or Frames(tolerance_s=self.transform_tolerance),
        )

    def _navigator(self, mount: Pose | None, **options: Any) -> Navigator:
        """options: those of Navigator that not all nodes have."""
        return Navigator(
            robot=load_robot(self.robot) if self.robot is not None else None,
            mount=self.mount or mount,
            zero_is_free=self.zero_is_free,
            nan_is_free=self.nan_is_free,
            supervisor=SupervisorConfig(hold_periods=self.watchdog_periods),
            recovery=self.recovery,
            **options,
        )


@dataclass(frozen=True, kw_only=True)
class DriveConfig(RuntimeConfig):
    """A policy that drives a robot to the goals it gets."""

    guidance: Literal["goal", "replan", "map"] | None = None
    """goal: the policy sees the final goal; replan: the same, and waypoints on a map of its own scans when blocked;
    map: a waypoint on the A* path of the known map. map with a map, else as trained, which must not be map."""
    map: Path | None = None
    """YAML file of the ROS map of guidance map."""
    unknown: Unknown = "solid"
    """What cells of the map are that nothing has looked at: solid or free."""
    localisation: Source = "pose"
    """Where the place on the map comes from: poses on topic amcl_pose; tf, the transform from the map's frame to the
    odometry's; or the odometry, if its frame is the map's."""
    stamped: bool = False
    """Commands are TwistStamped instead of Twist."""
    goal_tolerance_m: float = GOAL_TOLERANCE_M
    """Distance to the goal at which it is reached, m."""
    goal_yaw: bool = False
    """Turn to the goal's heading on arrival."""
    yaw_goal_tolerance: float = 0.25
    """Of that heading, rad."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unknown != "solid" and self.map is None:
            raise ConfigError(f"unknown is {self.unknown!r} without map; give map too")

    @property
    def source(self) -> Source:
        """See RuntimeConfig."""
        return self.localisation

    @property
    def commands_are_stamped(self) -> bool:
        """See RuntimeConfig."""
        return self.stamped

    def navigator(self, mount: Pose | None = None) -> Navigator:
        """See RuntimeConfig."""
        policy = find_policy(self.policy)
        guidance = self.guidance or ("map" if self.map is not None else policy.guidance)
        if guidance == "map" and self.map is None:
            raise ConfigError(
                f"policy {self.policy!r} drives with guidance map: give --map MAP.yaml, or --guidance goal or replan"
            )
        return self._navigator(
            mount,
            policy=policy,
            guidance=guidance,
            world=load_map(self.map, self.unknown) if self.map is not None else None,
            goal_tolerance_m=self.goal_tolerance_m,
            yaw_tolerance_rad=self.yaw_goal_tolerance,
        )


@dataclass(frozen=True, kw_only=True)
class ControllerConfig(RuntimeConfig):
    """A policy that follows the paths of Nav2's planners, in the place of its controller_server. Parameters of Nav2
    that mean the same have the same names."""

    enable_stamped_cmd_vel: bool = False
    """Commands are TwistStamped instead of Twist."""
    speed_limit_topic: str = "speed_limit"
    """Topic of nav2_msgs/SpeedLimit."""
    failure_tolerance: float = 2.0
    """Seconds for which the robot may be held before its goal is aborted; 0 at once, -1 never."""
    costmap_update_timeout: float = 2.0
    """The same where it is held because scans or odometry are missing, or not to be believed."""
    bond_heartbeat_period: float = 0.25
    """Seconds between two signs of life to Nav2's lifecycle manager; 0 for none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.failure_tolerance >= 0.0 or self.failure_tolerance == -1.0):
            raise ConfigError(f"failure_tolerance is {self.failure_tolerance}; give seconds, or -1 for ever")
        if not self.costmap_update_timeout >= 0.0:
            raise ConfigError(f"costmap_update_timeout is {self.costmap_update_timeout}; give seconds")
        if not 0.0 <= self.bond_heartbeat_period <= 2.0:
            raise ConfigError(f"bond_heartbeat_period is {self.bond_heartbeat_period}; give 0 to 2 seconds")

    @property
    def source(self) -> Source:
        """See RuntimeConfig."""
        return "tf"

    @property
    def commands_are_stamped(self) -> bool:
        """See RuntimeConfig."""
        return self.enable_stamped_cmd_vel

    def navigator(self, mount: Pose | None = None) -> Navigator:
        """See RuntimeConfig."""
        return self._navigator(mount, policy=self.policy, guidance=PATH)


@dataclass(frozen=True, kw_only=True)
class SimConfig(Place):
    """A simulated robot: it publishes what a robot does, and drives as it is told."""

    simulator: str = NATIVE
    """What moves and senses the robot: a simulator's name (adrl list). Ours is native; scripts/gazebo-chroot sets
    Gazebo up."""
    task: int = 0
    """Number of the test task whose world and start it has."""
    start: tuple[float, float, float] | None = None
    """x (m), y (m), yaw (rad) in the world where it starts instead, as 1,2,0.5."""
    robot: str = "diffbot"
    """A robot's name (adrl list) or a TOML file."""
    seed: int = 0
    """Of the sensors' noise."""
    speed: float = 1.0
    """Times as fast as real time; 0 goes on when a command has come, and without one after 20 ms."""
    stamped: bool = False
    """Commands are TwistStamped instead of Twist."""
    odom_frame: str = "odom"
    """Frame of the odometry; its origin is where the robot starts."""
    map_frame: str = "map"
    """Frame of the world and of the poses on topic amcl_pose."""
    base_frame: str = "base_link"
    """Frame of the robot."""
    scan_frame: str = "base_scan"
    """Frame of its LiDAR, which sits where the robot's mount is."""
    localised: bool = True
    """Publish amcl_pose: where the robot is."""
    tf: bool = False
    """Publish transforms too: map -> odom -> base, and the LiDAR's mount."""

    def __post_init__(self) -> None:
        super().__post_init__()
        find_simulator(self.simulator)
        if not 0.0 <= self.speed <= 1000.0:
            raise ConfigError(f"speed is {self.speed}; give 0 to 1000")
        if not self.robot:
            raise ConfigError("robot is empty; give a robot's name or a TOML file")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; give 0 or more")


def with_parameters(config: Config, get: Callable[[str, Parameter], Any]) -> Config:
    """The settings with the values of a node's parameters. get(name, default): a parameter's value.

    Raises ConfigError for a value that the setting cannot have.
    """
    changes: dict[str, Any] = {}
    for field in fields(config):
        before = _as_parameter(getattr(config, field.name), NUMBERS.get(field.name, 0))
        after = get(field.name, before)
        if type(before) is float and type(after) is int:
            after = float(after)
        if field.name == "people_share" and isinstance(after, float | int):
            after = str(after)  # it has no default that is a number
        if type(after) is not type(before) and not isinstance(before, list):
            raise ConfigError(f"parameter {field.name} is {after!r}; give a {type(before).__name__}")
        if isinstance(before, list) and isinstance(after, str) and field.name not in NUMBERS:
            raise ConfigError(f"parameter {field.name} is {after!r}; give a list, as [{after}]")
        if after != before:
            changes[field.name] = _from_parameter(field.name, after)
    return replace(config, **changes)


def _as_parameter(value: Any, numbers: int) -> Parameter:
    """Parameters have no None: an empty string or list stands for it."""
    if value is None:
        return [] if numbers else ""
    if isinstance(value, tuple):
        return [str(one) if isinstance(one, Path) else one for one in value]
    return str(value) if isinstance(value, Path) else value


def _from_parameter(name: str, value: Any) -> Any:
    if name in NUMBERS:
        try:
            numbers = tuple(map(float, value))
        except (TypeError, ValueError):
            numbers = (math.nan,)
        if len(numbers) not in (0, NUMBERS[name]) or not all(map(math.isfinite, numbers)):
            raise ConfigError(f"parameter {name} is {value!r}; give {NUMBERS[name]} numbers")
        return numbers or None
    if name in ("map", "world", "barn"):
        return Path(value) if value else None
    if name == "people_share":
        try:
            return float(value) if value else None
        except ValueError:
            raise ConfigError(f"parameter people_share is {value!r}; give 0 to 1") from None
    if name in ("guidance", "scenario") or (name == "robot" and not value):
        return value or None
    return value
