"""Where to drive, as the commands take it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from adrl.errors import ConfigError
from adrl.types import Scenario
from adrl.worlds import MapScenario, SdfScenario, get_scenario


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where to drive: one of the three."""

    scenario: str | None = None
    """A family of worlds; adrl list names them. clutter when neither a map nor a world is given."""
    map: Path | None = None
    """YAML file of a ROS map_server map, instead of a scenario."""
    world: Path | None = None
    """Gazebo SDF world of boxes, cylinders and planes, instead of a scenario."""

    def __post_init__(self) -> None:
        if sum(place is not None for place in (self.scenario, self.map, self.world)) > 1:
            raise ConfigError("give one of scenario, map and world")

    def load(self) -> Scenario:
        """The scenario, map or world, read once. Raises UnknownName, MapError, WorldError."""
        return self._loaded

    @cached_property
    def _loaded(self) -> Scenario:
        if self.map is not None:
            return MapScenario(self.map)
        if self.world is not None:
            return SdfScenario(self.world)
        return get_scenario(self.scenario or "clutter")
