"""From a report's source to the data its page shows: plain JSON, small enough to open at once."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.evaluation.metrics import RATES, Episodes
from adrl.evaluation.supervised import spells
from adrl.evaluation.traces import Trace, Traces
from adrl.report.encode import numbers, packed, world_content, world_picture
from adrl.report.failure_map import failure_map
from adrl.report.metrics_log import read_metrics
from adrl.report.source import Evaluated, Source
from adrl.types import Array, RobotConfig, World

MOST_REPLAYS, MOST_FRAMES, MOST_BEAMS = 32, 300, 120
"""Of a whole report, of a replay, of a scan: together they bound the size of the page."""
MOST_POINTS = 400
"""Of a curve."""
FIXED = ("success", "failure")
"""Reward terms whose weight is fixed; the others are charted."""

# Title, unit, and the columns of metrics.jsonl that a chart shows, with their names.
RUN_CHARTS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("Success", "%", {"success": "validation tasks", "train_success": "training episodes"}),
    (
        "Release of the expert",
        "",
        {"S": "maturity S", "alpha": "expert share α", "lambda_bc": "imitation weight λ"},
    ),
    (
        "Value",
        "",
        {"q_mean": "mean Q", "statistic": "maturity's statistic", "promised": "promised", "came": "came"},
    ),
    ("Return of an episode", "", {"return_mean": "mean return"}),
)
COMPARED: tuple[tuple[str, str, str], ...] = (
    ("success", "Success on validation tasks", "%"),
    ("return_mean", "Return of an episode", ""),
    ("S", "Maturity S", ""),
    ("alpha", "Expert share α", ""),
    ("lambda_bc", "Imitation weight λ", ""),
    ("q_mean", "Mean Q", ""),
)


def document(source: Source) -> dict[str, Any]:
    """Everything the page shows. Raises CheckpointError on a log that cannot be read."""
    worlds = _Worlds()
    chosen = _chosen(source.evaluations)
    return {
        "kind": source.kind,
        "name": source.name,
        "facts": list(source.facts.items()),
        "missing": source.missing,
        "rows": [_table_row(row) for row in source.rows],
        "charts": charts(source),
        "evaluations": [
            _evaluation(entry, traces, worlds)
            for entry, traces in zip(source.evaluations, chosen, strict=True)
        ],
        "solved": None if source.driven is None else _solved(source.driven),
        "final": {method: _final(paths) for method, paths in source.logs.items()},
        "worlds": worlds.contents,
    }


def charts(source: Source) -> list[dict[str, Any]]:
    """Curves of training: a title, a unit, and series with x and y for wall_s and env_steps."""
    return _compared_charts(source.logs) if source.kind == "comparison" else _run_charts(source.logs)


def _final(paths: Sequence[Path]) -> dict[str, float | None]:
    """What the schedules came to in the first seed."""
    rows = read_metrics(paths[0])
    return {name: numbers(rows[name][-1:])[0] for name in ("alpha", "lambda_bc") if name in rows}


class _Worlds:
    """Each world once, by number."""

    def __init__(self) -> None:
        self.contents: list[dict[str, Any]] = []
        self._kept: list[World] = []

    def number(self, world: World) -> int:
        for number, known in enumerate(self._kept):
            if known is world:
                return number
        self._kept.append(world)
        self.contents.append(world_content(world))
        return len(self._kept) - 1


def _table_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Only numbers and names; settings and paths stay out of the page."""
    return {
        key: round(value, 6) if isinstance(value, float) else value
        for key, value in row.items()
        if key in ("label", "note") or isinstance(value, (int, float))
    }


