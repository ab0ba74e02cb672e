"""Replay of reward terms, not rewards: what is sampled gets the reward of today's weights (eq 17).

Arrays are time-major rings (T, N, ...), so that an n-step window is a run of rows. The successor of every step is
stored beside it: an ended episode's next row in the ring is another episode's first. What leaves here is a fresh
copy: JAX may alias an array it is handed, and the ring is written again.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.agents.losses import Batch, ExpertBatch
from adrl.errors import CheckpointError, DatasetError

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

NUM_TERMS, NUM_FEATURES, ACTION_SIZE = 6, 3, 2


class Demonstrations(Protocol):
    """Expert data D2: M steps, each episode's in order, the last one of each marked terminated or truncated."""

    @property
    def observation(self) -> F32: ...  # (M, D) s_t
    @property
    def action(self) -> F32: ...  # (M, 2) executed
    @property
    def expert_action(self) -> F32: ...  # (M, 2) the expert's label
    @property
    def next_observation(self) -> F32: ...  # (M, D) true successor
    @property
    def reward_terms(self) -> F32: ...  # (M, R)
    @property
    def features(self) -> F32: ...  # (M, F) of s_t
    @property
    def terminated(self) -> Mask: ...  # (M,)
    @property
    def truncated(self) -> Mask: ...  # (M,)


class Replay:
    """A ring of T rows of N environments."""

    def __init__(self, rows: int, num_envs: int, observation_size: int, n_step: int, gamma: float) -> None:
        """rows: T, at least n_step. n_step, gamma: of the targets sampled from it."""
        self.n_step = n_step
        self.rows = max(rows, n_step)
        self.num_envs = num_envs
        self._discounts = (gamma ** np.arange(n_step + 1)).astype(np.float32)
        shape = (self.rows, num_envs)
        # np.zeros takes memory only as it is written.
        self.arrays: dict[str, NDArray[Any]] = {
            "observation": np.zeros((*shape, observation_size), np.float32),
            "next_observation": np.zeros((*shape, observation_size), np.float32),
            "action": np.zeros((*shape, ACTION_SIZE), np.float32),
            "terms": np.zeros((*shape, NUM_TERMS), np.float32),
            "features": np.zeros((*shape, NUM_FEATURES), np.float32),
            "terminated": np.zeros(shape, np.bool_),
            "truncated": np.zeros(shape, np.bool_),
        }
        self.head = 0
        """Row written next."""
        self.count = 0
        """Rows that hold data."""
        self.margin = n_step - 1
        """Newest rows that no window may start in: it would run over the write head."""
        self._flatten()

    def _flatten(self) -> None:
        self._flat = {name: a.reshape(-1, *a.shape[2:]) for name, a in self.arrays.items()}

    def add(
        self,
        observation: F32,
        action: F32,
        terms: F32,
        features: F32,
        next_observation: F32,
        terminated: Mask,
        truncated: Mask,
    ) -> None:
        """Write one step of all N environments. next_observation: the true successors, before any reset."""
        values = (observation, next_observation, action, terms, features, terminated, truncated)
        for array, value in zip(self.arrays.values(), values, strict=True):
            array[self.head] = value
        self.head = (self.head + 1) % self.rows
        self.count = min(self.count + 1, self.rows)

    @property
    def ready(self) -> bool:
        """Whether a window fits."""
        return self.count > self.margin

    def sample(self, rng: np.random.Generator, count: int) -> Batch:
        """Draw `count` windows uniformly. Arrays are (count, ...) and owned by the caller; target_noise is drawn too."""
        oldest = self.head - self.count
        time = oldest + rng.integers(self.count - self.margin, size=count)
        env = rng.integers(self.num_envs, size=count)
        noise = rng.standard_normal((count, ACTION_SIZE), dtype=np.float32)
        return self.gather(time, env, noise)

    def gather(self, time: NDArray[np.int64], env: NDArray[np.int64], noise: F32) -> Batch:
        """The windows that start at rows `time` (modulo the ring) of environments `env`, (B,) each.

        A window stops after the step that ends its episode, terminated or truncated; it bootstraps from that step's
        successor, unless it terminated.
        """
        steps = (time[:, None] + np.arange(self.n_step)) % self.rows  # (B, n)
        window = steps * self.num_envs + env[:, None]
        ended = self._take("terminated", window) | self._take("truncated", window)
        alive = np.ones(window.shape, dtype=bool)
        np.logical_and.accumulate(~ended[:, :-1], axis=1, out=alive[:, 1:])
        length = alive.sum(axis=1)  # k of each window
        last = window[np.arange(len(window)), length - 1]
        terminated = self._take("terminated", last)
        return Batch(
            observation=self._take("observation", window[:, 0]),
            action=self._take("action", window[:, 0]),
            terms=self._take("terms", window),
            features=self._take("features", window),
            step_discount=self._discounts[:-1] * alive,
            bootstrap_observation=self._take("next_observation", last),
            bootstrap_discount=self._discounts[length] * ~terminated,
            target_noise=noise,
        )

    def _take(self, name: str, index: NDArray[np.int64]) -> NDArray[Any]:
        # "wrap" skips numpy's slow bounds check; every index is inside already.
        return np.take(self._flat[name], index, axis=0, mode="wrap")

    def newest(self, name: str, rows: int) -> NDArray[Any]:
        """The last `rows` rows of an array, at most those that hold data: (rows, N, ...), a copy."""
        rows = min(rows, self.count)
        return self.arrays[name][np.arange(self.head - rows, self.head) % self.rows]

    def state(self) -> dict[str, NDArray[Any]]:
        """The rows that hold data, and the head: enough for a byte-equal resume. Views, not copies."""
        filled = {name: array[: self.count] for name, array in self.arrays.items()}
        return filled | {"position": np.array([self.head, self.count], dtype=np.int64)}

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Continue from what state() returned. Raises CheckpointError if it is of another shape."""
        head, count = (int(x) for x in state["position"])
        if not (0 <= head < self.rows and 0 <= count <= self.rows):
            raise CheckpointError(f"replay has {self.rows} rows, the checkpoint was written with more")
        for name, array in self.arrays.items():
            if state[name].shape != (count, *array.shape[1:]) or state[name].dtype != array.dtype:
                raise CheckpointError(
                    f"replay array {name!r} is {state[name].shape}, expected {(count, *array.shape[1:])}"
                )
            array[:count] = state[name]
        self.head, self.count = head, count


class ExpertReplay(Replay):
    """The demonstrations D2 as windows, and as rows for the cloning term."""

    def __init__(self, data: Demonstrations, n_step: int, gamma: float) -> None:
        """Raises DatasetError if arrays disagree in length or hold NaN, or the last episode is not ended."""
        _check(data)
        rows = len(data.observation)
        super().__init__(rows, 1, data.observation.shape[1], n_step, gamma)
        sources = {
            "observation": data.observation,
            "next_observation": data.next_observation,
            "action": data.action,
            "terms": data.reward_terms,
            "features": data.features,
            "terminated": data.terminated,
            "truncated": data.truncated,
        }
        for name, source in sources.items():
            self.arrays[name][:rows, 0] = source
        self.count, self.head = rows, rows % self.rows
        # Every window stops at the end of its episode, so it may start anywhere.
        self.margin = 0
        self._label = np.ascontiguousarray(data.expert_action, dtype=np.float32)

    def require_size(self, observation_size: int) -> None:
        """Raises DatasetError if the observations are not of this length."""
        found = self.arrays["observation"].shape[-1]
        if found != observation_size:
            raise DatasetError(
                f"the demonstrations' observations have {found} numbers, the environment's {observation_size}; "
                "collect them with the same robot and encoder"
            )

    def sample_labels(self, rng: np.random.Generator, count: int) -> ExpertBatch:
        """Draw `count` rows uniformly: states and the expert's actions in them."""
        index = rng.integers(self.count, size=count)
        return ExpertBatch(self._take("observation", index), self._label[index])


