"""The curriculum of jump-start reinforcement learning (Uchendu et al. 2022, algorithm 1).

A guide drives the first h steps of each episode, the actor the rest; here h counts reference periods, so that it is the
same time for every robot. h begins at the length of the longest demonstration and shrinks by a tenth of that whenever
both together do as well as they ever did.
"""

from typing import NamedTuple, Self

import numpy as np

from adrl.agents.interface import Mask
from adrl.types import Array

STAGES = 10
"""n of the paper: h takes this many values above 0."""
TOLERANCE = 0.05
"""beta of the paper: how far below its best success a stage may be and count as learnt."""
WINDOW = 32
"""Episodes over which success is measured, at the least: as many of each robot."""
AVERAGED = 3
"""Windows over which success is averaged before it counts as the best, so that no lucky window sets the mark."""


class JumpStart(NamedTuple):
    """The curriculum's state. Plain numbers, so a checkpoint holds it as JSON.

    A window has the first episodes of each robot that begin after the window does, all under one h. Whichever end
    first instead would be short ones, and those of robots that crash.
    """

    horizon: float
    """Reference periods that the guide drives at first."""
    awaited: list[int]
    """(N,) episodes of each robot until the window has all of its own: one more if one runs that began before."""
    stage: int = STAGES
    """STAGES to 0; 0 leaves all to the actor."""
    succeeded: int = 0
    """Of the present window."""
    windows: int = 0
    """How many the average holds, AVERAGED at the most."""
    average: float = 0.0
    """Moving average of the windows' success, under whatever h."""
    best: float = 0.0
    """The highest average of AVERAGED windows so far."""

    @classmethod
    def start(cls, horizon: float, num_envs: int) -> Self:
        """As all robots begin their first episode."""
        return cls(horizon, [_episodes_each(num_envs)] * num_envs)

    def guided_steps(self, periods: Array) -> Array:
        """(N,) h, the steps at the beginning of an episode that the guide drives, of robots whose steps are so many
        reference periods (N,) long."""
        # The horizon is so many steps of some robot: for it what is not whole is the arithmetic's.
        return np.rint(np.round(self.horizon / periods * self.stage / STAGES, 6))

    def after(self, ended: Mask, success: Mask) -> Self:
        """After a step of all robots, (N,) each: at the end of a window, on to the next stage if it went well."""
        if self.stage == 0 or not ended.any():
            return self
        awaited = np.array(self.awaited)
        each = _episodes_each(len(awaited))
        judged = ended & (awaited > 0) & (awaited <= each)
        succeeded = self.succeeded + int((judged & success).sum())
        awaited -= ended & (awaited > 0)
        if awaited.any():
            return self._replace(awaited=awaited.tolist(), succeeded=succeeded)
        following = self._judged(succeeded / (each * len(awaited)))
        return following._replace(awaited=[each + 1] * len(awaited), succeeded=0)

    def _judged(self, success: float) -> Self:
        """After a window's success: as much as ever was, and more than none, passes the stage."""
        passed = min(self.best, success) > 0.0 and success >= self.best - TOLERANCE
        windows = min(self.windows + 1, AVERAGED)
        average = self.average + (success - self.average) / windows
        best = max(self.best, average) if windows == AVERAGED else self.best
        return self._replace(stage=self.stage - passed, windows=windows, average=average, best=best)


def _episodes_each(num_envs: int) -> int:
    """A window's episodes of each robot."""
    return -(-WINDOW // num_envs)
