"""What share of DynaBARN's kind of tasks can be solved at all: a search in space and time with full knowledge.

    python docs/dynabarn_solvable.py [--robot jackal_dynabarn] [--episodes N]

The robot is its circumscribed disc and moves in any direction at up to its greatest speed, or waits, on a grid in
space and time; where every cylinder will be is known. Without inertia and turning it is an upper bound for robots, but
for the grid: places count whole cells, so that ways narrower than a cell beside the robot are not found.
"""

import sys
from dataclasses import dataclass

import numpy as np
import tyro
from scipy import ndimage

from adrl.envs import NavSim
from adrl.evaluation.statistics import wilson_interval
from adrl.types import Array, RobotConfig, Task
from adrl.worlds import SCENARIOS, load_robot, task_set

CELL_M = 0.125
"""Side of a cell; the robot crosses one in a step at its greatest speed."""
CROSS = ndimage.generate_binary_structure(2, 1)
SQUARE = ndimage.generate_binary_structure(2, 2)


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to measure, on test tasks."""

    robot: str = "jackal_dynabarn"
    episodes: int = 200


def solvable(task: Task, robot: RobotConfig) -> bool:
    """Whether the goal is reached from the start before the time limit without a touch."""
    x_min, y_min, x_max, y_max = task.world.bounds
    columns, rows = int((x_max - x_min) / CELL_M), int((y_max - y_min) / CELL_M)
    x = x_min + (np.arange(columns) + 0.5) * CELL_M
    y = y_min + (np.arange(rows) + 0.5) * CELL_M
    radius = robot.circumscribed_radius_m
    still = np.minimum(y - y_min, y_max - y)[:, None] > radius
    still = still & ((x - x_min) > radius)[None]
    goal = np.hypot(x[None] - task.goal[0], y[:, None] - task.goal[1]) <= task.goal_tolerance_m
    reached = np.zeros((rows, columns), dtype=bool)
    reached[int((task.start[1] - y_min) / CELL_M), int((task.start[0] - x_min) / CELL_M)] = True
    # Eight neighbours in two of five steps, four in the others: an octagon, at most 8 % beyond the disc it can reach.
    for step, places in enumerate(cylinders(task, robot)):
        around = SQUARE if step % 5 in (1, 3) else CROSS
        across, up = (x - places[:, :1]) ** 2, (y - places[:, 1:2]) ** 2
        hit = (up[:, :, None] + across[:, None, :] <= (places[:, 2, None, None] + radius) ** 2).any(axis=0)
        reached = ndimage.binary_dilation(reached, around) & still & ~hit
        if (reached & goal).any():
            return True
        if not reached.any():
            return False
    return False


def cylinders(task: Task, robot: RobotConfig) -> Array:
    """(T, M, 3) x, y and radius of each after every CELL_M of the robot's way, up to the time limit."""
    period_s = CELL_M / robot.max_speed_mps
    clock = RobotConfig(control_period_s=period_s)
    sim = NavSim(1, clock)
    sim.reset(np.array([0]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    sim.b["pose"][0, 0] += 1000.0  # out of the way: it only keeps the time
    seen = []
    for _ in range(int(task.time_limit_s / period_s)):
        sim.native.step()
        seen.append(sim.moving(0))
    return np.array(seen)


def main(options: Options) -> None:
    """Print the share with its 95 % interval."""
    robot = load_robot(options.robot)
    assert isinstance(robot, RobotConfig)
    tasks = task_set(SCENARIOS["dynabarn"], robot, "test", options.episodes)
    solved = sum(solvable(task, robot) for task in tasks)
    share, low, high = (100.0 * value for value in wilson_interval(solved, len(tasks)))
    sys.stdout.write(f"{solved} of {len(tasks)}: {share:.1f} % [{low:.1f}, {high:.1f}]\n")


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