def _check(data: Demonstrations) -> None:
    rows = len(data.observation)
    if rows == 0:
        raise DatasetError("the demonstrations hold no step; collect some first")
    widths = {
        "observation": data.observation.shape[1:],
        "next_observation": data.observation.shape[1:],
        "action": (ACTION_SIZE,),
        "expert_action": (ACTION_SIZE,),
        "reward_terms": (NUM_TERMS,),
        "features": (NUM_FEATURES,),
        "terminated": (),
        "truncated": (),
    }
    for name, width in widths.items():
        array = getattr(data, name)
        if array.shape != (rows, *width):
            raise DatasetError(f"demonstrations.{name} is {array.shape}, expected {(rows, *width)}")
        if not np.isfinite(array).all():
            raise DatasetError(f"demonstrations.{name} holds NaN or infinity")
    if not (data.terminated[-1] or data.truncated[-1]):
        raise DatasetError("the demonstrations' last step ends no episode; mark it truncated")


def mix(expert: Batch | None, online: Batch | None, updates: int) -> Batch:
    """D = (1 - alpha) D1 + alpha D2 (eq 4): batches of `updates` * rows each -> arrays (updates, rows, ...).

    Each update's rows are the expert's first, then the online ones.
    """
    parts = [part for part in (expert, online) if part is not None and len(part.observation)]
    split = [[field.reshape(updates, -1, *field.shape[1:]) for field in part] for part in parts]
    if len(split) == 1:
        return Batch(*split[0])
    return Batch(*(np.concatenate(fields, axis=1) for fields in zip(*split, strict=True)))
