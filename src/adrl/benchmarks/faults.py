"""What goes wrong between a robot's sensors, its runtime and its base: a table of faults, each a named function.

A fault changes messages on their way. Its functions get the line that they come over and the message, and return what
arrives: the message, another one, an older one, or None.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from adrl.deploy import Odometry, Pose, Scan, Twist
from adrl.types import RobotConfig

Message = TypeVar("Message")
Stamped = TypeVar("Stamped", Scan, Odometry)
KEPT = 64
"""Messages that a line remembers."""

SPELL, PAUSE = 20, 40
"""Control periods that a fault of Fault.in_spells lasts, and that all is well before and between."""


class Line(Generic[Message]):
    """One stream of messages of one robot, one a control period."""

    def __init__(self, robot: RobotConfig, seed: np.random.SeedSequence) -> None:
        self.robot = robot
        self.rng = np.random.default_rng(seed)
        self.step = -1
        self.since = 0
        """Steps since the fault began."""
        self.sent: deque[Message] = deque(maxlen=KEPT)
        """What has been sent, the newest last."""
        self.held: list[tuple[int, Message]] = []
        """Messages under way, and the step in which each arrives."""

    def ago(self, periods: int) -> Message | None:
        """What was sent so many periods ago."""
        return self.sent[-1 - periods] if periods < len(self.sent) else None


ScanFault = Callable[[Line[Scan], Scan], Scan | None]
OdometryFault = Callable[[Line[Odometry], Odometry], Odometry | None]
CommandFault = Callable[[Line[Twist], Twist], Twist | None]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What becomes of each stream; None leaves it alone."""

    scan: ScanFault | None = None
    odometry: OdometryFault | None = None
    localisation: Callable[[Line[Any], Pose], Pose | None] | None = None
    """Of poses on the map."""
    command: CommandFault | None = None
    clock: Callable[[int, float], float] | None = None
    """Step and true time to what every clock on the robot says."""
    node: Callable[[int], bool] = lambda step: True
    """Whether the node runs in a step."""
    base_factors: Mapping[str, float] = field(default_factory=dict)
    """By what to multiply parameters of the base that its RobotConfig does not know of; names are those of PARAMS."""
    base_terms: Mapping[str, float] = field(default_factory=dict)
    """What to add to them."""
    in_spells: bool = False
    """SPELL periods of every SPELL + PAUSE, else always."""
    drivable: bool = True
    """Whether it leaves enough to drive by."""
    glass: bool = False
    """The LiDAR looks through part of what stands there."""
    told: bool = True
    """Whether anything that arrives tells of it."""


def pass_on(line: Line[Message], message: Message, fault: Callable | None, in_spells: bool) -> Message | None:
    """What arrives of a message."""
    line.step += 1
    line.sent.append(message)
    phase = line.step - PAUSE
    on = fault is not None and (not in_spells or (phase >= 0 and phase % (SPELL + PAUSE) < SPELL))
    line.since = line.since + 1 if on else 0
    return fault(line, message) if on and fault is not None else message


# --- any stream ---------------------------------------------------------------------------------------------


def lost(line: Line[Message], message: Message, share: float = 1.0) -> Message | None:
    """Some never arrive."""
    return None if line.rng.random() < share else message


def late(line: Line[Message], message: Message, periods: int) -> Message | None:
    """Each is so old when it arrives, and says so."""
    return line.ago(periods)


def late_unsaid(line: Line[Stamped], message: Stamped, periods: int) -> Stamped | None:
    """Each is so old when it arrives, and is stamped then."""
    old = line.ago(periods)
    return old and dataclasses.replace(old, stamp_s=message.stamp_s)


def late_at_random(line: Line[Stamped], message: Stamped, most: int, unsaid: bool = False) -> Stamped | None:
    """Each is late by a time of its own: newer ones may overtake older ones."""
    line.held.append((line.step + int(line.rng.integers(0, most + 1)), message))
    come = [held for held in line.held if held[0] <= line.step]
    line.held = [held for held in line.held if held[0] > line.step]
    if not come:
        return None
    old = come[int(line.rng.integers(len(come)))][1]
    return dataclasses.replace(old, stamp_s=message.stamp_s) if unsaid else old


def frozen(line: Line[Stamped], message: Stamped, restamped: bool = True) -> Stamped | None:
    """The last one before the fault, again and again."""
    old = line.ago(min(line.since, len(line.sent) - 1))
    return old and (dataclasses.replace(old, stamp_s=message.stamp_s) if restamped else old)


