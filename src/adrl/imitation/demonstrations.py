"""Demonstrations of an expert, recorded with noise so that getting back on course is seen too."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError, DatasetError
from adrl.imitation.bursts import Bursts
from adrl.imitation.experts import PERFECT, Expert, find_expert
from adrl.ranges import Range, check_ranges
from adrl.rewards import FEATURES
from adrl.types import ACTION_SIZE, Array

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class NoiseConfig:
    """How the demonstrator is pushed off its course.

    A row drives as the expert says until a burst begins; then one normal offset is added to the expert's
    actions and held until the burst ends. Noise drawn anew each step would average out and lead nowhere;
    between bursts the expert is seen to recover. Both waiting times are geometric. Chosen by what cloning
    makes of 40,000 steps of `clutter`: 40 % success without noise, 60 % with (0.3, 0.5, 0.8 s), 66 % with
    (0.5, 0.5, 0.8 s), 72 % with these, where the demonstrator itself still arrives in 93 %.
    """

    fraction: Annotated[float, Range(0.0, 0.99)] = 0.5
    """Share of the time that bursts take; 0 for none; 0 to 0.99."""
    std: Annotated[float, Range(0.0, 10.0)] = 0.3
    """Standard deviation of the offset, in units of the normalised action; 0 to 10."""
    burst_s: Annotated[float, Range(0.001, 1000.0)] = 1.6
    """Mean length of a burst; 0.001 to 1000."""

    def __post_init__(self) -> None:
        check_ranges(self, "noise.")


@dataclass(frozen=True, eq=False, kw_only=True)
class Demonstrations:
    """M steps, each episode's in order; the last step of an episode is terminated or truncated, never both.

    Raises DatasetError if there is no step, arrays disagree, hold NaN or infinity, or the last episode has no
    end.
    """

    observation: F32
    """(M, D) s_t."""
    action: F32
    """(M, 2) executed, in [-1, 1]."""
    expert_action: F32
    """(M, 2) what the expert would do in s_t."""
    next_observation: F32
    """(M, D) true successor, also of an episode's last step."""
    reward_terms: F32
    """(M, R) r_i of eqs 7-12."""
    features: F32
    """(M, F) T_obs, T_goal, T_stop of s_t."""
    terminated: Mask
    """(M,) arrived or collided."""
    truncated: Mask
    """(M,) cut off: by the time limit, or by the end of the recording."""
    periods: Array | float = 1.0
    """(M,) length of a step in reference periods (adrl.rewards.step), or one for all."""

    def __post_init__(self) -> None:
        steps = len(self.observation)
        if steps == 0:
            raise DatasetError("the demonstrations hold no step; collect some first")
        size, num_terms, num_features = (
            array.shape[-1] for array in (self.observation, self.reward_terms, self.features)
        )
        # A reward may bring more features; the three are always there.
        for name, shape in column_shapes(size, num_terms, max(num_features, len(FEATURES))).items():
            array = getattr(self, name)
            if array.shape != (steps, *shape):
                raise DatasetError(f"demonstrations: {name} is {array.shape}, expected {(steps, *shape)}")
            if not np.isfinite(array).all():
                raise DatasetError(f"demonstrations: {name} holds NaN or infinity")
        if (self.terminated & self.truncated).any():
            raise DatasetError(
                "demonstrations: a step is both terminated and truncated; an arrival is no timeout"
            )
        if not (self.terminated[-1] or self.truncated[-1]):
            raise DatasetError("demonstrations: the last step ends no episode; mark it truncated")

    def __len__(self) -> int:
        return len(self.observation)

    @property
    def ended(self) -> Mask:
        """(M,) whether a step is its episode's last."""
        return self.terminated | self.truncated

    @property
    def success(self) -> Mask:
        """(M,) whether a step reached the goal."""
        return self.reward_terms[:, 0] > 0.0


def column_shapes(observation_size: int, num_terms: int, num_features: int) -> dict[str, tuple[int, ...]]:
    """D, R, F -> shape of one step of each array of Demonstrations."""
    return {
        "observation": (observation_size,),
        "action": (ACTION_SIZE,),
        "expert_action": (ACTION_SIZE,),
        "next_observation": (observation_size,),
        "reward_terms": (num_terms,),
        "features": (num_features,),
        "terminated": (),
        "truncated": (),
    }


