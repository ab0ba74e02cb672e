"""The observation encoder: scan, goal, twist and more in, one vector out. Training and robots share it."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.observation.body import Body
from adrl.observation.component import F32, Component, ComponentFactory, Mirror, OfEach, Senses
from adrl.observation.config import EncoderConfig
from adrl.observation.goal import Goal
from adrl.observation.last_action import LastAction
from adrl.observation.motion import MotionCues, ScanHistory
from adrl.observation.path_ahead import PathAhead
from adrl.observation.scan import Scan
from adrl.observation.tracks import Tracks
from adrl.observation.twist import Twist
from adrl.registry import look_up
from adrl.types import Array, RobotConfig

COMPONENTS: dict[str, Callable[[Sequence[RobotConfig], EncoderConfig], Component]] = {
    "scan": Scan,
    "goal": Goal,
    "twist": Twist,
    "last_action": LastAction,
    "motion": MotionCues,
    "tracks": Tracks,
    "path": PathAhead,
    "body": Body,
}
"""The built-in components, in the order in which an observation has them; see EncoderConfig.has.

Each is made for all robots of an encoder at once, and finds in Senses.kind which of them a row is.
"""


class ObservationEncoder:
    """(N, K) ranges, goals, twists and last actions -> (N, D) float32, the components side by side.

    Of one robot, or of several, of which each row is one: its kind. D = num_sectors + 8; motion cues are num_sectors
    more, tracks 5 num_tracks, and with either encode() takes the ScanHistory of the robots; points of the path are 12
    more, and it takes them. The body and extra components come on top.
    """

    def __init__(
        self, robot: RobotConfig | Sequence[RobotConfig], config: EncoderConfig | None = None
    ) -> None:
        """Raises UnknownName and ConfigError for extra components that are none."""
        self.config = config or EncoderConfig()
        self.robots: tuple[RobotConfig, ...] = (robot,) if isinstance(robot, RobotConfig) else tuple(robot)
        """By their numbers, which Senses.kind has."""
        self.components: dict[str, Component] = {
            name: make(self.robots, self.config) for name, make in COMPONENTS.items() if self.config.has(name)
        }
        """By name, in order."""
        scan = self.components["scan"]
        assert isinstance(scan, Scan)
        self.scan = scan
        for extra in self.config.extra_components:
            name, make = _factory(extra)
            if name in self.components:
                raise ConfigError(f"encoder.extra_components: {name!r} is there twice; give another name")
            parts = [make(one, self.config) for one in self.robots]
            self.components[name] = OfEach(name, self.robots, parts) if len(parts) > 1 else parts[0]
        ends = np.cumsum([component.size for component in self.components.values()]).tolist()
        self.places: dict[str, slice] = {
            name: slice(start, end)
            for name, start, end in zip(self.components, [0, *ends], ends, strict=False)
        }
        """Where each component stands in an observation."""
        self.size: int = ends[-1]
        """D, the length of an observation."""

    @property
    def robot(self) -> RobotConfig:
        """The robot of an encoder of one."""
        (robot,) = self.robots
        return robot

    @property
    def history_steps(self) -> int:
        """Control periods between the newest scan of the history and the oldest; 0 without."""
        return self.config.past_steps

    @property
    def needs_path(self) -> bool:
        """Whether encode() takes points of the path."""
        return self.config.path

    @property
    def extent_m(self) -> F32:
        """(S,) distance from the only robot's LiDAR to its footprint's edge, in the middle of each sector."""
        (extent_m,) = self.scan.extent_m
        return extent_m

    @property
    def beams_of_sectors(self) -> NDArray[np.int32]:
        """(S, L) numbers of the only robot's beams in each sector; see BeamsOfSectors."""
        (beams,) = self.scan.beams
        return beams.table

    @property
    def mirror(self) -> Mirror | None:
        """Left for right; None where the body or the LiDAR of a robot is not symmetric."""
        orders, signs = [], []
        for name, component in self.components.items():
            mirror = component.mirror()
            if mirror is None:
                return None
            orders.append(self.places[name].start + mirror.order)
            signs.append(mirror.sign)
        return Mirror(np.concatenate(orders), np.concatenate(signs))

    @property
    def limit(self) -> float:
        """No number of a simulated observation is further from 0."""
        return max(component.limit for component in self.components.values())

    def encode(
        self,
        ranges: F32,
        goal: Array,
        twist: Array,
        last_action: F32,
        history: ScanHistory | None = None,
        path: Array | None = None,
        *,
        kind: NDArray[np.intp] | None = None,
    ) -> F32:
        """(N, D) of N robots; arguments as in Senses. Raises ValueError without kinds where there are several."""
        if kind is None:
            if len(self.robots) > 1:
                raise ValueError(
                    f"this encoder is of {len(self.robots)} robots; say which of them each row is"
                )
            kind = np.zeros(len(ranges), np.intp)
        senses = Senses(ranges, goal, twist, last_action, history, path, kind=kind)
        out = np.empty((len(ranges), self.size), dtype=np.float32)
        for name, component in self.components.items():
            component.write(senses, out[:, self.places[name]])
        return out


def _factory(
    extra: "str | ComponentFactory",
) -> tuple[str, Callable[[RobotConfig, EncoderConfig], Component]]:
    """An extra component's name, and what makes it. Raises UnknownName."""
    if isinstance(extra, str):
        return extra, look_up("observation component", extra, {})
    return extra.name, extra
