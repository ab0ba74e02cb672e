"""How a scan and the rest become an observation. Stored with every policy."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import tyro

from adrl.errors import ConfigError
from adrl.observation.component import ComponentFactory

MAX_HISTORY_STEPS = 50


@dataclass(frozen=True, kw_only=True)
class EncoderConfig:
    """How a scan becomes features. Stored with every policy."""

    num_sectors: int = 36
    """Sectors of a full circle; each holds the nearest range of its beams."""
    near_m: float = 0.3
    """Range in m at which the logarithmic scale turns: gaps of this size and below get most of the resolution."""
    goal_scale_m: float = 1.0
    """Same for the distance to the goal, m."""
    history_steps: int = 0
    """Control periods between the two scans whose comparison adds num_sectors motion cues (see motion); 0 for none."""
    extra_components: tuple[Annotated[str | ComponentFactory, tyro.conf.arg(constructor=str)], ...] = ()
    """Components after the built-in ones: factories, or names of the entry point group
    "adrl.observation_components"."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra_components", tuple(self.extra_components))  # JSON has lists
        for component in self.extra_components:
            if not isinstance(component, str) and not isinstance(getattr(component, "name", None), str):
                raise ConfigError(
                    f"encoder.extra_components holds {component!r}; give names, or factories with a name"
                )
        if not 4 <= self.num_sectors <= 2048:
            raise ConfigError(f"encoder.num_sectors is {self.num_sectors}; give 4 to 2048")
        for name in ("near_m", "goal_scale_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"encoder.{name} is {value}; give a positive number")
        if not 0 <= self.history_steps <= MAX_HISTORY_STEPS:
            raise ConfigError(
                f"encoder.history_steps is {self.history_steps}; give 0 to {MAX_HISTORY_STEPS} control periods"
            )

    def fields(self) -> dict[str, Any]:
        """As JSON takes it: components by their names, no entry where there are none, as in policies of before."""
        plain = asdict(replace(self, extra_components=()))
        del plain["extra_components"]
        names = [part if isinstance(part, str) else part.name for part in self.extra_components]
        return plain | ({"extra_components": names} if names else {})
