"""Robots in a BatchSim with their buffers, for the tests of the core."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import _core
from adrl.planning.local_control import LocalControl, dwa_config
from adrl.types import Array, LidarConfig, RobotConfig, Task, World

Buffers = dict[str, NDArray[Any]]

PARAMS = (
    "speed_gain",
    "yaw_gain",
    "acceleration",
    "yaw_acceleration",
    "lag_s",
    "latency_s",
    "range_noise",
    "dropout",
    "odometry_speed_error",
    "odometry_yaw_error",
)
"""Columns of the buffer `params`."""

IDEAL = dict(speed_gain=1.0, yaw_gain=1.0, acceleration=1e6, yaw_acceleration=1e6)
"""A base that does at once what it is told; the other params are 0."""

OUTPUTS = (
    "ranges",
    "pose",
    "odometry",
    "twist",
    "clearance",
    "least_clearance",
    "waypoint",
    "route_left",
    "time",
    "travelled",
    "reached",
    "collided",
    "at_fault",
    "memory",
    "people",
)
"""Buffers that the simulator writes."""


def buffers(n: int, beams: int) -> Buffers:
    """Arrays of the shapes and dtypes that BatchSim asks for, all 0."""
    one = dict.fromkeys(("clearance", "least_clearance", "route_left", "time", "travelled"), ())
    rows = one | {"command": (2,), "pose": (3,), "odometry": (3,), "twist": (2,), "waypoint": (2,)}
    rows |= {"params": (_core.NUM_PARAMS,), "memory": (_core.MEMORY_SIZE,)}
    rows |= {"people": (_core.MAX_PEOPLE, _core.PERSON_NUMBERS)}
    b: Buffers = {name: np.zeros((n, *shape)) for name, shape in rows.items()}
    b |= {name: np.zeros(n, dtype=np.uint8) for name in ("active", "reached", "collided", "at_fault")}
    b |= {"seed": np.zeros(n, dtype=np.uint64), "kind": np.zeros(n, dtype=np.int64)}
    return b | {"ranges": np.zeros((n, beams), dtype=np.float32)}


def params(**values: float) -> Array:
    """(NUM_PARAMS,) of an ideal base, but for what is given."""
    assert len(PARAMS) == _core.NUM_PARAMS
    assert set(values) <= set(PARAMS)
    return np.array([(IDEAL | values).get(name, 0.0) for name in PARAMS])


def a_task(
    world: World,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    goal: tuple[float, float] = (100.0, 0.0),
    **more: Any,
) -> Task:
    """A task whose path is the straight line unless another is given."""
    path = more.pop("path", np.array([start[:2], goal]))
    return Task(world=world, start=start, goal=goal, path=path, shortest_m=1.0, time_limit_s=60.0, **more)


class Fleet:
    """Robot i on task i. `b` holds the buffers."""

    def __init__(
        self,
        tasks: Sequence[Task],
        robot: RobotConfig,
        *,
        num_threads: int = 1,
        config: _core.SimConfig | None = None,
        **values: Any,
    ) -> None:
        """values: of the params of all robots, see `params`."""
        n = len(tasks)
        self.b = buffers(n, robot.lidar.num_beams)
        self.b["params"][:] = params(**values)
        self.b["seed"][:] = np.arange(n) + 7
        self.b["active"][:] = 1
        self.sim = _core.BatchSim(n, num_threads, [(robot.native, config or _core.SimConfig())], self.b)
        self.control = LocalControl(n, robot, dwa_config(robot), num_threads=self.sim.num_threads)
        for i, task in enumerate(tasks):
            self.sim.set_task(i, task.native)

    def reset(self) -> "Fleet":
        self.sim.reset(np.ones(len(self.b["active"]), dtype=np.uint8))
        return self

    def step(self, command: object = None) -> "Fleet":
        """One control period; command (2,) or (N, 2), or what was commanded before."""
        if command is not None:
            self.b["command"][:] = np.asarray(command, dtype=np.float64)
        self.sim.step()
        return self

    def plan(self) -> Array:
        """(N, 2) commands of A*+DWA."""
        count = len(self.b["active"])
        out = np.zeros((count, 2))
        self.sim.plan(np.ones(count, np.uint8), self.control.native, out)
        return out

    def snapshot(self) -> Buffers:
        return {name: array.copy() for name, array in self.b.items()}


def assert_equal_bytes(
    one: Mapping[str, NDArray[Any]], other: Mapping[str, NDArray[Any]], rows: Any = slice(None)
) -> None:
    """All that the simulator writes is the same in some rows, to the last bit."""
    for name in OUTPUTS:
        assert one[name][rows].tobytes() == other[name][rows].tobytes(), name


SQUARE = ((0.3, -0.2), (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2))


def a_robot(*, polygon: bool = False, beams: int = 16, max_range_m: float = 6.0, **more: Any) -> RobotConfig:
    """A robot of up to 3 m/s and 3 rad/s either way: a disc of 0.2 m or a rectangle of 0.6 x 0.4 m."""
    more.setdefault("lidar", LidarConfig(num_beams=beams, max_range_m=max_range_m))
    shape: dict[str, Any] = dict(radius_m=None, footprint_m=SQUARE) if polygon else dict(radius_m=0.2)
    limits: dict[str, Any] = dict(max_speed_mps=3.0, min_speed_mps=-3.0, max_yaw_rate_radps=3.0)
    return RobotConfig(**(shape | limits | more))


EMPTY = World(bounds=(-4.0, -4.0, 4.0, 4.0))
WALLED = World(
    bounds=(-4.0, -4.0, 4.0, 4.0),
    segments=np.array([[-4.0, -4, 4, -4], [4, -4, 4, 4], [4, 4, -4, 4], [-4, 4, -4, -4]]),
    circles=np.array([[1.5, 1.0, 0.4], [-1.0, 2.0, 0.3]]),
    discs=np.array([[-2.0, -2.0, 2.0, -2.0, 0.3, 0.5, 0.1, math.inf]]),
)
