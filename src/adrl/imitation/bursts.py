"""Which of many robots are disturbed now: stretches of time that begin and end by chance."""

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array

Mask = NDArray[np.bool_]


class Bursts:
    """N rows, each calm until a burst begins and then disturbed until it ends; both waiting times are geometric."""

    def __init__(self, num_envs: int, share: float, mean_s: float, rng: np.random.Generator) -> None:
        """share: of the time in bursts, in [0, 1). mean_s: of a burst's length, which a large share makes longer."""
        self._rng = rng
        self._mean_s, self._calm_to_burst = mean_s, share / (1.0 - share)
        self._most = min(1.0, 1.0 / max(self._calm_to_burst, 1e-9))
        self.active = np.zeros(num_envs, dtype=bool)
        """(N,) the rows in a burst."""

    def step(self, dt_s: Array) -> Mask:
        """Go on by each row's control period (N,), and tell the rows (N,) whose burst begins."""
        ends = np.minimum(dt_s / self._mean_s, self._most)
        change = self._rng.random(len(self.active))
        begins = ~self.active & (change < ends * self._calm_to_burst)
        self.active = np.where(self.active, change >= ends, begins)
        return begins
