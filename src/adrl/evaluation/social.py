"""What people had of a robot: how near it came, whose fault a collision was, and how long it stood for them."""

import numpy as np
from numpy.typing import NDArray

from adrl.envs import NavSim
from adrl.geometry import Array, in_robot_frame
from adrl.types import RobotConfig

NEAR_M = 0.5
"""From the footprint's edge to a body: nearer is in a person's space."""
FARTHEST_M = 10.0
"""Up to which distances are told."""
STILL_MPS, STILL_RADPS = 0.02, 0.05
"""A robot below both stands."""


class Company:
    """Watches the people about every robot of a rollout, from their starts on."""

    def __init__(self, sim: NavSim) -> None:
        n = sim.num_envs
        people = [task.people.radius_m for task in sim.tasks if task is not None]
        self._radius_m = np.full((n, max(map(len, people))), -np.inf)  # of nobody: infinitely far off
        for row, radius_m in zip(self._radius_m, people, strict=True):
            row[: len(radius_m)] = radius_m
        self.person_distance_m = np.minimum(self._gaps(sim), FARTHEST_M)
        """(N,) least distance from the footprint to a body; 0 or less after a touch."""
        self.near_person_s = np.zeros(n)
        """(N,) time within NEAR_M of a person."""
        self.frozen_s = np.zeros(n)
        """(N,) time at rest."""
        self.at_fault = np.zeros(n, dtype=bool)
        """(N,) collided, and had moved into what it touched."""
        self._time_s = sim.b["time"].copy()

    def add(self, sim: NavSim, active: NDArray[np.bool_]) -> None:
        """One step of the robots (N,) that were driving."""
        passed_s = np.where(active, sim.b["time"] - self._time_s, 0.0)
        self._time_s = sim.b["time"].copy()
        gaps = self._gaps(sim)
        self.person_distance_m = np.where(
            active, np.minimum(self.person_distance_m, gaps), self.person_distance_m
        )
        self.near_person_s += passed_s * (gaps < NEAR_M)
        speed, yaw_rate = np.abs(sim.b["twist"]).T
        stands = (speed < STILL_MPS) & (yaw_rate < STILL_RADPS)
        self.frozen_s += passed_s * (stands & (sim.b["collided"] == 0))  # contact stops a robot at once
        self.at_fault |= active & sim.b["at_fault"].astype(bool)

    def columns(self, sim: NavSim, shortest_m: Array) -> dict[str, NDArray[np.generic]]:
        """The columns of Episodes that exist among people. shortest_m: (N,)."""
        return {
            "at_fault": self.at_fault,
            "person_distance_m": self.person_distance_m,
            "near_person_s": self.near_person_s,
            "frozen_s": self.frozen_s,
            "lost_s": sim.b["time"] - shortest_m / sim.rows.robot.max_speed_mps,
        }

    def _gaps(self, sim: NavSim) -> Array:
        """(N,) distance from each robot's footprint to the nearest body."""
        count = self._radius_m.shape[1]
        places = in_robot_frame(sim.b["pose"][:, None], sim.b["people"][:, :count, :2])
        away = np.empty(self._radius_m.shape)
        for number, kind in enumerate(sim.kinds):
            rows = sim.b["kind"] == number
            away[rows] = _to_footprint(kind.robot, places[rows])
        return (away - self._radius_m).min(axis=1)


def _to_footprint(robot: RobotConfig, points: Array) -> Array:
    """(..., 2) points of the robot's frame -> (...) distance to its footprint; inside a disc negative, a polygon 0."""
    if robot.radius_m is not None:
        return np.hypot(points[..., 0], points[..., 1]) - robot.radius_m
    least = np.full(points.shape[:-1], np.inf)
    inside = np.ones(points.shape[:-1], dtype=bool)
    corners = robot.polygon
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, off = b - a, points - a
        along = np.clip(off @ edge / (edge @ edge), 0.0, 1.0)
        least = np.minimum(least, np.hypot(*np.moveaxis(off - along[..., None] * edge, -1, 0)))
        inside &= edge[0] * off[..., 1] - edge[1] * off[..., 0] >= 0.0
    return np.where(inside, 0.0, least)
