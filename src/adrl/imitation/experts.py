"""Experts: who shows how to drive. The planner, and what people and poor planners make of its commands.

Each is a small class with at most one number. All but `cautious` and `mapless` make something of the robot's best
planner. What an expert does wrong follows from its seed, for all robots at once.
"""

import inspect
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar, Protocol, runtime_checkable
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.imitation.bursts import Bursts
from adrl.imitation.episode_starts import EpisodeStarts
from adrl.imitation.narrow_shy import ShyPaths
from adrl.observation import in_robot_frame, to_action, to_twist
from adrl.planning.local_control import mppi_config
from adrl.planning.own_map import OWN_MAP, OwnMapDriver
from adrl.ranges import Range, check_ranges
from adrl.registry import look_up
from adrl.types import ACTION_SIZE, RobotConfig

if TYPE_CHECKING:
    from adrl import _core
    from adrl.envs import NavVectorEnv

F32 = NDArray[np.float32]


class Driver:
    """An expert at the wheel of one environment's robots. This one is the planner itself."""

    def __init__(self, env: "NavVectorEnv") -> None:
        self.env = env
        self.given_up = np.zeros(env.num_envs, dtype=bool)
        """(N,) rows that it drives no further, by what actions() saw last."""
        self.asked = np.ones(env.num_envs, dtype=bool)
        """(N,) rows whose answer somebody wants. An expert that plans may leave the others out, for whole drives."""

    def actions(self) -> F32:
        """(N, 2) what the expert does in the environment's current states. Asked once a step."""
        return self.env.expert_actions(self.asked)

    def advising(self) -> AbstractContextManager[None]:
        """While this lasts somebody else drives, and asks what the expert would do: see LocalControl.advising."""
        return self.env.sim.expert.advising()

    def within_reach(self, actions: F32) -> F32:
        """(N, 2) any actions, as this expert would carry them out: noise pushes it no further than it goes."""
        return np.clip(actions, -1.0, 1.0)


@runtime_checkable
class Expert(Protocol):
    """Who shows how to drive. str() of it is what --expert takes.

    `drives` may be there too, a number: so many drives, from start to end, are all that it shows. So may `planner`, the
    controller that it is made of, whatever the robot's best one is.
    """

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Take the wheel. seed: of what is drawn; equal seeds drive equally. Raises ConfigError."""
        ...


@dataclass(frozen=True)
class _Named:
    """What our experts share: a name, and at most one number."""

    def __post_init__(self) -> None:
        check_ranges(self, f"expert {self._name()}: ")

    def __str__(self) -> str:
        return ":".join([self._name(), *(f"{number:g}" for number in vars(self).values())])

    def _name(self) -> str:
        return next(name for name, kind in EXPERTS.items() if kind is type(self))


@dataclass(frozen=True)
class Perfect(_Named):
    """The planner, which knows the map and where moving discs will be."""

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """The planner."""
        return Driver(env)


@dataclass(frozen=True)
class Slow(_Named):
    """Keeps to a share of the robot's greatest speeds, NUMBER (0.5), on the planner's arcs."""

    share: Annotated[float, Range(0.4, 1.0)] = 0.5
    """0.4 to 1: a slower one would not arrive within the tasks' time, 2.5 times what the way takes at full speed."""

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Scales what is faster; speed and yaw rate by the same factor, so that the arc stays."""
        return _SlowDriver(env, self.share)


class _SlowDriver(Driver):
    def __init__(self, env: "NavVectorEnv", share: float) -> None:
        super().__init__(env)
        self._share = share

    def actions(self) -> F32:
        return self.within_reach(super().actions())

    def within_reach(self, actions: F32) -> F32:
        robots = self.env.sim.rows.robot
        limits = self._share * np.stack([robots.fastest_mps, robots.max_yaw_rate_radps], axis=1)
        twist = to_twist(actions, robots)
        excess = (np.abs(twist) / limits).max(axis=1, keepdims=True)
        return to_action(twist / np.maximum(excess, 1.0), robots)


@dataclass(frozen=True)
class Noisy(_Named):
    """A share of its commands, NUMBER (0.2), is wrong: any, held for 0.8 s in the mean."""

    share: Annotated[float, Range(0.0, 0.9)] = 0.2

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Wrong commands are drawn from all that the robot can do."""
        return _NoisyDriver(env, self.share, np.random.default_rng((seed, crc32(b"noisy"))))


