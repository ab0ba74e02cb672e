"""N robots of any kinds, each on its own task: the batch simulator with observations and reward terms around it.

No autoreset and no Gymnasium: NavVectorEnv and the evaluation's rollout are built on this.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.envs.kinds import Kind, KindRows, agreed, chosen
from adrl.envs.randomization import NOMINAL, Randomization, draw_params
from adrl.envs.steps import Outcome, Steps
from adrl.errors import ConfigError, PlanningError
from adrl.observation import EncoderConfig, ObservationEncoder, in_robot_frame, to_action, to_twist
from adrl.observation.motion import ScanHistory
from adrl.observation.path_ahead import PATH_POINTS_M
from adrl.planning.global_planner import plan
from adrl.planning.local_control import CONTROLLERS, DWA, LocalControl
from adrl.planning.path_guide import sim_config
from adrl.planning.replanner import Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.planning.standstill import Standstill
from adrl.registry import look_up
from adrl.rewards import RewardConfig
from adrl.rewards.step import reference_period_s
from adrl.simulators import Body
from adrl.types import Array, People, RobotConfig, Task

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp] | slice
ALL = slice(None)


class NavSim:
    """Robots that observe and act. `b` holds the simulator's arrays, a row a robot; see _core.BatchSim."""

    def __init__(
        self,
        num_envs: int,
        robot: RobotConfig | Sequence[Kind],
        *,
        guidance: str = "goal",
        randomization: Randomization = NOMINAL,
        encoder: EncoderConfig | None = None,
        reward: RewardConfig | None = None,
        replanner: ReplannerConfig | None = None,
        maturity: float = 0.0,
        taken_as: RobotConfig | None = None,
        expert: str = DWA,
        plans_itself: bool = False,
        num_threads: int = 1,
        body: Body | None = None,
    ) -> None:
        """robot: of all rows, led by guidance and taken_as another one; or the kinds that a row may be, which say that
        themselves. Rows begin as the first kind; reset() may make them others.

        replanner, maturity: for guidance `replan`, S being the policy's. num_threads: 0 takes one per core.

        expert: what drives in expert_actions(), of adrl.planning.local_control.CONTROLLERS.

        taken_as: see Kind.
        plans_itself: the policy makes its own routes, and with guidance `replan` no replanner makes any.
        body: moves and senses the robots instead of our simulator; of the randomization it knows nothing. Raises
        UnknownName for a guidance that does not exist, ConfigError for a body with fewer robots, and for no kinds.
        """
        alone = isinstance(robot, RobotConfig)
        kinds = [Kind(robot=robot, guidance=guidance, taken_as=taken_as)] if alone else robot
        if len(kinds) == 0:
            raise ConfigError("there are no kinds of robots; give one or more")
        self.kinds: tuple[Kind, ...] = tuple(kinds)
        """What a row may be, by its number, which b["kind"] has."""
        if body is not None and len(self.kinds) > 1:
            raise ConfigError(f"a body drives robots of one kind; {len(self.kinds)} were given")
        if body is not None and (body.num_envs < num_envs or randomization != NOMINAL):
            raise ConfigError(
                f"the body has {body.num_envs} robots and drives them as they are; "
                "give num_envs at most that number, and no randomization"
            )
        self.num_envs = num_envs
        self.body = body
        known = [kind.known_as for kind in self.kinds]
        self.encoder = ObservationEncoder(known, encoder)
        self.reward = reward or RewardConfig()
        self._randomization = randomization
        num_beams = max(kind.robot.lidar.num_beams for kind in self.kinds)
        self.b = _buffers(num_envs, num_beams)
        if self.encoder.needs_path:
            self.b["path_ahead"] = np.zeros((num_envs, len(PATH_POINTS_M), 2))
        self._table = KindRows.of(self.kinds, plans_itself=plans_itself)
        self.rows = self._table[self.b["kind"]]
        """What each row is at present."""
        self._on_map = agreed(self._table.on_map)
        self._reach_as_known = bool((self._table.robot.max_range_m == self._table.known.max_range_m).all())
        configs = [sim_config(kind.robot, _led_by(kind, plans_itself)) for kind in self.kinds]
        natives = [(kind.robot.native, config) for kind, config in zip(self.kinds, configs, strict=True)]
        self.native = _core.BatchSim(num_envs, num_threads, natives, self.b)
        self.set_expert(expert)
        self.replanner: Replanner | None = None
        if self._table.led.any():
            self.replanner = Replanner(
                num_envs,
                known,
                replanner,
                maturity=maturity,
                num_threads=self.native.num_threads,
                kind=self.b["kind"],
                tells_path=self.encoder.needs_path,
            )
        self.tasks: list[Task | None] = [None] * num_envs
        self.paths: list[Array] = [np.empty((0, 2))] * num_envs
        """Of each row the one that it follows on a known map: its task's, or for a car that stood a new array."""
        self._time_limit_s = np.full(num_envs, np.inf)
        self._last_action = np.zeros((num_envs, 2), dtype=np.float32)
        self._has_cars_on_map = bool((self._table.car & self._table.on_map).any())
        self._standstill = Standstill(num_envs)
        self._path_from = np.full((num_envs, 3), np.inf)
        """(N, 3) poses from which cars have got another path than their task's; infinite where they have that."""
        self._steps = Steps(self, self._table, self.reward)
        steps = self.encoder.history_steps
        self._history = ScanHistory(num_envs, num_beams, steps) if steps > 0 else None

    @property
    def robot(self) -> RobotConfig:
        """That of all rows. Raises ConfigError where there are several."""
        return self._only("robots", {kind.robot: None for kind in self.kinds})

    @property
    def guidance(self) -> str:
        """That of all rows. Raises ConfigError where there are several."""
        return self._only("guidances", {kind.guidance: None for kind in self.kinds})

    @property
    def periods(self) -> Array:
        """(N,) length of a step of each row's present robot, in reference periods: what is paid and discounted for."""
        robots = self.rows.robot
        return robots.control_period_s / reference_period_s(robots.max_speed_mps)

    @property
    def least_periods(self) -> float:
        """The same of the kind with the shortest steps."""
        robots = self._table.robot
        return float((robots.control_period_s / reference_period_s(robots.max_speed_mps)).min())

    @property
    def num_threads(self) -> int:
        """Threads that step the robots, this one included."""
        return self.native.num_threads

    def reset(
        self,
        indices: NDArray[np.intp],
        tasks: Sequence[Task],
        seeds: NDArray[np.uint64],
        rng: np.random.Generator | Sequence[np.random.Generator],
        kinds: NDArray[np.intp] | None = None,
    ) -> None:
        """Start the robots `indices` (M,) on `tasks`.

        seeds: (M,) of their sensors' noise. rng: draws their parameters; M of them, one each, where a robot's must
        not depend on the others. kinds: (M,) numbers of the kinds that they are from now on; as they were if None.
        """
        if kinds is not None and len(self.kinds) > 1:
            self.b["kind"][indices] = kinds
            self._know_kinds()
        mask = np.zeros(self.num_envs, dtype=np.uint8)
        for i, task in zip(indices, tasks, strict=True):
            self.set_task(int(i), task)
        mask[indices] = 1
        self.b["seed"][indices] = seeds
        robots = [self.kinds[int(k)].robot for k in self.b["kind"][indices]]
        if isinstance(rng, np.random.Generator):
            drawn = draw_params(robots, self._randomization, rng)
        else:
            each = [
                draw_params([own], self._randomization, one) for own, one in zip(robots, rng, strict=True)
            ]
            drawn = np.concatenate(each)
        self.b["params"][indices] = drawn
        self.b["active"][indices] = 1
        self.b["command"][indices] = 0.0
        self._last_action[indices] = to_action(np.zeros((len(indices), 2)), self.rows.known[indices])
        self.native.reset(mask)
        self.expert.restart(indices)
        if self.body is not None:
            self.body.reset(indices, tasks, self.b)
        if self._history is not None:
            self._history.begin(indices, self._ranges(), self.b["odometry"])
        if self.replanner is not None:
            goals = np.array([task.goal for task in tasks]).reshape(-1, 2)
            self.replanner.reset(indices, goals, self.b["odometry"][indices])
            self._replan(mask.astype(bool))
        self._standstill.begin(indices, self.b["route_left"][indices], 0.0)
        self._path_from[indices] = np.inf
        self._steps.begin(indices)

    def set_task(self, i: int, task: Task) -> None:
        """Another world or goal for robot i, which goes on from where it is; reset() begins the task."""
        self.tasks[i] = task
        if np.isfinite(self._path_from[i]).all():
            self._path_from[i] = np.inf
            self.b["memory"][i, 0] = 0.0
        self.native.set_task(i, task.native)
        self.paths[i] = task.path
        self._time_limit_s[i] = task.time_limit_s

    def set_people(self, i: int, people: People) -> None:
        """Those about robot i who walk on, and after them others, who set out from where their routes begin."""
        task = self.tasks[i]
        assert task is not None
        walking = len(task.people)
        self.set_task(i, dataclasses.replace(task, people=people))
        for k, route in enumerate(people.routes[walking:], walking):
            yaw = math.atan2(*(route[min(1, len(route) - 1)] - route[0])[::-1])
            onwards = float(len(route) > 1)
            self.b["people"][i, k] = [*route[0], 0.0, 0.0, yaw, 0.0, onwards, 1.0, 0.0, 0.0]

    def observe(self, rows: Rows = ALL) -> F32:
        """(N, D) observations, a new array; of the robots `rows` (M,) alone, (M, D)."""
        return self.encoder.encode(*self.measured(rows), kind=self.b["kind"][rows])

    def measured(self, rows: Rows = ALL) -> tuple[Any, ...]:
        """What an encoder takes: ranges, goal in the robot's frame, twist, last action, the scans' history, and for one
        that needs it the path."""
        b = self.b
        # A known map comes with localisation; mapless robots only have their odometry.
        pose = chosen(self._on_map, self.rows.on_map[rows], b["pose"][rows], b["odometry"][rows])
        goal = in_robot_frame(pose, b["waypoint"][rows])
        if self.replanner is not None:
            goal = self.replanner.as_goals(goal, rows)
        history = self._history
        if history is not None and not isinstance(rows, slice):
            history = history.of(rows)
        measured = self._ranges(rows), goal, b["twist"][rows], self._last_action[rows], history
        if not self.encoder.needs_path:
            return measured
        return *measured, in_robot_frame(pose[:, None], b["path_ahead"][rows])

    def step(self, actions: F32) -> Outcome:
        """Execute (N, 2) normalised actions for one control period on every active robot."""
        b = self.b
        before = self._steps.before()
        self._last_action = np.clip(actions, -1.0, 1.0).astype(np.float32)
        b["command"][:] = to_twist(actions, self.rows.known)
        if self.body is None:
            self.native.step()
        else:
            self.body.step(b)
            self.native.follow(before.pose)
        if self._history is not None:
            self._history.add(self._ranges(), b["odometry"])
        outcome, step = self._steps.outcome(before, self._time_limit_s)
        if self.replanner is not None:
            self._replan(b["active"].astype(bool))
        again = self._cars_that_stand(outcome) if self._has_cars_on_map else ()
        for i in again:
            self._plan_again(int(i))
        self._steps.see(step, waypoints_moved=self.replanner is not None or len(again) > 0)
        return outcome

    def _cars_that_stand(self, outcome: Outcome) -> NDArray[np.intp]:
        """(M,) rows of cars on a map that have not got on for a while; see Standstill."""
        b, rows = self.b, self.rows
        lasts = self._standstill.update(b["route_left"], b["time"])
        over = outcome.reached | outcome.collided | outcome.timed_out
        return np.flatnonzero(lasts & rows.car & rows.on_map & b["active"].astype(bool) & ~over)

    def _plan_again(self, i: int) -> None:
        """A path from where car i stands. Where there is none, it goes on with the one it has."""
        b = self.b
        try:
            again = self._from(i, b["pose"][i])
            self.native.set_path(i, again.native)
            self.paths[i], self._path_from[i] = again.path, b["pose"][i]
        except PlanningError:
            pass
        self._standstill.begin(np.array([i]), b["route_left"][i], b["time"][i])

    def _from(self, i: int, pose: Array) -> Task:
        """Robot i's task with a path from a pose. Raises PlanningError."""
        task = self.tasks[i]
        assert task is not None
        x, y, yaw = pose.tolist()
        path = plan(
            task.world.without_discs, (x, y, yaw), task.goal, self.kinds[int(self.b["kind"][i])].robot
        )
        return dataclasses.replace(task, path=path)

    def people(self, row: int) -> Array:
        """(P, 3) x, y and radius of the people about a robot, now."""
        task = self.tasks[row]
        radius = np.empty(0) if task is None else task.people.radius_m
        return np.column_stack([self.b["people"][row, : len(radius), :2], radius])

    def legs(self, row: int) -> Array:
        """(2 P, 3) x, y and radius of what the LiDAR sees of the people about a robot, now: of none where it sees their
        bodies."""
        task = self.tasks[row]
        if task is None or not task.people.legs:
            return np.empty((0, 3))
        seen = _core.seen(
            task.world.native, task.people.native, self.b["people"][row], float(self.b["time"][row])
        )
        return seen[len(task.world.discs) :]

    def moving(self, row: int) -> Array:
        """(M, 3) x, y and radius of the discs and people about a robot, now."""
        task = self.tasks[row]
        if task is None:
            return np.empty((0, 3))
        centres = task.world.disc_centres(float(self.b["time"][row]))
        return np.concatenate([np.column_stack([centres, task.world.discs[:, 4]]), self.people(row)])

    def set_expert(self, name: str) -> None:
        """Let this local controller, of CONTROLLERS, drive in expert_actions() from now on."""
        self.expert = self.local_control(look_up("controller", name, CONTROLLERS))

    def local_control(
        self, config: Callable[[RobotConfig], "_core.ControllerConfig"], *, foresee: bool = True
    ) -> LocalControl:
        """Local controllers of these robots, each with the constants for its own kind."""
        return LocalControl(
            self.num_envs,
            [kind.robot for kind in self.kinds],
            config,
            foresee=foresee,
            num_threads=self.native.num_threads,
            kind=self.b["kind"],
        )

    def expert_actions(self, asked: Mask | None = None) -> F32:
        """(N, 2) actions of A* and the expert's controller in the current states, which know the world and where discs
        will be. asked (N,): see planned_actions."""
        return self.planned_actions(self.expert, asked)

    def planned_actions(self, control: LocalControl, asked: Mask | None = None) -> F32:
        """(N, 2) actions of a local controller that knows the world, on the paths of the tasks.

        asked (N,): whose; the others are commanded to stand. All, when None.
        """
        command = np.zeros((self.num_envs, 2))
        mask = np.ones(self.num_envs, np.uint8) if asked is None else asked.astype(np.uint8)
        self.native.plan(mask, control.native, command)
        return to_action(command, self.rows.known)

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all that changes; with the tasks, enough to continue to the same bytes."""
        own = {
            "last_action": self._last_action,
            **self._steps.state(),
            "time_limit_s": self._time_limit_s,
            "path_from": self._path_from,
        }
        own |= {f"standstill.{name}": array for name, array in self._standstill.b.items()}
        own |= {f"expert.{name}": array for name, array in self.expert.b.items()}
        if self._history is not None:
            own |= self._history.arrays
        if self.replanner is not None:
            own |= {f"replanner.{name}": array for name, array in self.replanner.state().items()}
        return {name: array.copy() for name, array in (self.b | own).items()}

    def set_state(self, state: Mapping[str, NDArray[Any]], tasks: Sequence[Task | None]) -> None:
        """Continue from what state() returned. Raises ConfigError for robots that a body moves."""
        if self.body is not None:
            raise ConfigError("robots that Gazebo moves cannot be put back amid an episode; start a new run")
        for name, array in self.b.items():
            array[:] = state.get(name, 0) if name in _NEWER else state[name]
        self._know_kinds()
        self._last_action = state["last_action"].copy()
        self._steps.set_state(state)
        self._time_limit_s[:] = state["time_limit_s"]
        for name, array in self.expert.b.items():
            array[:] = state.get(f"expert.{name}", 0.0)  # states of before know of no memory
        if self._history is not None:
            for name, array in self._history.arrays.items():
                array[:] = state[name]
        if self.replanner is not None:
            prefix = "replanner."
            own = {
                name.removeprefix(prefix): array for name, array in state.items() if name.startswith(prefix)
            }
            self.replanner.set_state(own)
        self._path_from[:] = state.get("path_from", np.inf)  # states of before know no other path
        for name, array in self._standstill.b.items():
            array[:] = state.get(f"standstill.{name}", array)
        for i, task in enumerate(tasks):
            self.tasks[i] = task
            if task is not None:
                pose = self._path_from[i]
                driven = self._from(i, pose) if np.isfinite(pose).all() else task
                self.native.set_task(i, driven.native)
                self.paths[i] = driven.path

    def _only(self, what: str, found: Mapping[Any, None]) -> Any:
        if len(found) > 1:
            raise ConfigError(f"this simulator holds {len(found)} {what}; ask its kinds, or its rows")
        return next(iter(found))

    def _know_kinds(self) -> None:
        """After a change of b["kind"]."""
        self.rows = self._table[self.b["kind"]]

    def _replan(self, active: Mask) -> None:
        """The waypoints of those of the active robots (N,) that the replanner leads."""
        assert self.replanner is not None
        led = self.rows.led
        waypoints = self.replanner.update(self._ranges(), self.b["odometry"], active & led)
        self.b["waypoint"][led] = waypoints[led]
        if self.encoder.needs_path:
            self.b["path_ahead"][led] = self.replanner.b["path_ahead"][led]

    def _ranges(self, rows: Rows = ALL) -> F32:
        """(N, K) metres, by a LiDAR of the reach that the policy knows; beyond the robot's own all is free."""
        ranges = self.b["ranges"][rows]
        if self._reach_as_known:
            return ranges
        reach, known = (
            numbers.max_range_m[rows].astype(np.float32)[:, None]
            for numbers in (self.rows.robot, self.rows.known)
        )
        taken = np.minimum(ranges, known)
        farther = np.flatnonzero(reach < known)
        taken[farther] = np.where(ranges[farther] < reach[farther], ranges[farther], known[farther])
        return taken


