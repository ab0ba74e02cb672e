"""The course of chosen episodes, step by step: what a replay shows. Recorded as they are driven."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.envs.nav_sim import NavSim
from adrl.envs.steps import Outcome
from adrl.evaluation.metrics import RATES
from adrl.evaluation.supervised import Supervised
from adrl.geometry import in_robot_frame, in_world_frame
from adrl.rewards import RewardConfig, reward_terms, weights
from adrl.types import Array, RobotConfig, Task, World

FAILURES, ARRIVALS = 24, 8
"""Episodes of each kind that are kept, the first of the split."""
ROUTE_SPACING_S = 0.5
"""Time between the points of the routes, which are kept of all episodes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trace:
    """One episode of T control periods. Rows of (T + 1, ...) arrays are states, the start first; of (T, ...) steps."""

    task: int
    """Number of the task in its split."""
    ending: str
    """One of RATES."""
    robot: RobotConfig
    """That drove."""
    world: World
    goal: tuple[float, float]
    goal_tolerance_m: float
    path: Array
    """(P, 2) the task's A* path; see later_paths."""
    time_s: Array
    """(T + 1,) control periods; a collision ends the last one early."""
    pose: Array
    """(T + 1, 3) x, y, yaw: where the robot is."""
    twist: Array
    """(T + 1, 2) speed in m/s and yaw rate in rad/s."""
    waypoint: Array
    """(T + 1, 2) what the policy heads for, where its own odometry makes it believe that to be."""
    clearance: Array
    """(T + 1,) metres from the footprint to the nearest obstacle, at most 1."""
    ranges: NDArray[np.float16]
    """(T + 1, K) the scan, as the policy got it."""
    weights: Array
    """(T, R) weights w'_i of the step's reward (eqs 14-16)."""
    paid: Array
    """(T, R) each term's part of the step's reward: scale * w'_i * r_i (eq 17)."""
    people: Array = field(default_factory=lambda: np.empty((0, 0, 3)))
    """(T + 1, P, 3) x, y and radius of the people; (0, 0, 3) where nobody walks."""
    reasons: tuple[tuple[str, ...], ...] | None = None
    """Of each of the T steps, why the supervisor sent another command than the policy's; None without a supervisor."""
    legs: Array = field(default_factory=lambda: np.empty((0, 0, 3)))
    """(T + 1, 2 P, 3) x, y and radius of their legs, where the LiDAR sees those; (0, 0, 3) where it sees bodies."""
    later_paths: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(Q, 3) the paths that a car was given after `path`, one after another: number of the state from which on the
    point's path holds, then x and y."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Traces:
    """What one evaluation keeps."""

    robot: RobotConfig
    """The first that drove: the only one, but for a family of robots."""
    guidance: str
    maturity: float
    """S of the reward's weights."""
    terms: tuple[str, ...]
    """Names of the R reward terms."""
    world: World | None
    """The world of all tasks, None where they differ."""
    episodes: list[Trace]
    tasks: NDArray[np.int32]
    """(E,) number of every task that was driven."""
    routes: list[Array]
    """E routes (P, 2), positions ROUTE_SPACING_S apart, the last one included."""


STEPS = ("weights", "paid")
"""Fields of Trace with a row a step."""


@dataclass
class StepLog:
    """Rows of the robots that were driving, step after step."""

    robot: list[NDArray[np.intp]] = field(default_factory=list)
    values: dict[str, list[NDArray[Any]]] = field(default_factory=dict)

    def add(self, rows: NDArray[np.intp], **values: NDArray[Any]) -> None:
        self.robot.append(rows)
        for name, value in values.items():
            self.values.setdefault(name, []).append(value[rows])

    def of(self, robots: Sequence[int]) -> list[dict[str, NDArray[Any]]]:
        """The columns of each of these robots, in the order of time."""
        if not self.robot:
            return [{} for _ in robots]
        whose = np.concatenate(self.robot)
        columns = {name: np.concatenate(parts) for name, parts in self.values.items()}
        return [{name: column[whose == i] for name, column in columns.items()} for i in robots]


class PathLog:
    """The paths that robots are given on their way. Made where they stand at their starts; add after every step."""

    def __init__(self, sim: NavSim) -> None:
        self._last, self._state = list(sim.paths), 0
        self._given: dict[int, list[tuple[int, Array]]] = {}

    def add(self, sim: NavSim) -> None:
        self._state += 1
        for robot, (path, last) in enumerate(zip(sim.paths, self._last, strict=True)):
            if path is not last:
                self._last[robot] = path
                self._given.setdefault(robot, []).append((self._state, path))

    def of(self, robot: int) -> list[tuple[int, Array]]:
        """(number of the first state in which it holds, (P, 2) path) of each that the robot was given."""
        return self._given.get(robot, [])

    def rows(self, robot: int) -> Array:
        """(Q, 3) the same as Trace.later_paths has it."""
        parts = [np.insert(path, 0, state, axis=1) for state, path in self.of(robot)]
        return np.concatenate([np.empty((0, 3)), *parts])


