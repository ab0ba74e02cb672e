"""The learner: replay, networks and schedule. It samples, updates and matures; train.py drives it."""

import zlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents import networks, td3
from adrl.agents.backend import jax, jnp
from adrl.agents.config import TrainConfig
from adrl.agents.losses import Batch, ExpertBatch, Weights
from adrl.agents.replay import Demonstrations, Replay
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.errors import CheckpointError
from adrl.imitation import schedule
from adrl.imitation.probe import BoundsTable, Probe
from adrl.imitation.schedule import Bounds, MaturityState

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
    ) -> None:
        """Raises DatasetError if the demonstrations are malformed or of another shape."""
        self._config = config
        self._rng = rng
        rows = max(config.replay_capacity // num_envs, 1)
        of_targets = config.td3.n_step, config.td3.gamma
        self.replay = Replay(rows, num_envs, observation_size, *of_targets, demonstrations)
        self._probe = None if probe is None else jnp.array(probe.observation, copy=True)
        self._bounds = None if probe is None else BoundsTable(probe, config.td3.gamma, config.reward)
        self._shape = td3.make_shape(observation_size, config.td3, config.reward)
        self._update = td3.make_update(self._shape)
        self._probe_value = td3.make_probe_value(self._shape)
        self.state = td3.init_state(rng, self._shape)
        self._actor = jnp.array(self.state.actor, copy=True)
        self._info: td3.UpdateInfo | None = None
        self._schedule = MaturityState()
        self._measured_at = 0
        self.probe_value, self.bounds = float("nan"), Bounds(float("nan"), float("nan"))
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
        """S(t) (eq 13)."""
        return self._config.default_maturity if self._probe is None else self._schedule.maturity

    @property
    def alpha(self) -> float:
        """alpha(t) (eq 3); 0 without demonstrations."""
        return schedule.alpha(self.maturity, self._config.schedule) if self.has_expert else 0.0

    @property
    def lambda_bc(self) -> float:
        """Weight of cloning: lambda(t) (eq 5), 1 while the actor only clones, 0 without demonstrations."""
        if not self.has_expert:
            return 0.0
        return 1.0 if self.clones_only else schedule.lambda_bc(self.maturity, self._config.schedule)

    @property
    def expert_rows(self) -> int:
        """Expert rows of a batch: round(alpha B) (eq 4)."""
        return round(self.alpha * self._config.td3.batch_size)

    @property
    def pretraining(self) -> bool:
        """Whether updates on demonstrations alone are still due."""
        return self.has_expert and self.pretrain_updates < self._config.pretrain_updates

    @property
    def clones_only(self) -> bool:
        """Whether the actor only clones: in pretraining, and while the critics are still cold."""
        warm = self.online_updates >= self._config.critic_warmup_updates
        return self.has_expert and (self.pretraining or not warm)

    def update(self) -> None:
        """Sample and start updates_per_iteration updates; they run while the caller goes on."""
        config, updates = self._config, self._config.updates_per_iteration
        pretraining = self.pretraining
        expert_rows = config.td3.batch_size if pretraining else self.expert_rows
        rows = self._sample(expert_rows, updates)
        labels = self._sample_labels(updates // config.td3.policy_delay)
        weights = Weights(self.maturity, self.lambda_bc, q_weight=0.0 if self.clones_only else 1.0)
        weights = Weights(*(np.float32(w) for w in weights))
        self.state, self._actor, self._info = self._update(self.state, rows, labels, weights)
        if pretraining:
            self.pretrain_updates += updates
        else:
            self.online_updates += updates

    def mature(self) -> None:
        """Measure S if it is due (eqs 2, 13). Waits for the running updates."""
        since = self.online_updates - self._measured_at
        if self._probe is None or self._bounds is None or since < self._config.schedule.interval_updates:
            return
        self.probe_value = float(self._probe_value(self.state, self._probe))
        self.bounds = self._bounds.at(self._schedule.maturity)
        self._schedule = schedule.update(
            self._schedule, self.probe_value, self.bounds, since, self._config.schedule
        )
        self._measured_at = self.online_updates

    def policy(self, config: PolicyConfig, *, averaged: bool = True) -> MlpPolicy:
        """The averaged actor, or today's, in numpy with its own memory. Waits for the running updates."""
        vector = self.state.average_actor if averaged else self._actor
        *hidden, (weight, bias) = networks.unflatten(np.array(vector), self._shape.actor)
        return MlpPolicy([*hidden, (weight.T, bias)], replace(config, maturity=self.maturity))

    def row(self) -> dict[str, float | int | None]:
        """The learner's part of a metrics row."""
        info = self._info
        return {
            "updates": self.updates,
            "S": self.maturity,
            "alpha": self.alpha,
            "lambda_bc": self.lambda_bc,
            "q_mean": None if info is None else float(info.q_mean),
            "critic_loss": None if info is None else float(info.critic_loss),
            "expert_fraction": self.expert_rows / self._config.td3.batch_size,
            "probe_value": self.probe_value,
            "q_min": self.bounds.low,
            "q_max": self.bounds.high,
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
            "probe_value": None if np.isnan(self.probe_value) else self.probe_value,
            "bounds": None if np.isnan(self.bounds.low) else list(self.bounds),
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
            self.probe_value, self.bounds = numbers["probe_value"], Bounds(*numbers["bounds"])
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
        """Cloning batches (count, M, ...); None where nothing is ever cloned: plain TD3 pays for none."""
        config = self._config
        warms_up = config.pretrain_updates + config.critic_warmup_updates > 0
        if not self.has_expert or not (config.schedule.lambda_max > 0.0 or warms_up):
            return None
        return self.replay.sample_labels(self._rng, (count, config.td3.bc_batch_size))
