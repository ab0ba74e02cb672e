"""Stable-Baselines3's TD3, SAC and PPO on the same environment, observation, action and reward as our learner.

Ours are widths, discount and, for TD3 and SAC, batch, learning rate, n-step targets and how fast they follow, replay,
steps before the first update, and gradient updates for each step of the vector environment. Some constants of SAC and
PPO were tuned (baselines/tuned.py); all else is the library's. With its own one-step
targets TD3 had 12 % on `clutter` after 5,900 updates, with these 95 %.

That is how its users have it. Mirrored batches, rows that lead to failures, critics with LayerNorm, noise that differs
from robot to robot and the averaged actor are our learner's, in every method of it; with `habits` the library's
algorithms have them too, as far as its interface takes them: sb3_habits.py.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents.budget import require_end, require_updates, spent_fraction
from adrl.agents.config import TrainConfig
from adrl.agents.interface import Evaluate
from adrl.agents.metrics import EpisodeTally, MetricsLog, crossed
from adrl.baselines import require_sb3
from adrl.baselines.tuned import TUNED
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, UnknownName
from adrl.rewards.step import step_discounts

require_sb3()

import torch  # noqa: E402
from stable_baselines3 import PPO, SAC, TD3  # noqa: E402
from stable_baselines3.common.base_class import BaseAlgorithm  # noqa: E402
from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402
from stable_baselines3.common.noise import NormalActionNoise  # noqa: E402
from stable_baselines3.common.vec_env import VecEnv  # noqa: E402

from adrl.baselines.sb3_habits import averaged, with_habits  # noqa: E402
from adrl.baselines.sb3_policies import TanhMeanPolicy  # noqa: E402

F32 = NDArray[np.float32]

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"TD3": TD3, "SAC": SAC, "PPO": PPO}
EXPLORATION_STD = 0.2
"""Standard deviation of TD3's action noise: about the middle of ours. SAC explores by itself."""
ENDLESS = 2**62


class Sb3VecEnv(VecEnv):
    """A NavVectorEnv as Stable-Baselines3 wants it. Rewards have the environment's fixed maturity."""

    def __init__(self, env: NavVectorEnv) -> None:
        self.env = env  # first: the base asks it for its render mode
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._actions: F32 = np.zeros((env.num_envs, 2), np.float32)

    def reset(self) -> F32:
        """(N, D) first observations; the seed of seed(), if it was called, counts once."""
        observation, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep (N, 2) actions for step_wait."""
        self._actions = np.asarray(actions, dtype=np.float32)

    def step_wait(self) -> tuple[F32, F32, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, dones, infos. A done that only truncated says so: its target still bootstraps."""
        observation, rewards, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": info["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "is_success": bool(info["success"][i]),
            }
        return observation, rewards, done, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute, once for each environment asked for: they are one object."""
        return [getattr(self.env, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of all environments."""
        if len(self._rows(indices)) != self.num_envs:
            raise ConfigError(f"{attr_name} can be set for all environments only; they are one object")
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of all environments at once; its result once for each."""
        return [getattr(self.env, method_name)(*args, **kwargs)] * len(self._rows(indices))

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """False: there is no wrapper around the batch."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: Any) -> list[int]:
        return list(self._get_indices(indices))


@dataclass(frozen=True)
class Sb3Result:
    """A finished run of a baseline."""

    policy: MlpPolicy
    env_steps: int
    updates: int
    train_seconds: float


def make_model(
    algorithm: str,
    env: NavVectorEnv,
    config: TrainConfig,
    tuned: Mapping[str, Any] | None = None,
    *,
    habits: bool = False,
) -> BaseAlgorithm:
    """An untrained model with our learner's sizes, on one thread. Raises UnknownName.

    tuned: constructor's arguments instead of those of TUNED. habits: see with_habits.
    """
    if algorithm not in ALGORITHMS:
        raise UnknownName("algorithm", algorithm, ALGORITHMS)
    torch.set_num_threads(1)
    kind: Any = ALGORITHMS[algorithm]  # each has a constructor of its own
    options = _on_policy(config) if algorithm == "PPO" else _off_policy(algorithm, config)
    options |= {"gamma": _step_discount(config, env)} | dict(TUNED[algorithm] if tuned is None else tuned)
    if habits:
        options = with_habits(algorithm, options, config, env.sim.encoder.mirror, env.num_envs)
    return kind(env=Sb3VecEnv(env), seed=config.seed, device="cpu", **options)


