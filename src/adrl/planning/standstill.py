"""Cars on a known map that do not get on. They cannot turn on the spot, so once off their path they do not find back to
it: they need another one, from where they stand."""

import numpy as np
from numpy.typing import NDArray

from adrl.types import Array

WAIT_S = 3.0
"""A car that has not got on for so long is given another path."""
GOT_ON_M = 0.1
"""So much less of the path left is getting on."""


class Standstill:
    """When N robots last got on along their paths. All that changes is in the arrays `b`, a row a robot."""

    def __init__(self, num_robots: int) -> None:
        self.b: dict[str, Array] = {
            "least_left": np.full(num_robots, np.inf),
            "since": np.zeros(num_robots),
        }
        """least_left: metres of path that were left when the robot last got on, at the time `since`, s."""

    def begin(self, rows: NDArray[np.intp], left_m: Array | float, now_s: Array | float) -> None:
        """Robots `rows` (M,) have another path, with so much of it left (M,), at this time (M,)."""
        self.b["least_left"][rows], self.b["since"][rows] = left_m, now_s

    def update(self, left_m: Array, now_s: Array) -> NDArray[np.bool_]:
        """left_m, now_s: (N,) metres of path left, and the time -> (N,) robots that have not got on for WAIT_S."""
        least, since = self.b["least_left"], self.b["since"]
        better = left_m < least - GOT_ON_M
        least[better], since[better] = left_m[better], now_s[better]
        np.minimum(since, now_s, out=since)  # a clock may go back
        return now_s - since > WAIT_S + 1e-6  # sums of periods and their multiples differ by less