def _evaluation(entry: Evaluated, chosen: Sequence[Trace], worlds: _Worlds) -> dict[str, Any]:
    episodes, summary, traces = entry.episodes, entry.summary, entry.traces
    ratio = np.divide(
        episodes.distance_m,
        episodes.shortest_m,
        out=np.full(len(episodes), math.nan),
        where=episodes.success & (episodes.shortest_m > 0.0),
    )
    endings = np.stack([getattr(episodes, name) for name in RATES]).argmax(axis=0)
    about = {key: summary[key] for key in ("policy", "method", "scenario", "robot", "guidance", "split")}
    return about | {
        "label": entry.label,
        "tasks": {
            "task": episodes.task.tolist(),
            "ending": [RATES[i] for i in endings],
            "time_s": numbers(episodes.time_s, 4),
            "distance_m": numbers(episodes.distance_m, 4),
            "shortest_m": numbers(episodes.shortest_m, 4),
            "ratio": numbers(ratio, 4),
            "clearance_m": numbers(episodes.least_clearance_m, 3),
            "smoothness": numbers(episodes.smoothness, 3),
            **_social(episodes),
        },
        "maturity": None if traces is None else round(traces.maturity, 4),
        "terms": [] if traces is None else list(traces.terms),
        "robot_shape": None if traces is None else robot_shape(traces.robot),
        "replays": [] if traces is None else [_replay(trace, traces.robot, worlds) for trace in chosen],
        "map": None if traces is None else _map(entry, traces),
    }


def _social(episodes: Episodes) -> dict[str, Any]:
    if not episodes.among_people:
        return {}
    whose = np.where(episodes.collision, np.where(np.asarray(episodes.at_fault), "robot", "other"), "")
    return {
        "fault": whose.tolist(),
        **{
            name: numbers(getattr(episodes, name), 3)
            for name in ("person_distance_m", "near_person_s", "frozen_s", "lost_s")
        },
    }


def robot_shape(robot: RobotConfig) -> dict[str, Any]:
    """The robot as the scene draws it, with those of its beams that are shown."""
    lidar = robot.lidar
    kept = shown_beams(lidar.num_beams)
    return {
        "radius_m": robot.radius_m,
        "polygon": numbers(robot.polygon),
        "reach_m": robot.circumscribed_radius_m,
        "mount": numbers(lidar.mount),
        "angles": numbers(lidar.angles_rad[kept]),
        "max_range_m": lidar.max_range_m,
        "max_speed_mps": robot.max_speed_mps,
    }


