"""Which local controller is the expert of a robot: the best one in a short trial in the first training worlds."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adrl.planning.local_control import CONTROLLERS, TITLES
from adrl.types import RobotConfig, Task

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv

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


def best_planner(env: "NavVectorEnv") -> Trial:
    """The trial of the best controller for the robot of env, in its first tasks; the same for every seed.

    In the order of what a decision costs: the first that arrives and keeps a good pace. If there is none, the fastest
    of those that arrive; if none does, the one that arrives most often.
    """
    tasks = [env.task(i) for i in range(min(TRIALS, env.num_tasks))]
    trials = []
    for name in CONTROLLERS:
        trials.append(trial(name, env.robot, tasks, env.sim.num_threads))
        if trials[-1].arrives and trials[-1].pace <= GOOD_PACE:
            return trials[-1]
    arriving = [trial for trial in trials if trial.arrives]
    if arriving:
        return min(arriving, key=lambda trial: trial.pace)
    return max(trials, key=lambda trial: (trial.success - trial.backward, -trial.pace))


def trial(controller: str, robot: RobotConfig, tasks: list[Task], num_threads: int = 1) -> Trial:
    """Let a controller drive these tasks, a robot each."""
    from adrl.envs import NavSim

    n, rows = len(tasks), np.arange(len(tasks))
    sim = NavSim(n, robot, expert=controller, num_threads=num_threads)
    sim.reset(rows, tasks, rows.astype(np.uint64), np.random.default_rng(0))
    running, arrived = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    backward = driven = 0
    while running.any():
        outcome = sim.step(sim.expert_actions())
        driven += int(running.sum())
        if not robot.is_car:
            backward += int((sim.b["twist"][running, 0] < 0.0).sum())
        arrived |= outcome.reached & running
        running &= ~(outcome.reached | outcome.collided | outcome.timed_out)
        sim.b["active"][:] = running
    shortest_m = np.array([task.shortest_m for task in tasks])[arrived].sum()
    pace = float(sim.b["time"][arrived].sum() * robot.max_speed_mps / shortest_m) if arrived.any() else np.inf
    return Trial(controller=controller, success=float(arrived.mean()), pace=pace, backward=backward / driven)
