"""Gymnasium vector environment over the batch simulator."""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from adrl.envs.kinds import Kind
from adrl.envs.mixture import Mixture, TaskPool
from adrl.envs.nav_sim import Body, NavSim
from adrl.envs.randomization import MILD, NOMINAL, Randomization
from adrl.envs.render import Renderer
from adrl.envs.steps import Outcome
from adrl.envs.task_draws import Generator, Seeds, TaskDraws
from adrl.errors import ConfigError, UnknownName
from adrl.observation import EncoderConfig
from adrl.planning.local_control import DWA
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig, reward, reward_terms
from adrl.types import ACTION_SIZE, RobotConfig, Scenario, Task
from adrl.worlds import RobotFamily, get_scenario, load_robots, robot_from_fields

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

RENDER_FPS = 10
Robot = str | RobotConfig | RobotFamily | Mapping[str, Any] | Kind
"""What an environment takes for a robot: a name, a file, its fields, itself; or a family of them."""


class NavVectorEnv(VectorEnv[F32, F32, NDArray[Any]]):
    """N robots on tasks drawn from a scenario. Arrival and collision terminate, the time limit truncates.

    Observations (N, D) float32, see ObservationEncoder; actions (N, 2) float32 in [-1, 1]: speed, yaw rate.
    info: reward_terms (N, R), features (N, F), success, is_success (the same), collision (N,), of the step that was
    made. Masks, final_obs and final_info are those of Gymnasium's own vector environments; SameStep adds next_obs
    (N, D), the true successor of every row, which differs from the observation where another episode has begun.
    Row i of reset(seed=s) lives as NavEnv does after reset(seed=s + i), in every autoreset mode.

    It pickles and copies, in the middle of an episode too. reset() and step() raise Gymnasium's ResetNeeded and
    InvalidAction, and ConfigError.
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
        scenario: str | Scenario | Sequence[str | Scenario] = "clutter",
        robot: Robot | Sequence[Robot] = "diffbot",
        guidance: str | Sequence[str] = "goal",
        split: str = "train",
        task_pool: int = 512,
        task_priority: float | None = None,
        randomize: bool | Randomization = True,
        encoder: EncoderConfig | Mapping[str, Any] | None = None,
        reward_config: RewardConfig | None = None,
        replanner: ReplannerConfig | None = None,
        maturity: float = 0.5,
        taken_as: RobotConfig | None = None,
        max_episode_steps: int | None = None,
        seed: int | None = None,
        num_threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        body: Body | None = None,
    ) -> None:
        """split, task_pool: tasks are drawn from the first `task_pool` ones of the split.
        task_priority: None has each row draw by itself; a number draws for all rows from one stream of random
        numbers, with chances 0.1 + task_priority * the task's failure rate, 0 for all alike.

        scenario, robot, guidance: several make a mixture. Task i is driven by the robots in turn, and which guidance
        and which scenario it has is drawn by its number, so that rows become other robots from episode to episode; see
        Mixture. A guidance NAME@PLACE is drawn in that scenario alone. A family of robots gives each task a robot of
        its own, of the same split. A Kind is a robot that brings its guidance.
        robot, encoder: also as their fields, as JSON gives them.
        randomize: False for the nominal robot, True for mild variation, or a Randomization.
        replanner: constants of guidance `replan`.
        maturity: S at first; see the property.
        taken_as: the robot, if it is one, as a policy of another one takes it; see Kind.
        max_episode_steps: truncates episodes whose task gives more time.
        seed: of the first reset if that gives none; None for entropy. num_threads: 0 takes one per core.
        autoreset_mode: SameStep, NextStep, or Disabled to reset with options={"reset_mask": mask}.
        body: moves and senses the robots instead of our simulator, as they are: randomize must be False.
        """
        if num_envs < 1:
            raise ConfigError(f"num_envs is {num_envs}; give 1 or more")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ConfigError(f"max_episode_steps is {max_episode_steps}; give 1 or more")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UnknownName("render_mode", str(render_mode), self.metadata["render_modes"])
        self.num_envs = num_envs
        self.scenarios: tuple[Scenario, ...] = tuple(get_scenario(one) for one in _several(scenario))
        """What tasks are drawn from."""
        robots = [found for one in _several(robot) for found in _robots(one, split, task_pool)]
        if taken_as is not None:
            robots = _as_taken(robots, taken_as, _several(guidance))
        mixture = Mixture(robots=robots, guidances=_several(guidance), scenarios=self.scenarios)
        self._pool = TaskPool(mixture, split, task_pool)
        randomization = {True: MILD, False: NOMINAL}[randomize] if isinstance(randomize, bool) else randomize
        self._make_sim = functools.partial(
            NavSim,
            num_envs,
            self._pool.kinds,
            randomization=randomization,
            encoder=EncoderConfig(**encoder) if isinstance(encoder, Mapping) else encoder,
            reward=reward_config,
            replanner=replanner,
            num_threads=num_threads,
            body=body,
        )
        self._maturity, self._expert = maturity, DWA
        self.sim = self._make_sim(maturity=maturity)
        self._most_steps = np.inf if max_episode_steps is None else max_episode_steps
        self._draws = TaskDraws(num_envs, task_pool, task_priority)
        if seed is not None:
            self._draws.seed(seed, np.arange(num_envs))
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = [mode.value for mode in AutoresetMode]
            raise UnknownName("autoreset_mode", str(autoreset_mode), modes) from None
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self._task_index = np.full(num_envs, NEVER, dtype=np.int64)
        size, limit = self.sim.encoder.size, self.sim.encoder.limit
        self.single_observation_space = spaces.Box(-limit, limit, (size,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._renderer = Renderer() if render_mode is not None else None

    @property
    def robot(self) -> RobotConfig:
        """The robot of an environment of one. Raises ConfigError for one of several."""
        return self.sim.robot

    @property
    def scenario(self) -> Scenario:
        """The scenario of an environment of one. Raises ConfigError for one of several."""
        if len(self.scenarios) != 1:
            raise ConfigError(f"this environment has {len(self.scenarios)} scenarios; see its scenarios")
        return self.scenarios[0]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Robots and their guidances, which rows are by turns: sim.b["kind"] (N,) has their present numbers."""
        return self.sim.kinds

    @property
    def num_tasks(self) -> int:
        """Tasks that rows draw from: the first ones of the split."""
        return self._pool.size

    @property
    def task_index(self) -> NDArray[np.int64]:
        """(N,) numbers of the rows' tasks in the split, a copy; -1 for a row that no reset() has begun."""
        return self._task_index.copy()

    def task(self, index: int) -> Task:
        """Task `index` of the split, one of num_tasks."""
        return self._pool[index]

    def kind_of_task(self, index: int) -> int:
        """The number of the kind that task `index` is of."""
        self._pool[index]  # another robot may have to take it
        return int(self._pool.kind[index])

    def scenario_of_task(self, index: int) -> Scenario:
        """Where a task of its split is."""
        return self._pool.scenario(index)

    @property
    def periods(self) -> NDArray[np.float64]:
        """(N,) length of a step of each row's present robot, in reference periods: what is paid and discounted for."""
        return self.sim.periods

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

    @property
    def expert(self) -> str:
        """What drives in expert_actions(): a local controller of adrl.planning.local_control.CONTROLLERS."""
        return self._expert

    @expert.setter
    def expert(self, name: str) -> None:
        self._expert = name
        self.sim.set_expert(name)

    @property
    def np_random(self) -> tuple[Generator, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """What tasks, noise and robots are drawn with: a generator a row, or one for all with task_priority."""
        return self._draws.streams

    @np_random.setter
    def np_random(self, value: tuple[Generator, ...]) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        self._draws.streams = value

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The seed of each generator; -1 for one that was set."""
        return self._draws.seeds

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | None = None
    ) -> tuple[F32, dict[str, Any]]:
        """Start new episodes: all, or those of options["reset_mask"] (N,) bool. Returns (N, D), info.

        seed: s, of which row i takes s + i; or one a row, None for those that go on drawing. Raises ConfigError for
        a mask that is none, and for other options.
        """
        mask = self._reset_mask(options or {})
        rows = np.flatnonzero(mask)
        if seed is not None:
            self._draws.seed(seed, rows)
        self._begin(rows)
        return self.sim.observe(), _of_rows(self._nothing(), mask)

    def step(self, actions: F32) -> tuple[F32, F32, Mask, Mask, dict[str, Any]]:
        """Execute (N, 2) actions for one control period. Returns obs, reward, terminated, truncated, info.

        In mode NextStep a row whose episode has ended begins another instead, whatever its action, for reward 0.
        """
        observation, terminated, truncated, info = self.advance(actions)
        paid = reward(info["reward_terms"], info["features"], self._maturity, self.sim.reward)
        return observation, np.asarray(paid, dtype=np.float32), terminated, truncated, info

    def advance(self, actions: F32) -> tuple[F32, Mask, Mask, dict[str, Any]]:
        """step() without the reward, for who forms it from the terms, as our learner does (eq 17)."""
        actions = self._sound(actions)
        resting = self._resting()
        outcome = self.sim.step(actions)
        terminated = outcome.reached | outcome.collided
        truncated = outcome.timed_out
        if self.sim.reward.eq8 == "literal":
            # A timeout is a failure there: it is paid for, and nothing comes after it.
            terminated, truncated = terminated | truncated, np.zeros_like(truncated)
        truncated |= ~terminated & (self.sim.b["time"] >= self._cut_s() - 1e-6)
        info = _results(outcome)
        if resting.any():
            self._begin(np.flatnonzero(resting))
            for values in (terminated, truncated, *info.values()):
                values[resting] = 0
        ended = terminated | truncated
        self._draws.learn(self._task_index[ended], outcome.reached[ended])
        self.sim.b["active"][ended] = 0
        observation = self.sim.observe()
        info = _of_rows(info, np.ones(self.num_envs, dtype=bool))
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            info |= {"next_obs": observation.copy(), "_next_obs": np.ones(self.num_envs, dtype=bool)}
            if ended.any():
                info |= _final(observation, {name: info[name] for name in RESULTS}, ended)
                begun = np.flatnonzero(ended)
                self._begin(begun)
                observation[begun] = self.sim.observe(begun)
        return observation, terminated, truncated, info

    def expert_actions(self, asked: Mask | None = None) -> F32:
        """(N, 2) actions of A* and the expert, which know everything, in the current states.

        asked (N,): whose; the others are commanded to stand. All, when None. Let it be the same for a whole episode.
        A robot that has not got on for 4 s is led to where it has room, for 2 s. Where somebody else drives, ask within
        `with env.sim.expert.advising():`, which leaves that out.
        """
        self._check_begun()
        return self.sim.expert_actions(asked)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One (H, W, 3) picture a robot, in render mode rgb_array."""
        if self._renderer is None:
            return None
        return tuple(self._renderer.draw(self.sim, i) for i in range(self.num_envs))

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes, as arrays: with the constructor's arguments, enough to resume."""
        return self.sim.state() | self._draws.state() | {"task_index": self._task_index.copy()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what state() returned."""
        self._task_index[:] = state["task_index"]
        self._draws.set_state(state)
        self._set_sim_state(state)

    def __getstate__(self) -> dict[str, Any]:
        if self.sim.body is not None:
            raise ConfigError("robots that another program moves cannot be copied; make a new environment")
        return self.__dict__ | {"sim": self.sim.state()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.sim = self._make_sim(maturity=self._maturity, expert=self._expert)
        self._set_sim_state(state["sim"])

    def _set_sim_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        tasks = [None if i == NEVER else self._pool[int(i)] for i in self._task_index]
        self.sim.set_state(state, tasks)

    def _begin(self, rows: NDArray[np.intp]) -> None:
        draw = self._draws.draw(rows)
        self._task_index[rows] = draw.task
        tasks, kinds = [self._pool[int(i)] for i in draw.task], self._pool.kind[draw.task]
        self.sim.reset(rows, tasks, draw.noise_seed, draw.params, kinds=kinds)

    def _cut_s(self) -> NDArray[np.float64]:
        """(N,) seconds after which an episode is cut."""
        return self._most_steps * self.sim.rows.robot.control_period_s

    def _reset_mask(self, options: Mapping[str, Any]) -> Mask:
        require_known_options(options, ("reset_mask",))
        mask = options.get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ConfigError(f"reset_mask is {mask}; give {self.num_envs} booleans, one of them true")
        return mask

    def _sound(self, actions: F32) -> F32:
        """(N, 2) the actions, which are numbers."""
        actions = np.asarray(actions, dtype=np.float32)
        if actions.shape != (self.num_envs, ACTION_SIZE):
            raise InvalidAction(f"actions have shape {actions.shape}; give {(self.num_envs, ACTION_SIZE)}")
        if not np.isfinite(actions).all():
            rows = np.flatnonzero(~np.isfinite(actions).all(axis=1)).tolist()
            raise InvalidAction(f"actions of rows {rows} are not finite; give numbers in [-1, 1]")
        return actions

    def _resting(self) -> Mask:
        """(N,) rows whose episode has ended and none has begun."""
        self._check_begun()
        resting = self.sim.b["active"] == 0
        if self.autoreset_mode is AutoresetMode.DISABLED and resting.any():
            rows = np.flatnonzero(resting).tolist()
            raise ResetNeeded(f"the episodes of rows {rows} have ended; reset() them before the next step()")
        return resting

    def _check_begun(self) -> None:
        if (self._task_index == NEVER).any():
            rows = np.flatnonzero(self._task_index == NEVER).tolist()
            raise ResetNeeded(f"rows {rows} have no episode yet; call reset() first")

    def _nothing(self) -> dict[str, NDArray[Any]]:
        """A step's results, all zero: of rows that have just begun."""
        n, count = self.num_envs, len(reward_terms(self.sim.reward))
        arrays = [
            np.zeros((n, count), np.float32),
            np.zeros((n, len(self.sim.reward.features())), np.float32),
        ]
        return dict(zip(RESULTS, arrays + [np.zeros(n, dtype=bool) for _ in range(3)], strict=True))


def _several(given: Any) -> Sequence[Any]:
    """One thing, or several, as several."""
    return tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else (given,)


def _robots(robot: Robot, split: str, count: int) -> Sequence[RobotConfig | Kind]:
    """A robot, or `count` of the split of a family."""
    if isinstance(robot, Kind):
        return (robot,)
    found = robot_from_fields(robot) if isinstance(robot, Mapping) else load_robots(robot)
    return [found.draw(split, i) for i in range(count)] if isinstance(found, RobotFamily) else (found,)


def _as_taken(
    robots: Sequence[RobotConfig | Kind], taken_as: RobotConfig, guidances: Sequence[str]
) -> Sequence[Kind]:
    """The robot with each guidance, taken as another one."""
    if len(robots) != 1 or isinstance(robots[0], Kind):
        raise ConfigError(
            "taken_as is of one robot; with several, give each as Kind(robot=..., taken_as=...)"
        )
    return [Kind(robot=robots[0], guidance=guidance, taken_as=taken_as) for guidance in guidances]


NEVER = -1
"""Number of the task of a row that no reset() has begun."""
RESULTS = ("reward_terms", "features", "success", "is_success", "collision")
"""What info says of a step, and of a reset, so that recorders such as minari.DataCollector find the same entries."""


def require_known_options(options: Mapping[str, Any], known: Sequence[str]) -> None:
    """Raises ConfigError for options of reset() that do nothing."""
    strange = [name for name in options if name not in known]
    if strange:
        takes = f"takes {', '.join(known)}" if known else "takes none"
        raise ConfigError(
            f"options of reset() hold {strange[0]!r}, and this environment {takes}; leave it out"
        )


def make_nav_vec(
    num_envs: int = 1, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, **options: Any
) -> NavVectorEnv:
    """What gymnasium.make_vec makes: NavVectorEnv in NextStep by default, as Gymnasium's own are."""
    return NavVectorEnv(num_envs, autoreset_mode=autoreset_mode, **options)


def _results(outcome: Outcome) -> dict[str, NDArray[Any]]:
    arrays = (
        outcome.reward_terms,
        outcome.features,
        outcome.reached,
        outcome.reached.copy(),  # Stable-Baselines3's name for it
        outcome.collided,
    )
    return dict(zip(RESULTS, arrays, strict=True))


def _of_rows(info: Mapping[str, NDArray[Any]], rows: Mask) -> dict[str, NDArray[Any]]:
    """The entries, each with the mask of the rows that have it; as VectorEnv._add_info gives them."""
    return dict(info) | {f"_{name}": rows.copy() for name in info}


def _final(observation: F32, info: Mapping[str, NDArray[Any]], ended: Mask) -> dict[str, Any]:
    """What rows saw last and what came of their last step, as Gymnasium's own vector environments tell it."""
    final_obs = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        final_obs[i] = observation[i].copy()
    zeroed = {name: np.zeros_like(value) for name, value in info.items()}
    for name, value in info.items():
        zeroed[name][ended] = value[ended]
    return {
        "final_obs": final_obs,
        "_final_obs": ended.copy(),
        "final_info": _of_rows(zeroed, ended),
        "_final_info": ended.copy(),
    }
