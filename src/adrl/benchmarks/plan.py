"""How long planning takes: distance field and A* on a map, local controllers' decisions a second, and replanning."""

import functools
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.benchmarks.timing import median_seconds, rate_per_second, require_rounds
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.observation import in_robot_frame
from adrl.planning.global_planner import plan
from adrl.planning.grid import clearance_limit_m, free_space, planning_grid
from adrl.planning.local_control import CONTROLLERS, DWA, LocalControl
from adrl.planning.replanner import EVIDENCE_HIGH, Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import Array, OccupancyGrid, RobotConfig, Task
from adrl.worlds import MapScenario, get_scenario, task_set
from adrl.worlds.ros_map import Unknown

QUERIES = 50
SIDE = 400
"""Cells on a side of the windows that replanning is timed on."""
WALL = 2 * EVIDENCE_HIGH
"""What a cell of a wall holds in such a window: see Evidence of the core."""


def bench_controllers(
    *,
    robot: RobotConfig | None = None,
    num_envs: int = 512,
    num_threads: int = 0,
    seconds: float = 1.0,
    rounds: int = 5,
) -> dict[str, Any]:
    """Decisions a second of the local controllers on `complex`, robots (diffbot when None) under way; see rate_key."""
    if num_envs < 1:
        raise ConfigError(f"envs is {num_envs}; give 1 or more")
    require_rounds(rounds, seconds)
    robot = robot or RobotConfig()
    tasks = task_set(get_scenario("complex"), robot, "validation", min(num_envs, 64))
    sim = NavSim(num_envs, robot, guidance="map", num_threads=num_threads)
    everyone = np.arange(num_envs)
    rng = np.random.default_rng(0)
    sim.reset(everyone, [tasks[i % len(tasks)] for i in everyone], everyone.astype(np.uint64), rng)

    rates = {}
    for name, config in CONTROLLERS.items():
        control = LocalControl(num_envs, robot, config(robot), num_threads=sim.num_threads)

        def decide(control: LocalControl = control) -> int:
            with control.advising():  # nobody drives meanwhile: that is no reason to recover
                sim.planned_actions(control)
            return num_envs

        of_rounds = []
        for _ in range(rounds):
            for _ in range(20):  # so that the robots are among obstacles, not at rest at their starts
                sim.step(sim.expert_actions())
            of_rounds.append(rate_per_second(decide, seconds))
        rates[rate_key(name)] = statistics.median(of_rounds)
    return {
        "schema_version": 1,
        "robot": robot.name,
        **rates,
        "threads": sim.num_threads,
        "envs": num_envs,
    }


def bench_car_paths(robot: RobotConfig, *, queries: int = QUERIES) -> dict[str, Any]:
    """Hybrid A* of a car on tasks of `complex`, each planned once, on one thread, its grid at hand. Times in ms."""
    durations = []
    for task in task_set(get_scenario("complex"), robot, "validation", queries):
        space = free_space(planning_grid(task.world, clearance_limit_m(robot)), robot)
        begin = time.perf_counter()
        plan(task.world, task.start, task.goal, robot, space)
        durations.append(time.perf_counter() - begin)
    return {
        "queries": queries,
        "p50_ms": 1e3 * float(np.median(durations)),
        "p95_ms": 1e3 * float(np.percentile(durations, 95)),
    }


def rate_key(controller: str) -> str:
    """Under which the results have the decisions a second of a controller; DWA's name stood alone once."""
    return "decisions_per_second" if controller == DWA else f"{controller}_decisions_per_second"


def bench_map(path: Path, unknown: Unknown = "solid", *, rounds: int = 3) -> dict[str, Any]:
    """Distance field, inflation and A* between random places of a map, a query at a time, on one thread."""
    scenario = MapScenario(path, unknown)
    grid = scenario.world.grid
    assert grid is not None
    robot = RobotConfig()
    tasks = task_set(scenario, robot, "validation", QUERIES)
    durations = [median_seconds(functools.partial(_plan, grid, robot, task), rounds) for task in tasks]
    return {
        "schema_version": 1,
        "map": path.name,
        "cells": list(grid.solid.shape),
        "queries": QUERIES,
        "median_ms": 1e3 * statistics.median(durations),
        "p95_ms": 1e3 * float(np.percentile(durations, 95)),
    }


def _plan(grid: OccupancyGrid, robot: RobotConfig, task: Task) -> None:
    blocked = (_core.distance_field(grid.solid, grid.resolution_m) <= robot.circumscribed_radius_m).astype(
        np.uint8
    )
    places = np.array([task.start[:2], task.goal])
    in_map = in_robot_frame(
        np.array([grid.origin] * 2), places
    )  # the map's axes may be turned against the world's
    start, goal = ((int(y), int(x)) for x, y in in_map / grid.resolution_m)
    cells, _ = _core.astar(blocked, start, goal)
    _core.shorten_path(blocked, cells)


