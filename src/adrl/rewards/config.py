"""Constants of the reward. Terms keep the paper's numbers; `scale` brings their sum near 1."""

import functools
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

import tyro

from adrl.errors import ConfigError
from adrl.ranges import Range, check_ranges
from adrl.registry import look_up
from adrl.rewards.extra import RewardTerm
from adrl.rewards.features import FEATURES, Feature
from adrl.rewards.step import Array
from adrl.types import Form, require_forms

EQUATIONS = ("eq8", "eq9", "eq10", "eq11", "eq14", "eq16", "eq17")
"""The equations that have two forms."""

STANDING_AT_WORST = 3.3
"""The most that a reference period of standing costs: the least the weighted shaping terms can sum to."""


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Constants and forms of eqs 7 to 17. Stored with every run.

    In the corrected forms the weights keep this order for gamma <= 0.98 a reference period: reaching the goal >
    standing, circling, spinning, orbiting > crashing. Standing in the worst place costs at most 3.3 a period, 165
    for ever; a crash costs failure_weight * 200. A longer horizon needs a larger failure_weight: 2 for gamma = 0.99.
    """

    success_reward: ClassVar[float] = 200.0
    """r_su of eq 7, paid once on arrival."""
    failure_penalty: ClassVar[float] = 200.0
    """-r_f of eq 8, paid once on collision."""
    safe_clearance_m: Annotated[float, Range(0.001, 100.0)] = 0.1
    """d_safe - d_r of eq 11: clearance of the footprint's edge, in m, below which an obstacle costs; 0.001 to 100."""
    stagnation_fraction: ClassVar[float] = 0.15
    """d_m of eq 12 as a fraction of max_speed * dt, the longest step a robot can make."""
    near_goal_m: ClassVar[float] = 3.0
    """Distance in m below which the goal counts as near: T_goal rises from 0 here to 1 at the goal."""
    success_weight: ClassVar[float] = 1.0
    """Weight of the success row; fixed, while the four shaping rows always sum to 1."""
    failure_weight: Annotated[float, Range(1e-06, 1e6)] = 1.0
    """Weight of the failure row; fixed; 1e-06 to 1e+06."""
    scale: Annotated[float, Range(1e-06, 1e6)] = 0.02
    """Factor on the weighted sum (eq 17), so that values stay within a few units; 1e-06 to 1e+06."""
    extra_terms: tuple[Annotated[str | RewardTerm, tyro.conf.arg(constructor=str)], ...] = ()
    """Shaping terms beside the paper's: RewardTerm objects, names of the entry point group "adrl.reward_terms", or
    no-approach, which pays nothing for nearing the goal: what is left on the way are costs."""
    eq8: Form = "corrected"
    """Failure. Literal: distance to the obstacles' middle points, and a timeout fails too and terminates."""
    eq9: Form = "corrected"
    """Motion. Literal: without the -1, so that driving in circles pays for ever."""
    eq10: Form = "corrected"
    """Approach. Literal: pays any displacement and any turn, in metres and radians."""
    eq11: Form = "corrected"
    """Obstacle. Literal: positive and unbounded just inside the safe distance."""
    eq14: Form = "corrected"
    """Approach weight. Literal: times T_goal, so that nothing leads to a goal that is far."""
    eq16: Form = "corrected"
    """Normalisation. Literal: over all six weights, so that a near obstacle makes a crash cheaper."""
    eq17: Form = "corrected"
    """The sum. Literal: formed when the step is stored, with that day's weights, and never again."""

    def __post_init__(self) -> None:
        require_forms(self, *EQUATIONS)
        object.__setattr__(self, "extra_terms", tuple(self.extra_terms))  # JSON has lists
        for term in self.extra_terms:
            if not isinstance(term, (str, RewardTerm)):
                raise ConfigError(f"reward.extra_terms holds {term!r}; give names, or RewardTerm objects")
        for name, count in Counter(map(str, self.extra_terms)).items():
            if count > 1 or name in ("success", "failure"):
                fault = "is there twice" if count > 1 else "has a fixed weight"
                raise ConfigError(f"reward.extra_terms: {name!r} {fault}; give another name")
        check_ranges(self, "reward.")

    def literal(self) -> Self:
        """The same constants with every equation as printed."""
        return replace(self, **dict.fromkeys(EQUATIONS, "literal"))

    def extra(self) -> tuple[RewardTerm, ...]:
        """The extra terms. Raises UnknownName for a name that no installed package offers."""
        return tuple(_offered(term) if isinstance(term, str) else term for term in self.extra_terms)

    def features(self) -> dict[str, Feature]:
        """The F features that the weights are functions of: the paper's three, then those of the extra terms."""
        return FEATURES | {name: feature for term in self.extra() for name, feature in term.features.items()}

    def quantities(self) -> dict[str, Callable[[Any], Array]]:
        """What the extra terms need of a step that Step has not."""
        return {name: value for term in self.extra() for name, value in term.quantities.items()}


@functools.cache
def _offered(name: str) -> RewardTerm:
    from adrl.rewards.weights import EXTRA_TERMS  # which need this module

    found = look_up("reward term", name, EXTRA_TERMS)
    if not isinstance(found, RewardTerm):
        raise ConfigError(f"reward term {name!r}: its entry point gives {found!r}, not a RewardTerm")
    return found
