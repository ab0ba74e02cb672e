"""Tiny vector environments with the training contract, in which every value is known by hand."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.imitation.demonstrations import Demonstrations, column_shapes
from adrl.rewards import FEATURES, REWARD_TERMS, RewardConfig

F32 = NDArray[np.float32]

PLAIN = RewardConfig(scale=1.0)
"""Makes a step's reward the first of its terms."""


class ProbeEnv:
    """N rows. A state is a number x and the steps t since the row's start; the observation is (x, 1).

    Subclasses say what a step pays and how an episode ends.
    """

    length = 1
    """Steps an episode."""
    truncates = False
    """Whether it ends by truncation."""
    maturity = 0.0
    """S, as the training loop sets it."""

    def __init__(self, num_envs: int = 8) -> None:
        self.num_envs = num_envs
        self._rng = np.random.Generator(np.random.PCG64(0))
        self._x = np.zeros(num_envs, np.float32)
        self._t = np.zeros(num_envs, np.int64)
        self.buffer = np.zeros((num_envs, 2), np.float32)

    @property
    def periods(self) -> NDArray[np.float64]:
        """(N,) a step is a reference period."""
        return np.ones(self.num_envs)

    def start(self) -> F32:
        """(N,) x at the start of an episode."""
        return np.zeros(self.num_envs, np.float32)

    def pay(self, action: F32) -> F32:
        """(N,) reward of a step."""
        raise NotImplementedError

    def move(self, action: F32) -> F32:
        """(N,) next x."""
        return self._x

    def fail(self) -> NDArray[np.bool_]:
        """(N,) whether the step that ended in the present x failed, which ends the episode."""
        return np.zeros(self.num_envs, bool)

    def expert_actions(self) -> F32:
        """(N, 2)."""
        return np.full((self.num_envs, 2), 0.5, np.float32)

    def reset(self, *, seed: int | None = None) -> tuple[F32, dict[str, Any]]:
        if seed is not None:
            self._rng = np.random.Generator(np.random.PCG64(seed))
        self._x, self._t = self.start(), np.zeros(self.num_envs, np.int64)
        return self._observe(), {}

    def advance(self, actions: F32) -> tuple[F32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        rewards = self.pay(actions).astype(np.float32)
        self._x = self.move(actions).astype(np.float32)
        self._t = self._t + 1
        failed = self.fail()
        ended = (self._t >= self.length) | failed
        final = self._observe().copy()
        self._x = np.where(ended, self.start(), self._x)
        self._t[ended] = 0
        terms = np.zeros((self.num_envs, 6), np.float32)
        terms[:, 0], terms[:, 1] = rewards, -failed.astype(np.float32)
        info = {
            "reward_terms": terms,
            "features": np.zeros((self.num_envs, 3), np.float32),
            "next_obs": final,
            "success": ended & ~failed & (rewards > 0),
            "collision": failed,
        }
        terminated = failed if self.truncates else ended
        truncated = ended & ~terminated
        return self._observe(), terminated, truncated, info

    def state(self) -> dict[str, NDArray[Any]]:
        inner = self._rng.bit_generator.state["state"]
        halves = [inner[key] >> shift & (1 << 64) - 1 for key in ("state", "inc") for shift in (0, 64)]
        return {"x": self._x.copy(), "t": self._t.copy(), "rng": np.array(halves, np.uint64)}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._x, self._t = state["x"].copy(), state["t"].copy()
        a, b, c, d = (int(word) for word in state["rng"])
        self._rng.bit_generator.state = {
            "bit_generator": "PCG64",
            "state": {"state": a | b << 64, "inc": c | d << 64},
            "has_uint32": 0,
            "uinteger": 0,
        }

    def _observe(self) -> F32:
        # One buffer, written again every step, as a simulator does: who keeps it must copy it.
        self.buffer[:, 0] = self._x
        self.buffer[:, 1] = 1.0
        return self.buffer


class Constant(ProbeEnv):
    """One step, pays 1: Q = 1."""

    def pay(self, action: F32) -> F32:
        return np.ones(self.num_envs, np.float32)


class Signed(ProbeEnv):
    """One step, starts at x = -1 or 1, pays x: Q = x."""

    def start(self) -> F32:
        return np.where(self._rng.random(self.num_envs) < 0.5, -1.0, 1.0).astype(np.float32)

    def pay(self, action: F32) -> F32:
        return self._x


class TwoSteps(ProbeEnv):
    """x = 0, then x = 1; the second step pays 1: Q(0) = gamma, Q(1) = 1."""

    length = 2

    def pay(self, action: F32) -> F32:
        return self._x

    def move(self, action: F32) -> F32:
        return np.ones(self.num_envs, np.float32)


class Endless(ProbeEnv):
    """Pays 1 for ever and is truncated every 5 steps: Q = 1 / (1 - gamma)."""

    length, truncates = 5, True

    def pay(self, action: F32) -> F32:
        return np.ones(self.num_envs, np.float32)


class Aim(Signed):
    """One step, pays 1 - |a - target|^2 with target (0.6 x, -0.3): the actor finds it."""

    def pay(self, action: F32) -> F32:
        return 1.0 - ((action - self.expert_actions()) ** 2).sum(axis=1)

    def expert_actions(self) -> F32:
        return np.stack([0.6 * self._x, np.full(self.num_envs, -0.3, np.float32)], axis=1)


class Walk(ProbeEnv):
    """Ten steps from a random start: pays the way covered. For the resume tests."""

    length = 10

    def start(self) -> F32:
        return self._rng.uniform(-1.0, 0.0, self.num_envs).astype(np.float32)

    def pay(self, action: F32) -> F32:
        return 0.1 * action[:, 0]

    def move(self, action: F32) -> F32:
        return self._x + np.float32(0.1) * action[:, 0]


class Stumble(Walk):
    """A walk that also fails, now and then: left of -0.9."""

    def fail(self) -> NDArray[np.bool_]:
        return self._x < -0.9


def record_demonstrations(env: ProbeEnv, rows: int) -> Demonstrations:
    """Let the expert of env drive for `rows` steps."""
    observation = env.reset(seed=11)[0].copy()
    columns: dict[str, list[NDArray[Any]]] = {
        name: [] for name in column_shapes(2, len(REWARD_TERMS), len(FEATURES))
    }
    for _ in range(rows):
        action = env.expert_actions()
        following, terminated, truncated, info = env.advance(action)
        step = {
            "observation": observation,
            "action": action,
            "expert_action": action,
            "next_observation": info["next_obs"],
            "reward_terms": info["reward_terms"],
            "features": info["features"],
            "terminated": terminated,
            "truncated": truncated,
        }
        for name, column in columns.items():
            column.append(np.array(step[name]))
        observation = following.copy()
    columns["truncated"][-1] |= ~columns["terminated"][-1]
    flat = {
        name: np.stack(column, axis=1).reshape(-1, *column[0].shape[1:]) for name, column in columns.items()
    }
    return Demonstrations(**flat)