def bench_replan(*, queries: int = 1000) -> dict[str, Any]:
    """One robot's replanning on 400 x 400 cells: distance field, A* and choice of the waypoint. Times in ms.

    Each query is a window of its own, random clutter or a maze, a third of the goals shut in, and is timed once.
    """
    if queries < 1:
        raise ConfigError(f"queries is {queries}; give 1 or more")
    robot = RobotConfig()
    replanners = {
        name: Replanner(1, robot, ReplannerConfig(cells=SIDE, headings=headings))
        for name, headings in (("plain", False), ("headings", True))
    }
    durations: dict[str, list[float]] = {name: [] for name in replanners}
    rng = np.random.default_rng(0)
    for k in range(queries):
        window, pose, goal = _query(rng, k)
        for name, replanner in replanners.items():
            replanner.b["log_odds"][0] = window
            durations[name].append(_replanning_seconds(replanner, pose, goal))
    results: dict[str, Any] = {"cells": [SIDE, SIDE], "queries": queries}
    for name, spent in durations.items():
        results[name] = {
            "p50_ms": 1e3 * float(np.median(spent)),
            "p99_ms": 1e3 * float(np.percentile(spent, 99)),
        }
    return results


def _query(rng: np.random.Generator, k: int) -> tuple[NDArray[np.int8], Array, Array]:
    """Window k (SIDE, SIDE) whose first cell is at (0, 0), a pose (1, 3) off its solid cells, and a goal (1, 2)."""
    window = (_clutter if k % 2 == 0 else _maze)(rng)
    start, goal = rng.integers(4, SIDE - 4, (2, 2))
    while window[tuple(start)] > 0:
        start = rng.integers(4, SIDE - 4, 2)
    if k % 3 == 0:
        _shut_in(window, *goal)
    heading = rng.uniform(-np.pi, np.pi)
    places: Array = (
        np.array([start, goal], dtype=np.float64)[:, ::-1] + 0.5
    ) * ReplannerConfig().resolution_m
    return window, np.array([[*places[0], heading]]), places[1:].copy()


def _replanning_seconds(replanner: Replanner, pose: Array, goal: Array) -> float:
    chosen = np.ones(1, dtype=np.uint8)
    begin = time.perf_counter()
    replanner.native.plan(chosen, pose, goal)
    return time.perf_counter() - begin


def _clutter(rng: np.random.Generator) -> NDArray[np.int8]:
    """(SIDE, SIDE) a window with sixty round obstacles."""
    window = np.zeros((SIDE, SIDE), dtype=np.int8)
    rows, columns = np.ogrid[:SIDE, :SIDE]
    for row, column, radius in rng.uniform((0, 0, 3), (SIDE, SIDE, 12), (60, 3)):
        window[(rows - row) ** 2 + (columns - column) ** 2 < radius**2] = WALL
    return window


def _maze(rng: np.random.Generator, pitch: int = 16) -> NDArray[np.int8]:
    """(SIDE, SIDE) a window of cells `pitch` wide in which one way leads to each from any other."""
    window = np.zeros((SIDE, SIDE), dtype=np.int8)
    window[::pitch] = window[:, ::pitch] = window[-1] = window[:, -1] = WALL
    count = SIDE // pitch
    seen = np.zeros((count, count), dtype=bool)
    seen[0, 0] = True
    trail = [(0, 0)]
    while trail:
        row, column = trail[-1]
        neighbours = [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
        fresh = [(r, c) for r, c in neighbours if 0 <= r < count and 0 <= c < count and not seen[r, c]]
        if not fresh:
            trail.pop()
            continue
        r, c = fresh[rng.integers(len(fresh))]
        seen[r, c] = True
        trail.append((r, c))
        if r != row:
            window[max(r, row) * pitch, column * pitch + 1 : (column + 1) * pitch] = 0
        else:
            window[row * pitch + 1 : (row + 1) * pitch, max(c, column) * pitch] = 0
    return window


def _shut_in(window: NDArray[np.int8], row: int, column: int, half: int = 20) -> None:
    """Put walls about a cell."""
    top, bottom = max(row - half, 0), min(row + half, SIDE - 1)
    left, right = max(column - half, 0), min(column + half, SIDE - 1)
    window[[top, bottom], left : right + 1] = WALL
    window[top : bottom + 1, [left, right]] = WALL