def _step_discount(config: TrainConfig, env: NavVectorEnv) -> float:
    """gamma of a step of the only robot."""
    return float(step_discounts(config.td3.gamma, env.periods[:1])[0])


def _off_policy(algorithm: str, config: TrainConfig) -> dict[str, Any]:
    noise = NormalActionNoise(np.zeros(2), np.full(2, EXPLORATION_STD)) if algorithm == "TD3" else None
    return {
        "policy": "MlpPolicy",
        "learning_rate": config.td3.critic_learning_rate,
        "buffer_size": config.replay_capacity,
        "learning_starts": config.start_steps,
        "batch_size": config.td3.batch_size,
        "train_freq": 1,
        "gradient_steps": config.updates_per_iteration,
        "n_steps": config.td3.n_step,
        # TD3's targets follow at each actor update as ours do, SAC's at each update.
        "tau": config.td3.polyak / (1 if algorithm == "TD3" else config.td3.policy_delay),
        "action_noise": noise,
        "policy_kwargs": {"net_arch": list(config.td3.widths)},
    }


def _on_policy(config: TrainConfig) -> dict[str, Any]:
    return {
        "policy": TanhMeanPolicy,
        # With 64 robots a rollout of 2,048 rows, as the library's default is with one.
        "n_steps": 32,
        "batch_size": config.td3.batch_size,
        "policy_kwargs": {"net_arch": list(config.td3.widths), "activation_fn": torch.nn.ReLU},
    }


def acting(model: BaseAlgorithm) -> torch.nn.Module:
    """The module of a model that holds its actor: of PPO the whole policy, which has one optimiser."""
    policy: Any = model.policy
    return policy if isinstance(model, PPO) else policy.actor


def to_policy(model: BaseAlgorithm, config: PolicyConfig, actor: torch.nn.Module | None = None) -> MlpPolicy:
    """The deterministic actor, tanh(MLP(s)), in numpy with its own memory: the model's own, or another of its kind."""
    source: Any = acting(model) if actor is None else actor
    if isinstance(model, PPO):
        modules = [source.mlp_extractor.policy_net, source.action_net]
    else:
        modules = [source.mu] if isinstance(model, TD3) else [source.latent_pi, source.mu]
    linear = [m for module in modules for m in module.modules() if isinstance(m, torch.nn.Linear)]
    layers = [(_array(layer.weight).T.copy(), _array(layer.bias)) for layer in linear]
    sizes = replace(config, input_size=layers[0][0].shape[0], widths=tuple(len(b) for _, b in layers[:-1]))
    return MlpPolicy(layers, sizes)


def mean_q(model: BaseAlgorithm) -> float | None:
    """Mean over a batch of what the critic says: of TD3 and SAC Q_1(s, a) of replayed rows, as our learner logs it.

    PPO learns no Q: its value estimate V(s), over the states of the running rollout. None before there is any.
    """
    if isinstance(model, PPO):
        buffer = model.rollout_buffer
        rows = buffer.buffer_size if buffer.full else buffer.pos
        return float(buffer.values[:rows].mean()) if rows else None
    source: Any = model
    if source._n_updates == 0:
        return None
    batch = source.replay_buffer.sample(source.batch_size)
    with torch.no_grad():
        return float(source.critic(batch.observations, batch.actions)[0].mean())


def promised(model: BaseAlgorithm, observation: F32, actor: torch.nn.Module | None = None) -> float:
    """Mean over states (E, D) of Q_1 of an actor's deterministic action: what the critic promises from there.

    actor: as of to_policy. Of PPO V(s). SAC's includes the entropy that its actor is paid for.
    """
    states = torch.as_tensor(observation)
    source: Any = model
    driver: Any = acting(model) if actor is None else actor
    with torch.no_grad():
        if isinstance(model, PPO):
            return float(source.policy.predict_values(states).mean())
        return float(source.critic(states, driver._predict(states, deterministic=True))[0].mean())


