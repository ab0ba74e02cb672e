"""Local controllers of N robots: what drives along a path, knowing the world or a map of the robot's own."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.errors import ConfigError
from adrl.types import RobotConfig


def local_lookahead_m(robot: RobotConfig) -> float:
    """How far along its path a robot that moves so fast has to look."""
    return min(max(1.5 * robot.max_speed_mps, 0.5), 3.0)


def dwa_config(robot: RobotConfig) -> "_core.DwaConfig":
    """The dynamic window approach for this robot."""
    config = _core.DwaConfig()
    config.lookahead_m = local_lookahead_m(robot)
    return config


def pursuit_config(robot: RobotConfig) -> "_core.PursuitConfig":
    """Regulated pure pursuit for this robot."""
    config = _core.PursuitConfig()
    config.max_lookahead_dist = max(config.min_lookahead_dist, local_lookahead_m(robot))
    return config


def mppi_config(robot: RobotConfig) -> "_core.MppiConfig":
    """Model predictive path integral control, whose constants are shares of the robot's limits."""
    return _core.MppiConfig()


def orca_config(robot: RobotConfig) -> "_core.OrcaConfig":
    """Optimal reciprocal collision avoidance for this robot. Raises ConfigError for a car."""
    if robot.is_car:
        raise ConfigError(f"robot {robot.name!r} is a car: orca drives robots that turn on the spot")
    config = _core.OrcaConfig()
    config.lookahead_m = local_lookahead_m(robot)
    return config


DWA = "dwa"
CONTROLLERS: dict[str, Callable[[RobotConfig], Any]] = {
    DWA: dwa_config,
    "pursuit": pursuit_config,
    "mppi": mppi_config,
}
"""name -> its constants for a robot, in the order in which they are tried."""
TITLES: dict[str, str] = {DWA: "A*+DWA", "pursuit": "A*+pure pursuit", "mppi": "A*+MPPI"}
"""name -> what the planner with this controller is called where people read."""


def near_config(name: str, robot: RobotConfig, lookahead_m: float) -> "_core.ControllerConfig":
    """Constants of a controller that heads for no point farther ahead than that."""
    config = CONTROLLERS[name](robot)
    for field in ("lookahead_m", "min_lookahead_dist", "max_lookahead_dist"):
        if hasattr(config, field):
            setattr(config, field, min(getattr(config, field), lookahead_m))
    return config


class LocalControl:
    """A local controller a robot. All that changes is in the arrays `b`; `native` is the core's."""

    def __init__(
        self,
        num_robots: int,
        robot: RobotConfig | Sequence[RobotConfig],
        config: "_core.ControllerConfig | Callable[[RobotConfig], _core.ControllerConfig]",
        *,
        foresee: bool = True,
        num_threads: int = 1,
        kind: NDArray[np.intp] | None = None,
    ) -> None:
        """robot: one, or those of several kinds; config: for all, or what makes it for a robot.

        foresee: in a known world moving discs are where they will be; otherwise they stand where they are. kind: (N,)
        which of the robots each row is, an array of the caller's that is read at every decision; all the first if None.
        """
        robots = (robot,) if isinstance(robot, RobotConfig) else tuple(robot)
        configs = [config(one) if callable(config) else config for one in robots]
        size = max(map(_core.control_memory, configs))
        self.b: dict[str, NDArray[Any]] = {"memory": np.zeros((num_robots, size))}
        kinds = [
            (one.native, (one.max_acceleration_mps2, one.max_yaw_acceleration_radps2, one.lag_s), made)
            for one, made in zip(robots, configs, strict=True)
        ]
        kind = np.zeros(num_robots, np.intp) if kind is None else kind
        self.native = _core.LocalControl(num_robots, num_threads, kinds, foresee, self.b | {"kind": kind})

    @contextmanager
    def advising(self) -> Iterator[None]:
        """While this lasts somebody else drives, and asks what these controllers would do: robots that stand are not
        led out of where they are stuck, as their drivers may just not do what they are told."""
        recovers, self.native.recovers = self.native.recovers, False
        try:
            yield
        finally:
            self.native.recovers = recovers

    def restart(self, indices: NDArray[np.intp]) -> None:
        """Forget what is remembered of robots `indices` (M,)."""
        self.b["memory"][indices] = 0.0
