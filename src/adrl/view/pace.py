"""How fast time goes on the page, against the wall's clock."""

import time
from collections.abc import Iterator
from typing import Any

BUDGET_S = 0.08
"""A turn drives on for at most so long; a machine that is too slow for the speed asked for falls behind and says so."""
LONGEST_S = 0.25
"""Between two turns no more than this is made up for: a page that was away has missed the rest."""
SMOOTHING = 0.1
"""Weight of the newest turn in the speed that is reached."""


class Pace:
    """Which control periods are due."""

    def __init__(self) -> None:
        self.playing, self.speed = True, 1.0
        self._period_s, self._due_s = 1.0, 0.0
        self._last_s: float | None = None
        self._reached = 1.0

    def begin(self, period_s: float) -> None:
        """A drive begins whose control periods are so long."""
        self._period_s, self._due_s = period_s, 0.0
        self._reached = self.speed

    def set(self, playing: bool | None = None, speed: float | None = None) -> None:
        """speed: times of real time. None: as it is."""
        self.playing = self.playing if playing is None else playing
        self.speed = self.speed if speed is None else speed
        self._due_s, self._reached = 0.0, self.speed

    def steps(self, now_s: float) -> Iterator[None]:
        """As many as are due at a time of the wall's clock."""
        passed_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), LONGEST_S)
        self._last_s = now_s
        if not self.playing or passed_s == 0.0:
            return
        self._due_s += passed_s * self.speed
        began_s, done = time.perf_counter(), 0
        while self._due_s >= self._period_s and time.perf_counter() - began_s < BUDGET_S:
            self._due_s -= self._period_s
            done += 1
            yield
        behind_s = max(self._due_s - self._period_s, 0.0)
        self._due_s -= behind_s
        share = 1.0 - behind_s / (passed_s * self.speed)
        self._reached += SMOOTHING * (max(share, 0.0) * self.speed - self._reached)

    def content(self) -> dict[str, Any]:
        """What a page shows of it."""
        return {"playing": self.playing, "speed": self.speed, "reached": round(self._reached, 2)}