def collect(
    env: "NavVectorEnv",
    num_steps: int,
    *,
    expert: str | Expert = PERFECT,
    noise: NoiseConfig | None = None,
    seed: int = 0,
    learner: Callable[[F32], F32] | None = None,
    on_step: Callable[[int, int], None] | None = None,
) -> Demonstrations:
    """Let an expert drive all rows of env for at least num_steps steps together, disturbed by noise.

    Records what was executed and what the expert would have done. learner: observations (N, D) -> actions (N, 2),
    drives in the expert's place, so that labels are of the states that it comes to (DAgger, Ross et al. 2011). An
    expert of so many `drives` shows these instead of num_steps steps. seed: of the tasks, the sensors, the expert and
    the noise; equal seeds give equal bytes. on_step(done, total) is told the progress, in steps or drives. Episodes
    that run at the end are marked truncated, as are drives that the expert gives up. Raises ConfigError if there is
    nothing to record, env does not reset ended rows by itself, or the expert cannot drive its robot.
    """
    if num_steps < 1:
        raise ConfigError(f"the number of demonstration steps is {num_steps}; give 1 or more")
    if env.metadata["autoreset_mode"].value != "SameStep":
        raise ConfigError("demonstrations need an environment with autoreset_mode SameStep")
    expert = find_expert(expert)
    extent = _Extent(env.num_envs, num_steps, getattr(expert, "drives", None))
    observation, _ = env.reset(seed=seed)
    driver = expert.driver(env, seed)
    noise_rng = np.random.default_rng((seed, 1))
    offsets = _Offsets(noise or NoiseConfig(), env.num_envs, noise_rng)
    steps: list[dict[str, NDArray[Any]]] = []
    asked = nullcontext if learner is None else driver.advising
    while not extent.reached:
        with asked():
            label = driver.actions()
        meant = label if learner is None else learner(observation)
        action = driver.within_reach(meant + offsets.step(env.sim.rows.robot.control_period_s))
        periods = env.periods
        following, terminated, truncated, info = env.advance(action)
        given_up = driver.given_up & ~(terminated | truncated)
        if given_up.any():
            truncated = truncated | given_up
            following, _ = env.reset(options={"reset_mask": given_up})
        step = {
            "observation": observation,
            "action": action,
            "expert_action": label,
            "next_observation": info["next_obs"],
            "reward_terms": info["reward_terms"],
            "features": info["features"],
            "terminated": terminated,
            "truncated": truncated,
            "periods": periods,
        }
        steps.append({name: np.array(column) for name, column in step.items()})
        observation = following
        extent.add(terminated | truncated)
        if on_step is not None:
            on_step(extent.done, extent.total)
    data = {name: np.stack([step[name] for step in steps], axis=1) for name in steps[0]}  # (N, T, ...)
    data["truncated"][:, -1] |= ~data["terminated"][:, -1]
    kept = extent.kept(data["terminated"] | data["truncated"])
    return Demonstrations(**{name: column[kept] for name, column in data.items()})


class _Extent:
    """How much is recorded: a number of steps, or each row's share of a number of drives."""

    def __init__(self, num_envs: int, num_steps: int, drives: int | None) -> None:
        rows = np.arange(num_envs)
        self._drives = None if drives is None else drives // num_envs + (rows < drives % num_envs)
        self._ended = np.zeros(num_envs, dtype=np.int64)
        self._steps = 0
        self.total = drives or -(-num_steps // num_envs) * num_envs
        """Drives, or steps."""

    @property
    def done(self) -> int:
        """Of the total."""
        return self._steps if self._drives is None else int(np.minimum(self._ended, self._drives).sum())

    @property
    def reached(self) -> bool:
        return self.done >= self.total

    def add(self, ended: Mask) -> None:
        """A step of all rows (N,), and whose drives ended with it."""
        self._steps += len(ended)
        self._ended += ended

    def kept(self, ended: Mask) -> Mask:
        """(N, T) the steps, of those of which (N, T) are the last of their drives, that belong to what was wanted."""
        if self._drives is None:
            return np.ones_like(ended)
        return np.cumsum(ended, axis=1) - ended < self._drives[:, None]


class _Offsets:
    """What the demonstrator's actions are pushed by; see NoiseConfig."""

    def __init__(self, config: NoiseConfig, num_envs: int, rng: np.random.Generator) -> None:
        self._std, self._rng = np.float32(config.std), rng
        self._bursts = Bursts(num_envs, config.fraction, config.burst_s, rng)
        self._offset = np.zeros((num_envs, ACTION_SIZE), dtype=np.float32)

    def step(self, dt_s: Array) -> F32:
        """(N, 2) to add to the actions of a step of dt_s (N,)."""
        begins = self._bursts.step(dt_s)
        drawn = self._rng.standard_normal(self._offset.shape, dtype=np.float32) * self._std
        self._offset[begins] = drawn[begins]
        return self._offset * self._bursts.active[:, None]