def misstamped(line: Line[Stamped], message: Stamped, by_s: float) -> Stamped:
    """The sensor's clock is not the node's."""
    return dataclasses.replace(message, stamp_s=message.stamp_s + by_s)


# --- scans --------------------------------------------------------------------------------------------------


def _with(scan: Scan, ranges: np.ndarray) -> Scan:
    return dataclasses.replace(scan, ranges=ranges)


def frozen_noisy(line: Line[Scan], scan: Scan) -> Scan | None:
    """The last scan before the fault, with fresh noise and stamps."""
    old = frozen(line, scan)
    return old and noisy(line, old, line.robot.lidar.noise_std_m)


def doubled(line: Line[Scan], scan: Scan) -> Scan | None:
    """Each scan comes twice, the second time with a new stamp."""
    return late_unsaid(line, scan, line.step % 2)


def reads(line: Line[Scan], scan: Scan, value: float, share: float = 1.0) -> Scan:
    """Some beams, drawn anew each time, read this."""
    struck = line.rng.random(len(scan.ranges)) < share
    return _with(scan, np.where(struck, value, scan.ranges))


def arc_reads(line: Line[Scan], scan: Scan, value: float, middle_rad: float, width_rad: float) -> Scan:
    """The beams of an arc read this."""
    angles = scan.angle_min_rad + scan.angle_increment_rad * np.arange(len(scan.ranges))
    off = np.abs(np.remainder(angles - middle_rad + math.pi, 2.0 * math.pi) - math.pi)
    return _with(scan, np.where(off <= 0.5 * width_rad, value, scan.ranges))


def cut_off(line: Line[Scan], scan: Scan, share: float) -> Scan:
    """The scan ends early."""
    return _with(scan, scan.ranges[: round(share * len(scan.ranges))])


def noisy(line: Line[Scan], scan: Scan, std_m: float) -> Scan:
    """Noise on what is hit."""
    noise = std_m * line.rng.standard_normal(len(scan.ranges))
    return _with(
        scan, np.where(scan.ranges < scan.range_max_m, np.maximum(scan.ranges + noise, 0.01), scan.ranges)
    )


def specks(line: Line[Scan], scan: Scan, share: float) -> Scan:
    """Dust: some beams end at random before what they should hit."""
    near = scan.ranges * line.rng.uniform(0.1, 1.0, len(scan.ranges))
    return _with(scan, np.where(line.rng.random(len(near)) < share, near, scan.ranges))


def rescaled(line: Line[Scan], scan: Scan, factor: float = 1.0, term_m: float = 0.0) -> Scan:
    """Ranges that are wrong alike."""
    free = scan.ranges >= scan.range_max_m
    return _with(scan, np.where(free, scan.ranges, np.maximum(factor * scan.ranges + term_m, 0.01)))


def rounded(line: Line[Scan], scan: Scan, to_m: float) -> Scan:
    """Ranges in coarse steps."""
    return _with(scan, np.round(scan.ranges / to_m) * to_m)


def short_sighted(line: Line[Scan], scan: Scan, share: float) -> Scan:
    """Beyond a part of its reach the LiDAR sees nothing: dirt on it, rain, dark walls."""
    return _with(scan, np.where(scan.ranges > share * scan.range_max_m, np.inf, scan.ranges))


def turned(line: Line[Scan], scan: Scan, by_rad: float) -> Scan:
    """The LiDAR is mounted so, and nobody has said it."""
    return dataclasses.replace(scan, angle_min_rad=scan.angle_min_rad - by_rad)


def mirrored(line: Line[Scan], scan: Scan) -> Scan:
    """The LiDAR is mounted upside down, and nobody has said it."""
    return _with(scan, scan.ranges[::-1])


# --- odometry -----------------------------------------------------------------------------------------------


def twist_is(line: Line[Odometry], odometry: Odometry, factor: float, std: float = 0.0) -> Odometry:
    """Its twist is wrong."""
    noise = std * line.rng.standard_normal(2)
    v, w = factor * np.array(odometry.twist) + noise
    return dataclasses.replace(odometry, twist=(float(v), float(w)))


def twist_in_odom_frame(line: Line[Odometry], odometry: Odometry) -> Odometry:
    """Its twist's x is along the odometry's frame, not along the robot."""
    v, w = odometry.twist
    return dataclasses.replace(odometry, twist=(v * math.cos(odometry.pose[2] + 2.0), w))


