"""The robot, encoder and replanner that a policy was trained with, from its config.json."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig, without_constants
from adrl.worlds.given import GIVEN
from adrl.worlds.robots import robot_from_fields


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What turns scans into a policy's observations."""

    robot: RobotConfig
    encoder: EncoderConfig
    replanner: ReplannerConfig
    """The constants of guidance `replan`; the defaults for a policy that was trained without."""


def setup_of(policy: MlpPolicy) -> Setup:
    """What a policy was trained with. Raises CheckpointError where its config.json contradicts itself."""
    config = policy.config
    name = str(config.extra.get("run", "policy"))
    robot = robot_from_fields(config.robot)
    environment = _mapping(config, "environment")
    try:
        encoder = EncoderConfig(**config.encoder)
        replanner = ReplannerConfig(**without_constants(ReplannerConfig, environment.get("replanner", {})))
    except TypeError as error:
        raise CheckpointError(
            f"policy {name!r}: bad encoder or replanner in config.json ({error}); restore the file"
        ) from None
    size = ObservationEncoder(robot, encoder).size
    if size != config.input_size:
        raise CheckpointError(
            f"policy {name!r}: config.json has an encoder of {size} numbers and weights for "
            f"{config.input_size}; restore the file"
        )
    return Setup(robot=robot, encoder=encoder, replanner=replanner)


def as_trained(driven: RobotConfig, trained: RobotConfig) -> RobotConfig:
    """The robot that is driven, as a policy of another one takes it.

    Speeds are shares of its greatest ones, distances begin at its own footprint. It reverses only as the policy's own
    robot does, and the LiDAR reaches no other way than the policy's, whose scale of distances that is.
    """
    reverse = driven.max_speed_mps * trained.min_speed_mps / trained.max_speed_mps
    lidar = replace(driven.lidar, max_range_m=trained.lidar.max_range_m)
    return replace(driven, min_speed_mps=reverse, lidar=lidar)


def robot_differences(trained: RobotConfig, driven: RobotConfig) -> tuple[str, ...]:
    """What is another number on the robot that is driven, as "max_speed_mps 0.9 instead of 0.6"; names do not count."""
    there, here = _numbers(trained), _numbers(driven)
    differing = [name for name in here if here[name] != there[name]]
    return tuple(f"{name} {_text(here[name])} instead of {_text(there[name])}" for name in differing)


def other_robot(policy: str, trained: RobotConfig, driven: RobotConfig) -> str | None:
    """A line that says what is other on the robot that is driven than on the one a policy was trained for, or None."""
    found = robot_differences(trained, driven)
    if not found:
        return None
    name = driven.name if driven.name != trained.name else f"another {driven.name}"
    return f"policy {policy} was trained for robot {trained.name} and drives {name}: {', '.join(found)}"


def _numbers(robot: RobotConfig) -> dict[str, Any]:
    fields = asdict(robot)
    lidar = {f"lidar.{name}": value for name, value in fields.pop("lidar").items()}
    return {name: value for name, value in (fields | lidar).items() if name != "name"}


def _text(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def training_worlds(config: PolicyConfig) -> set[str] | None:
    """Fingerprints of the given worlds that a policy was trained in, its demonstrations' and those of the policy it
    began with included; None where its run does not say.

    Raises CheckpointError for a list that is none.
    """
    environment, settings = _mapping(config, "environment"), _mapping(config, "settings")
    if "worlds" not in environment:
        # A run writes no entry where it has nothing to say, and runs of before never did.
        scenario = str(config.extra.get("scenario", GIVEN[0]))
        drawn = not scenario.startswith(GIVEN)
        return set() if drawn and not environment.get("fine_tune") and not settings.get("dataset") else None
    worlds = environment["worlds"]
    if worlds is None or (isinstance(worlds, list) and all(isinstance(world, str) for world in worlds)):
        return None if worlds is None else set(worlds)
    raise CheckpointError(
        f"environment.worlds in config.json is {worlds!r}, no list of names; restore the file"
    )


def _mapping(config: PolicyConfig, name: str) -> Mapping[str, Any]:
    """An entry of config.json that holds others. Raises CheckpointError."""
    entry = config.extra.get(name, {})
    if not isinstance(entry, Mapping):
        raise CheckpointError(f"{name} in config.json is {entry!r}, no table of settings; restore the file")
    return entry
