"""Gymnasium vector environment over the batch simulator."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from adrl.envs.nav_sim import Body, NavSim
from adrl.envs.randomization import MILD, NOMINAL, Randomization
from adrl.envs.render import Renderer
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig, reward
from adrl.types import ACTION_SIZE, RobotConfig, Scenario, Task
from adrl.worlds import get_scenario, load_robot, robot_from_fields, task_set

F32 = NDArray[np.float32]

RENDER_FPS = 10
FAILURE_GAIN = 0.3
"""Weight of a task's latest episode in its failure rate."""


class TaskPool:
    """The first `size` tasks of a split, each made when it is first asked for."""

    def __init__(self, scenario: Scenario, robot: RobotConfig, split: str, size: int) -> None:
        if size < 1:
            raise ConfigError(f"task_pool is {size}; give 1 or more")
        self.size = size
        self._scenario, self._robot, self._split = scenario, robot, split
        self._tasks: dict[int, Task] = {}

    def __getitem__(self, index: int) -> Task:
        """Task `index` of the split."""
        if index not in self._tasks:
            self._tasks[index] = task_set(self._scenario, self._robot, self._split, 1, first=index)[0]
        return self._tasks[index]


class NavVectorEnv(VectorEnv[F32, F32, NDArray[Any]]):
    """N robots on tasks drawn from a scenario. Arrival and collision terminate, the time limit truncates.

    Observations (N, D) float32, see ObservationEncoder; actions (N, 2) float32 in [-1, 1]: speed, yaw rate.
    info: reward_terms (N, R), features (N, F), success, collision (N,) and final_obs (N, D), the true
    successor of every row, which differs from the observation where an episode has ended and another begun.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        scenario: str | Scenario = "clutter",
        robot: str | RobotConfig | Mapping[str, Any] = "diffbot",
        guidance: str = "goal",
        split: str = "train",
        task_pool: int = 512,
        task_priority: float = 0.0,
        randomize: bool | Randomization = True,
        encoder: EncoderConfig | Mapping[str, Any] | None = None,
        reward_config: RewardConfig | None = None,
        replanner: ReplannerConfig | None = None,
        maturity: float = 0.5,
        seed: int = 0,
        num_threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        body: Body | None = None,
    ) -> None:
        """split, task_pool: tasks are drawn from the first `task_pool` ones of the split.
        task_priority: chances are 0.1 + task_priority * the task's failure rate; 0 draws all alike.

        robot, encoder: also as their fields, as JSON gives them.
        randomize: False for the nominal robot, True for mild variation, or a Randomization.
        replanner: constants of guidance `replan`.
        maturity: S at first; see the property.
        seed: used until reset(seed=...) gives another. num_threads: 0 takes one per core.
        autoreset_mode: SAME_STEP, or DISABLED to reset with options={"reset_mask": mask}.
        body: moves and senses the robots instead of our simulator, as they are: randomize must be False.
        """
        if num_envs < 1:
            raise ConfigError(f"num_envs is {num_envs}; give 1 or more")
        self.num_envs = num_envs
        self.robot = robot_from_fields(robot) if isinstance(robot, Mapping) else load_robot(robot)
        self.scenario = get_scenario(scenario)
        randomization = {True: MILD, False: NOMINAL}[randomize] if isinstance(randomize, bool) else randomize
        self.sim = NavSim(
            num_envs,
            self.robot,
            guidance=guidance,
            randomization=randomization,
            encoder=EncoderConfig(**encoder) if isinstance(encoder, Mapping) else encoder,
            reward=reward_config,
            replanner=replanner,
            maturity=maturity,
            num_threads=num_threads,
            body=body,
        )
        self._maturity = maturity
        if not 0.0 <= task_priority <= 1000.0:
            raise ConfigError(f"task_priority is {task_priority}; give 0 to 1000")
        self._pool = TaskPool(self.scenario, self.robot, split, task_pool)
        self._priority = task_priority
        # As if all had failed so far: a task that nobody has tried is worth a try.
        self._failure_rate = np.ones(task_pool)
        self._autoreset = AutoresetMode(autoreset_mode)
        if self._autoreset is AutoresetMode.NEXT_STEP:
            raise ConfigError("autoreset_mode NextStep is not offered; take SameStep or Disabled")
        self.metadata = self.metadata | {"autoreset_mode": self._autoreset}
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._task_index = np.zeros(num_envs, dtype=np.int64)
        size, limit = self.sim.encoder.size, self.sim.encoder.limit
        self.single_observation_space = spaces.Box(-limit, limit, (size,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._renderer = Renderer() if render_mode is not None else None

    @property
    def maturity(self) -> float:
        """S of eq 13: sets the weights of the reward (eqs 14-16), which our learner forms itself, and the replanner's
        thresholds (eq 20)."""
        return self._maturity

    @maturity.setter
    def maturity(self, value: float) -> None:
        self._maturity = value
        if self.sim.replanner is not None:
            self.sim.replanner.maturity = value

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[F32, dict[str, Any]]:
        """Start new episodes: all, or those of options["reset_mask"] (N,) bool. Returns (N, D), info."""
        if seed is not None:
            self._rng = np.random.Generator(np.random.PCG64(seed))
            self._failure_rate[:] = 1.0
        mask = (options or {}).get("reset_mask")
        indices = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        self._begin(indices)
        return self.sim.observe(), {}

    def step(self, actions: F32) -> tuple[F32, F32, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Execute (N, 2) actions for one control period. Returns obs, reward, terminated, truncated, info."""
        outcome = self.sim.step(np.asarray(actions, dtype=np.float32).reshape(self.num_envs, 2))
        terminated = outcome.reached | outcome.collided
        truncated = outcome.timed_out
        if self.sim.reward.eq8 == "literal":
            # A timeout is a failure there: it is paid for, and nothing comes after it.
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        observation = self.sim.observe()
        info = {
            "reward_terms": outcome.reward_terms,
            "features": outcome.features,
            "success": outcome.reached,
            "collision": outcome.collided,
            "final_obs": observation,
        }
        ended = terminated | truncated
        if ended.any():
            for i in np.flatnonzero(ended):  # one by one: several robots may have driven the same task
                task = self._task_index[i]
                self._failure_rate[task] += FAILURE_GAIN * (
                    float(~outcome.reached[i]) - self._failure_rate[task]
                )
        if self._autoreset is AutoresetMode.SAME_STEP and ended.any():
            info["_final_obs"] = ended
            self._begin(np.flatnonzero(ended))
            observation = self.sim.observe()
        rewards = reward(outcome.reward_terms, outcome.features, self._maturity, self.sim.reward)
        return observation, np.asarray(rewards, dtype=np.float32), terminated, truncated, info

    def expert_actions(self) -> F32:
        """(N, 2) actions of A*+DWA, which knows everything, in the current states."""
        return self.sim.expert_actions()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One (H, W, 3) picture a robot, in render mode rgb_array."""
        if self._renderer is None:
            return None
        return tuple(self._renderer.draw(self.sim, i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window, if any."""
        if self._renderer is not None:
            self._renderer.close()

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes, as arrays: with the constructor's arguments, enough to resume."""
        own = {"task_index": self._task_index.copy(), "failure_rate": self._failure_rate.copy()}
        return self.sim.state() | own | {"rng": _pack(self._rng)}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned."""
        self._task_index[:] = state["task_index"]
        self._failure_rate[:] = state["failure_rate"]
        _unpack(self._rng, state["rng"])
        self.sim.set_state(state, [self._pool[int(i)] for i in self._task_index])

    def _begin(self, indices: NDArray[np.intp]) -> None:
        if self._priority == 0.0:
            chosen = self._rng.integers(self._pool.size, size=len(indices))
        else:
            chance = 0.1 + self._priority * self._failure_rate
            chosen = self._rng.choice(self._pool.size, size=len(indices), p=chance / chance.sum())
        seeds = self._rng.integers(2**63, size=len(indices), dtype=np.uint64)
        self._task_index[indices] = chosen
        self.sim.reset(indices, [self._pool[int(i)] for i in chosen], seeds, self._rng)


def _pack(rng: np.random.Generator) -> NDArray[np.uint64]:
    """(6,) the state of a PCG64 generator: two 128-bit numbers as halves, and the buffered 32 bits."""
    state = rng.bit_generator.state
    low = (1 << 64) - 1
    numbers = [state["state"]["state"], state["state"]["inc"]]
    words = [half for number in numbers for half in (number & low, number >> 64)]
    return np.array([*words, state["has_uint32"], state["uinteger"]], dtype=np.uint64)


def _unpack(rng: np.random.Generator, words: NDArray[np.uint64]) -> None:
    w = [int(x) for x in words]
    rng.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": w[0] | w[1] << 64, "inc": w[2] | w[3] << 64},
        "has_uint32": w[4],
        "uinteger": w[5],
    }
