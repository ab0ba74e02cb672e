"""The learner's configuration. Intervals count updates or environment steps; actions are in [-1, 1]."""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import tyro

from adrl.errors import ConfigError
from adrl.imitation.schedule import ScheduleConfig
from adrl.ranges import Range, check_ranges
from adrl.rewards import RewardConfig
from adrl.types import Form, require_forms

MAX_WIDTH = 8192
AVERAGE_POWER = 15.0
"""eta of polynomial-decay averaging (Shamir and Zhang 2013): step t takes a share (1 + eta) / (t + eta)."""

RowWeights = Literal["all", "q-filter", "spread", "state"]
Guide = Literal["none", "start", "proposal", "jump-start"]


@dataclass(frozen=True, kw_only=True)
class Td3Config:
    """Twin delayed deep deterministic policy gradient, with the cloning term of eq 6."""

    widths: tuple[int, ...] = (128, 128)
    """Hidden units of each layer, of the actor and of each critic; 1 to 8192."""
    critic_layer_norm: tyro.conf.Suppress[bool] = True
    """Normalise each hidden layer of the critics: keeps values bounded at actions nobody took."""
    gamma: Annotated[float, Range(0.0, 1.0)] = 0.98
    """Discount a reference period (adrl.rewards): 0.1 s, longer for slow robots. A run takes the power of it that its
    robot's control period calls for; 0 to 1."""
    n_step: Annotated[int, Range(1, 1000)] = 3
    """Steps of reward before the target bootstraps; 1 to 1000."""
    batch_size: Annotated[int, Range(1, 100000)] = 256
    """Rows of a critic update, expert and online together; 1 to 100000."""
    bc_batch_size: Annotated[int, Range(1, 100000)] = 128
    """Demonstration rows of the cloning term of an actor update; 1 to 100000."""
    actor_learning_rate: Annotated[float, Range(1e-12, 1.0)] = 1e-3
    """Step size of Adam for the actor; 1e-12 to 1. Rounds of demonstrations have their own."""
    critic_learning_rate: Annotated[float, Range(1e-12, 1.0)] = 1e-3
    """The same for the critics; 1e-12 to 1."""
    polyak: Annotated[float, Range(0.0, 1.0)] = 0.01
    """Share of the new weights a target network takes over at each actor update; more in the first 1,600 of them; 0 to
    1."""
    actor_average: ClassVar[float] = 0.0025
    """Share of the new actor that the averaged one takes over at each actor update. The average is what is evaluated
    and saved: single actors of a run differ by many points of success, their average does not."""
    policy_delay: ClassVar[int] = 2
    """Critic updates an actor update."""
    target_noise_std: ClassVar[float] = 0.2
    """Standard deviation of the noise on the target's action."""
    target_noise_clip: ClassVar[float] = 0.5
    """That noise is clipped to this absolute value."""
    q_scale_floor: Annotated[float, Range(1e-12, 1e6)] = 0.1
    """Least value of the mean |Q| that the cloning term is measured in (eq 6); 1e-12 to 1e+06."""
    row_weights: tyro.conf.Suppress[RowWeights] = "all"
    """Which rows of the demonstrations count in the cloning term ("selective", eq 6), see losses.cloning_loss. all:
    alike; q-filter: those where Q_1 prefers the expert's action to the actor's; spread: each by how likely the critics
    hold that; state: each by how far it is not released."""
    q_filter: ClassVar[bool] = False
    """What files of before call row_weights = "q-filter"."""
    eq6: Form = "corrected"
    """The actor's objective. Literal: Q is not divided by its mean absolute value, so that the weight of cloning
    beside it depends on the scale of the reward."""

    def __post_init__(self) -> None:
        require_forms(self, "eq6")
        if not self.widths or not 1 <= min(self.widths) <= max(self.widths) <= MAX_WIDTH:
            raise ConfigError(
                f"Td3Config.widths is {self.widths}; give one or more widths, each 1 to {MAX_WIDTH}"
            )
        _require_one_of(self, "row_weights", RowWeights)
        check_ranges(self, "Td3Config.")


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """A training run. Give steps or max_seconds: the budget that is spent first ends it."""

    seed: Annotated[int, Range(0, 2**63 - 1)] = 0
    """Of tasks, noise, robots and weights; 0 to 9.22337e+18."""
    steps: Annotated[int, Range(1, math.inf)] | None = None
    """Environment steps over all rows; a run of so many steps resumes to the same bytes; 1 or more."""
    max_seconds: Annotated[float, Range(1e-09, math.inf)] | None = None
    """Wall clock of the run in s, 1e-09 or more: imports, demonstrations, probe, compilation and learning, with
    --resume also what was spent before. Time spent on validation is not counted, so the command takes longer; it is
    where it decides which policy is kept: in fine-tuning, and after rounds of demonstrations."""
    updates_per_iteration: ClassVar[int] = 4
    """Gradient updates for each step of the vector environment; a multiple of policy_delay."""
    replay_capacity: Annotated[int, Range(1, 10_000_000)] = 500_000
    """Transitions kept; about 0.4 kB each; 1 to 1e+07."""
    start_steps: Annotated[int, Range(0, math.inf)] = 2048
    """Environment steps before the first online update; 0 or more."""
    pretrain_updates: Annotated[int, Range(0, math.inf)] = 100
    """Updates on demonstrations alone before the first environment step; the actor only clones; 0 or more."""
    guide: tyro.conf.Suppress[Guide] = "none"
    """What becomes of the actor that pretraining has cloned. none: it goes on, if cloning does. Otherwise it goes on in
    any case, and a copy stays as it is: start, no copy; proposal, the copy's action is taken wherever the critics
    prefer it, in driving and in the target; jump-start, the copy drives the first steps of each episode."""
    critic_warmup_updates: Annotated[int, Range(0, math.inf)] = 0
    """Online updates during which the actor only clones: a cold critic would undo what was cloned; 0 or more."""
    exploration_std: tuple[float, float] = (0.05, 0.4)
    """Standard deviation of the action noise of the first and of the last robot; evenly spaced between."""
    dynamic_reward: tyro.conf.Suppress[bool] = True
    """Weigh the reward by today's S (eqs 14-17); if not, by static_maturity."""
    static_maturity: ClassVar[float] = 0.5
    """S of the reward weights where they are static."""
    failure_share: Annotated[float, Range(0.0, 1.0)] = 0.03
    """Share of the online rows of a batch that come from the last ten steps before a failure. They would be rare: a
    policy that nearly always arrives forgets how near is too near; 0 to 1."""
    mirror: bool = True
    """Mirror half of the rows of every batch, left for right: what a symmetric robot learns in a world it also
    learns in the mirrored one. Robots whose body or LiDAR is not symmetric are never mirrored."""
    log_interval_steps: Annotated[int, Range(1, math.inf)] = 6400
    """Environment steps between rows of metrics.jsonl; 1 or more."""
    eval_interval_steps: Annotated[int, Range(1, math.inf)] | None = None
    """Environment steps between validations, 1 or more, or None for none. A run that ends before the first has one at
    its end."""
    checkpoint_interval_steps: Annotated[int, Range(1, math.inf)] | None = 200_000
    """Environment steps between checkpoints, or None for one at the end only; 1 or more."""
    td3: Td3Config = field(default_factory=Td3Config)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)

    def __post_init__(self) -> None:
        check_ranges(self, "TrainConfig.")
        _require_one_of(self, "guide", Guide)
        low, high = self.exploration_std
        if not 0.0 <= low <= high <= 2.0:
            raise ConfigError(
                f"TrainConfig.exploration_std is {self.exploration_std}; give 0 <= first <= last <= 2"
            )

    @property
    def measures_maturity(self) -> bool:
        """Whether S matters: to the reward's weights, or to the release of the expert."""
        return self.dynamic_reward or self.schedule.releases

    @property
    def needs_probe(self) -> bool:
        """Whether S is measured against what an expert earns (eq 13)."""
        return self.measures_maturity and self.schedule.needs_probe

    @property
    def uses_expert(self) -> bool:
        """Whether it matters who the expert is: to what is imitated, or to the bounds of S."""
        return self.schedule.imitates or self.needs_probe

    def literal(self) -> Self:
        """The same constants with every equation as printed."""
        return replace(
            self,
            td3=replace(self.td3, eq6="literal"),
            schedule=self.schedule.literal(),
            reward=self.reward.literal(),
        )

    def comparable(self) -> dict[str, Any]:
        """The configuration without the budget: a run may be resumed to go on for longer."""
        content = asdict(self)
        del content["steps"], content["max_seconds"]
        return content


def _require_one_of(owner: object, name: str, choices: object) -> None:
    value, known = getattr(owner, name), get_args(choices)
    if value not in known:
        raise ConfigError(f"{type(owner).__name__}.{name} is {value!r}; give one of {', '.join(known)}")
