"""What not knowing the map costs: the routes of a point that replans on what it has scanned, and follows them exactly.

    python docs/replanning_floor.py [--range-m M] [--beams K] [--replanner.density-weight W]

The replanner maps the scans of a LiDAR without noise, takes what it has not seen for free, and plans anew every
`every` steps; the robot moves straight to its waypoints, in any direction, without inertia. So what its routes are
longer than the shortest ones is not the driving's: docs/decisions.md has the numbers.
"""

import sys
from dataclasses import dataclass, field, replace

import numpy as np
import tyro

from adrl import _core
from adrl.evaluation.statistics import bootstrap_mean
from adrl.planning.replanner import Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import RobotConfig
from adrl.worlds import get_scenario, task_set

MAX_STEPS = 1500


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to measure, on validation tasks."""

    scenario: str = "complex"
    episodes: int = 200
    range_m: float = 6.0
    """Range of the LiDAR, m."""
    beams: int = 180
    every: int = 3
    """Steps of 0.06 m between two scans and plans."""
    replanner: ReplannerConfig = field(default_factory=ReplannerConfig)


def main(options: Options) -> None:
    """Print mean and median of route / shortest path over the tasks that are reached."""
    lidar = replace(
        RobotConfig().lidar, num_beams=options.beams, max_range_m=options.range_m, noise_std_m=0.0
    )
    robot = replace(RobotConfig(), lidar=lidar)
    tasks = task_set(get_scenario(options.scenario), RobotConfig(), "validation", options.episodes)
    config = replace(options.replanner, range_m=max(options.replanner.range_m, options.range_m))
    replanner = Replanner(len(tasks), robot, config)
    goals = np.array([task.goal for task in tasks])
    pose = np.array([task.start for task in tasks])
    replanner.reset(np.arange(len(tasks)), goals, pose)
    step_m = robot.max_speed_mps * robot.control_period_s
    tolerance_m = np.array([task.goal_tolerance_m for task in tasks])
    ranges = np.zeros((len(tasks), options.beams), dtype=np.float32)
    travelled_m = np.zeros(len(tasks))
    active = np.ones(len(tasks), dtype=bool)
    for k in range(MAX_STEPS):
        if k % options.every == 0:
            for i in np.flatnonzero(active):
                world = tasks[i].world.native
                ranges[i] = _core.raycast(world, pose[i : i + 1], lidar.angles_rad, options.range_m)[0]
            mask = active.astype(np.uint8)
            replanner.native.observe(mask, pose, ranges)
            replanner.native.plan(mask, pose, goals)
        way = replanner.b["waypoint"] - pose[:, :2]
        left_m = np.maximum(np.hypot(*way.T), 1e-9)
        moved_m = np.where(active, np.minimum(step_m, left_m), 0.0)
        pose[:, :2] += way / left_m[:, None] * moved_m[:, None]
        pose[:, 2] = np.where(active, np.arctan2(way[:, 1], way[:, 0]), pose[:, 2])
        travelled_m += moved_m
        active &= np.hypot(*(goals - pose[:, :2]).T) > tolerance_m
        if not active.any():
            break
    ratios = (travelled_m / np.array([task.shortest_m for task in tasks]))[~active]
    mean = bootstrap_mean(ratios)
    sys.stdout.write(
        f"{options.scenario}, {options.episodes} tasks, {options.range_m:g} m, {options.beams} beams: "
        f"reached {100.0 * (~active).mean():.1f} %, optimality {mean.estimate:.3f} [{mean.low:.3f}, {mean.high:.3f}], "
        f"median {np.median(ratios):.3f}\n"
    )


if __name__ == "__main__":
    main(tyro.cli(Options))
