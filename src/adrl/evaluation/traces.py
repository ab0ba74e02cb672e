"""The course of chosen episodes, step by step: what a replay shows. Recorded as they are driven, kept in one file."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as pack_safetensors

from adrl import files
from adrl.envs.nav_sim import NavSim
from adrl.envs.steps import Outcome
from adrl.errors import AdrlError, CheckpointError, FileError, brief
from adrl.evaluation.metrics import RATES
from adrl.evaluation.supervised import Supervised, spells, steps_of
from adrl.geometry import in_robot_frame, in_world_frame
from adrl.json_files import parse_json
from adrl.rewards import REWARD_TERMS, RewardConfig, reward_terms, weights
from adrl.types import Array, OccupancyGrid, RobotConfig, Task, World
from adrl.worlds import robot_from_fields

SCHEMA_VERSION = 1
TRACES_FILE = "traces.safetensors"
FAILURES, ARRIVALS = 24, 8
"""Episodes of each kind that are kept, the first of the split."""
LEAST_SIDE_M = 0.01
"""Of a world in a file."""
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
    """(P, 2) the task's A* path."""
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


_STATES = ("time_s", "pose", "twist", "waypoint", "clearance", "ranges")
_STEPS = ("weights", "paid")
_WALKERS = ("people", "legs")
"""Absent from a file where there are none."""


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
        self._step = 0
        self._add_state(sim, np.arange(sim.num_envs))

    def add(self, sim: NavSim, active: NDArray[np.bool_], outcome: Outcome) -> None:
        """One step of the robots that were driving, (N,) active."""
        rows = np.flatnonzero(active)
        weight = weights(outcome.features, self._maturity, self.reward)
        paid = self.reward.scale * weight * outcome.reward_terms
        told = {} if self._supervised is None else {"reasons": _objects(self._supervised.reasons)}
        self._steps.add(rows, weights=weight, paid=paid, **told)
        self._step += 1
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
                    **states,
                    **{name: steps.get(name, none) for name in _STEPS},
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


def write_traces(path: str | os.PathLike[str], traces: Traces) -> None:
    """Write them to one safetensors file, at once. A world that several episodes share is there once."""
    worlds: dict[int, World] = {id(trace.world): trace.world for trace in traces.episodes}
    if traces.world is not None:
        worlds[id(traces.world)] = traces.world
    place = {key: number for number, key in enumerate(worlds)}
    tensors: dict[str, NDArray[Any]] = {"routes.task": traces.tasks}
    tensors["routes.size"] = np.array([len(route) for route in traces.routes], np.int32)
    tensors["routes.xy"] = np.concatenate([*traces.routes, np.empty((0, 2))]).astype(np.float32)
    for number, world in enumerate(worlds.values()):
        tensors |= {f"world.{number}.{name}": array for name, array in _world_arrays(world).items()}
    for number, trace in enumerate(traces.episodes):
        tensors[f"episode.{number}.path"] = trace.path
        for name in (*_STATES, *_STEPS):
            array = np.asarray(getattr(trace, name))
            tensors[f"episode.{number}.{name}"] = array.astype(np.float16 if name == "ranges" else np.float32)
        for name in _WALKERS:
            if getattr(trace, name).size:
                tensors[f"episode.{number}.{name}"] = getattr(trace, name).astype(np.float32)
    about = {
        "schema_version": SCHEMA_VERSION,
        "robot": asdict(traces.robot),
        "guidance": traces.guidance,
        "maturity": traces.maturity,
        "reward_terms": list(traces.terms),
        "world": None if traces.world is None else place[id(traces.world)],
        "worlds": [_world_about(world) for world in worlds.values()],
        "episodes": [
            {"task": t.task, "ending": t.ending, "world": place[id(t.world)]}
            | {"goal": list(t.goal), "goal_tolerance_m": t.goal_tolerance_m}
            | ({"robot": asdict(t.robot)} if t.robot != traces.robot else {})
            | ({} if t.reasons is None else {"reasons": spells(t.reasons)})
            for t in traces.episodes
        ],
    }
    packed = {name: np.ascontiguousarray(array) for name, array in tensors.items()}
    metadata = {"traces": json.dumps(about, allow_nan=False)}
    files.atomic_write_bytes(path, pack_safetensors(packed, metadata))


def _objects(items: Sequence[Any]) -> NDArray[Any]:
    """(N,) of any objects."""
    return np.fromiter(items, dtype=object, count=len(items))


Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]


class _WorldAbout(TypedDict):
    bounds: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    resolution_m: NotRequired[float]
    origin: NotRequired[tuple[float, float, float]]


class _EpisodeAbout(TypedDict):
    task: int
    ending: Literal["success", "collision", "timeout"]
    world: Annotated[int, Meta(ge=0)]
    goal: tuple[float, float]
    goal_tolerance_m: float
    robot: NotRequired[dict[str, Any]]
    """Where it is another than that of the file."""
    reasons: NotRequired[list[tuple[Annotated[int, Meta(ge=0)], list[str]]]]
    """Where a supervisor drove along: steps at which its reasons change, and what they are from there on."""


class _About(TypedDict):
    """What stands beside the arrays, as JSON."""

    schema_version: int
    robot: dict[str, Any]
    guidance: str
    maturity: float
    reward_terms: NotRequired[list[str]]
    """REWARD_TERMS where it is absent, as all had them once."""
    world: Annotated[int, Meta(ge=0)] | None
    worlds: list[_WorldAbout]
    episodes: list[_EpisodeAbout]


