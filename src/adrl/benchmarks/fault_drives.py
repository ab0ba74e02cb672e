"""Drives with faults: simulator -> faulty lines -> runtime with supervisor -> base with its watchdog -> simulator."""

import dataclasses
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args
from zlib import crc32

import numpy as np

from adrl.benchmarks.faults import FAULTS
from adrl.benchmarks.faulty_lines import FaultyLines, params_of
from adrl.benchmarks.witness import Witness
from adrl.deploy import MlpPolicy, Navigator, load_policy
from adrl.deploy.policy import resolve_policy
from adrl.envs import NavSim
from adrl.evaluation.statistics import wilson_interval
from adrl.types import RobotConfig, Task
from adrl.worlds import get_scenario, load_robot, task_set

Outcome = Literal["arrived", "hit_standing", "hit_moving", "timeout"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
SCENARIOS = ("clutter", "complex", "rooms", "dynamic")
ROBOT_NAMES = ("diffbot", "turtlebot3_burger", "jackal")
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
    at_fault: bool = False
    """It moved into what it hit."""
    avoidable: bool = False
    """It was at fault, and braking by what was to be seen would have avoided it: see Witness."""


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
    """A row a fault, the worst first: how many drives ended how, with the 95 % interval of hits at what stands, and how
    many of the collisions were the robot's fault, or avoidable."""
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(drive.fault for drive in drives):
        mine = [drive for drive in drives if drive.fault == name]
        ends = Counter(drive.outcome for drive in mine)
        reasons: Counter[str] = Counter()
        for drive in mine:
            reasons.update(drive.reasons.keys())
        blame = {name: sum(getattr(drive, name) for drive in mine) for name in ("at_fault", "avoidable")}
        hits = wilson_interval(ends["hit_standing"], len(mine))
        row: dict[str, Any] = {"fault": name, "drives": len(mine)} | {end: ends[end] for end in OUTCOMES}
        row |= blame
        row |= {"hit_standing_low": hits.low, "hit_standing_high": hits.high}
        row["reasons"] = dict(reasons.most_common())
        rows.append(row)
    return sorted(rows, key=lambda row: (-row["hit_standing"], -row["timeout"]))


def policy_of(robot: RobotConfig) -> MlpPolicy:
    """The shipped one of the robot, else the diffbot's on the robot."""
    own = robot.name == "jackal"
    shipped = load_policy(resolve_policy("jackal" if own else "diffbot"))
    config = dataclasses.replace(shipped.config, robot=dataclasses.asdict(robot))
    return shipped if own else MlpPolicy(shipped.layers, config)


class _Robot:
    """One drive: its lines, its navigator, its base."""

    def __init__(self, name: str, robot: RobotConfig, scenario: str, task: Task, number: int) -> None:
        self.name, self.fault, self.task, self.number = name, FAULTS[name], task, number
        # By what the drive is, and not by its place among others: a part of them is the same drives.
        drive = np.random.SeedSequence(crc32(f"{name}/{robot.name}/{scenario}/{number}".encode()))
        self.lines = FaultyLines(robot, task.world, drive, self.fault)
        self.sensors_seed = drive.spawn(1)[0].generate_state(1, np.uint64)[0]
        """Of the simulated sensors' noise."""
        policy = policy_of(robot)
        world = task.world if policy.config.guidance == "map" else None
        self.navigator = Navigator(policy, world=world)
        self.navigator.set_goal(task.goal)
        self.moved_m, self.moved_s = 0.0, 0.0
        """How far it had come when it moved last, and when that was."""
        self.outcome: Outcome | None = None
        self.witness = Witness(robot)
        self.reasons: Counter[str] = Counter()

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
            at_fault=bool(sim.b["at_fault"][i]),
            avoidable=bool(sim.b["at_fault"][i]) and one.witness.could_brake(sim, i),
        )
        for i, one in enumerate(robots)
    ]


def _step(one: _Robot, sim: NavSim, i: int, step: int) -> None:
    """What robot i receives in a control period, and what its base does with what it sends."""
    one.witness.look(sim, i)
    received = one.lines.receive(sim, i, step)
    if received is not None:
        command = one.navigator.step(
            received.scan, received.odometry, received.now_s, map_pose=received.place
        )
        one.reasons.update(command.reasons)
        if command.status == "reached":
            one.outcome = "arrived"
        elif command.status == "failed":
            one.outcome = "timeout"
        one.lines.send(sim, i, command.twist)
    one.lines.watch_base(sim, i)


def _moving_near(sim: NavSim, i: int) -> bool:
    """Whether a moving disc or a person touches robot i."""
    moving = sim.moving(i)
    away = np.hypot(*(moving[:, :2] - sim.b["pose"][i, :2]).T) - moving[:, 2]
    return bool((away < sim.robot.circumscribed_radius_m + TOUCH_M).any())
