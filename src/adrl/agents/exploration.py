"""How the robots act while the actor learns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents.config import TrainConfig
from adrl.agents.interface import Mask
from adrl.agents.jump_start import JumpStart
from adrl.deploy.policy import MlpPolicy
from adrl.errors import CheckpointError
from adrl.types import ACTION_SIZE, Array

F32 = NDArray[np.float32]
Choice = Callable[[F32, F32, F32], F32]
"""Observations (N, D) and two actions (N, 2) for each -> the one that the critics prefer (N, 2)."""


@dataclass(frozen=True)
class Acting:
    """Whatever drives while updates run: copies of its own, of before them."""

    actor: MlpPolicy
    guide: MlpPolicy | None = None
    """The cloned policy of TrainConfig.guide."""
    choose: Choice | None = None
    """Between the actor's action and the guide's, where the guide proposes (IBRL)."""


class Explorer:
    """Gaussian noise on the actor's action, of another size in each row; and what a guide drives instead."""

    def __init__(self, config: TrainConfig, num_envs: int, longest_demonstration: float) -> None:
        """longest_demonstration: in reference periods, see JumpStart.horizon."""
        self._noise_std = np.linspace(*config.exploration_std, num_envs, dtype=np.float32)[:, None]
        self._jumps = config.guide == "jump-start"
        self._jump = JumpStart.start(longest_demonstration if self._jumps else 0, num_envs)

    def act(
        self, acting: Acting | None, observation: F32, steps: F32, periods: Array, rng: np.random.Generator
    ) -> F32:
        """(N, 2) actions. acting: None as long as nothing has been learnt, and actions are uniform. steps: (N,)
        of the episodes so far, of so many reference periods (N,) each."""
        shape = (len(observation), ACTION_SIZE)
        if acting is None:
            return rng.uniform(-1.0, 1.0, shape).astype(np.float32)
        noise = self._noise_std * rng.standard_normal(shape, dtype=np.float32)
        action = np.clip(acting.actor.act(observation) + noise, -1.0, 1.0).astype(np.float32, copy=False)
        if acting.guide is None:
            return action
        if acting.choose is not None:
            return acting.choose(observation, action, acting.guide.act(observation))
        guided = steps < self._jump.guided_steps(periods)
        return np.where(guided[:, None], acting.guide.act(observation), action)

    def count(self, ended: Mask, success: Mask) -> None:
        """Tell which episodes (N,) a step ended, and where the goal was reached."""
        if self._jumps:
            self._jump = self._jump.after(ended, success)

    def numbers(self) -> dict[str, Any]:
        """The state, for JSON; empty where there is none."""
        return self._jump._asdict() if self._jumps else {}

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """Continue from numbers(). Raises CheckpointError if they are of another number of robots."""
        if not self._jumps:
            return
        jump = JumpStart(**numbers)
        if len(jump.awaited) != len(self._jump.awaited):
            raise CheckpointError(
                f"the checkpoint's curriculum is of {len(jump.awaited)} robots, not {len(self._jump.awaited)}"
            )
        self._jump = jump