def pose_noisy(line: Line[Odometry], odometry: Odometry, std_m: float) -> Odometry:
    """Poses that jitter."""
    x, y, yaw = np.array(odometry.pose) + std_m * line.rng.standard_normal(3)
    return dataclasses.replace(odometry, pose=(float(x), float(y), float(yaw)))


def pose_shifted(line: Line[Odometry], odometry: Odometry, by_m: float, by_rad: float) -> Odometry:
    """Poses of another frame from now on."""
    x, y, yaw = odometry.pose
    return dataclasses.replace(odometry, pose=(x + by_m, y, yaw + by_rad))


def no_number(line: Line[Odometry], odometry: Odometry, share: float) -> Odometry:
    """Some poses are NaN."""
    return dataclasses.replace(odometry, pose=(math.nan,) * 3) if line.rng.random() < share else odometry


def pose_is_about(line: Line[Any], pose: Pose, std_m: float, std_rad: float) -> Pose:
    """Localisation that is not exact."""
    x, y, yaw = np.array(pose) + np.array([std_m, std_m, std_rad]) * line.rng.standard_normal(3)
    return float(x), float(y), float(yaw)


# --- clocks -------------------------------------------------------------------------------------------------


def jumps(by_s: float) -> Callable[[int, float], float]:
    """All clocks jump once."""
    return lambda step, time_s: time_s + (by_s if step >= PAUSE else 0.0)


def runs(rate: float) -> Callable[[int, float], float]:
    """All clocks run at this rate."""
    return lambda step, time_s: rate * time_s


def asleep(step: int) -> bool:
    """The node hangs for ten periods now and then."""
    return step % 50 < 40


RIGHT_ANGLE = 0.5 * math.pi

