"""Drives with faults: simulator -> faulty lines -> runtime with supervisor -> base with its watchdog -> simulator."""

import dataclasses
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args
from zlib import crc32

import numpy as np

from adrl import _core
from adrl.benchmarks.faults import FAULTS, Fault, Line, pass_on
from adrl.deploy import MlpPolicy, Navigator, Odometry, Pose, Scan, Twist, load_policy
from adrl.deploy.policy import DEFAULT, resolve_policy
from adrl.envs import NavSim
from adrl.envs.randomization import PARAMS, nominal_params
from adrl.evaluation.statistics import wilson_interval
from adrl.geometry import compose
from adrl.types import RobotConfig, Task, World
from adrl.worlds import get_scenario, load_robot, task_set

Outcome = Literal["arrived", "hit_standing", "hit_moving", "timeout"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
SCENARIOS = ("clutter", "complex", "rooms", "dynamic")
ROBOT_NAMES = ("diffbot", "turtlebot3_burger", "jackal")
WATCHDOG = 2
"""Periods without a command after which a base stops by itself."""
SPARE = 2.0
"""Of a task's time limit: who stands for a while still has the time to arrive."""
MOVED_M, STANDS_S = 0.02, 40.0
"""Who has not moved for so long does not arrive any more."""
TOUCH_M = 0.05
"""A hit is one with a moving disc when it is as near as this."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How one ended."""

    fault: str
    robot: str
    scenario: str
    task: int
    outcome: Outcome
    time_s: float
    reasons: dict[str, int]
    """Control periods under way in which each reason was given."""


def fault_drives(
    faults: Iterable[str] = tuple(FAULTS),
    *,
    robots: Sequence[str] = ROBOT_NAMES,
    scenarios: Sequence[str] = SCENARIOS,
    tasks: int = 1,
    first: int = 0,
) -> list[Drive]:
    """Every fault with every robot in every scenario, on so many of its test tasks, from the first one named on."""
    drives: list[Drive] = []
    names = tuple(faults)
    for robot in map(load_robot, robots):
        for scenario in scenarios:
            drawn = task_set(get_scenario(scenario), robot, "test", first + tasks)[first:]
            drives += _drive(names, robot, scenario, dict(enumerate(drawn, first)))
    return drives


def table(drives: Iterable[Drive]) -> list[dict[str, Any]]:
    """A row a fault, the worst first: how many drives ended how, with the 95 % interval of hits at what stands."""
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(drive.fault for drive in drives):
        mine = [drive for drive in drives if drive.fault == name]
        ends = Counter(drive.outcome for drive in mine)
        reasons: Counter[str] = Counter()
        for drive in mine:
            reasons.update(drive.reasons.keys())
        hits = wilson_interval(ends["hit_standing"], len(mine))
        row: dict[str, Any] = {"fault": name, "drives": len(mine)} | {end: ends[end] for end in OUTCOMES}
        row |= {"hit_standing_low": hits.low, "hit_standing_high": hits.high}
        row["reasons"] = dict(reasons.most_common())
        rows.append(row)
    return sorted(rows, key=lambda row: (-row["hit_standing"], -row["timeout"]))


def policy_of(robot: RobotConfig) -> MlpPolicy:
    """The shipped one of the robot, else `default` on the robot."""
    own = robot.name == "jackal"
    shipped = load_policy(resolve_policy("jackal" if own else DEFAULT))
    config = dataclasses.replace(shipped.config, robot=dataclasses.asdict(robot))
    return shipped if own else MlpPolicy(shipped.layers, config)


class _Robot:
    """One drive: its lines, its navigator, its base."""

    def __init__(self, name: str, robot: RobotConfig, scenario: str, task: Task, number: int) -> None:
        self.name, self.fault, self.task, self.number = name, FAULTS[name], task, number
        # By what the drive is, and not by its place among others: a part of them is the same drives.
        drive = np.random.SeedSequence(crc32(f"{name}/{robot.name}/{scenario}/{number}".encode()))
        scans, odometry, commands, places, glass, sensors = drive.spawn(6)
        self.scans: Line[Scan] = Line(robot, scans)
        self.odometry: Line[Odometry] = Line(robot, odometry)
        self.commands: Line[Twist] = Line(robot, commands)
        self.places: Line[Pose] = Line(robot, places)
        self.sensors_seed = sensors.generate_state(1, np.uint64)[0]
        """Of the simulated sensors' noise."""
        policy = policy_of(robot)
        world = task.world if policy.config.guidance == "map" else None
        self.navigator = Navigator(policy, world=world)
        self.navigator.set_goal(task.goal)
        self.age = WATCHDOG
        """Periods since the base was told anything."""
        self.moved_m, self.moved_s = 0.0, 0.0
        """How far it had come when it moved last, and when that was."""
        self.outcome: Outcome | None = None
        self.reasons: Counter[str] = Counter()
        self.sees = _without_glass(task.world, glass) if self.fault.glass else None

    def is_late(self, travelled_m: float, time_s: float) -> bool:
        """Whether it has used up its time, or stands for good."""
        if travelled_m > self.moved_m + MOVED_M:
            self.moved_m, self.moved_s = travelled_m, time_s
        return time_s >= SPARE * self.task.time_limit_s or time_s - self.moved_s > STANDS_S


def _drive(names: Sequence[str], robot: RobotConfig, scenario: str, tasks: dict[int, Task]) -> list[Drive]:
    robots = [_Robot(name, robot, scenario, task, number) for name in names for number, task in tasks.items()]
    everyone = np.arange(len(robots))
    sim = NavSim(len(robots), robot, guidance="goal")
    seeds = np.array([one.sensors_seed for one in robots])
    sim.reset(everyone, [one.task for one in robots], seeds, np.random.default_rng(0))
    sim.b["params"][:] = [params_of(robot, one.fault) for one in robots]
    period_s = robot.control_period_s
    step = 0
    while sim.b["active"].any():
        for i in np.flatnonzero(sim.b["active"]).tolist():
            _step(robots[i], sim, i, step)
        sim.native.step()
        step += 1
        for i in np.flatnonzero(sim.b["active"]).tolist():
            one = robots[i]
            if sim.b["collided"][i]:
                one.outcome = "hit_moving" if _moving_near(sim, i) else "hit_standing"
            elif one.outcome is None and one.is_late(float(sim.b["travelled"][i]), step * period_s):
                one.outcome = "timeout"
            if one.outcome is not None:
                sim.b["active"][i] = 0
    return [
        Drive(
            fault=one.name,
            robot=robot.name,
            scenario=scenario,
            task=one.number,
            outcome=one.outcome or "timeout",
            time_s=float(sim.b["time"][i]),
            reasons=dict(one.reasons),
        )
        for i, one in enumerate(robots)
    ]


def _step(one: _Robot, sim: NavSim, i: int, step: int) -> None:
    """What robot i receives in a control period, and what its base does with what it sends."""
    fault, b, period_s = one.fault, sim.b, sim.robot.control_period_s
    now_s = step * period_s
    if fault.clock is not None:
        now_s = fault.clock(step, now_s)
    ranges = b["ranges"][i] if one.sees is None else _seen_through(one, sim, i)
    scan = pass_on(one.scans, as_scan(ranges, sim.robot, now_s), fault.scan, fault.in_spells)
    odometry = pass_on(one.odometry, as_odometry(sim, i, now_s), fault.odometry, fault.in_spells)
    one.age += 1
    if fault.node(step):
        x, y, yaw = b["pose"][i].tolist()
        place = pass_on(one.places, (x, y, yaw), fault.localisation, fault.in_spells)
        command = one.navigator.step(scan, odometry, now_s, map_pose=place)
        one.reasons.update(command.reasons)
        if command.status == "reached":
            one.outcome = "arrived"
        elif command.status == "failed":
            one.outcome = "timeout"
        sent = pass_on(one.commands, command.twist, fault.command, fault.in_spells)
        if sent is not None:
            b["command"][i], one.age = sent, 0
    if one.age >= WATCHDOG:
        b["command"][i] = 0.0


def as_scan(ranges: np.ndarray, robot: RobotConfig, stamp_s: float) -> Scan:
    """What a driver publishes of the simulated LiDAR."""
    lidar = robot.lidar
    return Scan(
        ranges=ranges.astype(np.float64),
        angle_min_rad=lidar.angle_min_rad,
        angle_increment_rad=lidar.angle_increment_rad,
        range_max_m=lidar.max_range_m,
        stamp_s=stamp_s,
    )


def as_odometry(sim: NavSim, i: int, stamp_s: float) -> Odometry:
    """The simulated robot's own reckoning."""
    (x, y, yaw), (v, w) = sim.b["odometry"][i].tolist(), sim.b["twist"][i].tolist()
    return Odometry(pose=(x, y, yaw), twist=(v, w), stamp_s=stamp_s)


def params_of(robot: RobotConfig, fault: Fault) -> np.ndarray:
    """(P,) of the simulated base."""
    params: dict[str, float] = dict(zip(PARAMS, nominal_params(robot).tolist(), strict=True))
    for name, factor in fault.base_factors.items():
        params[name] *= factor
    for name, term in fault.base_terms.items():
        params[name] += term
    return np.array([params[name] for name in PARAMS])


def _moving_near(sim: NavSim, i: int) -> bool:
    """Whether a moving disc or a person touches robot i."""
    moving = sim.moving(i)
    away = np.hypot(*(moving[:, :2] - sim.b["pose"][i, :2]).T) - moving[:, 2]
    return bool((away < sim.robot.circumscribed_radius_m + TOUCH_M).any())


def _without_glass(world: World, seed: np.random.SeedSequence) -> World:
    """A third of the circles and polygons are of glass: the LiDAR looks through them."""
    rng = np.random.default_rng(seed)
    circles = world.circles[rng.random(len(world.circles)) > 1.0 / 3.0]
    polygons = tuple(corners for corners in world.polygons if rng.random() > 1.0 / 3.0)
    return dataclasses.replace(world, circles=circles, polygons=polygons)


def _seen_through(one: _Robot, sim: NavSim, i: int) -> np.ndarray:
    """(K,) ranges where glass is not seen."""
    assert one.sees is not None
    lidar = sim.robot.lidar
    sensor = np.array([compose(sim.b["pose"][i], lidar.mount)])
    time_s = float(sim.b["time"][i])
    through = _core.raycast(one.sees.native, sensor, lidar.angles_rad, lidar.max_range_m, time_s)[0]
    return np.maximum(through, sim.b["ranges"][i])
