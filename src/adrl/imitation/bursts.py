"""Which of many robots are disturbed now: stretches of time that begin and end by chance."""

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


class Bursts:
    """N rows, each calm until a burst begins and then disturbed until it ends; both waiting times are geometric."""

    def __init__(
        self, num_envs: int, share: float, mean_s: float, dt_s: float, rng: np.random.Generator
    ) -> None:
        """share: of the time in bursts, in [0, 1). mean_s: of a burst's length, which a large share makes longer."""
        self._rng = rng
        calm_to_burst = share / (1.0 - share)
        self._ends = min(dt_s / mean_s, 1.0, 1.0 / max(calm_to_burst, 1e-9))
        self._begins = self._ends * calm_to_burst
        self.active = np.zeros(num_envs, dtype=bool)
        """(N,) the rows in a burst."""

    def step(self) -> Mask:
        """Go on by one control period, and tell the rows (N,) whose burst begins."""
        change = self._rng.random(len(self.active))
        begins = ~self.active & (change < self._begins)
        self.active = np.where(self.active, change >= self._ends, begins)
        return begins
