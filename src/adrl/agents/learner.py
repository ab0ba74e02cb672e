"""The learner: replay, networks and schedule. It samples, updates and matures; train.py drives it."""

import time
import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents import td3
from adrl.agents.actor_policy import policy_of, vector_of
from adrl.agents.backend import jax, jnp
from adrl.agents.config import TrainConfig
from adrl.agents.exploration import Acting, Choice
from adrl.agents.losses import Batch, ExpertBatch, Weights
from adrl.agents.replay import Demonstrations, Replay
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation import schedule
from adrl.imitation.probe import BoundsTable, Probe
from adrl.imitation.schedule import Bounds, MaturityState
from adrl.observation import Mirror

F32 = NDArray[np.float32]


class Learner:
    """Everything that learns. Its random numbers come from the generator it is given."""

    def __init__(
        self,
        config: TrainConfig,
        num_envs: int,
        observation_size: int,
        demonstrations: Demonstrations | None,
        probe: Probe | None,
        rng: np.random.Generator,
        mirror: Mirror | None = None,
        start: MlpPolicy | None = None,
    ) -> None:
        """demonstrations are left aside by a method that does not imitate.

        mirror: of the observations, None for a robot that is not symmetric. start: the actor to begin with, which is
        held while the critics are cold. Raises ConfigError if demonstrations or probe are missing or the start is of
        another shape, DatasetError if they are malformed or of another shape.
        """
        if not config.schedule.imitates:
            demonstrations = None
        elif demonstrations is None:
            raise ConfigError(
                "the method imitates and needs demonstrations; collect some, or take another method"
            )
        if config.needs_probe and probe is None:
            raise ConfigError("the maturity S is measured against a probe (adrl.imitation.probe); record one")
        self._config = config
        self._rng = rng
        rows = max(config.replay_capacity // num_envs, 1)
        of_targets = config.td3.n_step, config.td3.gamma
        self._mirror = mirror if config.mirror else None
        self._schedule = MaturityState()
        self.replay = Replay(
            rows,
            num_envs,
            observation_size,
            *of_targets,
            demonstrations,
            self._mirror,
            config.failure_share,
            config.reward,
            self.reward_maturity,
        )
        self._probe = None if probe is None else jnp.array(probe.observation, copy=True)
        self._bounds = None if probe is None else BoundsTable(probe, config.td3.gamma, config.reward)
        self._returns: list[float] = []
        self._arrived: list[bool] = []
        proposes = config.guide == "proposal"
        self._shape = td3.make_shape(observation_size, config.td3, config.reward, guide_proposes=proposes)
        self._update = td3.make_update(self._shape)
        self._probe_value = td3.make_probe_value(self._shape)
        self._q_of_average = td3.make_q_of_average(self._shape)
        self._better_action = td3.make_better_action(self._shape)
        self.state = td3.init_state(rng, self._shape)
        self._started = start is not None
        if start is not None:
            self.state = td3.with_actor(self.state, vector_of(start, self._shape.actor))
        self._actor = jnp.array(self.state.actor, copy=True)
        if proposes or config.guide == "jump-start":
            self._keep_guide()
        self._info: td3.UpdateInfo | None = None
        self.compile_seconds: float | None = None
        """Wall clock of the first update's call, which traces and compiles; None before it."""
        self._measured_at = 0
        self.bounds = Bounds(float("nan"), float("nan"))
        self.pretrain_updates = 0
        self.online_updates = 0

    @property
    def has_expert(self) -> bool:
        """Whether there are demonstrations."""
        return self.replay.expert_steps > 0

    @property
    def updates(self) -> int:
        """Gradient updates so far."""
        return self.pretrain_updates + self.online_updates

    @property
    def maturity(self) -> float:
        """S(t) (eq 13); static_maturity where nothing follows it."""
        config = self._config
        return self._schedule.maturity if config.measures_maturity else config.static_maturity

    @property
    def reward_maturity(self) -> float:
        """S of today's reward weights (eqs 14-16)."""
        return self.maturity if self._config.dynamic_reward else self._config.static_maturity

    @property
    def alpha(self) -> float:
        """alpha(t) (eq 3); 0 without demonstrations."""
        return schedule.alpha(self._schedule, self._config.schedule) if self.has_expert else 0.0

    @property
    def lambda_bc(self) -> float:
        """Weight of cloning: lambda(t) (eq 5), 1 while the actor only clones, 0 without demonstrations or held."""
        if not self.clones or self.holds_actor:
            return 0.0
        return 1.0 if self.clones_only else schedule.lambda_bc(self._schedule, self._config.schedule)

    @property
    def expert_rows(self) -> int:
        """Expert rows of a batch: round(alpha B) (eq 4)."""
        return round(self.alpha * self._config.td3.batch_size)

    @property
    def clones(self) -> bool:
        """Whether the actor ever clones the expert."""
        config = self._config
        return self.has_expert and (config.schedule.lambda_max > 0.0 or config.guide != "none")

    @property
    def pretraining(self) -> bool:
        """Whether updates on demonstrations alone are still due."""
        return self.clones and self.pretrain_updates < self._config.pretrain_updates

    @property
    def cold(self) -> bool:
        """Whether the critics would undo what the actor can: in pretraining, and in the first online updates."""
        return self.pretraining or self.online_updates < self._config.critic_warmup_updates

    @property
    def clones_only(self) -> bool:
        """Whether the actor only clones, as the critics are cold."""
        return self.clones and self.cold

    @property
    def holds_actor(self) -> bool:
        """Whether the actor it was given stays as it is, as the critics are cold."""
        return self._started and self.cold

    @property
    def acts_at_random(self) -> bool:
        """Whether the actor has learnt nothing yet that could drive."""
        return self.updates == 0 and not self._started

    def update(self) -> None:
        """Sample and start updates_per_iteration updates; they run while the caller goes on."""
        config, updates = self._config, self._config.updates_per_iteration
        pretraining = self.pretraining
        expert_rows = config.td3.batch_size if pretraining else self.expert_rows
        rows = self._sample(expert_rows, updates)
        labels = self._sample_labels(updates // config.td3.policy_delay)
        weights = Weights(*(np.float32(w) for w in self._weights()))
        began_s = time.monotonic()
        self.state, self._actor, self._info = self._update(self.state, rows, labels, weights)
        if self.compile_seconds is None:
            self.compile_seconds = time.monotonic() - began_s
        if pretraining:
            self.pretrain_updates += updates
            if self.state.guide is not None:  # what it proposes in the target is never untrained
                self._keep_guide()
        else:
            self.online_updates += updates

    def _weights(self) -> Weights:
        """What the schedule says today."""
        hold = self.clones_only or self.holds_actor
        weights = Weights(self.reward_maturity, self.lambda_bc, q_weight=0.0 if hold else 1.0)
        highest = self._config.schedule.lambda_max
        if hold or highest == 0.0 or self._config.td3.row_weights != "state":
            return weights
        return weights._replace(lambda_bc=highest, release=1.0 - self.lambda_bc / highest)

    def _keep_guide(self) -> None:
        """The averaged actor of today becomes the guide."""
        self.state = self.state._replace(guide=jnp.array(self.state.average_actor, copy=True))

    def mature(self, returns: Iterable[float] = (), arrived: Iterable[bool] = ()) -> None:
        """Measure S if it is due (eqs 2, 13). Waits for the running updates.

        returns: of the training episodes that have ended since the last call, see EpisodeTally.add. arrived: whether
        each ended at its goal.
        """
        config = self._config.schedule
        if config.follows_return:
            self._returns += returns
        if config.rise == "arrivals":
            self._arrived += arrived
        since = self.online_updates - self._measured_at
        if not self._config.measures_maturity or since < config.interval_updates:
            return
        if self._bounds is not None:
            self.bounds = self._bounds.at(self.reward_maturity)
        self._schedule = schedule.arrivals(self._schedule, self._arrived)
        self._schedule = schedule.update(self._schedule, self._statistic(), self.bounds, since, config)
        self._returns.clear()
        self._arrived.clear()
        self._measured_at = self.online_updates

    def _statistic(self) -> float:
        """Q(t) (eq 2), or what stands for it in the controls."""
        config, last = self._config.schedule, self._schedule.statistic
        if config.follows_return:
            # Without a finished episode there is nothing new; before the first, nothing has been learnt.
            fallback = self.bounds.low if last is None else last
            return float(np.mean(self._returns)) if self._returns else fallback
        if config.eq2 == "literal" or self._probe is None:
            return 0.0 if self._info is None else float(self._info.q_mean)
        return float(self._probe_value(self.state, self._probe))

    def q_at(self, observation: F32) -> float:
        """Mean Q_1(s, pi(s)) of the averaged actor over states (B, D): what the critic promises from there."""
        return float(self._q_of_average(self.state, jnp.array(observation, copy=True)))

    def policy(self, config: PolicyConfig, *, averaged: bool = True) -> MlpPolicy:
        """The averaged actor, or today's, in numpy with its own memory. Waits for the running updates."""
        vector = self.state.average_actor if averaged else self._actor
        return policy_of(vector, self._shape.actor, replace(config, maturity=self.maturity))

    def acting(self, config: PolicyConfig) -> Acting:
        """What drives while the next updates run. Waits for the running ones."""
        actor = self.policy(config, averaged=False)
        if self.state.guide is None:
            return Acting(actor)
        guide = policy_of(self.state.guide, self._shape.actor, config)
        return Acting(actor, guide, self._choice() if self._shape.guide_proposes else None)

    def _choice(self) -> Choice:
        """Between two actions, by the target critics as they are now."""
        critics = jnp.array(self.state.target_critics, copy=True)

        def choose(observation: F32, first: F32, second: F32) -> F32:
            rows = (jnp.array(array, copy=True) for array in (observation, first, second))
            return np.array(self._better_action(critics, *rows))

        return choose

    def row(self) -> dict[str, float | int | None]:
        """The learner's part of a metrics row."""
        info, statistic = self._info, self._schedule.statistic
        bounds = schedule.bounds_in_use(self._schedule, self.bounds, self._config.schedule)
        return {
            "updates": self.updates,
            "S": self.maturity,
            "alpha": self.alpha,
            "lambda_bc": self.lambda_bc,
            "q_mean": None if info is None else float(info.q_mean),
            "critic_loss": None if info is None else float(info.critic_loss),
            "expert_fraction": self.expert_rows / self._config.td3.batch_size,
            "statistic": float("nan") if statistic is None else statistic,
            "q_min": bounds.low,
            "q_max": bounds.high,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Parameters and moments by path. Waits for the running updates."""
        leaves, _ = jax.tree_util.tree_flatten_with_path(self.state)
        return {jax.tree_util.keystr(path).strip("."): np.array(leaf) for path, leaf in leaves}

    def numbers(self) -> dict[str, Any]:
        """The rest of the state, for JSON."""
        return {
            "schedule": list(self._schedule),
            "measured_at": self._measured_at,
            "bounds": None if np.isnan(self.bounds.low) else list(self.bounds),
            "returns": self._returns,
            "arrived": self._arrived,
            "info": None if self._info is None else [float(number) for number in self._info],
            "pretrain_updates": self.pretrain_updates,
            "online_updates": self.online_updates,
            "data": self.fingerprint(),
        }

    def restore(self, arrays: dict[str, NDArray[Any]], numbers: dict[str, Any]) -> None:
        """Continue from arrays() and numbers(). Raises CheckpointError if they are of other nets or data."""
        if numbers["data"] != self.fingerprint():
            raise CheckpointError("the checkpoint was trained with other demonstrations or another probe")
        leaves, treedef = jax.tree_util.tree_flatten_with_path(self.state)
        restored = []
        for path, leaf in leaves:
            name = jax.tree_util.keystr(path).strip(".")
            if name not in arrays or arrays[name].shape != leaf.shape or arrays[name].dtype != leaf.dtype:
                raise CheckpointError(f"the checkpoint's {name!r} is missing or not of these networks")
            restored.append(jnp.array(arrays[name], copy=True))
        self.state = jax.tree_util.tree_unflatten(treedef, restored)
        self._actor = jnp.array(self.state.actor, copy=True)
        self._schedule = MaturityState(*numbers["schedule"])
        self._measured_at = numbers["measured_at"]
        if numbers["bounds"] is not None:
            self.bounds = Bounds(*numbers["bounds"])
        self._returns = list(numbers["returns"])
        self._arrived = list(numbers.get("arrived", []))  # absent before S could rise with them
        if numbers["info"] is not None:
            self._info = td3.UpdateInfo(*(jnp.float32(number) for number in numbers["info"]))
        self.pretrain_updates = numbers["pretrain_updates"]
        self.online_updates = numbers["online_updates"]

    def fingerprint(self) -> list[int]:
        """Checksums of the demonstrations and of the probe: a resumed run must be given the same."""
        probe = 0 if self._probe is None else zlib.crc32(np.asarray(self._probe).tobytes())
        return [self.replay.checksum(), probe]

    def _sample(self, expert_rows: int, updates: int) -> Batch:
        """Mixed batches (eq 4) with axes (updates / policy_delay, policy_delay, B, ...)."""
        online_rows = self._config.td3.batch_size - expert_rows
        batches = self.replay.sample(self._rng, updates, online_rows, expert_rows)
        delay = self._config.td3.policy_delay
        return Batch(*(field.reshape(-1, delay, *field.shape[1:]) for field in batches))

    def _sample_labels(self, count: int) -> ExpertBatch | None:
        """Cloning batches (count, M, ...); None where nothing is cloned from now on: plain TD3 pays for none."""
        if not (self.clones_only or (self.clones and self._config.schedule.lambda_max > 0.0)):
            return None
        return self.replay.sample_labels(self._rng, (count, self._config.td3.bc_batch_size))
