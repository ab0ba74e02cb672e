"""What robots of one kind see and follow, in one value: from an evaluation through a rollout to the simulator."""

from dataclasses import dataclass

from adrl.envs.nav_sim import NavSim
from adrl.envs.randomization import NOMINAL, Randomization
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

    def simulate(
        self,
        num_envs: int,
        *,
        reward: RewardConfig | None = None,
        num_threads: int = 1,
        body: Body | None = None,
    ) -> NavSim:
        """num_envs such robots. Raises UnknownName and ConfigError."""
        return NavSim(
            num_envs,
            self.robot,
            guidance=self.guidance,
            randomization=self.randomization,
            encoder=self.encoder,
            reward=reward,
            replanner=self.replanner,
            maturity=self.maturity,
            taken_as=self.taken_as,
            plans_itself=self.plans_itself,
            num_threads=num_threads,
            body=body,
        )