class _NoisyDriver(Driver):
    MEAN_S = 0.8

    def __init__(self, env: "NavVectorEnv", share: float, rng: np.random.Generator) -> None:
        super().__init__(env)
        self._rng = rng
        self._bursts = Bursts(env.num_envs, share, self.MEAN_S, rng)
        self._wrong = np.zeros((env.num_envs, ACTION_SIZE), dtype=np.float32)

    def actions(self) -> F32:
        begins = self._bursts.step(self.env.sim.rows.robot.control_period_s)
        drawn = self._rng.uniform(-1.0, 1.0, self._wrong.shape).astype(np.float32)
        self._wrong[begins] = drawn[begins]
        return np.where(self._bursts.active[:, None], self._wrong, super().actions())


@dataclass(frozen=True)
class NarrowShy(_Named):
    """Enters no gap narrower than NUMBER (0.75) m: it goes round, or gives up."""

    width_m: Annotated[float, Range(0.05, 20.0)] = 0.75

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Raises ConfigError for a robot that fits through no gap of that width anyway."""
        return _ShyDriver(env, self.width_m)


class _ShyDriver(Driver):
    def __init__(self, env: "NavVectorEnv", width_m: float) -> None:
        super().__init__(env)
        self._paths = ShyPaths(env, width_m)

    def advising(self) -> AbstractContextManager[None]:
        return self._paths.control.advising()

    def actions(self) -> F32:
        commands = self._paths.commands(self.asked)
        self.given_up = self._paths.at_end
        return to_action(commands, self.env.robot)


@dataclass(frozen=True)
class HalfWise(_Named):
    """Good in a share of the worlds, NUMBER (0.5); in the others it heads for the goal, blind."""

    share: Annotated[float, Range(0.0, 1.0)] = 0.5

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Which worlds is decided by the task's number in its split, whatever the seed."""
        return _HalfWiseDriver(env, self.share)


class _HalfWiseDriver(Driver):
    def __init__(self, env: "NavVectorEnv", share: float) -> None:
        super().__init__(env)
        places = "+".join(scenario.name for scenario in env.scenarios)
        rng = np.random.default_rng((crc32(places.encode()), crc32(b"half-wise")))
        self.wise = rng.random(env.num_tasks) < share
        """(T,) whether it is good in a task of the environment's split."""
        self._goals = np.full((env.num_tasks, 2), np.nan)

    def actions(self) -> F32:
        wise = self.wise[self.env.task_index]
        return np.where(wise[:, None], super().actions(), self._blind())

    def _blind(self) -> F32:
        """(N, 2) straight for the goal: turn to it, the faster ahead the straighter it lies."""
        env, robots, task = self.env, self.env.sim.rows.robot, self.env.task_index
        for new in np.unique(task[np.isnan(self._goals[task, 0])]):
            self._goals[new] = env.task(int(new)).goal
        x, y = in_robot_frame(env.sim.b["pose"], self._goals[task]).T
        angle = np.arctan2(y, x)
        speed = robots.max_speed_mps * np.maximum(np.cos(angle), 0.0)
        return to_action(np.stack([speed, 2.0 * angle], axis=1), robots)


@dataclass(frozen=True)
class Few(_Named):
    """NUMBER (5) drives of the planner, each from its start to its end, are all there is."""

    drives: Annotated[int, Range(1, 100_000)] = 5

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """The planner."""
        return Driver(env)


