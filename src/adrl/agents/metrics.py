"""What a run reports: rows of metrics.jsonl, the same to TensorBoard, and the episodes since the last row."""

import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import CheckpointError
from adrl.rewards import RewardConfig, reward, reward_terms, weights
from adrl.types import Array

F32 = NDArray[np.float32]

METRICS_FILE = "metrics.jsonl"
TENSORBOARD_FOLDER = "tb"


class MetricsLog:
    """Appends rows to metrics.jsonl and TensorBoard."""

    def __init__(self, run: Path, length: int = 0, env_steps: int = 0) -> None:
        """length: bytes of metrics.jsonl to keep; what a killed run wrote after its checkpoint goes.

        env_steps: TensorBoard drops its points from here on. Raises CheckpointError if the file is shorter.
        """
        SummaryWriter = _summary_writer()
        self._path = run / METRICS_FILE
        run.mkdir(parents=True, exist_ok=True)
        self._file = open(self._path, "ab")  # noqa: SIM115 - open for as long as the run
        found = self._file.tell()
        if found < length:
            self._file.close()
            raise CheckpointError(
                f"{self._path}: has {found} bytes, the checkpoint was written after {length}"
            )
        self._file.truncate(length)
        self._board = SummaryWriter(str(run / TENSORBOARD_FOLDER), purge_step=env_steps if length else None)

    def write(self, row: Mapping[str, float | int | None]) -> None:
        """Append a row: numbers, or None where one is undefined. Not-a-number is written as None."""
        clean = {
            key: None if value is None or not math.isfinite(value) else value for key, value in row.items()
        }
        self._file.write(json.dumps(clean, allow_nan=False).encode() + b"\n")
        self._file.flush()
        for key, value in clean.items():
            if value is not None and key != "env_steps":
                self._board.add_scalar(key, value, int(row["env_steps"] or 0))

    def position(self) -> int:
        """Bytes written so far, safe on the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return os.fstat(self._file.fileno()).st_size

    def close(self) -> None:
        """Close both files."""
        self._file.close()
        self._board.close()


def _summary_writer() -> Any:
    """tensorboardX's writer, imported as if there were no PyTorch: for a graph view that is not used here it would be
    imported too, a second and more of a run's wall clock."""
    hidden = "torch" not in sys.modules
    if hidden:
        sys.modules["torch"] = None  # pyright: ignore[reportArgumentType]  # import torch now raises ImportError
    try:
        from tensorboardX import SummaryWriter
    finally:
        if hidden:
            del sys.modules["torch"]
    return SummaryWriter


@dataclass
class EpisodeTally:
    """Returns of running episodes, and what ended since the last row. Each step under the S of its day."""

    running: F32
    """(N,) return of the episodes that still run."""
    to_go: F32
    """(N,) sum over their steps of the discounted return from that step on."""
    length: F32
    """(N,) their steps so far."""
    finished: int = 0
    succeeded: int = 0
    return_sum: float = 0.0
    total: int = 0
    """Episodes since the start of the run."""

    @classmethod
    def empty(cls, num_envs: int) -> "EpisodeTally":
        """Before the first step."""
        running, to_go, length = np.zeros((3, num_envs), np.float32)
        return cls(running, to_go, length)

    def add(self, rewards: F32, ended: NDArray[np.bool_], success: NDArray[np.bool_], discount: Array) -> F32:
        """Count one step of all rows: (N,) each. discount: of a step of each row, see step_discounts.

        Returns what the episodes that it ended earned, in the order of their rows: the mean over their steps of the
        discounted return from there, as the probe's bounds are means over states along the way. A reward after k
        steps counts discount^j, j = 0 ... k.
        """
        self.running += rewards
        self.length += 1.0
        cut = (1.0 - discount).astype(np.float32)
        counts = (1.0 - discount.astype(np.float32) ** self.length) / np.where(cut > 0.0, cut, 1.0)
        counts = np.where(cut > 0.0, counts, self.length)
        self.to_go += rewards * counts
        returns = self.to_go[ended] / self.length[ended]
        if ended.any():
            number = int(ended.sum())
            self.finished += number
            self.total += number
            self.succeeded += int((success & ended).sum())
            self.return_sum += float(self.running[ended].sum(dtype=np.float64))
            self.running[ended] = 0.0
            self.to_go[ended] = 0.0
            self.length[ended] = 0.0
        return returns

    def take(self) -> dict[str, float | int | None]:
        """Means over what ended since the last call, None without any."""
        n = self.finished
        row = {
            "return_mean": self.return_sum / n if n else None,
            "train_success": self.succeeded / n if n else None,
        }
        self.finished, self.succeeded, self.return_sum = 0, 0, 0.0
        return row

    def arrays(self) -> dict[str, F32]:
        """What is kept of every row."""
        return {name: getattr(self, name) for name in ("running", "to_go", "length")}

    def state(self) -> dict[str, Any]:
        """The rest, as plain numbers."""
        return {name: getattr(self, name) for name in ("finished", "succeeded", "return_sum", "total")}


def reward_row(terms: F32, features: F32, maturity: float, config: RewardConfig) -> dict[str, float]:
    """Means over recent steps (N, T, ...) of each term r_i, each weight w'_i, and of the reward they make."""
    w = weights(features, maturity, config)
    row = {"reward_mean": float(reward(terms, features, maturity, config).mean())}
    for i, name in enumerate(reward_terms(config)):
        row[f"term/{name}"] = float(terms[..., i].mean())
        row[f"weight/{name}"] = float(w[..., i].mean())
    return row


def crossed(env_steps: int, step: int, interval_steps: int | None) -> bool:
    """Whether the last `step` of `env_steps` environment steps crossed a multiple of the interval; None has none."""
    return interval_steps is not None and env_steps // interval_steps > (env_steps - step) // interval_steps
