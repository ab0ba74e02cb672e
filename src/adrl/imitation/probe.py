"""The probe: fixed states along an expert's routes, and what chance and the expert earn from them (eq 13).

Not start states alone: with a horizon of five seconds the value of a start says little about arriving.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adrl.imitation.demonstrations import Demonstrations
from adrl.imitation.schedule import Bounds
from adrl.rewards import RewardConfig, reward
from adrl.types import Array

F32 = NDArray[np.float32]


class ProbeEnv(Protocol):
    """What a vector environment must offer to be probed; NavVectorEnv does."""

    num_envs: int

    @property
    def periods(self) -> Array:
        """(N,) length of a step of each row's present robot, in reference periods."""
        ...

    def reset(self, *, seed: int | None = None) -> tuple[F32, dict[str, Any]]:
        """Start new episodes in every row."""
        ...

    def advance(self, actions: F32) -> tuple[F32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Gymnasium's vector step without the reward, with reward_terms and features in info."""
        ...

    def expert_actions(self) -> F32:
        """(N, 2) the expert's actions in the current states."""
        ...

    def state(self) -> dict[str, NDArray[Any]]:
        """All that changes."""
        ...

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Rollouts:
    """One episode a row, or its first T steps. Rewards are formed from this under any weights."""

    terms: F32
    """(T, P, R) reward terms."""
    features: F32
    """(T, P, F) features of the states in which the actions were taken."""
    alive: NDArray[np.bool_]
    """(T, P) whether the step belongs to the row's first episode."""
    periods: Array
    """(P,) length of a row's steps in reference periods."""

    def value(self, maturity: float, gamma: float, config: RewardConfig) -> float:
        """Mean over the rows of the discounted return under the weights of S = maturity. gamma: a reference period."""
        rewards = reward(self.terms, self.features, maturity, config) * self.alive  # (T, P)
        returns, steps = np.empty(len(self.periods)), np.arange(len(self.alive))
        for periods in np.unique(self.periods):
            rows = self.periods == periods
            returns[rows] = (gamma ** float(periods)) ** steps @ rewards[:, rows]
        return float(returns.mean())


@dataclass(frozen=True, eq=False, kw_only=True)
class Probe:
    """Fixed states and the two policies' episodes from them."""

    observation: F32
    """(P, D) observations of the states."""
    random: Rollouts
    expert: Rollouts

    def bounds(self, maturity: float, gamma: float, config: RewardConfig) -> Bounds:
        """Q_min and Q_max of eq 13 under the weights of S = maturity."""
        return Bounds(self.random.value(maturity, gamma, config), self.expert.value(maturity, gamma, config))


class BoundsTable:
    """Bounds on a grid of S, so that a training step only interpolates."""

    def __init__(self, probe: Probe, gamma: float, config: RewardConfig, points: int = 21) -> None:
        self._grid = np.linspace(0.0, 1.0, points)
        bounds = [probe.bounds(s, gamma, config) for s in self._grid]
        self._low, self._high = np.array(bounds).T

    def at(self, maturity: float) -> Bounds:
        """Bounds at S = maturity."""
        low = np.interp(maturity, self._grid, self._low)
        high = np.interp(maturity, self._grid, self._high)
        return Bounds(float(low), float(high))


CUT_SHARE = 0.02
"""Share of a discounted return that lies beyond the probe's last step: 194 steps at gamma = 0.98."""
LONGEST = 3000
STOPS, STOP_STEPS = 8, 25
"""A state of the probe lies 0, 25, ..., 175 steps down the expert's way: a copy of the whole state each is enough."""


MOST_STOPS = 1024
"""More of them would make no mean of recorded returns better."""


def probe_steps(gamma: float) -> int:
    """Steps, discounted by gamma each, after which CUT_SHARE of a return is left: what they would add is little."""
    return LONGEST if gamma >= 1.0 else min(round(math.log(CUT_SHARE) / math.log(max(gamma, 1e-6))), LONGEST)


def record_probe(env: ProbeEnv, seed: int, max_steps: int, act: Callable[[], F32] | None = None) -> Probe:
    """Run a random policy and the expert from the same num_envs / 2 states, at most max_steps each; see probe_steps.

    Both at once, the first half of the rows at random: a step costs hardly more for twice the rows. A random action is
    held for ten steps: drawn anew each step it would average out to standing still. act: the expert's actions in the
    current states; env.expert_actions when None.
    """
    act = act or env.expert_actions
    rng = np.random.Generator(np.random.PCG64(seed))
    observation, start = _along_routes(env, seed, rng, act)
    half = env.num_envs // 2
    for array in start.values():
        if len(array) == env.num_envs:  # the rest, such as a random generator, is of no row
            array[half : 2 * half] = array[:half]
    env.set_state(start)
    held = np.zeros((half, 2), dtype=np.float32)

    def actions(step: int) -> F32:
        if step % 10 == 0:
            held[:] = rng.uniform(-1.0, 1.0, size=held.shape)
        chosen = np.array(act(), dtype=np.float32)
        chosen[:half] = held
        return chosen

    periods = np.array(env.periods)
    terms, features, alive = _record(env, actions, max_steps)
    random, expert = (
        Rollouts(
            terms=terms[:, rows], features=features[:, rows], alive=alive[:, rows], periods=periods[rows]
        )
        for rows in (slice(half), slice(half, 2 * half))
    )
    return Probe(observation=observation[:half], random=random, expert=expert)


def as_shown(demonstrations: Demonstrations, max_steps: int) -> Rollouts:
    """What the drives themselves earned, from stops along each: of an expert that cannot be asked for more.

    Stops near the end of a recording that was cut off tell less than max_steps steps; they are left out, if there are
    others.
    """
    last = np.flatnonzero(demonstrations.ended)
    first = np.concatenate([[0], last[:-1] + 1])
    stops = first[:, None] + STOP_STEPS * np.arange(STOPS)  # (drives, STOPS)
    end = np.broadcast_to(last[:, None] + 1, stops.shape)
    within = stops < end
    start, end = stops[within], end[within]
    whole = demonstrations.terminated[end - 1] | (start + max_steps <= end)
    if whole.any():
        start, end = start[whole], end[whole]
    chosen = np.linspace(0, len(start) - 1, min(len(start), MOST_STOPS)).astype(np.intp)
    start, end = start[chosen], end[chosen]
    step = start + np.arange(min(max_steps, int((end - start).max())))[:, None]  # (T, P)
    alive = step < end
    step = np.where(alive, step, start)
    return Rollouts(
        terms=demonstrations.reward_terms[step],
        features=demonstrations.features[step],
        alive=alive,
        periods=np.broadcast_to(demonstrations.periods, len(demonstrations))[start],
    )


def _along_routes(
    env: ProbeEnv, seed: int, rng: np.random.Generator, act: Callable[[], F32]
) -> tuple[F32, dict[str, NDArray[Any]]]:
    """Observations (P, D) and states of rows that the expert has driven for different times, each as it was then."""
    observation, _ = env.reset(seed=seed)
    chosen, state = np.array(observation, dtype=np.float32), env.state()
    stop = rng.integers(STOPS, size=env.num_envs)
    for number in range(1, STOPS):
        for _ in range(STOP_STEPS):
            observation = env.advance(act())[0]
        rows = stop == number
        chosen[rows] = observation[rows]
        for name, array in env.state().items():
            if len(array) == env.num_envs:
                state[name][rows] = array[rows]
    return chosen, state


def _record(env: ProbeEnv, act: Callable[[int], F32], max_steps: int) -> tuple[F32, F32, NDArray[np.bool_]]:
    """Terms, features and alive of Rollouts, of all rows."""
    alive = np.ones(env.num_envs, dtype=bool)
    terms, features, mask = [], [], []
    for step in range(max_steps):
        _, terminated, truncated, info = env.advance(act(step))
        terms.append(np.array(info["reward_terms"], dtype=np.float32))
        features.append(np.array(info["features"], dtype=np.float32))
        mask.append(alive.copy())
        alive &= ~(terminated | truncated)
        if not alive.any():
            break
    return np.stack(terms), np.stack(features), np.stack(mask)
