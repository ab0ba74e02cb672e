"""Drives from ROS recordings: bags of ROS 1, and of ROS 2 in both storage formats."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from adrl.bags import Bag, open_bag
from adrl.bags.odometry import SILENCE_PERIODS, contradiction, phase_s, read_odometry, read_twists
from adrl.bags.reader import COMMAND_TOPIC, ODOMETRY_TOPIC, TWISTS
from adrl.errors import DatasetError
from adrl.evaluation.drives import Drives
from adrl.types import Array


def read_bag(
    path: str | os.PathLike[str],
    period_s: float,
    command_topic: str = COMMAND_TOPIC,
    odometry_topic: str = ODOMETRY_TOPIC,
) -> Drives:
    """Resample a bag's commands (Twist or TwistStamped) and odometry to control periods.

    Periods begin when commands come; the speeds at their ends are interpolated between odometry messages, by the times
    at which the bag recorded them. A drive ends a period after the last command before a pause: the
    recording does not say when the base stopped by itself. Raises MissingExtra without rosbags, DatasetError
    naming file and topic.
    """
    with open_bag(path) as bag:
        commands = read_twists(bag, command_topic)
        odometry, notes = _speeds(bag, odometry_topic)
    return _resample(Path(path), commands, odometry, period_s, notes)


def _speeds(bag: Bag, topic: str) -> tuple[Array, tuple[str, ...]]:
    """(M, 3) seconds, speed, yaw rate of odometry, or of a topic of twists, and what to say of them.

    Raises DatasetError where the poses of odometry contradict its twists: constants that were fitted to neither are
    worth nothing.
    """
    if bag.types(topic) & set(TWISTS):
        return read_twists(bag, topic), ()
    odometry = read_odometry(bag, topic)
    table = np.column_stack([odometry.times_s, odometry.twist])
    if not odometry.has_poses:
        return table, (f"{topic}: pose.pose never changes: speeds are those of twist.twist, unchecked",)
    try:
        wrong = contradiction(odometry)
    except ValueError as error:
        wrong = str(error)
    if wrong is not None:
        raise DatasetError(
            f"{bag.path}: {topic}: {wrong}; mend the base's odometry, or give a topic of measured speeds (Twist)"
        )
    return table, ()


def _resample(
    path: Path, commands: Array, odometry: Array, period_s: float, notes: tuple[str, ...]
) -> Drives:
    """Control periods in which there are odometry and commands."""
    phase = phase_s(commands[:, 0], period_s)
    parts = []
    pairs = _side_by_side(_stretches(odometry, period_s), _stretches(commands, period_s))
    for number, (stretch, orders) in enumerate(pairs):
        low = max(stretch[0, 0], orders[0, 0] - 0.5 * period_s)
        high = min(stretch[-1, 0], orders[-1, 0] + 1.5 * period_s)
        count = int((high - low) / period_s) - 1
        if count < 1:
            continue
        begins = phase + (math.ceil((low - phase) / period_s) + np.arange(count)) * period_s
        ends = begins + period_s
        # Half a period of grace: a command comes about when its period begins.
        newest = np.searchsorted(orders[:, 0], begins + 0.5 * period_s, side="right") - 1
        told = orders[np.maximum(newest, 0), 1:]
        done = np.stack([np.interp(ends, stretch[:, 0], stretch[:, column]) for column in (1, 2)], axis=1)
        # One period late: nobody knows whether the robot stood before.
        time_s = (np.arange(count) + 2) * period_s
        parts.append((np.full(count, number), time_s, told, done))
    if not parts:
        raise DatasetError(
            f"{path}: commands and odometry do not overlap for two periods of {period_s} s without a pause of "
            f"{SILENCE_PERIODS:g}; drive it with something that repeats its commands"
        )
    drive, time_s, told, done = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Drives(drive.astype(np.int64), time_s, told, done, notes)


def _side_by_side(first: list[Array], second: list[Array]) -> Iterator[tuple[Array, Array]]:
    """Stretches of two topics that may overlap, in order of time."""
    i = j = 0
    while i < len(first) and j < len(second):
        yield first[i], second[j]
        if first[i][-1, 0] < second[j][-1, 0]:
            i += 1
        else:
            j += 1


def _stretches(table: Array, period_s: float) -> list[Array]:
    """Rows between silences."""
    return np.split(table, np.flatnonzero(np.diff(table[:, 0]) > SILENCE_PERIODS * period_s) + 1)
