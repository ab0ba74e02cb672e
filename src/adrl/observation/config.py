"""How a scan and the rest become an observation. Stored with every policy."""

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from adrl.errors import ConfigError
from adrl.observation.component import ComponentFactory
from adrl.ranges import Range, check_ranges
from adrl.types import RobotConfig

if TYPE_CHECKING:
    ExtraComponent = str | ComponentFactory
else:
    ExtraComponent = str  # what the command line reads; a robot has no library that could be told more

FOLLOWED_STEPS = 4
"""Control periods over which tracks are followed."""


@dataclass(frozen=True, kw_only=True)
class EncoderConfig:
    """How a scan becomes features. Stored with every policy."""

    num_sectors: Annotated[int, Range(4, 2048)] = 36
    """Sectors of a full circle, 4 to 2048; each holds the nearest range of its beams."""
    near_m: Annotated[float, Range(0.001, 100.0)] = 0.3
    """Range in m at which the logarithmic scale turns, 0.001 to 100: gaps of this size and below get most of the
    resolution."""
    goal_scale_m: Annotated[float, Range(0.001, 1000.0)] = 1.0
    """Same for the distance to the goal, m; 0.001 to 1000."""
    history_steps: Annotated[int, Range(0, 50)] = 0
    """Control periods between the two scans whose comparison adds num_sectors motion cues (see motion), 0 to 50; 0 for
    none."""
    num_tracks: Annotated[int, Range(0, 32)] = 0
    """Also tell place, velocity and age of so many things that move, the nearest ones (see tracks), 0 to 32; 0 for
    none."""
    path: bool = False
    """Also tell six points of the path, up to 3 m ahead (see path_ahead): where the way to the waypoint goes on to."""
    body: bool = False
    """Also tell what the robot's body is (see body): for a policy of many robots."""
    reach_m: Annotated[float, Range(0.05, 1000.0)] | None = None
    """Where the scale of the scan's distances ends, m, 0.05 to 1000: what is farther, and what the robot's own LiDAR
    does not reach, reads free. None: the reach of the robot's own LiDAR, another scale for each."""
    extra_components: tuple[ExtraComponent, ...] = ()
    """Components after the built-in ones: factories, or names of the entry point group
    "adrl.observation_components"."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra_components", tuple(self.extra_components))  # JSON has lists
        for component in self.extra_components:
            if not isinstance(component, str) and not isinstance(getattr(component, "name", None), str):
                raise ConfigError(
                    f"encoder.extra_components holds {component!r}; give names, or factories with a name"
                )
        check_ranges(self, "encoder.")

    def has(self, component: str) -> bool:
        """Whether an observation has this built-in component; motion cues, tracks, path and body are asked for."""
        asked = {
            "motion": self.history_steps > 0,
            "tracks": self.num_tracks > 0,
            "path": self.path,
            "body": self.body,
        }
        return asked.get(component, True)

    @property
    def past_steps(self) -> int:
        """Control periods between the newest scan that is needed and the oldest."""
        return max(self.history_steps, FOLLOWED_STEPS if self.num_tracks > 0 else 0)

    def reach_of(self, robot: RobotConfig) -> float:
        """Where the scale of a robot's distances ends, m."""
        return robot.lidar.max_range_m if self.reach_m is None else self.reach_m

    def fields(self) -> dict[str, Any]:
        """As JSON takes it: components by their names; what came later has no entry where it is not used, as in
        policies of before."""
        plain = asdict(replace(self, extra_components=()))
        names = [part if isinstance(part, str) else part.name for part in self.extra_components]
        later = {
            "num_tracks": self.num_tracks,
            "path": self.path,
            "body": self.body,
            "reach_m": self.reach_m,
            "extra_components": names,
        }
        return {name: value for name, value in (plain | later).items() if value or name not in later}