def _led_by(kind: Kind, plans_itself: bool) -> str:
    """The guidance that the simulator gives: one that plans itself is told the goal alone."""
    return "goal" if kind.guidance == "replan" and plans_itself else kind.guidance


_NEWER = ("kind", "at_fault", "people")
"""Arrays that states of before do not have: there was one kind, and nobody walked."""


def _buffers(n: int, beams: int) -> dict[str, NDArray[Any]]:
    shapes: dict[str, tuple[tuple[int, ...], Any]] = {
        "kind": ((n,), np.intp),
        "command": ((n, 2), np.float64),
        "active": ((n,), np.uint8),
        "seed": ((n,), np.uint64),
        "params": ((n, _core.NUM_PARAMS), np.float64),
        "ranges": ((n, beams), np.float32),
        "pose": ((n, 3), np.float64),
        "odometry": ((n, 3), np.float64),
        "twist": ((n, 2), np.float64),
        "clearance": ((n,), np.float64),
        "least_clearance": ((n,), np.float64),
        "waypoint": ((n, 2), np.float64),
        "route_left": ((n,), np.float64),
        "time": ((n,), np.float64),
        "travelled": ((n,), np.float64),
        "reached": ((n,), np.uint8),
        "collided": ((n,), np.uint8),
        "at_fault": ((n,), np.uint8),
        "memory": ((n, _core.MEMORY_SIZE), np.float64),
        "people": ((n, _core.MAX_PEOPLE, _core.PERSON_NUMBERS), np.float64),
    }
    return {name: np.zeros(shape, dtype=dtype) for name, (shape, dtype) in shapes.items()}
