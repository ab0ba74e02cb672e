"""Whether a robot that drove into somebody could have braked by what was to be seen."""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from adrl.envs import NavSim
from adrl.geometry import compose
from adrl.types import Array, RobotConfig

TOLD_S = 0.4
"""Before a robot has to begin to brake, somebody must have walked as they do for so long: fewer scans tell no
velocity."""
STRAIGHT_M = 0.1
"""Who comes farther than this from where they would be at the velocity of before has turned, or changed pace."""
STANDS_MPS = 0.15
"""Who is slower stands."""
ON_M, BEAMS = 0.15, 2
"""So many beams that end so near to a body see it."""


class Witness:
    """Remembers for as long as one robot needs to stop what moved about it, and whether its LiDAR could see it."""

    def __init__(self, robot: RobotConfig) -> None:
        reaction_s = robot.latency_s + 3.0 * robot.lag_s + 3.0 * robot.control_period_s
        stopping_s = reaction_s + robot.fastest_mps / robot.max_acceleration_mps2
        periods = math.ceil((TOLD_S + stopping_s) / robot.control_period_s)
        self._lidar, self._period_s = robot.lidar, robot.control_period_s
        self._known: deque[tuple[Array, NDArray[np.bool_]]] = deque(maxlen=periods + 1)
        self._walked: NDArray[np.bool_] | None = None
        """(M,) who has walked in view."""

    def look(self, sim: NavSim, i: int) -> None:
        """A control period of robot i of the simulator has begun."""
        moving = sim.moving(i)
        x, y, yaw = compose(sim.b["pose"][i], self._lidar.mount)
        ranges = sim.b["ranges"][i, : self._lidar.num_beams]
        hit = ranges < self._lidar.max_range_m
        angles, away = yaw + self._lidar.angles_rad[hit], ranges[hit]
        points = np.column_stack([x + away * np.cos(angles), y + away * np.sin(angles)])
        off = np.linalg.norm(moving[:, None, :2] - points, axis=2) - moving[:, 2:]
        seen = (np.abs(off) < ON_M).sum(axis=1) >= BEAMS
        if self._known and self._walked is not None:
            gone_m = np.hypot(*(moving[:, :2] - self._known[-1][0][:, :2]).T)
            self._walked |= seen & (gone_m > STANDS_MPS * self._period_s)
        else:
            self._walked = np.zeros(len(moving), dtype=bool)
        self._known.append((moving, seen))

    def could_brake(self, sim: NavSim, i: int) -> bool:
        """Whether what touches robot i was in view, and walked straight on, for as long as it takes to stop for it.

        Who has only stood is no more than two posts to a LiDAR that sees legs, and the body about them is not seen.
        """
        moving = sim.moving(i)
        if len(moving) == 0 or len(self._known) < (self._known.maxlen or 0):
            return False
        x, y = sim.b["pose"][i, :2]
        who = int((np.hypot(moving[:, 0] - x, moving[:, 1] - y) - moving[:, 2]).argmin())
        if not all(seen[who] for _, seen in self._known):
            return False
        task = sim.tasks[i]
        if task is not None and task.people.legs and self._walked is not None and not self._walked[who]:
            return False
        places = np.array([known[who, :2] for known, _ in self._known] + [moving[who, :2]])
        step = places[1] - places[0]
        straight = places[0] + np.arange(len(places))[:, None] * step
        return bool((np.hypot(*(places - straight).T) < STRAIGHT_M).all())