def shown_beams(count: int) -> NDArray[np.intp]:
    """Which beams of a scan are shown."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_BEAMS)).round().astype(np.intp))


def _chosen(evaluations: Sequence[Evaluated]) -> list[list[Trace]]:
    """The replays of each evaluation, in the order of its tasks: MOST_REPLAYS in all.

    An even share each, of which three quarters are failures where there are so many; then more failures, then more
    arrivals, until the page is full.
    """
    kept = [[] if entry.traces is None else entry.traces.episodes for entry in evaluations]
    share = max(1, MOST_REPLAYS // max(1, sum(map(bool, kept))))
    failures = [[trace for trace in traces if trace.ending != "success"] for traces in kept]
    arrivals = [[trace for trace in traces if trace.ending == "success"] for traces in kept]
    chosen = []
    for failed, arrived in zip(failures, arrivals, strict=True):
        some = failed[: max(share - len(arrived), math.ceil(0.75 * share))]
        chosen.append([*some, *arrived[: share - len(some)]])
    left = MOST_REPLAYS - sum(map(len, chosen))
    for pool in (failures, arrivals):
        for traces, known in zip(pool, chosen, strict=True):
            more = [trace for trace in traces if trace not in known][: max(left, 0)]
            known += more
            left -= len(more)
    return [sorted(traces, key=lambda trace: trace.task) for traces in chosen]


def _replay(trace: Trace, first: RobotConfig, worlds: _Worlds) -> dict[str, Any]:
    """first: the robot whose shape stands with the evaluation."""
    robot = trace.robot
    last = len(trace.pose) - 1
    frames = np.unique(np.linspace(0, last, min(last + 1, MOST_FRAMES)).round().astype(np.intp))
    # Of the step that led to the frame; the start shows the first step's weights, and nothing paid.
    nothing = np.zeros((1, trace.paid.shape[1]))
    paid = np.concatenate([nothing, np.cumsum(trace.paid, axis=0)])
    weights = np.concatenate([trace.weights[:1], trace.weights]) if last else nothing
    ranges = trace.ranges[frames][:, shown_beams(robot.lidar.num_beams)]
    return {
        "task": trace.task,
        "ending": trace.ending,
        "robot": None if robot == first else robot.name,
        "robot_shape": None if robot == first else robot_shape(robot),
        "world": worlds.number(trace.world),
        "goal": numbers(trace.goal),
        "goal_tolerance_m": trace.goal_tolerance_m,
        "path": numbers(trace.path, 4),
        "later_paths": _later(trace),
        "time_s": numbers(trace.time_s[frames]),
        "pose": packed(np.column_stack([trace.pose[frames, :2], np.unwrap(trace.pose[frames, 2])])),
        "waypoint": packed(trace.waypoint[frames]),
        "twist": packed(trace.twist[frames]),
        "clearance": packed(np.maximum(trace.clearance[frames], 0.0), 1.0),
        "weights": packed(weights[frames]),
        "paid": packed(paid[frames]),
        "people": None if not trace.people.size else _people(trace.people[frames]),
        "legs": None if not trace.legs.size else _people(trace.legs[frames]),
        "held": None if trace.reasons is None else _held(trace),
        "ranges": packed(np.minimum(ranges, robot.lidar.max_range_m), robot.lidar.max_range_m),
    }


def _later(trace: Trace) -> list[list[Any]]:
    """[from which time on, in s; the path, x and y in turn], one after the other, of what replaced the first path."""
    since = trace.later_paths[:, 0]
    return [
        [numbers(trace.time_s[int(state)])[0], numbers(trace.later_paths[since == state, 1:], 4)]
        for state in np.unique(since)
    ]


def _held(trace: Trace) -> list[list[Any]]:
    """[from which time on, in s; for which reasons the supervisor changed the command], one after the other."""
    return [[numbers(trace.time_s[step])[0], words] for step, words in spells(trace.reasons or ())]


def _people(places: Array) -> dict[str, Any]:
    """(F, P, 3) x, y and radius of each person, or leg, in each frame."""
    return {
        "places": packed(places[:, :, :2].reshape(len(places), -1)),
        "radius_m": numbers(places[0, :, 2], 3),
    }


def _map(entry: Evaluated, traces: Traces) -> dict[str, Any] | None:
    found = failure_map(traces, entry.episodes)
    if found is None or traces.world is None:
        return None
    failed = np.flatnonzero(~entry.episodes.success)
    return {
        "bounds": numbers(traces.world.bounds),
        "window": numbers(found.window_m),
        "picture": world_picture(traces.world),
        "origin": [found.x0_m, found.y0_m],
        "cell_m": found.cell_m,
        "passed": found.passed.tolist(),
        "failed": found.failed.tolist(),
        "collided": found.collided.tolist(),
        "ends": {
            "task": entry.episodes.task[failed].tolist(),
            "ending": ["collision" if hit else "timeout" for hit in entry.episodes.collision[failed]],
            "start": [numbers(point, 4) for point in entry.episodes.start_xy_m[failed]],
            "end": [numbers(point, 4) for point in entry.episodes.final_pose[failed, :2]],
            "goal": [numbers(point, 4) for point in entry.episodes.goal_xy_m[failed]],
        },
    }


def _run_charts(logs: Mapping[str, Sequence[Path]]) -> list[dict[str, Any]]:
    charts = []
    for paths in logs.values():
        rows = read_metrics(paths[0])
        of_reward = [
            (title, "", _shaping(rows, prefix))
            for title, prefix in (("Reward weights", "weight/"), ("Reward terms", "term/"))
        ]
        for title, unit, names in (*RUN_CHARTS, *of_reward):
            series = [_single(rows, key, name, unit) for key, name in names.items()]
            charts.append({"title": title, "unit": unit, "series": [entry for entry in series if entry]})
    return [chart for chart in charts if chart["series"]]


def _shaping(columns: Iterable[str], prefix: str) -> dict[str, str]:
    """Columns of the shaping terms, with their names: a run may have other ones than the paper."""
    named = {key: key.removeprefix(prefix) for key in columns if key.startswith(prefix)}
    return {key: name for key, name in named.items() if name not in FIXED}


def _single(rows: Mapping[str, NDArray[np.float64]], key: str, name: str, unit: str) -> dict[str, Any] | None:
    """One run's column where it was logged; None where it never was."""
    known = np.flatnonzero(np.isfinite(rows.get(key, np.empty(0))))
    if not len(known):
        return None
    known = known[np.unique(np.linspace(0, len(known) - 1, min(len(known), MOST_POINTS)).round().astype(int))]
    y = numbers(rows[key][known] * (100.0 if unit == "%" else 1.0))
    axes = {
        axis: {"x": numbers(rows[axis][known]), "y": y} for axis in ("wall_s", "env_steps") if axis in rows
    }
    return {"name": name, **axes}


