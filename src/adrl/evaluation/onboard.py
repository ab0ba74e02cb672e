"""A policy driven as a robot's node drives it: by scans and odometry alone, with supervisor and recovery."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.deploy import Navigator
from adrl.deploy.policies import ResolvedPolicy
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.observation import to_action
from adrl.types import RobotConfig

F32 = NDArray[np.float32]


class Onboard:
    """What rollout() takes for a policy: a Navigator a robot, which makes its own waypoints and is told of no map."""

    def __init__(self, policy: ResolvedPolicy, robot: RobotConfig, guidance: str) -> None:
        """guidance: goal or replan. Raises ConfigError for one that takes the map."""
        if guidance == "map":
            raise ConfigError("the benchmark gives no map; leave guidance out, or give goal or replan")
        self.guidances = (guidance,)
        self._options: dict[str, Any] = {"policy": policy, "robot": robot, "guidance": guidance}
        self._navigators: dict[int, Navigator] = {}

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Episodes of the robots `rows` (M,) begin."""
        for row in rows.tolist():
            self._navigators[row] = Navigator(**self._options)

    def act_in(self, sim: NavSim) -> F32:
        """(N, 2) actions: what the navigators command in this control period; to stand, of robots that have ended."""
        twists = np.zeros((sim.num_envs, 2))
        for row in np.flatnonzero(sim.b["active"]).tolist():
            twists[row] = self._twist(self._navigators[row], sim, row)
        return to_action(twists, sim.robot)

    def _twist(self, navigator: Navigator, sim: NavSim, row: int) -> tuple[float, float]:
        b, task = sim.b, sim.tasks[row]
        assert task is not None
        if navigator.goal is None:
            navigator.set_goal(task.goal)
        now_s = float(b["time"][row])
        scan = as_scan(b["ranges"][row], sim.robot.lidar, now_s)
        return navigator.step(scan, as_odometry(sim, row, now_s), now_s).twist
