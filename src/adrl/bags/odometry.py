"""What a base was told and what it did, as a bag has it: commands and odometry, checked."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adrl.bags.reader import ODOMETRY, TWISTS, Bag
from adrl.bags.transforms import frame_name
from adrl.errors import DatasetError
from adrl.geometry import in_robot_frame, yaw_of
from adrl.types import SLIP_M, Array

SILENCE_PERIODS = 3.0
"""Control periods of silence on a topic that end a drive, and what comes after begins another."""
SAME_CLOCK_S = 1.0
"""Stamps farther apart are of two clocks."""
WINDOW_S = 3.0
"""Poses and twists are compared over so long: a real base averages its twists over up to a second."""
PAUSE_S = 1.0
"""Odometry that is silent for longer is not compared over the silence."""
MOVED = (0.05, 0.1)
"""m, rad in a window from which on it is compared,"""
COMPARED = (0.3, 0.6)
"""and m, rad in all of the windows together, without which nothing is said."""
MISMATCH = 0.4
"""Part of what was moved by which poses and twists may differ."""
OTHER_FRAME = 0.1
"""The same for speeds that are nearly those along x of the odometry's frame."""
CAN_BE_DRIVEN_MPS = 10.0
"""Where nobody says which robot it is, poses that move faster have begun anew; see RobotConfig.cannot_have_driven."""
MOST_SIDEWAYS = 0.5
"""Part of the way that no differential drive moves sideways."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OdometryTable:
    """M odometry messages in order of time."""

    times_s: Array
    """(M,) when the bag recorded them."""
    stamps_s: Array
    """(M,) when they were measured, by the clock of the robot."""
    pose: Array
    """(M, 3) x, y, yaw without jumps at pi, in `frame`."""
    twist: Array
    """(M, 2) speed and yaw rate as the messages say."""
    frame: str
    base: str
    """The robot's frame, "" where the messages do not name it."""

    @property
    def has_poses(self) -> bool:
        """Whether any pose differs from another; some bases measure speeds only."""
        return bool(np.ptp(self.pose, axis=0).any())

    def poses(self, times_s: Array) -> Array:
        """(T, 3) between the messages; before the first and after the last, those."""
        return np.stack([np.interp(times_s, self.times_s, column) for column in self.pose.T], axis=1)

    def recorded(self, stamp_s: float, seconds: float) -> float:
        """When a bag would have recorded what was measured at stamp_s, and came after `seconds`.

        A stamp of another clock, or of long ago, tells nothing.
        """
        now_s = float(np.interp(seconds, self.times_s, self.stamps_s))
        return seconds + stamp_s - now_s if abs(stamp_s - now_s) < SAME_CLOCK_S else seconds


def read_odometry(bag: Bag, topic: str) -> OdometryTable:
    """Raises DatasetError: see Bag.messages; numbers that are not finite; several frames on one topic."""
    rows, frames, bases = [], set[str](), set[str]()
    for seconds, message in bag.messages(topic, ODOMETRY):
        twist, pose = message.twist.twist, message.pose.pose
        place = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
        stamp_s = stamp_of(message.header)
        rows.append((seconds, *place, twist.linear.x, twist.angular.z, stamp_s))
        frames.add(frame_name(message.header.frame_id))
        bases.add(frame_name(message.child_frame_id))
    table = ordered(bag.path, topic, rows)
    table[:, 3] = np.unwrap(table[:, 3])
    return OdometryTable(
        times_s=table[:, 0],
        pose=table[:, 1:4],
        twist=table[:, 4:6],
        stamps_s=table[:, 6],
        frame=one_frame(bag.path, topic, "header.frame_id", frames),
        base=one_frame(bag.path, topic, "child_frame_id", bases),
    )


def stamp_of(header: Any) -> float:
    """Seconds."""
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def read_twists(bag: Bag, topic: str) -> Array:
    """(C, 3) seconds, speed, yaw rate of Twist or TwistStamped messages. Raises DatasetError as read_odometry."""
    rows = []
    for seconds, message in bag.messages(topic, TWISTS):
        twist = getattr(message, "twist", message)
        rows.append((seconds, twist.linear.x, twist.angular.z))
    return ordered(bag.path, topic, rows)


def ordered(path: Path, topic: str, rows: list[Any]) -> Array:
    """Rows that begin with seconds, in order of time. Raises DatasetError for numbers that are not finite."""
    table = np.array(rows, dtype=np.float64)
    if not np.isfinite(table).all():
        raise DatasetError(
            f"{path}: {topic} holds a number that is not finite, or an orientation that is none"
        )
    return table[np.argsort(table[:, 0], kind="stable")]


def one_frame(path: Path, topic: str, field: str, frames: Iterable[str]) -> str:
    """The one frame that all messages of a topic are in. Raises DatasetError for several."""
    found = sorted(set(frames))
    if len(found) > 1:
        raise DatasetError(
            f"{path}: {topic} has messages of several sources: {field} is {' and '.join(map(repr, found))}; "
            "record each on a topic of its own, and give the one that is meant"
        )
    return found[0]