@dataclass(frozen=True)
class Cautious(_Named):
    """A*+MPPI to which obstacles are NUMBER (4) times as repulsive: it keeps clear of them, and is as fast.

    Whoever imitates it may be off by more before it touches something.
    """

    repulsion: Annotated[float, Range(1.0, 100.0)] = 4.0
    planner: ClassVar[str] = "mppi"

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Drives whatever the robot's own planner is."""
        return _CautiousDriver(env, self.repulsion)


def repulsive_mppi(repulsion: float, robot: RobotConfig) -> "_core.MppiConfig":
    """MPPI's constants for a robot, with so many times its repulsion."""
    config = mppi_config(robot)
    config.repulsion_weight *= repulsion
    return config


class _CautiousDriver(Driver):
    def __init__(self, env: "NavVectorEnv", repulsion: float) -> None:
        super().__init__(env)
        self._control = env.sim.local_control(partial(repulsive_mppi, repulsion))
        self._starts = EpisodeStarts(env)

    def advising(self) -> AbstractContextManager[None]:
        return self._control.advising()

    def actions(self) -> F32:
        self._control.restart(self._starts.rows())
        return self.env.sim.planned_actions(self._control, self.asked)


@dataclass(frozen=True)
class Mapless(Cautious):
    """As cautious; but where the policy does not know the map, it goes by one of its own, of what it has seen.

    So it shows no way round what nobody in its place could know of. S is measured against what it earns from amid its
    drives with an empty map: its maps are no part of the states that the probe goes back to.
    """

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Drives whatever the robot's own planner is."""
        return _MaplessDriver(env, self.repulsion)


class _MaplessDriver(_CautiousDriver):
    def __init__(self, env: "NavVectorEnv", repulsion: float) -> None:
        super().__init__(env, repulsion)
        sim = env.sim
        self._mapless = OwnMapDriver(
            env.num_envs,
            [kind.robot for kind in sim.kinds],
            sim.local_control(partial(repulsive_mppi, repulsion)),
            OWN_MAP,
            num_threads=sim.num_threads,
            kind=sim.b["kind"],
        )

    @contextmanager
    def advising(self) -> Iterator[None]:
        with super().advising(), self._mapless.control.advising():
            yield

    def actions(self) -> F32:
        b, env = self.env.sim.b, self.env
        begun = self._starts.rows()
        self._control.restart(begun)
        if len(begun) > 0:
            goals = np.array([env.task(int(i)).goal for i in env.task_index[begun]])
            self._mapless.restart(begun, goals, b["odometry"][begun])
        knows = env.sim.rows.on_map
        commands = self._mapless.commands(b["ranges"], b["odometry"], b["twist"], ~knows & self.asked)
        actions = to_action(commands, env.sim.rows.known)
        if knows.any():
            actions[knows] = env.sim.planned_actions(self._control, knows & self.asked)[knows]
        return actions


PERFECT = "perfect"
EXPERTS: dict[str, Callable[..., Expert]] = {
    PERFECT: Perfect,
    "slow": Slow,
    "noisy": Noisy,
    "narrow-shy": NarrowShy,
    "half-wise": HalfWise,
    "few": Few,
    "cautious": Cautious,
    "mapless": Mapless,
}
"""name -> what makes an expert, of a number or of none."""


def find_expert(expert: str | Expert) -> Expert:
    """The expert of "NAME" or "NAME:NUMBER"; an expert is itself. Raises UnknownName and ConfigError."""
    if not isinstance(expert, str):
        return expert
    name, colon, text = expert.partition(":")
    make = look_up("expert", name, EXPERTS)
    if not colon:
        return make()
    if not inspect.signature(make).parameters:
        raise ConfigError(f"expert {expert!r}: {name} takes no number; leave out :{text}")
    try:
        number = float(text)
    except ValueError:
        raise ConfigError(f"expert {expert!r}: {text!r} is no number; give {name}:NUMBER") from None
    return make(int(number) if number.is_integer() else number)
