"""The file of an evaluation's traces: every array checked when it is read, as it may be anyone's."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as pack_safetensors

from adrl import files
from adrl.errors import AdrlError, CheckpointError, FileError, brief
from adrl.evaluation.supervised import spells, steps_of
from adrl.evaluation.traces import STEPS, Trace, Traces
from adrl.json_files import parse_json
from adrl.rewards import REWARD_TERMS
from adrl.types import OccupancyGrid, RobotConfig, World
from adrl.worlds import robot_from_fields

SCHEMA_VERSION = 1
STATES = ("time_s", "pose", "twist", "waypoint", "clearance", "ranges")
"""Fields of Trace with a row a state."""
WALKERS = ("people", "legs")
"""The same, absent from a file where there are none."""
LEAST_SIDE_M = 0.01
"""Of a world in a file."""


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
        for name in (*STATES, *STEPS):
            array = np.asarray(getattr(trace, name))
            tensors[f"episode.{number}.{name}"] = array.astype(np.float16 if name == "ranges" else np.float32)
        for name in (*WALKERS, "later_paths"):
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
        arrays = {name: tensors[f"episode.{number}.{name}"] for name in ("path", *STATES, *STEPS)}
        own = robot_from_fields(entry["robot"]) if "robot" in entry else robot
        _require_shapes(arrays, own, terms)
        for name in WALKERS:
            walkers = tensors.get(f"episode.{number}.{name}")
            if walkers is not None:
                arrays[name] = _walkers_like(name, walkers, len(arrays["time_s"]))
        later = tensors.get(f"episode.{number}.later_paths")
        if later is not None:
            arrays["later_paths"] = _paths_like(later, len(arrays["time_s"]))
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


def _paths_like(paths: NDArray[Any], states: int) -> NDArray[Any]:
    """The array, where it is as Trace.later_paths says. Raises ValueError."""
    if paths.ndim != 2 or paths.shape[1] != 3 or paths.dtype.kind != "f" or not np.isfinite(paths).all():
        raise ValueError(
            f"later_paths of an episode is {paths.dtype} {paths.shape}, not finite floats (Q, 3)"
        )
    since = paths[:, 0]
    if (
        (since % 1.0 != 0.0).any()
        or (np.diff(since) < 0).any()
        or not ((since >= 0) & (since < states)).all()
    ):
        raise ValueError("later_paths of an episode name states that it does not have, or not in their order")
    return paths


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