def phase_s(times_s: Array, period_s: float) -> float:
    """When in a control period messages come."""
    turns = np.exp(2j * math.pi * times_s / period_s).mean()
    return float(np.angle(turns)) / (2.0 * math.pi) * period_s


def driven_twists(odometry: OdometryTable, times_s: Array, span_s: float) -> Array:
    """(T, 2) speed along the heading and yaw rate that the poses tell, over span_s about each of times_s."""
    ends = (odometry.times_s[0], odometry.times_s[-1])
    low, high = (np.clip(times_s + sign * 0.5 * span_s, *ends) for sign in (-1.0, 1.0))
    moved = _motion(odometry.poses(low), odometry.poses(high))[:, [FORWARD, TURN]]
    return moved / np.maximum(high - low, 1e-9)[:, None]


def contradiction(odometry: OdometryTable) -> str | None:
    """How the twists of a drive contradict its poses, naming the fields; None where they do not.

    Raises ValueError where the poses themselves are none of a robot that drives the way it looks.
    """
    moved, told = _windows(odometry)
    forward, sideways = moved[:, FORWARD], np.abs(moved[:, SIDEWAYS])
    way = np.hypot(forward, sideways)
    far = way > MOVED[0]
    if way[far].sum() > COMPARED[0] and sideways[far].sum() > MOST_SIDEWAYS * way[far].sum():
        raise ValueError(
            f"pose.pose moves {sideways[far].sum():.1f} of {way[far].sum():.1f} m across its own heading, which a "
            "differential drive cannot; mend the orientation that the base reports"
        )
    for axis, (field, column, unit) in enumerate(
        (("twist.twist.linear.x", FORWARD, "m"), ("twist.twist.angular.z", TURN, "rad"))
    ):
        driven = moved[:, column]
        mismatch = _mismatch(driven, told[:, axis], axis)
        along_x = _mismatch(moved[:, ALONG_X], told[:, 0], 0)
        if (
            axis == 0
            and mismatch > OTHER_FRAME
            and along_x < min(OTHER_FRAME, 0.3 * mismatch)
            and told[:, 0].any()
        ):
            return f"{field} is the speed along x of the frame {odometry.frame!r} instead of the robot's own"
        if mismatch <= MISMATCH:
            continue
        if not odometry.twist[:, axis].any():
            return f"{field} is always 0 while pose.pose moves {np.abs(driven).sum():.1f} {unit}"
        return (
            f"{field} comes to {np.abs(told[:, axis]).sum():.1f} {unit} where pose.pose moves "
            f"{np.abs(driven).sum():.1f} {unit}, or to another direction"
        )
    return None


def _mismatch(driven: Array, told: Array, axis: int) -> float:
    """By which part of them two motions (W,) of windows differ; 0 where too little moves to say."""
    most = np.maximum(np.abs(driven), np.abs(told))
    moving = most > MOVED[axis]
    compared = most[moving].sum()
    return float(np.abs(driven - told)[moving].sum() / compared) if compared > COMPARED[axis] else 0.0


FORWARD, SIDEWAYS, TURN, ALONG_X = range(4)
"""Columns of a motion: m, m, rad in the robot's frame, m along x of the odometry's."""


def _motion(before: Array, after: Array) -> Array:
    """(M, 4) from poses (M, 3) to others, by the heading half way."""
    turn, along_x = (after - before)[:, 2], (after - before)[:, 0]
    half_way = np.column_stack([before[:, :2], before[:, 2] + 0.5 * turn])
    return np.column_stack([in_robot_frame(half_way, after[:, :2]), turn, along_x])


def _windows(odometry: OdometryTable) -> tuple[Array, Array]:
    """(W, 4) motions by the poses and (W, 2) by the twists, of the stretches of WINDOW_S without a pause or a jump."""
    times, twist = odometry.times_s, odometry.twist
    gaps = np.diff(times)
    hops = _motion(odometry.pose[:-1], odometry.pose[1:])
    told = 0.5 * (twist[1:] + twist[:-1]) * gaps[:, None]
    far = np.hypot(hops[:, FORWARD], hops[:, SIDEWAYS])
    broken = (gaps > PAUSE_S) | (far > CAN_BE_DRIVEN_MPS * gaps + SLIP_M)
    sums = np.concatenate(
        [np.zeros((1, 7)), np.cumsum(np.column_stack([hops, told, broken.astype(float)]), axis=0)]
    )
    number = (times - times[0]) // WINDOW_S
    first = np.flatnonzero(np.diff(number, prepend=-1.0) > 0.0)
    of_windows = sums[np.append(first[1:], len(times) - 1)] - sums[first]
    whole = of_windows[:, 6] == 0.0
    return of_windows[whole, :4], of_windows[whole, 4:6]
