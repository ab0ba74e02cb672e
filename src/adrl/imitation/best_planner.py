"""Which local controller is the expert of a robot: the best one in a short trial in the first training worlds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adrl.planning.local_control import CONTROLLERS, TITLES
from adrl.types import RobotConfig, Task

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv
    from adrl.imitation.experts import Expert

TRIALS = 50
"""Tasks that each controller drives."""
GOOD_SUCCESS = 0.98
"""A controller that arrives less often is no expert, if another does;"""
GOOD_PACE = 1.15
"""and none is looked for that is better than one within so many times what the shortest way takes at full speed."""
MOST_BACKWARD = 0.1
"""Share of its time that it may back."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """How a controller drove."""

    controller: str
    success: float
    """Share of the tasks in which it arrived."""
    pace: float
    """Its time in those, over what their shortest ways take at full speed; infinite where there are none."""
    backward: float
    """Share of the time in which the robot backed; 0 for a car, whose paths lead backward too."""

    @property
    def arrives(self) -> bool:
        """As an expert should, and forward."""
        return self.success >= GOOD_SUCCESS and self.backward <= MOST_BACKWARD

    def __str__(self) -> str:
        return f"{TITLES[self.controller]}: {100 * self.success:.0f} % of the trials, pace {self.pace:.2f}"


def planner_of(expert: "Expert", env: "NavVectorEnv") -> Trial:
    """The trial of the controller that an expert is made of: its own, or the best for the robots."""
    own = getattr(expert, "planner", None)
    return best_planner(env) if own is None else best_planner(env, (own,))


def best_planner(env: "NavVectorEnv", names: Sequence[str] | None = None) -> Trial:
    """The trial of the best of these controllers, or of all, for the robots of env, in its first tasks; the same for
    every seed.

    In the order of what a decision costs: the first that arrives and keeps a good pace. If there is none, the fastest
    of those that arrive; if none does, the one that arrives most often.
    """
    numbers = range(min(TRIALS, env.num_tasks))
    robots = [env.kinds[env.kind_of_task(i)].robot for i in numbers]
    tasks = [env.task(i) for i in numbers]
    trials = []
    for name in CONTROLLERS if names is None else names:
        trials.append(trial(name, robots, tasks, env.sim.num_threads))
        if trials[-1].arrives and trials[-1].pace <= GOOD_PACE:
            return trials[-1]
    arriving = [trial for trial in trials if trial.arrives]
    if arriving:
        return min(arriving, key=lambda trial: trial.pace)
    return max(trials, key=lambda trial: (trial.success - trial.backward, -trial.pace))


def trial(controller: str, robots: Sequence[RobotConfig], tasks: list[Task], num_threads: int = 1) -> Trial:
    """Let a controller drive these tasks, each with the robot in the same place."""
    from adrl.envs import Kind, NavSim

    n, rows = len(tasks), np.arange(len(tasks))
    kinds = list(dict.fromkeys(Kind(robot=robot) for robot in robots))
    kind = np.array([kinds.index(Kind(robot=robot)) for robot in robots])
    sim = NavSim(n, kinds, expert=controller, num_threads=num_threads)
    sim.reset(rows, tasks, rows.astype(np.uint64), np.random.default_rng(0), kinds=kind)
    car = np.array([robot.is_car for robot in robots])
    running, arrived = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    backward = driven = 0
    while running.any():
        outcome = sim.step(sim.expert_actions())
        driven += int(running.sum())
        backward += int((sim.b["twist"][running & ~car, 0] < 0.0).sum())
        arrived |= outcome.reached & running
        running &= ~(outcome.reached | outcome.collided | outcome.timed_out)
        sim.b["active"][:] = running
    full_speed_s = np.array([task.shortest_m for task in tasks]) / sim.rows.robot.max_speed_mps
    pace = float(sim.b["time"][arrived].sum() / full_speed_s[arrived].sum()) if arrived.any() else np.inf
    return Trial(controller=controller, success=float(arrived.mean()), pace=pace, backward=backward / driven)
