"""The robot, encoder and replanner that a policy was trained with, from its config.json."""

import math
from dataclasses import dataclass

from adrl.deploy.another_robot import as_trained, robot_differences
from adrl.deploy.policy import MlpPolicy
from adrl.errors import CheckpointError, ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig, without_constants
from adrl.worlds.families import RobotFamily, family_from_fields
from adrl.worlds.robot_files import robot_from_fields


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What turns scans into a policy's observations."""

    robot: RobotConfig | None
    """The robot it was trained for; None for one of a family."""
    family: RobotFamily | None
    """The family whose robots it was trained for; None for one of one robot."""
    trained_as: RobotConfig | None
    """The robot as the policy takes it: another one where it began as another robot's, see another_robot.as_trained."""
    encoder: EncoderConfig
    replanner: ReplannerConfig
    """The constants of guidance `replan`; the defaults for a policy that was trained without."""
    stop_within_m: float = math.inf
    """See RobotConfig.slowed: it asks for no greater speed; infinite for any."""

    def taken_as(self, driven: RobotConfig) -> RobotConfig:
        """A robot as the policy takes it: where the policy is told of it as it is, but for speeds that it does not
        use."""
        if self.trained_as is not None and not self.encoder.body:
            driven = as_trained(driven, self.trained_as)
        return driven.slowed(self.stop_within_m)

    def exported_for(self, robot: RobotConfig | None) -> RobotConfig:
        """The robot that an export drives, as the policy takes it. Raises ConfigError where it is to be another one."""
        if self.trained_as is not None:
            if robot is not None and robot_differences(self.trained_as, robot):
                raise ConfigError(
                    f"the policy was trained for robot {self.trained_as.name} and is exported for that; leave out "
                    f"robot {robot.name}"
                )
            return self.trained_as.slowed(self.stop_within_m)
        if robot is None:
            name = "any" if self.family is None else self.family.name
            raise ConfigError(
                f"the policy drives robots of family {name}, and an export is for one; give robot"
            )
        return robot.slowed(self.stop_within_m)


def setup_of(policy: MlpPolicy) -> Setup:
    """What a policy was trained with. Raises CheckpointError where its config.json contradicts itself."""
    config = policy.config
    name = str(config.extra.get("run", "policy"))
    family = family_from_fields(config.family) if config.family else None
    robot = None if family is not None else robot_from_fields(config.robot)
    environment = config.table("environment")
    try:
        encoder = EncoderConfig(**config.encoder)
        replanner = ReplannerConfig(**without_constants(ReplannerConfig, environment.get("replanner", {})))
    except TypeError as error:
        raise CheckpointError(
            f"policy {name!r}: bad encoder or replanner in config.json ({error}); restore the file"
        ) from None
    taken_as = environment.get("taken_as")
    trained_as = robot if taken_as is None else robot_from_fields(taken_as)
    size = ObservationEncoder(trained_as or RobotConfig(), encoder).size
    if size != config.input_size:
        raise CheckpointError(
            f"policy {name!r}: config.json has an encoder of {size} numbers and weights for "
            f"{config.input_size}; restore the file"
        )
    return Setup(
        robot=robot,
        family=family,
        trained_as=trained_as,
        encoder=encoder,
        replanner=replanner,
        stop_within_m=environment.get("stop_within_m", math.inf),
    )