class TraceRecorder:
    """Watches a rollout: begin, add after every step, end; then again for the next chunk of tasks."""

    def __init__(
        self,
        reward: RewardConfig | None = None,
        maturity: float = 0.0,
        *,
        failures: int = FAILURES,
        arrivals: int = ARRIVALS,
        supervised: Supervised | None = None,
    ) -> None:
        """reward, maturity: of the weights that are shown. failures, arrivals: how many of each to keep. supervised:
        what drives, where its reasons are to be kept."""
        self.reward = reward or RewardConfig()
        self._maturity, self._supervised = maturity, supervised
        self._left = {True: arrivals, False: failures}
        self._episodes: list[Trace] = []
        self._tasks: list[Task] = []
        self._numbers: list[int] = []
        self._routes: list[Array] = []
        self._robot: RobotConfig | None = None
        self._guidance = "goal"
        self._chunk: list[Task] = []
        self._chunk_numbers: NDArray[np.int64] = np.empty(0, np.int64)
        self._last: Array = np.empty((0, 3))
        self._step = 0

    def begin(self, sim: NavSim, numbers: NDArray[np.int64]) -> None:
        """Robots of the simulator stand at the starts of the tasks with these numbers in their split."""
        self._driving = [sim.kinds[int(k)].robot for k in sim.b["kind"]]
        self._robot, self._guidance = self._robot or self._driving[0], sim.guidance
        self._chunk = [task for task in sim.tasks if task is not None]
        self._chunk_numbers = numbers
        self._states, self._steps, self._points = StepLog(), StepLog(), StepLog()
        periods = np.round(ROUTE_SPACING_S / sim.rows.robot.control_period_s)
        self._every = np.maximum(1, periods.astype(np.int64))
        self._step, self._paths = 0, PathLog(sim)
        self._add_state(sim, np.arange(sim.num_envs))

    def add(self, sim: NavSim, active: NDArray[np.bool_], outcome: Outcome) -> None:
        """One step of the robots that were driving, (N,) active."""
        rows = np.flatnonzero(active)
        weight = weights(outcome.features, self._maturity, self.reward)
        paid = self.reward.scale * weight * outcome.reward_terms
        told = {} if self._supervised is None else {"reasons": _objects(self._supervised.reasons)}
        self._steps.add(rows, weights=weight, paid=paid, **told)
        self._step += 1
        self._paths.add(sim)
        self._add_state(sim, rows)

    def end(self, ending: NDArray[np.bool_]) -> None:
        """(3, N) which of RATES each robot came to. Keeps what is to be kept of the chunk."""
        chosen = []
        for i, arrived in enumerate(ending[0]):
            if self._left[bool(arrived)] > 0:
                self._left[bool(arrived)] -= 1
                chosen.append(i)
        for i, states, steps in zip(chosen, self._states.of(chosen), self._steps.of(chosen), strict=True):
            task, robot = self._chunk[i], self._driving[i]
            states["ranges"] = states["ranges"][:, : robot.lidar.num_beams]
            places = states.pop("people", None)
            if places is not None and len(task.people):
                radius_m = np.broadcast_to(task.people.radius_m, places[:, : len(task.people), 0].shape)
                states["people"] = np.dstack([places[:, : len(task.people)], radius_m])
            legs = states.pop("legs", None)
            if legs is not None and task.people.legs:
                states["legs"] = legs[:, : 2 * len(task.people)]
            none = np.empty((0, len(reward_terms(self.reward))), np.float32)
            self._episodes.append(
                Trace(
                    task=int(self._chunk_numbers[i]),
                    ending=RATES[int(ending[:, i].argmax())],
                    robot=robot,
                    world=task.world,
                    goal=task.goal,
                    goal_tolerance_m=task.goal_tolerance_m,
                    path=task.path,
                    later_paths=self._paths.rows(i),
                    **states,
                    **{name: steps.get(name, none) for name in STEPS},
                    reasons=None if self._supervised is None else tuple(steps.get("reasons", ())),
                )
            )
        points = self._points.of(range(len(self._chunk)))
        for i, columns in enumerate(points):
            self._routes.append(np.concatenate([columns["place"], self._last[i : i + 1, :2]]))
        self._tasks += self._chunk
        self._numbers += self._chunk_numbers.tolist()

    def traces(self) -> Traces:
        """What was kept."""
        worlds = {id(task.world): task.world for task in self._tasks}
        return Traces(
            robot=self._robot or RobotConfig(),
            guidance=self._guidance,
            maturity=self._maturity,
            terms=tuple(reward_terms(self.reward)),
            world=next(iter(worlds.values())) if len(worlds) == 1 else None,
            episodes=self._episodes,
            tasks=np.array(self._numbers, np.int32),
            routes=self._routes,
        )

    def _add_state(self, sim: NavSim, rows: NDArray[np.intp]) -> None:
        b = sim.b
        waypoint = b["waypoint"].copy()
        if self._guidance != "map":  # given in the odometry's frame
            waypoint = in_world_frame(b["pose"], in_robot_frame(b["odometry"], waypoint))
        walking = max((len(task.people) for task in self._chunk), default=0)
        self._states.add(
            rows,
            **({"people": b["people"][:, :walking, :2]} if walking else {}),
            **({"legs": self._legs(sim, walking)} if any(task.people.legs for task in self._chunk) else {}),
            time_s=b["time"],
            pose=b["pose"],
            twist=b["twist"],
            waypoint=waypoint,
            clearance=np.minimum(b["clearance"], 1.0),
            ranges=b["ranges"].astype(np.float16),
        )
        self._points.add(rows[self._step % self._every[rows] == 0], place=b["pose"][:, :2])
        self._last = b["pose"]

    def _legs(self, sim: NavSim, walking: int) -> NDArray[np.float32]:
        """(N, 2 P, 3) of the robots that drive, 0 where there are none."""
        legs = np.zeros((sim.num_envs, 2 * walking, 3), np.float32)
        for i in np.flatnonzero(sim.b["active"]).tolist():
            seen = sim.legs(i)
            legs[i, : len(seen)] = seen
        return legs


def _objects(items: Sequence[Any]) -> NDArray[Any]:
    """(N,) of any objects."""
    return np.fromiter(items, dtype=object, count=len(items))
