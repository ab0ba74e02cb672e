"""N robots that drive on maps of their own, as a classical stack does: map, A*, local controller.

No true map and no true pose: scans and odometry are all there is.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adrl.planning.local_control import LocalControl
from adrl.planning.replanner import NO_ROUTE, Replanner, route_buffers
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import Array, RobotConfig

OWN_MAP = ReplannerConfig(replan_interval_s=0.5, margin_m=0.05)
"""Constants of map and routes."""


class OwnMapDriver:
    """Commands for N robots to their goals. Poses and goals are in the frame of the odometry."""

    def __init__(
        self,
        num_robots: int,
        robot: RobotConfig | Sequence[RobotConfig],
        control: LocalControl,
        config: ReplannerConfig,
        *,
        num_threads: int = 1,
        kind: NDArray[np.intp] | None = None,
    ) -> None:
        """config: of map and routes; a route is planned anew every replan_interval_s. control: of as many robots.

        robot, kind: as in LocalControl.
        """
        self.control = control
        # Of the replanner the map and the search are wanted; eqs 18 to 21 are another method's.
        self._maps = Replanner(num_robots, robot, config, num_threads=num_threads, kind=kind)
        self._goals = np.zeros((num_robots, 2))
        self._routes = route_buffers(num_robots)
        self._since_plan = np.zeros(num_robots, np.int64)

    def restart(self, indices: NDArray[np.intp], goals: Array, odometry: Array) -> None:
        """Begin anew with robots `indices` (M,) at odometry (M, 3), to goals (M, 2), with empty maps."""
        mask = np.zeros(len(self._goals), np.uint8)
        mask[indices] = 1
        poses = np.zeros((len(mask), 3))
        poses[indices] = odometry
        self._maps.native.restart(mask, poses)
        self._goals[indices] = goals
        # Until there is a plan, straight on.
        routes = self._routes
        routes["corners"][indices, 0], routes["corners"][indices, 1] = odometry[:, :2], goals
        routes["num_corners"][indices] = 2
        routes["along"][indices] = 0.0
        self._since_plan[indices] = self._maps.interval[indices]
        self.control.restart(indices)

    def commands(
        self, ranges: NDArray[np.float32], odometry: Array, twist: Array, active: NDArray[np.bool_]
    ) -> Array:
        """One control period: (N, K) ranges, (N, 3) odometry, (N, 2) twists -> (N, 2) speeds and yaw rates.

        active (N,): the others get 0.
        """
        native, mask = self._maps.native, active.astype(np.uint8)
        corners, counts, along = self._routes.values()
        native.observe(mask, odometry, ranges)
        due = active & (self._since_plan >= self._maps.interval)
        self._since_plan[active] += 1
        if due.any():
            native.plan_routes(due.astype(np.uint8), odometry, self._goals, corners, counts)
            # Where there is no way, the last route stays.
            planned = due & (self._maps.b["found"] != NO_ROUTE)
            along[planned] = 0.0
            self._since_plan[due] = 1
        out = np.zeros((len(mask), 2))
        native.drive(self.control.native, mask, odometry, twist, corners, counts, along, out)
        return out
