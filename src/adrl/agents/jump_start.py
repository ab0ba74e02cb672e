"""The curriculum of jump-start reinforcement learning (Uchendu et al. 2022, algorithm 1).

A guide drives the first h steps of each episode, the actor the rest. h begins at the length of the longest
demonstration and shrinks by a tenth of that whenever both together do as well as they ever did.
"""

from typing import NamedTuple, Self

STAGES = 10
"""n of the paper: h takes this many values above 0."""
TOLERANCE = 0.05
"""beta of the paper: how far below its best success a stage may be and count as learnt."""
WINDOW = 32
"""Episodes over which the success of a stage is measured."""


class JumpStart(NamedTuple):
    """The curriculum's state. Plain numbers, so a checkpoint holds it as JSON."""

    horizon: int = 0
    """Steps that the guide drives at first."""
    stage: int = STAGES
    """STAGES to 0; 0 leaves all to the actor."""
    best: float = 0.0
    """The highest success of a window so far."""
    ended: int = 0
    """Episodes of the present window."""
    succeeded: int = 0

    @property
    def guided_steps(self) -> int:
        """h, the steps at the beginning of an episode that the guide drives."""
        return round(self.horizon * self.stage / STAGES)

    def after(self, ended: int, succeeded: int) -> Self:
        """With the episodes that ended since: at the end of a window, on to the next stage if it went well."""
        if self.stage == 0:
            return self
        ended, succeeded = self.ended + ended, self.succeeded + succeeded
        if ended < WINDOW:
            return self._replace(ended=ended, succeeded=succeeded)
        success = succeeded / ended
        best = max(self.best, success)
        stage = self.stage - (success >= best - TOLERANCE)
        return self._replace(stage=stage, best=best, ended=0, succeeded=0)