FAULTS: dict[str, Fault] = {
    "none": Fault(),
    # scans that come late, again, or not at all
    "scan lost, 10 %": Fault(scan=partial(lost, share=0.1)),
    "scan lost, 50 %": Fault(scan=partial(lost, share=0.5)),
    "scan lost for 2 s": Fault(scan=lost, in_spells=True),
    "scan late by 1": Fault(scan=partial(late, periods=1)),
    "scan late by 2": Fault(scan=partial(late, periods=2)),
    "scan late by 3": Fault(scan=partial(late, periods=3), drivable=False),
    "scan late by 1, unsaid": Fault(scan=partial(late_unsaid, periods=1)),
    "scan late by 2, unsaid": Fault(scan=partial(late_unsaid, periods=2)),
    "scan late by 2, unsaid, for 2 s": Fault(scan=partial(late_unsaid, periods=2), in_spells=True),
    "scan late by 4, unsaid": Fault(scan=partial(late_unsaid, periods=4), drivable=False),
    "scan late by 0 to 2": Fault(scan=partial(late_at_random, most=2)),
    "scan late by 0 to 2, unsaid": Fault(scan=partial(late_at_random, most=2, unsaid=True)),
    "scan frozen": Fault(scan=partial(frozen, restamped=False), in_spells=True),
    "scan frozen, new stamps": Fault(scan=frozen, in_spells=True),
    "scan frozen, new stamps and noise": Fault(scan=frozen_noisy, in_spells=True),
    "scan doubled, new stamps": Fault(scan=doubled),
    "scan stamped 40 ms ahead": Fault(scan=partial(misstamped, by_s=0.04)),
    "scan stamped 100 s behind": Fault(scan=partial(misstamped, by_s=-100.0), in_spells=True),
    # beams that tell nothing, or nothing true
    "all beams inf for 2 s": Fault(scan=partial(reads, value=math.inf), in_spells=True),
    "half the beams inf for 2 s": Fault(
        scan=partial(arc_reads, value=math.inf, middle_rad=0.0, width_rad=math.pi), in_spells=True
    ),
    "an arc of 60 deg inf for 2 s": Fault(
        scan=partial(arc_reads, value=math.inf, middle_rad=0.3, width_rad=math.pi / 3.0), in_spells=True
    ),
    "an arc of 60 deg inf from the start": Fault(
        scan=partial(arc_reads, value=math.inf, middle_rad=0.0, width_rad=math.pi / 3.0),
        drivable=False,
        told=False,
    ),
    "beams inf, 10 %": Fault(scan=partial(reads, value=math.inf, share=0.1)),
    "beams inf, 30 %": Fault(scan=partial(reads, value=math.inf, share=0.3)),
    "all beams NaN for 2 s": Fault(scan=partial(reads, value=math.nan), in_spells=True),
    "beams NaN, 20 %": Fault(scan=partial(reads, value=math.nan, share=0.2)),
    "beams NaN, 80 %": Fault(scan=partial(reads, value=math.nan, share=0.8), drivable=False),
    "an arc of 15 deg NaN": Fault(
        scan=partial(arc_reads, value=math.nan, middle_rad=0.5, width_rad=math.pi / 12.0)
    ),
    "beams -inf, 5 %": Fault(scan=partial(reads, value=-math.inf, share=0.05)),
    "beams 0, 10 %": Fault(scan=partial(reads, value=0.0, share=0.1)),
    "beams cut off by half": Fault(scan=partial(cut_off, share=0.5), drivable=False),
    "range noise of 3 cm": Fault(scan=partial(noisy, std_m=0.03)),
    "range noise of 10 cm": Fault(scan=partial(noisy, std_m=0.1), drivable=False),
    "specks, 1 % of the beams": Fault(scan=partial(specks, share=0.01)),
    "ranges 5 % long": Fault(scan=partial(rescaled, factor=1.05)),
    "ranges 5 % short": Fault(scan=partial(rescaled, factor=0.95)),
    "ranges 5 cm short": Fault(scan=partial(rescaled, term_m=-0.05)),
    "ranges in steps of 5 cm": Fault(scan=partial(rounded, to_m=0.05)),
    "reach of a third": Fault(scan=partial(short_sighted, share=1.0 / 3.0)),
    "glass": Fault(glass=True, told=False),
    # how the LiDAR is mounted
    "mounted backwards": Fault(scan=partial(turned, by_rad=math.pi), drivable=False),
    "mounted to the left": Fault(scan=partial(turned, by_rad=RIGHT_ANGLE), drivable=False),
    "mounted upside down": Fault(scan=mirrored, drivable=False),
    # odometry
    "odometry lost, 10 %": Fault(odometry=partial(lost, share=0.1)),
    "odometry lost, 50 %": Fault(odometry=partial(lost, share=0.5)),
    "odometry lost for 2 s": Fault(odometry=lost, in_spells=True),
    "odometry late by 2": Fault(odometry=partial(late, periods=2)),
    "odometry late by 2, unsaid": Fault(odometry=partial(late_unsaid, periods=2)),
    "odometry frozen, new stamps": Fault(odometry=frozen, in_spells=True),
    "odometry NaN, 10 %": Fault(odometry=partial(no_number, share=0.1)),
    "odometry jumps": Fault(
        odometry=partial(pose_shifted, by_m=2.0, by_rad=0.5), in_spells=True, drivable=False
    ),
    "odometry jitters by 5 mm": Fault(odometry=partial(pose_noisy, std_m=0.005)),
    "odometry drifts by 5 %": Fault(base_terms={"speed_drift": 0.05, "yaw_drift": -0.05}),
    "localisation noisy by 5 cm and 1 deg": Fault(
        localisation=partial(pose_is_about, std_m=0.05, std_rad=0.02)
    ),
    "twist always 0": Fault(odometry=partial(twist_is, factor=0.0)),
    "twist reversed": Fault(odometry=partial(twist_is, factor=-1.0)),
    "twist in the odometry's frame": Fault(odometry=twist_in_odom_frame),
    "twist noisy by 5 cm/s": Fault(odometry=partial(twist_is, factor=1.0, std=0.05)),
    # the base
    "commands lost, 10 %": Fault(command=partial(lost, share=0.1)),
    "commands lost, 50 %": Fault(command=partial(lost, share=0.5)),
    "commands late by 1": Fault(command=partial(late, periods=1)),
    "commands late by 2": Fault(command=partial(late, periods=2)),
    "commands late by 2 for 2 s": Fault(command=partial(late, periods=2), in_spells=True),
    "commands late by 3": Fault(command=partial(late, periods=3), drivable=False),
    "base 10 % fast": Fault(base_factors={"speed_gain": 1.1, "yaw_gain": 1.1}),
    "base 10 % slow": Fault(base_factors={"speed_gain": 0.9, "yaw_gain": 0.9}),
    "base of half the acceleration": Fault(
        base_factors={"acceleration_mps2": 0.5, "yaw_acceleration_radps2": 0.5}
    ),
    "base of thrice the lag": Fault(base_factors={"lag_s": 3.0}),
    # clocks and node
    "clock jumps by 100 s": Fault(clock=jumps(100.0)),
    "clock jumps by -100 s": Fault(clock=jumps(-100.0)),
    "clock 5 % fast": Fault(clock=runs(1.05)),
    "node hangs for 1 s": Fault(node=asleep),
}
