"""A*+DWA: a global path on the known map, followed by the dynamic window approach."""

import numpy as np
from numpy.typing import NDArray

from adrl.envs import NavSim


class AStarDwaPolicy:
    """A*+DWA with the true map: the path is planned when the task is made, discs are foreseen."""

    name = method = "astar-dwa"
    guidance = "map"
    training_worlds: tuple[str, ...] = ()

    def act_in(self, sim: NavSim) -> NDArray[np.float32]:
        """(N, 2) actions in the simulator's current state."""
        return sim.expert_actions()
