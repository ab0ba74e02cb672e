"""Our learner's habits in Stable-Baselines3's algorithms, each through an interface that the library offers.

  mirrored batches, rows that lead to failures   replay_buffer_class    TD3, SAC
  noise that differs from robot to robot         action_noise           TD3, SAC
  LayerNorm in the critics                       the policy's class     TD3, SAC, PPO
  the averaged actor                             the optimiser's hook   TD3, SAC, PPO

PPO keeps no replay: it learns from what its actor of now did, which can be neither mirrored nor drawn more often. Its
noise is learnt.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from torch.optim.swa_utils import AveragedModel

from adrl.agents.config import AVERAGE_POWER, Td3Config, TrainConfig
from adrl.agents.failures import FAILURE_STEPS
from adrl.baselines.sb3_policies import NormedSacPolicy, NormedTanhMeanPolicy, NormedTd3Policy
from adrl.observation import Mirror
from adrl.types import ACTION_SIZE

FAILURES_KEPT = 0.1
"""Rows kept for failures, as a share of the replay's: allocated beside it, and each holds a step a second time."""
POLICIES = {"TD3": NormedTd3Policy, "SAC": NormedSacPolicy, "PPO": NormedTanhMeanPolicy}


def with_habits(
    algorithm: str, options: Mapping[str, Any], config: TrainConfig, mirror: Mirror | None, num_envs: int
) -> dict[str, Any]:
    """The constructor's arguments `options` of an algorithm, with our habits in them.

    mirror: of the observations, None for a robot that is not symmetric.
    """
    options = dict(options) | {"policy": POLICIES[algorithm]}
    if algorithm == "PPO":
        return options
    # The library sets up n-step returns in its own replay only; one that is given takes them as its arguments.
    replay = {"n_steps": options.pop("n_steps"), "gamma": options["gamma"]}
    replay |= {"mirror": mirror if config.mirror else None, "failure_share": config.failure_share}
    return options | {
        "replay_buffer_class": HabitReplay,
        "replay_buffer_kwargs": replay,
        "action_noise": varied_noise(config, num_envs),
    }


class HabitReplay(NStepReplayBuffer):
    """The library's replay, with our learner's two habits of sampling.

    Every other row of a batch is mirrored. A fixed share of it, the last rows, are steps that led to a failure.
    """

    def __init__(
        self,
        buffer_size: int,
        *spaces: Any,
        n_envs: int = 1,
        mirror: Mirror | None = None,
        failure_share: float = 0.0,
        **options: Any,
    ) -> None:
        """mirror: None mirrors nothing. The rest is the library's."""
        super().__init__(buffer_size, *spaces, n_envs=n_envs, **options)
        self._mirror, self._failure_share = mirror, failure_share
        to_failures = max(round(FAILURES_KEPT * buffer_size), FAILURE_STEPS)
        self.failures = NStepReplayBuffer(to_failures, *spaces, n_envs=1, **options)
        """The last FAILURE_STEPS rows, or fewer, of each episode that failed; the newest where they are too many."""

    def add(
        self,
        obs: NDArray[Any],
        next_obs: NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Write one step of all environments, in the library's way."""
        head = self.pos
        super().add(obs, next_obs, action, reward, done, infos)
        for env in np.flatnonzero(done):
            if not (self.timeouts[head, env] or infos[env]["is_success"]):
                self._keep_failure(head, env)

    def _keep_failure(self, last: int, env: np.intp) -> None:
        rows = np.arange(last - min(FAILURE_STEPS, self.buffer_size) + 1, last + 1)
        rows = rows % self.buffer_size if self.full else rows[rows >= 0]
        ended = np.flatnonzero(self.dones[rows[:-1], env])  # of the episodes before
        for row in rows[ended[-1] + 1 if len(ended) else 0 :]:
            here = row, [env]
            states = self.observations[here], self.next_observations[here]
            self.failures.add(*states, self.actions[here], self.rewards[here], self.dones[here], [{}])

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """A batch, arrays (batch_size, ...). env: normalises, in the library's way."""
        to_failures = round(self._failure_share * batch_size) if self.failures.size() else 0
        batch = super().sample(batch_size - to_failures, env)
        if to_failures:
            pairs: Any = zip(batch, self.failures.sample(to_failures, env), strict=True)
            batch = ReplayBufferSamples(*map(torch.cat, pairs))
        if self._mirror is not None:
            self._mirror.observation(_every_other(batch.observations))
            self._mirror.observation(_every_other(batch.next_observations))
            self._mirror.action(_every_other(batch.actions))
        return batch


def _every_other(rows: torch.Tensor) -> NDArray[Any]:
    """A view, in numpy, of a batch on the CPU."""
    return rows.numpy()[::2]


def varied_noise(config: TrainConfig, num_envs: int) -> VectorizedActionNoise:
    """Normal noise on the actions of num_envs robots, from little for the first to much for the last."""
    mean = np.zeros(ACTION_SIZE)
    noise = VectorizedActionNoise(NormalActionNoise(mean, mean), num_envs)
    stds = np.linspace(*config.exploration_std, num_envs)
    noise.noises = [NormalActionNoise(mean, np.full(ACTION_SIZE, std)) for std in stds]
    return noise


def averaged(actor: Any) -> torch.nn.Module:
    """The average of an actor over all its updates to come, as our learner averages its own. actor: with its optimizer,
    as the library's have it."""
    average = AveragedModel(actor, avg_fn=follow)
    actor.optimizer.register_step_post_hook(lambda *_: average.update_parameters(actor))
    return average.module


def follow(average: torch.Tensor, new: torch.Tensor, updates: torch.Tensor | int) -> torch.Tensor:
    """The average after the update that comes after `updates` of them: agents/td3.py has the same."""
    share = max(Td3Config.actor_average, (1.0 + AVERAGE_POWER) / (float(updates) + 1.0 + AVERAGE_POWER))
    return average + share * (new - average)