def _compared_charts(logs: Mapping[str, Sequence[Path]]) -> list[dict[str, Any]]:
    """A chart a quantity, a line a method: the mean over seeds and the range from the worst to the best."""
    read = {method: [read_metrics(path) for path in paths] for method, paths in logs.items()}
    charts = []
    for key, title, unit in COMPARED:
        series = [_seeds(runs, key, method, unit) for method, runs in read.items()]
        if any(series):
            charts.append({"title": title, "unit": unit, "series": [entry for entry in series if entry]})
    return charts


def _seeds(
    runs: Sequence[Mapping[str, NDArray[np.float64]]], key: str, name: str, unit: str
) -> dict[str, Any] | None:
    logged = [run for run in runs if np.isfinite(run.get(key, np.empty(0))).any()]
    if not logged:
        return None
    return {"name": name} | {axis: _band(logged, axis, key, unit) for axis in ("wall_s", "env_steps")}


def _band(
    runs: Sequence[Mapping[str, NDArray[np.float64]]], axis: str, key: str, unit: str
) -> dict[str, list[float | None]]:
    """Mean, least and greatest over runs, where all of them have been logged, between their points straight lines."""
    curves = [(run[axis][known], run[key][known]) for run in runs for known in [np.isfinite(run[key])]]
    first, last = max(x[0] for x, _ in curves), min(x[-1] for x, _ in curves)
    at = np.linspace(first, max(first, last), 100)
    values = np.stack([np.interp(at, x, y) for x, y in curves]) * (100.0 if unit == "%" else 1.0)
    band = {"y": values.mean(axis=0), "low": values.min(axis=0), "high": values.max(axis=0)}
    return {"x": numbers(at)} | {name: numbers(column) for name, column in band.items()}


def _solved(driven: Any) -> dict[str, Any]:
    """Task by task, the share of each method's seeds that solved it; tasks in order."""
    columns = {
        name: np.array(driven.column(name).to_pylist()) for name in ("method", "guidance", "task", "success")
    }
    tasks = np.unique(columns["task"])
    whose = np.char.add(np.char.add(columns["method"], ", "), columns["guidance"])
    if len(np.unique(columns["guidance"])) == 1:
        whose = columns["method"]
    content: dict[str, Any] = {"task": tasks.tolist(), "methods": {}}
    for method in dict.fromkeys(whose.tolist()):
        rows = whose == method
        at = np.searchsorted(tasks, columns["task"][rows])
        count = np.bincount(at, minlength=len(tasks))
        solved = np.bincount(at, columns["success"][rows], minlength=len(tasks))
        share = np.divide(100.0 * solved, count, out=np.full(len(tasks), math.nan), where=count > 0)
        content["methods"][method] = numbers(share, 4)
    return content
