"""Where to drive, as the commands take it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from adrl.errors import ConfigError
from adrl.json_files import checked
from adrl.outputs import as_paths
from adrl.ranges import Range, check_ranges
from adrl.registry import listed_option
from adrl.types import Scenario
from adrl.worlds import BarnScenario, MapScenario, SdfScenario, get_scenario
from adrl.worlds.fixed import FixedWorld
from adrl.worlds.people import among_people
from adrl.worlds.ros_map import Unknown


def split_guidance(text: str) -> tuple[str, str]:
    """NAME or NAME@PLACE -> the guidance's name, and the place it is for; "" for any. Raises ConfigError."""
    name, at, place = (part.strip() for part in text.partition("@"))
    if at and not place:
        raise ConfigError(f"guidance {text!r}: give a place after @, as goal@clutter")
    return name, place


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where to drive: one of scenario, map, world and barn."""

    scenario: str | None = None
    """A family of worlds; adrl list names them. clutter when neither a map nor a world is given. For training also
    several, with commas between them."""
    map: Path | None = None
    """YAML file of a ROS map_server map, instead of a scenario."""
    unknown: Unknown = "solid"
    """What cells of the map are that nothing has looked at: solid or free."""
    world: Path | None = None
    """Gazebo world (SDF), instead of a scenario. Meshes need the extra meshes."""
    models: tuple[Path, ...] = ()
    """Folders of the models and meshes that the world names, looked in before Gazebo's variables and the folders beside
    the world."""
    ignore: tuple[str, ...] = ()
    """Names of models to leave out of the world; patterns such as 'tree_*' too."""
    barn: Path | None = None
    """Folder of worlds of the BARN benchmark with their paths, instead of a scenario."""
    barn_held_out: Annotated[int, Range(0, 1_000_000)] = 0
    """So many of these worlds, evenly spread in the order of their numbers, are kept for validation and test, and
    training has the others; 0 to 1e+06, and 0 trains, validates and tests on all."""
    people: Annotated[int, Range(0, 64)] = 0
    """So many people walk there: 0 to 64. 0: nobody, or as many as the scenario has of its own (crowd, corridor,
    doorway, office)."""
    people_share: Annotated[float, Range(0.0, 1.0)] | None = None
    """Of what is to be done to avoid the robot, the part that people do who look: 0 leaves all to the robot, 0.5 is
    reciprocal and the default, 1 leaves nothing to it; 0 to 1."""
    legs: bool = False
    """The LiDAR sees two legs of each person, which swing, instead of the body."""

    def __post_init__(self) -> None:
        check_ranges(self, "")
        as_paths(self, "map", "world", "barn")
        object.__setattr__(self, "models", tuple(map(Path, self.models)))
        if sum(place is not None for place in (self.scenario, self.map, self.world, self.barn)) > 1:
            raise ConfigError("give one of scenario, map, world and barn")
        if self.unknown != "solid" and self.map is None:
            raise ConfigError(f"unknown is {self.unknown!r} without map; give --map too")
        if (self.models or self.ignore) and self.world is None:
            raise ConfigError("--models and --ignore are for a world of Gazebo; give --world too")
        if self.barn_held_out and self.barn is None:
            raise ConfigError(f"barn_held_out is {self.barn_held_out} without barn; give --barn too")

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> "Place":
        """The place of a run, from the settings in its config.json. Raises FileError, ConfigError."""
        return checked(settings, Place)

    @property
    def default_guidance(self) -> str:
        """map where one world is given, as its map shows the way; goal in worlds that are drawn."""
        given = self.map is not None or self.world is not None or isinstance(self.scenario, FixedWorld)
        return "map" if given else "goal"

    def load(self) -> Scenario:
        """The scenario, map or worlds, read once.

        Raises UnknownName, MapError, WorldError, ConfigError, MissingExtra.
        """
        first, *others = self._loaded
        if others:
            raise ConfigError(f"scenario is {self.scenario}; give one of them")
        return first

    def load_all(self) -> tuple[Scenario, ...]:
        """As load(), and several scenarios where several are named."""
        return self._loaded

    @property
    def first(self) -> "Place":
        """The same, with the first of several scenarios. Raises ConfigError."""
        if not isinstance(self.scenario, str):
            return self
        return replace(self, scenario=listed_option("scenario", self.scenario)[0])

    @cached_property
    def _loaded(self) -> tuple[Scenario, ...]:
        return tuple(
            among_people(place, self.people, self.people_share, self.legs) for place in self._places()
        )

    def _places(self) -> tuple[Scenario, ...]:
        if self.map is not None:
            return (MapScenario(self.map, self.unknown),)
        if self.world is not None:
            return (SdfScenario(self.world, models=self.models, ignore=self.ignore),)
        if self.barn is not None:
            return (BarnScenario(self.barn, self.barn_held_out),)
        given = self.scenario or "clutter"
        return tuple(
            get_scenario(one)
            for one in (listed_option("scenario", given) if isinstance(given, str) else (given,))
        )
