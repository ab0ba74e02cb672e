"""What robots of one kind see and follow, in one value: from an evaluation through a rollout to the simulator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from adrl.envs.kinds import Kind
from adrl.envs.nav_sim import NavSim
from adrl.envs.randomization import NOMINAL, Randomization
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig
from adrl.simulators import Body
from adrl.types import RobotConfig


@dataclass(frozen=True, kw_only=True)
class Setting:
    """All that a NavSim is made of, but how many robots there are, what their reward is and who moves them."""

    robot: RobotConfig
    guidance: str = "goal"
    encoder: EncoderConfig | None = None
    replanner: ReplannerConfig | None = None
    """The constants of guidance `replan`."""
    maturity: float = 0.0
    """S of eq 20: the policy's, for the replanner's thresholds."""
    randomization: Randomization = NOMINAL
    taken_as: RobotConfig | None = None
    """The robot as a policy of another one takes it; see NavSim."""
    plans_itself: bool = False
    """The policy makes its own routes; see NavSim."""

    @property
    def kind(self) -> Kind:
        """What differs from robot to robot within one simulator."""
        return Kind(robot=self.robot, guidance=self.guidance, taken_as=self.taken_as)

    def simulate(
        self,
        num_envs: int,
        *,
        reward: RewardConfig | None = None,
        num_threads: int = 1,
        body: Body | None = None,
    ) -> NavSim:
        """num_envs such robots. Raises UnknownName and ConfigError."""
        return simulate([self], num_envs, reward=reward, num_threads=num_threads, body=body)


def simulate(
    settings: Sequence[Setting],
    num_envs: int,
    *,
    reward: RewardConfig | None = None,
    num_threads: int = 1,
    body: Body | None = None,
) -> NavSim:
    """num_envs robots, each of the kind of one of the settings: kind k is that of settings[k].

    Raises UnknownName, and ConfigError for settings that differ in more than robot, guidance and taken_as.
    """
    one = settings[0]
    for other in settings[1:]:
        if replace(other, robot=one.robot, guidance=one.guidance, taken_as=one.taken_as) != one:
            raise ConfigError(
                f"settings of robots {one.robot.name!r} and {other.robot.name!r} differ in more than robot, guidance "
                "and taken_as; drive them one after the other"
            )
    return NavSim(
        num_envs,
        [setting.kind for setting in settings],
        randomization=one.randomization,
        encoder=one.encoder,
        reward=reward,
        replanner=one.replanner,
        maturity=one.maturity,
        plans_itself=one.plans_itself,
        num_threads=num_threads,
        body=body,
    )