def _gradient_updates(model: BaseAlgorithm) -> int:
    """Updates so far. PPO counts passes over its rollout, each of several batches."""
    count = int(model._n_updates)
    if not isinstance(model, PPO):
        return count
    return count * -(-model.n_steps * model.n_envs // model.batch_size)


def _array(tensor: Any) -> F32:
    return np.array(tensor.detach().numpy(), dtype=np.float32)


def train_sb3(
    algorithm: str,
    env: NavVectorEnv,
    config: TrainConfig,
    out: Path,
    *,
    policy_config: PolicyConfig,
    evaluate: Evaluate | None = None,
    on_progress: Callable[[float], None] | None = None,
    start_time_s: float | None = None,
    tuned: Mapping[str, Any] | None = None,
    habits: bool = False,
) -> Sb3Result:
    """Train a baseline and leave metrics.jsonl and the policy, which adrl evaluate drives, in `out`.

    algorithm: of ALGORITHMS. config: seed, budget, sizes and intervals; what is the method of ADRL has no effect.
    start_time_s: of time.monotonic(); wall_s and max_seconds count from it, time in `evaluate` left out. tuned, habits:
    as of make_model. The policy is the last actor, as the library's users have it, with habits the averaged one. PPO
    ends with the first whole rollout at or past config.steps. Raises ConfigError, UnknownName.
    """
    require_end(config)
    started_s = time.monotonic() if start_time_s is None else start_time_s
    policy_config = replace(policy_config, maturity=env.maturity)
    model = make_model(algorithm, env, config, tuned, habits=habits)
    actor = averaged(acting(model)) if habits else acting(model)
    setup_s = time.monotonic() - started_s
    discount = _step_discount(config, env)
    watch = _Watch(
        config, env.num_envs, out, policy_config, evaluate, on_progress, started_s, actor, discount
    )
    try:
        model.learn(total_timesteps=config.steps or ENDLESS, callback=watch)
        seconds = watch.wall_s()
        require_updates(config, watch.updates, model.num_timesteps, setup_s)
        watch.write_last()
    finally:
        watch.log.close()
    counts = {
        "train_seconds": seconds,
        "env_steps": model.num_timesteps,
        "gradient_updates": watch.updates,
        "episodes": watch.tally.total,
    }
    policy = to_policy(model, replace(policy_config, extra=dict(policy_config.extra) | counts), actor)
    policy.save(out)
    return Sb3Result(policy, model.num_timesteps, watch.updates, seconds)


class _Watch(BaseCallback):
    """Ends the run when its budget is spent, and writes rows of metrics.jsonl."""

    def __init__(
        self,
        config: TrainConfig,
        num_envs: int,
        out: Path,
        policy_config: PolicyConfig,
        evaluate: Evaluate | None,
        on_progress: Callable[[float], None] | None,
        started_s: float,
        actor: torch.nn.Module,
        discount: float,
    ) -> None:
        super().__init__()
        self._config, self._policy_config, self._actor = config, policy_config, actor
        self._evaluate, self._on_progress = evaluate, on_progress
        self._started_s = started_s
        self.tally = EpisodeTally.empty(num_envs)
        self.log = MetricsLog(out)
        self._logged_at = 0
        self._discount = discount

    @property
    def updates(self) -> int:
        """Gradient updates so far."""
        return _gradient_updates(self.model)

    def wall_s(self) -> float:
        """Seconds since the start without those spent in evaluations."""
        return time.monotonic() - self._started_s

    def _on_step(self) -> bool:
        done, infos = self.locals["dones"], self.locals["infos"]
        success = np.array([info.get("is_success", False) for info in infos])
        rewards = np.asarray(self.locals["rewards"], np.float32)
        self.tally.add(rewards, done, success, np.full(len(done), self._discount))
        last = self.num_timesteps, len(done)
        evaluation_due = self._evaluate is not None and crossed(*last, self._config.eval_interval_steps)
        if evaluation_due or crossed(*last, self._config.log_interval_steps):
            self._write_row(evaluation_due)
        budget_s = self._config.max_seconds
        if self._on_progress is not None:
            self._on_progress(spent_fraction(self._config, self.num_timesteps, self.wall_s()))
        return budget_s is None or self.wall_s() < budget_s

    def write_last(self) -> None:
        """A row for the end of the run, unless there is one."""
        if self._logged_at < self.num_timesteps:
            self._write_row(evaluate=False)

    def _write_row(self, evaluate: bool) -> None:
        row: dict[str, Any] = {"wall_s": self.wall_s(), "env_steps": self.num_timesteps}
        row |= {"episode": self.tally.total, "updates": self.updates, "q_mean": mean_q(self.model)}
        row |= self.tally.take() | {"success": None}
        if evaluate and self._evaluate is not None:
            began_s = time.monotonic()
            policy = to_policy(self.model, self._policy_config, self._actor)
            result = self._evaluate(policy, self._config.static_maturity)
            value = promised(self.model, result.start, self._actor)
            row |= {"success": result.success, "q_start": value, "return_start": result.discounted_return}
            row["overestimation"] = value - result.discounted_return
            self._started_s += time.monotonic() - began_s
        self.log.write(row)
        self._logged_at = self.num_timesteps
