"""The robot, encoder and replanner that a policy was trained with, from its config.json."""

from dataclasses import dataclass

from adrl.deploy.policy import MlpPolicy
from adrl.errors import CheckpointError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig, without_constants
from adrl.worlds.robot_files import robot_from_fields


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What turns scans into a policy's observations."""

    robot: RobotConfig
    taken_as: RobotConfig
    """The robot as the policy takes it: another one where it began as another robot's, see another_robot.as_trained."""
    encoder: EncoderConfig
    replanner: ReplannerConfig
    """The constants of guidance `replan`; the defaults for a policy that was trained without."""


def setup_of(policy: MlpPolicy) -> Setup:
    """What a policy was trained with. Raises CheckpointError where its config.json contradicts itself."""
    config = policy.config
    name = str(config.extra.get("run", "policy"))
    robot = robot_from_fields(config.robot)
    environment = config.table("environment")
    try:
        encoder = EncoderConfig(**config.encoder)
        replanner = ReplannerConfig(**without_constants(ReplannerConfig, environment.get("replanner", {})))
    except TypeError as error:
        raise CheckpointError(
            f"policy {name!r}: bad encoder or replanner in config.json ({error}); restore the file"
        ) from None
    taken_as = environment.get("taken_as")
    taken_as = robot if taken_as is None else robot_from_fields(taken_as)
    size = ObservationEncoder(taken_as, encoder).size
    if size != config.input_size:
        raise CheckpointError(
            f"policy {name!r}: config.json has an encoder of {size} numbers and weights for "
            f"{config.input_size}; restore the file"
        )
    return Setup(robot=robot, taken_as=taken_as, encoder=encoder, replanner=replanner)