def read_traces(path: str | os.PathLike[str]) -> Traces:
    """Read what write_traces wrote. Raises CheckpointError naming the file: missing, truncated or foreign."""
    try:
        files.require_ordinary(path)
        with safe_open(path, framework="numpy") as stream:
            about = parse_json((stream.metadata() or {}).get("traces", "null"), _About)
            tensors = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118 - no mapping
        if about["schema_version"] != SCHEMA_VERSION:
            raise CheckpointError(f"{path}: written by another version of ADRL; evaluate again")
        return _unpack(about, tensors)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; give the traces of adrl evaluate --out") from None
    except CheckpointError:
        raise
    except (AdrlError, SafetensorError, OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise CheckpointError(
            f"{path}: truncated, or not the traces of adrl evaluate ({brief(repr(error))})"
        ) from error


def _unpack(about: _About, tensors: Mapping[str, NDArray[Any]]) -> Traces:
    robot, terms = robot_from_fields(about["robot"]), tuple(about.get("reward_terms", REWARD_TERMS))
    worlds = [
        _world(entry, {name: tensors[f"world.{i}.{name}"] for name in _WORLD_ARRAYS})
        for i, entry in enumerate(about["worlds"])
    ]
    episodes = []
    for number, entry in enumerate(about["episodes"]):
        arrays = {name: tensors[f"episode.{number}.{name}"] for name in ("path", *_STATES, *_STEPS)}
        own = robot_from_fields(entry["robot"]) if "robot" in entry else robot
        _require_shapes(arrays, own, terms)
        for name in _WALKERS:
            walkers = tensors.get(f"episode.{number}.{name}")
            if walkers is not None:
                arrays[name] = _walkers_like(name, walkers, len(arrays["time_s"]))
        told = steps_of(entry["reasons"], len(arrays["time_s"]) - 1) if "reasons" in entry else None
        own_parts = {"world": worlds[entry["world"]], "robot": own, "reasons": told}
        episodes.append(Trace(**arrays, **entry | own_parts))  # pyright: ignore
    tasks, sizes, positions = (tensors[f"routes.{name}"] for name in ("task", "size", "xy"))
    ends = np.cumsum(sizes)
    if tasks.shape != sizes.shape or (sizes < 1).any() or positions.shape != (sizes.sum(), 2):
        raise ValueError("the routes are malformed")
    if not np.isfinite(positions).all():
        raise ValueError("a route holds a number that is not finite")
    return Traces(
        robot=robot,
        guidance=about["guidance"],
        maturity=about["maturity"],
        terms=terms,
        world=None if about["world"] is None else worlds[about["world"]],
        episodes=episodes,
        tasks=tasks,
        routes=np.split(positions, ends[:-1]) if len(ends) else [],
    )


def _require_shapes(arrays: Mapping[str, NDArray[Any]], robot: RobotConfig, terms: Sequence[str]) -> None:
    """As Trace says, floats, and finite but for ranges. Raises ValueError."""
    states, points = len(arrays["time_s"]), len(arrays["path"])
    beams, steps = robot.lidar.num_beams, (states - 1, len(terms))
    shapes = {"path": (points, 2), "time_s": (states,), "pose": (states, 3), "twist": (states, 2)}
    shapes |= {"waypoint": (states, 2), "clearance": (states,), "ranges": (states, beams)}
    for name, shape in (shapes | {"weights": steps, "paid": steps}).items():
        array = arrays[name]
        if array.shape != shape or array.dtype.kind != "f":
            raise ValueError(f"{name} of an episode is {array.dtype} {array.shape}, not floats {shape}")
        if np.isnan(array).any() or not (name == "ranges" or np.isfinite(array).all()):
            raise ValueError(f"{name} of an episode holds a number that is not finite")


def _walkers_like(name: str, walkers: NDArray[Any], states: int) -> NDArray[Any]:
    """The array, where it is as Trace says. Raises ValueError."""
    shape = (states, walkers.shape[1] if walkers.ndim == 3 else 0, 3)
    if walkers.shape != shape or walkers.dtype.kind != "f" or not np.isfinite(walkers).all():
        raise ValueError(
            f"{name} of an episode is {walkers.dtype} {walkers.shape}, not finite floats {shape}"
        )
    return walkers


_WORLD_ARRAYS = ("circles", "segments", "discs", "corners", "sizes", "solid")


def _world_arrays(world: World) -> dict[str, NDArray[Any]]:
    return {
        "circles": world.circles,
        "segments": world.segments,
        "discs": world.discs,
        "corners": np.concatenate([*world.polygons, np.empty((0, 2))]),
        "sizes": np.array([len(corners) for corners in world.polygons], np.int32),
        "solid": np.empty((0, 0), np.uint8) if world.grid is None else np.asarray(world.grid.solid, np.uint8),
    }


def _world_about(world: World) -> dict[str, Any]:
    about: dict[str, Any] = {"bounds": [float(number) for number in world.bounds]}
    if world.grid is not None:
        about |= {"resolution_m": world.grid.resolution_m, "origin": list(world.grid.origin)}
    return about


def _world(about: _WorldAbout, arrays: dict[str, NDArray[Any]]) -> World:
    grid = None
    if arrays["solid"].size:
        if "origin" not in about or "resolution_m" not in about:
            raise ValueError("a world with cells lacks their origin or resolution_m")
        grid = OccupancyGrid(
            solid=arrays["solid"], resolution_m=about["resolution_m"], origin=about["origin"]
        )
    x_min, y_min, x_max, y_max = about["bounds"]
    if min(x_max - x_min, y_max - y_min) < LEAST_SIDE_M:
        raise ValueError(f"a world's bounds are {about['bounds']}")
    ends = np.cumsum(arrays["sizes"])
    return World(
        bounds=about["bounds"],
        circles=arrays["circles"],
        segments=arrays["segments"],
        discs=arrays["discs"],
        polygons=tuple(np.split(arrays["corners"], ends[:-1])) if len(ends) else (),
        grid=grid,
    )
