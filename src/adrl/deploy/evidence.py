"""Which of several explanations fits what is measured: Page's cumulative sums, one an alternative."""

import numpy as np

from adrl.types import Array

FADES = 0.98
"""f below: what is left of the sums at each measurement."""


class Evidence:
    """How much better than the belief each alternative has explained what has been measured of late.

    S <- max(0, f S + min(misfit of the belief - misfit of the alternative, most) - slack), Page 1954, "Continuous
    inspection schemes": S grows only while an alternative explains more than the belief does, by more than slack;
    measurements that tell the two not apart leave it to fade.
    """

    def __init__(self, alternatives: int, *, slack: float, most: float, enough: float) -> None:
        self._slack, self._most, self._enough = slack, most, enough
        self.sums: Array = np.zeros(alternatives)

    def forget(self) -> None:
        """Begin anew."""
        self.sums[:] = 0.0

    def add(self, belief: float, alternatives: Array) -> int | None:
        """Misfits of one measurement, (A,) those of the alternatives; the number of the alternative that has to be
        believed from now on, None for none."""
        better = np.minimum(belief - alternatives, self._most)
        self.sums = np.maximum(0.0, FADES * self.sums + better - self._slack)
        best = int(self.sums.argmax())
        return best if self.sums[best] > self._enough else None
