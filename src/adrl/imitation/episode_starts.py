"""In which rows of an environment an episode has begun since an expert last looked."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv


class EpisodeStarts:
    """For what an expert remembers of an episode, asked once a step."""

    def __init__(self, env: "NavVectorEnv") -> None:
        self._env = env
        self._task, self._time_s = np.full(env.num_envs, -1), np.zeros(env.num_envs)

    def rows(self) -> NDArray[np.intp]:
        """(M,) rows that have another task than at the last call, or whose clock has gone back."""
        task, time_s = self._env.task_index, self._env.sim.b["time"]
        begun = (task != self._task) | (time_s < self._time_s)
        self._task, self._time_s = task, time_s.copy()
        return np.flatnonzero(begun)
