"""The learner's configuration. Intervals count updates or environment steps; actions are in [-1, 1]."""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

from adrl.errors import ConfigError
from adrl.imitation.schedule import ScheduleConfig
from adrl.rewards import RewardConfig
from adrl.types import Form, require_forms


def _check(owner: object, low: float, high: float, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        if not (math.isfinite(value) and low <= value <= high):
            top = "or more" if high == math.inf else f"to {high:g}"
            raise ConfigError(f"{type(owner).__name__}.{name} is {value}; give {low:g} {top}")


@dataclass(frozen=True, kw_only=True)
class Td3Config:
    """Twin delayed deep deterministic policy gradient, with the cloning term of eq 6."""

    widths: tuple[int, ...] = (128, 128)
    """Hidden units of each layer, of the actor and of each critic."""
    critic_layer_norm: bool = True
    """Normalise each hidden layer of the critics: keeps values bounded at actions nobody took."""
    gamma: float = 0.98
    """Discount a reference period (adrl.rewards): 0.1 s, longer for slow robots. A run takes the power of it
    that its robot's control period calls for."""
    n_step: int = 3
    """Steps of reward before the target bootstraps."""
    batch_size: int = 256
    """Rows of a critic update, expert and online together."""
    bc_batch_size: int = 128
    """Demonstration rows of the cloning term of an actor update."""
    actor_learning_rate: float = 1e-3
    """Step size of Adam for the actor."""
    critic_learning_rate: float = 1e-3
    """The same for the critics."""
    polyak: float = 0.01
    """Share of the new weights a target network takes over at each actor update; more in the first 1,600 of them."""
    actor_average: float = 0.0025
    """Share of the new actor that the averaged one takes over at each actor update. The average is what is
    evaluated and saved: single actors of a run differ by many points of success, their average does not."""
    policy_delay: int = 2
    """Critic updates an actor update."""
    target_noise_std: float = 0.2
    """Standard deviation of the noise on the target's action."""
    target_noise_clip: float = 0.5
    """That noise is clipped to this absolute value."""
    q_scale_floor: float = 0.1
    """Least value of the mean |Q| that the cloning term is measured in (eq 6)."""
    q_filter: bool = False
    """Clone only where the critic prefers the expert's action to the actor's ("selective", eq 6)."""
    eq6: Form = "corrected"
    """The actor's objective. Literal: Q is not divided by its mean absolute value, so that the weight of cloning
    beside it depends on the scale of the reward."""

    def __post_init__(self) -> None:
        require_forms(self, "eq6")
        if not self.widths or min(self.widths) < 1:
            raise ConfigError(f"Td3Config.widths is {self.widths}; give one or more positive widths")
        _check(self, 1, math.inf, "n_step", "batch_size", "bc_batch_size", "policy_delay")
        _check(self, 0.0, 1.0, "gamma", "polyak", "actor_average")
        _check(self, 0.0, math.inf, "target_noise_std", "target_noise_clip")
        for name in ("actor_learning_rate", "critic_learning_rate", "q_scale_floor"):
            _check(self, 1e-12, math.inf, name)


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """A training run. Give steps or max_seconds: the budget that is spent first ends it."""

    seed: int = 0
    """Of tasks, noise, robots and weights; 0 or more."""
    steps: int | None = None
    """Environment steps over all rows; a run of so many steps resumes to the same bytes."""
    max_seconds: float | None = None
    """Wall clock of the whole run in s, a total: imports, demonstrations, probe and compilation are in it, and with
    --resume what was spent before. Validation is not."""
    updates_per_iteration: int = 4
    """Gradient updates for each step of the vector environment; a multiple of policy_delay."""
    replay_capacity: int = 500_000
    """Transitions kept; about 0.4 kB each."""
    start_steps: int = 2048
    """Environment steps before the first online update."""
    pretrain_updates: int = 100
    """Updates on demonstrations alone before the first environment step; the actor only clones."""
    critic_warmup_updates: int = 0
    """Online updates during which the actor only clones: a cold critic would undo what was cloned."""
    exploration_std: tuple[float, float] = (0.05, 0.4)
    """Standard deviation of the action noise of the first and of the last robot; evenly spaced between."""
    dynamic_reward: bool = True
    """Weigh the reward by today's S (eqs 14-17); if not, by static_maturity."""
    static_maturity: float = 0.5
    """S of the reward weights where they are static."""
    failure_share: float = 0.03
    """Share of the online rows of a batch that come from the last ten steps before a failure. They would be rare: a
    policy that nearly always arrives forgets how near is too near."""
    mirror: bool = True
    """Mirror half of the rows of every batch, left for right: what a symmetric robot learns in a world it also
    learns in the mirrored one. Robots whose body or LiDAR is not symmetric are never mirrored."""
    log_interval_steps: int = 6400
    """Environment steps between rows of metrics.jsonl."""
    eval_interval_steps: int | None = None
    """Environment steps between validations, or None for none. A run that ends before the first has one at its end."""
    checkpoint_interval_steps: int | None = 200_000
    """Environment steps between checkpoints, or None for one at the end only."""
    td3: Td3Config = field(default_factory=Td3Config)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    reward: RewardConfig = field(default_factory=RewardConfig)

    def __post_init__(self) -> None:
        for name in ("steps", "max_seconds", "eval_interval_steps", "checkpoint_interval_steps"):
            if getattr(self, name) is not None:
                _check(self, 1e-9 if name == "max_seconds" else 1, math.inf, name)
        _check(self, 0, 2**63 - 1, "seed")
        _check(self, 0, math.inf, "start_steps", "pretrain_updates", "critic_warmup_updates")
        _check(self, 1, math.inf, "updates_per_iteration", "replay_capacity", "log_interval_steps")
        _check(self, 0.0, 1.0, "static_maturity", "failure_share")
        if self.updates_per_iteration % self.td3.policy_delay:
            raise ConfigError(
                f"TrainConfig.updates_per_iteration is {self.updates_per_iteration}; give a multiple of "
                f"policy_delay = {self.td3.policy_delay}"
            )
        low, high = self.exploration_std
        if not 0.0 <= low <= high <= 2.0:
            raise ConfigError(
                f"TrainConfig.exploration_std is {self.exploration_std}; give 0 <= first <= last <= 2"
            )

    @property
    def measures_maturity(self) -> bool:
        """Whether S matters: to the reward's weights, or to the release of the expert."""
        return self.dynamic_reward or self.schedule.releases

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
