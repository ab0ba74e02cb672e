"""The observation encoder: scan, goal, twist and more in, one vector out. Training and robots share it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.errors import ConfigError
from adrl.observation.component import F32, Component, Mirror, Senses
from adrl.observation.config import EncoderConfig
from adrl.observation.goal import Goal
from adrl.observation.last_action import LastAction
from adrl.observation.motion import MotionCues, ScanHistory
from adrl.observation.scan import Scan
from adrl.observation.twist import Twist
from adrl.registry import look_up
from adrl.types import Array, RobotConfig

COMPONENTS: dict[str, Callable[[RobotConfig, EncoderConfig], Component]] = {
    "scan": Scan,
    "goal": Goal,
    "twist": Twist,
    "last_action": LastAction,
    "motion": MotionCues,
}
"""The built-in components, in the order in which an observation has them. Motion cues need history_steps."""


class ObservationEncoder:
    """(N, K) ranges, goals, twists and last actions -> (N, D) float32, the components side by side.

    D = num_sectors + 8; with motion cues 2 num_sectors + 8, and encode() takes the ScanHistory of the robots. Extra
    components come on top.
    """

    def __init__(self, robot: RobotConfig, config: EncoderConfig | None = None) -> None:
        """Raises UnknownName and ConfigError for extra components that are none."""
        self.config = config or EncoderConfig()
        self.robot = robot
        self.components: dict[str, Component] = {
            name: make(robot, self.config)
            for name, make in COMPONENTS.items()
            if name != "motion" or self.config.history_steps > 0
        }
        """By name, in order."""
        scan = self.components["scan"]
        assert isinstance(scan, Scan)
        self.scan = scan
        for extra in self.config.extra_components:
            name, make = _factory(extra)
            if name in self.components:
                raise ConfigError(f"encoder.extra_components: {name!r} is there twice; give another name")
            self.components[name] = make(robot, self.config)
        ends = np.cumsum([component.size for component in self.components.values()]).tolist()
        self.places: dict[str, slice] = {
            name: slice(start, end)
            for name, start, end in zip(self.components, [0, *ends], ends, strict=False)
        }
        """Where each component stands in an observation."""
        self.size: int = ends[-1]
        """D, the length of an observation."""

    @property
    def history_steps(self) -> int:
        """Control periods between the scans that motion cues compare; 0 without."""
        return self.config.history_steps

    @property
    def extent_m(self) -> F32:
        """(S,) distance from the LiDAR to the footprint's edge in the middle of each sector."""
        return self.scan.extent_m

    @property
    def beams_of_sectors(self) -> NDArray[np.int32]:
        """(S, L) numbers of the beams in each sector; see Scan."""
        return self.scan.beams_of_sectors

    @property
    def mirror(self) -> Mirror | None:
        """Left for right; None for a robot whose body or LiDAR is not symmetric."""
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
        self, ranges: F32, goal: Array, twist: Array, last_action: F32, history: ScanHistory | None = None
    ) -> F32:
        """(N, D) of N robots; arguments as in Senses."""
        senses = Senses(ranges, goal, twist, last_action, history)
        out = np.empty((len(ranges), self.size), dtype=np.float32)
        for name, component in self.components.items():
            component.write(senses, out[:, self.places[name]])
        return out


def _factory(extra: Any) -> tuple[str, Callable[[RobotConfig, EncoderConfig], Component]]:
    """An extra component's name, and what makes it. Raises UnknownName."""
    if isinstance(extra, str):
        return extra, look_up("observation component", extra, {})
    return extra.name, extra
