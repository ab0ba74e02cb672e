"""Drives from ROS recordings: bags of ROS 1, and of ROS 2 in both storage formats."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from adrl.errors import DatasetError, MissingExtra
from adrl.evaluation.drives import Drives
from adrl.types import Array

COMMAND_TOPIC = "/cmd_vel"
ODOMETRY_TOPIC = "/odom"
SILENCE_PERIODS = 3.0
"""Odometry that is silent for longer ends a drive, and what comes after begins another."""


def read_bag(
    path: Path,
    period_s: float,
    command_topic: str = COMMAND_TOPIC,
    odometry_topic: str = ODOMETRY_TOPIC,
) -> Drives:
    """Resample a bag's commands (Twist or TwistStamped) and odometry to control periods.

    Periods begin when commands come; the speeds at their ends are interpolated between odometry messages, by the times
    at which the bag recorded them. Raises MissingExtra without rosbags, DatasetError naming file and topic.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtra(
            "reading bags needs rosbags; install the extra: pip install 'adrl[bags]'"
        ) from None
    if not path.exists():
        raise DatasetError(f"{path}: no such file; give a CSV file, or a ROS 1 or ROS 2 bag")
    try:
        # Old ROS 2 bags do not say what their messages are; these have been the same in all releases.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            commands, odometry = (_twists(reader, path, topic) for topic in (command_topic, odometry_topic))
    except (AnyReaderError, OSError) as error:
        raise DatasetError(f"{path}: not a readable bag ({error})") from None
    return _resample(path, commands, odometry, period_s)


def _twists(reader: Any, path: Path, topic: str) -> Array:
    """(M, 3) seconds, speed, yaw rate of a topic's messages, in order of time."""
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if not connections:
        known = ", ".join(sorted({connection.topic for connection in reader.connections}))
        raise DatasetError(f"{path}: no topic {topic}; it has {known or 'none'}")
    rows = []
    for connection, nanoseconds, raw in reader.messages(connections=connections):
        twist = reader.deserialize(raw, connection.msgtype)
        while hasattr(twist, "twist"):  # of stamped ones and odometry, which hold it one or two deep
            twist = twist.twist
        if not hasattr(twist, "linear"):
            raise DatasetError(
                f"{path}: {topic} is of {connection.msgtype}; give a topic of twists or odometry"
            )
        rows.append((nanoseconds, twist.linear.x, twist.angular.z))
    if not rows:
        raise DatasetError(f"{path}: topic {topic} holds no message")
    table = np.array([((ns - reader.start_time) * 1e-9, v, w) for ns, v, w in rows], dtype=np.float64)
    if not np.isfinite(table).all():
        raise DatasetError(f"{path}: {topic} holds a number that is not finite")
    return table[np.argsort(table[:, 0], kind="stable")]


def _resample(path: Path, commands: Array, odometry: Array, period_s: float) -> Drives:
    """Control periods in which there is odometry, the first command given."""
    turns = np.exp(2j * math.pi * commands[:, 0] / period_s).mean()
    phase = float(np.angle(turns)) / (2.0 * math.pi) * period_s  # when in a period commands come
    parts = []
    breaks = np.flatnonzero(np.diff(odometry[:, 0]) > SILENCE_PERIODS * period_s) + 1
    for number, stretch in enumerate(np.split(odometry, breaks)):
        low, high = max(stretch[0, 0], commands[0, 0] - 0.5 * period_s), stretch[-1, 0]
        count = int((high - low) / period_s) - 1
        if count < 1:
            continue
        begins = phase + (math.ceil((low - phase) / period_s) + np.arange(count)) * period_s
        ends = begins + period_s
        # Half a period of grace: a command comes about when its period begins.
        newest = np.searchsorted(commands[:, 0], begins + 0.5 * period_s, side="right") - 1
        told = commands[np.maximum(newest, 0), 1:]
        done = np.stack([np.interp(ends, stretch[:, 0], stretch[:, column]) for column in (1, 2)], axis=1)
        # One period late: nobody knows whether the robot stood before.
        time_s = (np.arange(count) + 2) * period_s
        parts.append((np.full(count, number), time_s, told, done))
    if not parts:
        raise DatasetError(f"{path}: commands and odometry do not overlap for two periods of {period_s} s")
    drive, time_s, told, done = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Drives(drive.astype(np.int64), time_s, told, done)
