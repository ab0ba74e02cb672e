"""How long planning takes: distance field and A* on a map, and A*+DWA decisions a second."""

import functools
import statistics
from pathlib import Path
from typing import Any

import numpy as np

from adrl import _core
from adrl.benchmarks.timing import median_seconds, rate_per_second, require_rounds
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.observation import in_robot_frame
from adrl.types import OccupancyGrid, RobotConfig, Task
from adrl.worlds import get_scenario, load_map, task_set
from adrl.worlds.map_scenario import MapScenario

QUERIES = 50


def bench_dwa(
    *, num_envs: int = 512, num_threads: int = 0, seconds: float = 1.0, rounds: int = 5
) -> dict[str, Any]:
    """A*+DWA decisions a second on `complex`, robots under way."""
    if num_envs < 1:
        raise ConfigError(f"envs is {num_envs}; give 1 or more")
    require_rounds(rounds, seconds)
    robot = RobotConfig()
    tasks = task_set(get_scenario("complex"), robot, "validation", min(num_envs, 64))
    sim = NavSim(num_envs, robot, guidance="map", num_threads=num_threads)
    everyone = np.arange(num_envs)
    rng = np.random.default_rng(0)
    sim.reset(everyone, [tasks[i % len(tasks)] for i in everyone], everyone.astype(np.uint64), rng)

    def decide() -> int:
        sim.expert_actions()
        return num_envs

    rates = []
    for _ in range(rounds):
        for _ in range(20):  # so that the robots are among obstacles, not at rest at their starts
            sim.step(sim.expert_actions())
        rates.append(rate_per_second(decide, seconds))
    return {
        "schema_version": 1,
        "decisions_per_second": statistics.median(rates),
        "threads": sim.num_threads,
        "envs": num_envs,
    }


def bench_map(path: Path, *, rounds: int = 3) -> dict[str, Any]:
    """Distance field, inflation and A* between random places of a map, a query at a time, on one thread."""
    world = load_map(path)
    grid = world.grid
    assert grid is not None
    robot = RobotConfig()
    tasks = task_set(MapScenario(path), robot, "validation", QUERIES)
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
