"""Settings of the nodes. Each is an option of the command and a parameter of the node, with the same name."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from adrl.deploy import Navigator, SupervisorConfig
from adrl.deploy.driver import Driver
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import DEFAULT
from adrl.errors import ConfigError
from adrl.simulators import NATIVE, find_simulator
from adrl.worlds import load_map, load_robot
from adrl.worlds.place import Place
from adrl.worlds.ros_map import Unknown

LOG = logging.getLogger("adrl.driver")

Config = TypeVar("Config", "DriveConfig", "SimConfig")
Parameter = str | bool | int | float | list[float]

NUMBERS = {"mount": 3, "start": 3}
"""Settings that are None or so many numbers."""


@dataclass(frozen=True, kw_only=True)
class DriveConfig:
    """A policy that drives a robot to the goals it gets."""

    policy: str = DEFAULT
    """A shipped policy (adrl list), a run folder, model.onnx, an SB3 model.zip, or module:object of your own."""
    robot: str | None = None
    """The robot that is driven, a name (adrl list) or a TOML file, where the policy was trained for another:
    supervisor, LiDAR mount and recovery are this one's. As trained when left out."""
    guidance: Literal["goal", "replan", "map"] | None = None
    """goal: the policy sees the final goal; replan: the same, and waypoints on a map of its own scans when blocked;
    map: a waypoint on the A* path of the known map. map with a map, else as trained, which must not be map."""
    map: Path | None = None
    """YAML file of the ROS map of guidance map."""
    unknown: Unknown = "solid"
    """What cells of the map are that nothing has looked at: solid or free."""
    localisation: Literal["pose", "odometry"] = "pose"
    """Where the place on the map comes from: poses on topic amcl_pose, or the odometry, if its
    frame is the map's."""
    odom_frame: str = "odom"
    """Frame of the odometry."""
    map_frame: str = "map"
    """Frame of the map."""
    base_frame: str = "base_link"
    """Frame that stamped commands are in."""
    stamped: bool = False
    """Commands are TwistStamped instead of Twist."""
    goal_tolerance_m: float = 0.3
    """Distance to the goal at which it is reached, m."""
    mount: tuple[float, float, float] | None = None
    """x (m), y (m), yaw (rad) of the LiDAR on the robot; the robot's own when left out."""
    zero_is_free: bool = False
    """A range of 0 means nothing in reach, as the LDS-01 has it."""
    nan_is_free: bool = False
    """A range of NaN means nothing in reach."""
    watchdog_periods: float = 2.0
    """Control periods without a command after which the base stops by itself; the braking check allows for them."""
    recovery: bool = True
    """A robot that an obstacle holds for long turns to a free way by itself."""

    def driver(self) -> Driver:
        """Load all of it. Raises AdrlError."""
        policy = find_policy(self.policy)
        guidance = self.guidance or ("map" if self.map is not None else policy.guidance)
        if guidance == "map" and self.map is None:
            raise ConfigError(
                f"policy {self.policy!r} drives with guidance map: give --map MAP.yaml, or --guidance goal or replan"
            )
        navigator = Navigator(
            policy,
            guidance=guidance,
            world=load_map(self.map, self.unknown) if self.map is not None else None,
            robot=load_robot(self.robot) if self.robot is not None else None,
            mount=self.mount,
            zero_is_free=self.zero_is_free,
            nan_is_free=self.nan_is_free,
            goal_tolerance_m=self.goal_tolerance_m,
            supervisor=SupervisorConfig(hold_periods=self.watchdog_periods),
            recovery=self.recovery,
        )
        if navigator.other_robot is not None:
            LOG.warning("%s", navigator.other_robot)
        return Driver(
            navigator,
            odom_frame=self.odom_frame,
            map_frame=self.map_frame,
            localisation=self.localisation,
        )


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

    def __post_init__(self) -> None:
        super().__post_init__()
        find_simulator(self.simulator)
        if not 0.0 <= self.speed <= 1000.0:
            raise ConfigError(f"speed is {self.speed}; give 0 to 1000")


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
        if type(after) is not type(before) and not isinstance(before, list):
            raise ConfigError(f"parameter {field.name} is {after!r}; give a {type(before).__name__}")
        if after != before:
            changes[field.name] = _from_parameter(field.name, after)
    return replace(config, **changes)


def _as_parameter(value: Any, numbers: int) -> Parameter:
    """Parameters have no None: an empty string or list stands for it."""
    if value is None:
        return [] if numbers else ""
    return list(value) if isinstance(value, tuple) else str(value) if isinstance(value, Path) else value


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
    if name in ("guidance", "scenario") or (name == "robot" and not value):
        return value or None
    return value
