"""What the training loop takes and gives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.policy import MlpPolicy
from adrl.types import Array

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


class TrainEnv(Protocol):
    """What the loop needs of a vector environment (SAME_STEP autoreset); NavVectorEnv offers it."""

    num_envs: int

    @property
    def periods(self) -> Array:
        """(N,) length of the next step of each row in reference periods, in which rewards and discounts are meant."""
        ...

    @property
    def maturity(self) -> float:
        """S, which the loop sets before each step: the replanner's thresholds follow it (eq 20)."""
        ...

    @maturity.setter
    def maturity(self, value: float) -> None: ...

    def reset(self, *, seed: int | None = None) -> tuple[F32, dict[str, Any]]: ...

    def advance(self, actions: F32) -> tuple[F32, Mask, Mask, dict[str, Any]]:
        """Gymnasium's vector step without the reward: the loop forms it from the terms."""
        ...

    def state(self) -> dict[str, NDArray[Any]]: ...

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Where a run stands, for a progress bar."""

    phase: str = "training"
    """What is being done: worlds, demonstrations, probe, compilation, training or validation."""
    fraction: float
    """Of the budget, 0 to 1."""
    wall_s: float
    env_steps: int = 0
    updates: int = 0
    episodes: int = 0
    maturity: float = 0.0
    alpha: float = 0.0
    lambda_bc: float = 0.0
    train_success: float | None = None
    """Success of the exploring policy between the last two metrics rows."""
    success: float | None = None
    """The last evaluation's."""


class TrainingStopped(KeyboardInterrupt):
    """A signal ended a run, which has left what it can go on from."""


@dataclass(frozen=True)
class TrainResult:
    """A finished run."""

    policy: MlpPolicy
    folder: Path
    env_steps: int
    updates: int
    episodes: int
    train_seconds: float


@dataclass(frozen=True, kw_only=True)
class Validation:
    """How a policy did on the validation tasks."""

    success: float
    """Fraction that arrived."""
    seconds: float
    """Mean time of a task in s; one that was not solved counts with its time limit."""
    start: F32
    """(E, D) observations of the start states."""
    discounted_return: float
    """Mean over the tasks of the discounted return that was realised from there."""


Evaluate = Callable[[MlpPolicy, float], Validation]
"""Drives a policy; the number is S of the reward weights under which returns are formed. It must not touch the
training environment, and its time is not the run's: it measures, and the budget is for learning."""
