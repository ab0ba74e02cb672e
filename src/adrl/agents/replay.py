"""Replay of reward terms, not rewards: what is sampled gets the reward of today's weights (eq 17).

Online data D1 and demonstrations D2 share one store, so that a mixed batch (eq 4) is one gather: first a ring
of T steps for each of N environments, then the M steps of the demonstrations. The steps of an environment lie
side by side, so an n-step window is one read. The successor of every step is stored beside it: an ended
episode's next row is another episode's first. What leaves here is a fresh copy: JAX may alias an array it is
handed, and the ring is written again.
"""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.agents.failures import FAILURE_STEPS, Failures
from adrl.agents.losses import Batch, ExpertBatch
from adrl.errors import CheckpointError, DatasetError
from adrl.imitation.demonstrations import Demonstrations
from adrl.observation import Mirror
from adrl.rewards import RewardConfig, reward_terms
from adrl.rewards.step import step_discounts
from adrl.types import ACTION_SIZE, Array

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

FAILURE_TERM = 1
CONTINUES, TERMINATED, TRUNCATED = 0, 1, 2
"""What a step does to its episode."""


class Replay:
    """The mixed buffer D. Sampling is split in two: indices of windows, then what is in them."""

    def __init__(
        self,
        rows: int,
        num_envs: int,
        observation_size: int,
        n_step: int,
        gamma: float,
        demonstrations: Demonstrations | None = None,
        mirror: Mirror | None = None,
        failure_share: float = 0.0,
        reward: RewardConfig | None = None,
        maturity: float = 0.0,
    ) -> None:
        """rows: T, at least n_step. n_step, gamma: of the targets, gamma a reference period. mirror: every other row
        that is sampled is mirrored by it. failure_share: of the online rows sampled, those that lead to a failure.
        reward: whose R terms and F features are kept, the plain one when None. maturity: S of the reward weights before
        anything is learnt, for the literal eq 17 of the demonstrations.
        Raises DatasetError if D, R or F differ."""
        self._mirror, self._failure_share = mirror, failure_share
        self._failures = Failures()
        reward = reward or RewardConfig()
        self._num_terms, self._num_features = len(reward_terms(reward)), len(reward.features())
        self.n_step = n_step
        self.rows = max(rows, n_step)
        self.num_envs = num_envs
        self.expert_steps = 0 if demonstrations is None else len(demonstrations.observation)
        self._gamma = gamma
        self._ring = num_envs * self.rows
        size = self._ring + self.expert_steps
        # np.zeros takes memory only as it is written.
        self._store: dict[str, NDArray[Any]] = {
            "observation": np.zeros((size, observation_size), np.float32),
            "next_observation": np.zeros((size, observation_size), np.float32),
            "action": np.zeros((size, ACTION_SIZE), np.float32),
            "signals": np.zeros((size, self._num_terms + self._num_features + 1), np.float32),
            "ending": np.zeros(size, np.uint8),
            "discount": np.zeros(size, np.float64),
        }
        shape = num_envs, self.rows
        self._online = {
            name: a[: self._ring].reshape(*shape, *a.shape[1:]) for name, a in self._store.items()
        }
        self._labels = np.zeros((self.expert_steps, ACTION_SIZE), np.float32)
        self.longest_demonstration = 0.0
        """Reference periods of the longest episode of the demonstrations; 0 without any."""
        self.steps = 0
        """Rows written since the start of the run."""
        if demonstrations is not None:
            self._load(demonstrations, observation_size, maturity)

    def _load(self, data: Demonstrations, observation_size: int, maturity: float) -> None:
        found = data.observation.shape[1]
        if found != observation_size:
            raise DatasetError(
                f"demonstrations: an observation has {found} numbers, the environment's {observation_size}; "
                "collect them with the same robot and encoder"
            )
        for what, recorded, wanted in (
            ("reward terms", data.reward_terms.shape[1], self._num_terms),
            ("features", data.features.shape[1], self._num_features),
        ):
            if recorded != wanted:
                raise DatasetError(
                    f"demonstrations: a step has {recorded} {what}, the run's reward {wanted}; "
                    "collect them with the run's reward"
                )
        periods = np.broadcast_to(data.periods, len(data))
        ended_at = np.cumsum(periods)[data.ended]
        self.longest_demonstration = float(np.diff(ended_at, prepend=0.0).max())
        stored = np.full((len(data), 1), maturity)
        sources = {
            "observation": data.observation,
            "next_observation": data.next_observation,
            "action": data.action,
            "signals": np.concatenate([data.reward_terms, data.features, stored], axis=1),
            "ending": _ending(data.terminated, data.truncated),
            "discount": step_discounts(self._gamma, periods),
        }
        for name, source in sources.items():
            self._store[name][self._ring :] = source
        self._labels[:] = data.expert_action

    def add(
        self,
        observation: F32,
        action: F32,
        terms: F32,
        features: F32,
        next_observation: F32,
        terminated: Mask,
        truncated: Mask,
        maturity: float,
        periods: Array,
    ) -> None:
        """Write one step of all N environments. next_observation: the true successors, before any reset; maturity:
        S of today's reward weights, for the literal eq 17; periods: (N,) its length in reference periods."""
        online, head = self._online, self.head
        online["observation"][:, head] = observation
        online["next_observation"][:, head] = next_observation
        online["action"][:, head] = action
        online["signals"][:, head, : self._num_terms] = terms
        online["signals"][:, head, self._num_terms : -1] = features
        online["signals"][:, head, -1] = maturity
        online["discount"][:, head] = step_discounts(self._gamma, periods)
        online["ending"][:, head] = _ending(terminated, truncated)
        self._failures.add(self.steps, terminated & (terms[:, FAILURE_TERM] < 0.0))
        self.steps += 1

    @property
    def head(self) -> int:
        """Row written next."""
        return self.steps % self.rows

    @property
    def count(self) -> int:
        """Rows that hold data."""
        return min(self.steps, self.rows)

    @property
    def ready(self) -> bool:
        """Whether an online window fits."""
        return self.count >= self.n_step

    def sample(self, rng: np.random.Generator, updates: int, online_rows: int, expert_rows: int) -> Batch:
        """Batches of `updates` updates, the expert rows of each first: arrays (updates, rows, ...), fresh.

        Windows are drawn uniformly from each of the two buffers, but for the last failure_share of the online rows,
        which lead to failures where there are any. target_noise is drawn too.
        """
        windows = np.empty((updates, expert_rows + online_rows, self.n_step), np.int64)
        if expert_rows:
            windows[:, :expert_rows] = self._expert_windows(rng, updates * expert_rows).reshape(
                updates, expert_rows, -1
            )
        if online_rows:
            windows[:, expert_rows:] = self._online_windows(rng, updates * online_rows).reshape(
                updates, online_rows, -1
            )
        self._failures.forget_before(self.steps - self.count)
        to_failures = round(self._failure_share * online_rows)
        if to_failures and len(self._failures):
            windows[:, -to_failures:] = self._failure_windows(rng, updates * to_failures).reshape(
                updates, to_failures, -1
            )
        noise = rng.standard_normal((*windows.shape[:2], ACTION_SIZE), dtype=np.float32)
        return self.gather(windows, noise)

    def _online_windows(self, rng: np.random.Generator, count: int) -> NDArray[np.int64]:
        """(count, n) indices. No window starts in the newest n - 1 rows: it would run over the write head."""
        starts = self.count - self.n_step + 1
        env, offset = np.divmod(rng.integers(self.num_envs * starts, size=count), starts)
        steps = (self.head - self.count + offset)[:, None] + np.arange(self.n_step)
        return steps % self.rows + (env * self.rows)[:, None]

    def _failure_windows(self, rng: np.random.Generator, count: int) -> NDArray[np.int64]:
        """(count, n) indices. A window that runs over the write head stops at the failure before it."""
        steps, env = self._failures.draw(rng, count)
        starts = np.maximum(steps - rng.integers(FAILURE_STEPS, size=count), self.steps - self.count)
        return (starts[:, None] + np.arange(self.n_step)) % self.rows + (env * self.rows)[:, None]

    def _expert_windows(self, rng: np.random.Generator, count: int) -> NDArray[np.int64]:
        """(count, n) indices. A window stops at the end of its episode, so it may start anywhere."""
        steps = rng.integers(self.expert_steps, size=count)[:, None] + np.arange(self.n_step)
        return self._ring + np.minimum(steps, self.expert_steps - 1)

    def gather(self, windows: NDArray[np.int64], noise: F32) -> Batch:
        """(..., n) indices of windows -> their contents, arrays (..., ...).

        A window stops after the step that ends its episode, terminated or truncated; it bootstraps from that
        step's successor, unless it terminated.
        """
        ending, discount = self._take("ending", windows), self._take("discount", windows)
        step_discount = np.empty(windows.shape, np.float32)
        step_discount[..., 0] = 1.0
        alive = np.ones(windows.shape[:-1], bool)
        last, last_ending = windows[..., 0], ending[..., 0]
        bootstrap = discount[..., 0]
        for j in range(1, self.n_step):
            alive = alive & (ending[..., j - 1] == CONTINUES)
            step_discount[..., j] = alive * bootstrap
            bootstrap = np.where(alive, bootstrap * discount[..., j], bootstrap)
            last = np.where(alive, windows[..., j], last)
            last_ending = np.where(alive, ending[..., j], last_ending)
        first = windows[..., 0]
        observation, action = self._take("observation", first), self._take("action", first)
        successor = self._take("next_observation", last)
        if self._mirror is not None:
            self._mirror.observation(observation[..., ::2, :])
            self._mirror.observation(successor[..., ::2, :])
            self._mirror.action(action[..., ::2, :])
        return Batch(
            observation=observation,
            action=action,
            signals=self._take("signals", windows),
            step_discount=step_discount,
            bootstrap_observation=successor,
            bootstrap_discount=np.where(last_ending != TERMINATED, bootstrap, 0.0).astype(np.float32),
            target_noise=noise,
        )

    def _take(self, name: str, index: NDArray[np.int64]) -> NDArray[Any]:
        # "wrap" skips numpy's slow bounds check; every index is inside already.
        return np.take(self._store[name], index, axis=0, mode="wrap")

    def sample_labels(self, rng: np.random.Generator, shape: tuple[int, ...]) -> ExpertBatch:
        """Draw demonstration rows uniformly: states and the expert's actions in them, (*shape, ...)."""
        index = rng.integers(self.expert_steps, size=shape)
        labels = np.take(self._labels, index, axis=0, mode="wrap")
        observation = self._take("observation", self._ring + index)
        if self._mirror is not None:
            self._mirror.observation(observation[..., ::2, :])
            self._mirror.action(labels[..., ::2, :])
        return ExpertBatch(observation, labels)

    def newest(self, rows: int) -> tuple[F32, F32]:
        """Reward terms and features of the last `rows` rows, at most those that hold data: (N, rows, ...)."""
        rows = min(rows, self.count)
        signals = self._online["signals"][:, np.arange(self.head - rows, self.head) % self.rows]
        return signals[..., : self._num_terms], signals[..., self._num_terms : -1]

    def checksum(self) -> int:
        """Of the demonstrations: a resumed run must be given the same."""
        total = zlib.crc32(self._labels.tobytes())
        for name, array in self._store.items():
            if (
                name != "discount"
            ):  # what discounts follow from is the run's own, and of before there are none
                total = zlib.crc32(array[self._ring :].tobytes(), total)
        return total

    def state(self) -> dict[str, NDArray[Any]]:
        """The online rows that hold data, and the head: enough for a byte-equal resume."""
        filled = {name: array[:, : self.count] for name, array in self._online.items()}
        return filled | {"steps": np.array(self.steps, dtype=np.int64)}

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Continue from what state() returned. Raises CheckpointError if it is of another shape."""
        steps = int(state["steps"])
        count = min(steps, self.rows)
        for name, array in self._online.items():
            expected = (self.num_envs, count, *array.shape[2:])
            if state[name].shape != expected or state[name].dtype != array.dtype:
                raise CheckpointError(
                    f"the checkpoint's replay {name!r} is {state[name].shape}, not {expected}"
                )
            array[:, :count] = state[name]
        self.steps, self._failures = steps, Failures()
        for step in range(steps - count, steps):
            row = step % self.rows
            ended = self._online["ending"][:, row] == TERMINATED
            self._failures.add(step, ended & (self._online["signals"][:, row, FAILURE_TERM] < 0.0))


def _ending(terminated: Mask, truncated: Mask) -> NDArray[np.uint8]:
    """Termination wins where both are set: a terminated state has no value to bootstrap from."""
    return np.where(terminated, TERMINATED, np.where(truncated, TRUNCATED, CONTINUES)).astype(np.uint8)
