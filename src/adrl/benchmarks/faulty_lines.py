"""A simulated robot whose sensors, localisation, runtime and base are joined by lines with a fault.

received = lines.receive(sim, i, step)
if received is not None:                      # the node runs
    lines.send(sim, i, ...)                   # the command that the runtime made of it
lines.watch_base(sim, i)
...                                           # the simulator's step
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from adrl import _core
from adrl.benchmarks.faults import Fault, Line, pass_on
from adrl.deploy import Odometry, Pose, Scan, Twist
from adrl.envs import NavSim
from adrl.envs.randomization import PARAMS, nominal_params
from adrl.evaluation.supervised import as_odometry, as_scan
from adrl.geometry import compose
from adrl.types import RobotConfig, World

WATCHDOG = 2
"""Periods without a command after which a base stops by itself."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Received:
    """What reaches the runtime in a control period; None for what does not."""

    now_s: float
    """By the runtime's clock."""
    scan: Scan | None
    odometry: Odometry | None
    place: Pose | None
    """On the map, by a localisation."""


class FaultyLines:
    """The lines of one robot. `fault` may be another one from one period to the next."""

    def __init__(self, robot: RobotConfig, world: World, drive: np.random.SeedSequence, fault: Fault) -> None:
        """drive: of all that is drawn; five are spawned of it."""
        scans, odometry, commands, places, self._glass = drive.spawn(5)
        self._scans: Line[Scan] = Line(robot, scans)
        self._odometry: Line[Odometry] = Line(robot, odometry)
        self._commands: Line[Twist] = Line(robot, commands)
        self._places: Line[Pose] = Line(robot, places)
        self._age = WATCHDOG
        """Periods since the base was told anything."""
        self.fault = fault
        self.see(world)

    def see(self, world: World) -> None:
        """The world is another now."""
        self._world = world
        self._through: World | None = None
        """What the LiDAR sees where it looks through glass; made when that is first wanted."""

    def receive(self, sim: NavSim, i: int, step: int) -> Received | None:
        """What the sensors of the simulator's robot i say, after the lines; None while the node does not run."""
        fault, b = self.fault, sim.b
        now_s = step * sim.robot.control_period_s
        if fault.clock is not None:
            now_s = fault.clock(step, now_s)
        ranges = self._seen_through(sim, i) if fault.glass else b["ranges"][i]
        scan = pass_on(self._scans, as_scan(ranges, sim.robot.lidar, now_s), fault.scan, fault.in_spells)
        odometry = pass_on(self._odometry, as_odometry(sim, i, now_s), fault.odometry, fault.in_spells)
        self._age += 1
        if not fault.node(step):
            return None
        x, y, yaw = b["pose"][i].tolist()
        place = pass_on(self._places, (x, y, yaw), fault.localisation, fault.in_spells)
        return Received(now_s=now_s, scan=scan, odometry=odometry, place=place)

    def send(self, sim: NavSim, i: int, twist: Twist) -> None:
        """What the runtime sends to the base."""
        sent = pass_on(self._commands, twist, self.fault.command, self.fault.in_spells)
        if sent is not None:
            sim.b["command"][i], self._age = sent, 0

    def watch_base(self, sim: NavSim, i: int) -> None:
        """The base stops by itself when it has not been told anything for too long."""
        if self._age >= WATCHDOG:
            sim.b["command"][i] = 0.0

    def _seen_through(self, sim: NavSim, i: int) -> np.ndarray:
        """(K,) ranges where glass is not seen."""
        if self._through is None:
            self._through = _without_glass(self._world, self._glass)
        lidar = sim.robot.lidar
        sensor = np.array([compose(sim.b["pose"][i], lidar.mount)])
        time_s = float(sim.b["time"][i])
        through = _core.raycast(self._through.native, sensor, lidar.angles_rad, lidar.max_range_m, time_s)[0]
        return np.maximum(through, sim.b["ranges"][i])


def params_of(robot: RobotConfig, fault: Fault) -> np.ndarray:
    """(P,) of the simulated base."""
    params: dict[str, float] = dict(zip(PARAMS, nominal_params(robot).tolist(), strict=True))
    for name, factor in fault.base_factors.items():
        params[name] *= factor
    for name, term in fault.base_terms.items():
        params[name] += term
    return np.array([params[name] for name in PARAMS])


def _without_glass(world: World, seed: np.random.SeedSequence) -> World:
    """A third of the circles and polygons are of glass: the LiDAR looks through them."""
    rng = np.random.default_rng(seed)
    circles = world.circles[rng.random(len(world.circles)) > 1.0 / 3.0]
    polygons = tuple(corners for corners in world.polygons if rng.random() > 1.0 / 3.0)
    return dataclasses.replace(world, circles=circles, polygons=polygons)
