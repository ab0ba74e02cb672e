"""A*+DWA: a global path on the known map, followed by the dynamic window approach."""

import numpy as np
from numpy.typing import NDArray

from adrl.envs import NavSim


class AStarDwaPolicy:
    """Drives with full knowledge of its world: the path is planned when the task is made, discs are foreseen."""

    def act_in(self, sim: NavSim) -> NDArray[np.float32]:
        """(N, 2) actions in the simulator's current state."""
        return sim.expert_actions()
