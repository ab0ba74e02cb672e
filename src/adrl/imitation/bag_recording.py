"""What a robot recorded while somebody drove it, read from a bag and laid on control periods."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.bags import Bag, open_bag
from adrl.bags.reader import (
    COMMAND_TOPIC,
    GOALS,
    ODOMETRY,
    ODOMETRY_TOPIC,
    SCAN_TOPIC,
    SCANS,
    TRANSFORMS,
    TWISTS,
)
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.messages import Scan
from adrl.errors import DatasetError
from adrl.geometry import compose, inverse, yaw_of
from adrl.types import Array, RobotConfig

F32 = NDArray[np.float32]

GOAL_TOPICS = ("/goal_pose", "/move_base_simple/goal")
"""Where RViz sends goals, in ROS 2 and in ROS 1."""
TRANSFORM_TOPICS = ("/tf", "/tf_static")
SAME_GOAL_M = 0.01
"""A goal that is sent again is no new goal."""
SILENCE_PERIODS = 3.0
"""Scans or odometry that are silent for longer end an episode."""
GRACE_PERIODS = 0.25
"""What comes so much later than a period begins still belongs to its beginning; of commands twice as much."""
AT_ONCE_S = 1e-6
"""Times nearer than this are the same."""
JUMP_M = 0.5
"""Odometry that moves by so much more than twice what the robot can drive in a period has begun anew."""


@dataclass(frozen=True, kw_only=True)
class BagTopics:
    """Where a bag has what."""

    scan: str = SCAN_TOPIC
    odometry: str = ODOMETRY_TOPIC
    command: str = COMMAND_TOPIC
    goal: str | None = None
    """None: that of GOAL_TOPICS which the bag has; without one, goals are where the robot came to stand."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A bag at M instants, one control period apart. Poses and goals are in the odometry's frame."""

    ranges: F32
    """(M, K) the newest scan, as the robot's configured LiDAR would see it."""
    pose: Array
    """(M, 3)."""
    twist: Array
    """(M, 2) measured speed and yaw rate."""
    command: Array
    """(M, 2) what the base is told for the period that begins."""
    heard: NDArray[np.bool_]
    """(M,) whether scan and odometry are recent."""
    joined: NDArray[np.bool_]
    """(M - 1,) whether an instant and the next are of one drive."""
    goal: NDArray[np.int64]
    """(M,) number of the newest goal, -1 before the first; all -1 where goals is None."""
    goals: Array | None
    """(G, 2), None for a bag without a topic of goals."""


def read_recording(
    path: Path, robot: RobotConfig, topics: BagTopics, *, zero_is_free: bool = False
) -> Recording:
    """Read a bag of ROS 1 or ROS 2. Periods begin when scans come.

    zero_is_free: see LidarAdapter. Raises MissingExtra without rosbags; DatasetError for a topic that is missing, empty
    or of another type, for goals in a frame that nothing relates to the odometry's, and for too few scans.
    """
    with open_bag(path) as bag:
        scans = _scans(bag, topics.scan)
        odometry, frame = _odometry(bag, topics.odometry)
        commands = _commands(bag, topics.command)
        goals = _goals(bag, topics.goal, frame)
    period_s = robot.control_period_s
    grace_s, silence_s = GRACE_PERIODS * period_s, SILENCE_PERIODS * period_s
    scan_times = np.array([scan.stamp_s for scan in scans])
    for topic, times in ((topics.scan, scan_times), (topics.odometry, odometry[:, 0])):
        _require_rate(path, topic, times, robot)
    instants = _instants(scan_times, odometry[:, 0], period_s, grace_s)
    newest = np.searchsorted(scan_times, instants + grace_s, side="right") - 1
    adapter = LidarAdapter(robot.lidar, zero_is_free=zero_is_free)
    used, which = np.unique(newest, return_inverse=True)
    seen = np.stack([adapter(scans[i]) for i in used])
    pose, twist, gap_s = _at(odometry, instants)
    heard = np.maximum(instants - scan_times[newest], gap_s) <= silence_s
    told = np.searchsorted(commands[:, 0], instants + 2.0 * grace_s, side="right") - 1
    command = np.where(told[:, None] >= 0, commands[np.maximum(told, 0), 1:], 0.0)  # none yet: it stands
    moved_m = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    jumped = moved_m > 2.0 * robot.max_speed_mps * period_s + JUMP_M
    goal = np.full(len(instants), -1)
    if goals is not None:
        goal = np.searchsorted(goals[:, 0], instants + grace_s, side="right") - 1
    return Recording(
        ranges=seen[which],
        pose=pose,
        twist=twist,
        command=command,
        heard=heard,
        joined=heard[:-1] & heard[1:] & ~jumped,
        goal=goal,
        goals=None if goals is None else goals[:, 1:],
    )


def _instants(scan_times: Array, odometry_times: Array, period_s: float, grace_s: float) -> Array:
    """(M,) beginnings of control periods, in step with the scans, for as long as there are scans and odometry."""
    turns = np.exp(2j * math.pi * scan_times / period_s).mean()
    phase = float(np.angle(turns)) / (2.0 * math.pi) * period_s
    low = max(scan_times[0], odometry_times[0]) - grace_s
    high = min(scan_times[-1], odometry_times[-1]) + grace_s
    first = math.ceil((low - phase) / period_s)
    return phase + np.arange(first, math.floor((high - phase) / period_s) + 1) * period_s


def _require_rate(path: Path, topic: str, times: Array, robot: RobotConfig) -> None:
    """Raises DatasetError where messages are fewer than the robot's control needs."""
    longest_s = SILENCE_PERIODS * robot.control_period_s
    if len(times) < 2 or np.median(np.diff(times)) > longest_s:
        raise DatasetError(
            f"{path}: too few messages on {topic}: {len(times)} in {times[-1] - times[0]:.1f} s; robot "
            f"{robot.name!r} is controlled every {robot.control_period_s} s; record one every {longest_s:.2g} s or more"
        )


def _at(odometry: Array, instants: Array) -> tuple[Array, Array, Array]:
    """(M, 3) poses and (M, 2) twists between the messages; (M,) how long these are apart, 0 at a message."""
    times = odometry[:, 0]
    columns = [np.interp(instants, times, column) for column in odometry[:, 1:].T]
    after = np.clip(np.searchsorted(times, instants), 1, len(times) - 1)
    near = np.minimum(np.abs(instants - times[after - 1]), np.abs(times[after] - instants))
    gap_s = np.where(near < AT_ONCE_S, 0.0, times[after] - times[after - 1])
    return np.stack(columns[:3], axis=1), np.stack(columns[3:], axis=1), gap_s


def _scans(bag: Bag, topic: str) -> list[Scan]:
    """In order of time, which is when the bag recorded them."""
    scans = [
        Scan(
            ranges=message.ranges,
            angle_min_rad=message.angle_min,
            angle_increment_rad=message.angle_increment,
            range_min_m=message.range_min,
            range_max_m=message.range_max,
            stamp_s=seconds,
        )
        for seconds, message in bag.messages(topic, SCANS)
    ]
    for scan in scans:
        angles = (scan.angle_min_rad, scan.angle_increment_rad)
        if not (np.isfinite(angles).all() and scan.range_max_m > 0.0 and len(scan.ranges) > 0):
            raise DatasetError(
                f"{bag.path}: {topic} has a scan of {len(scan.ranges)} beams from angle {angles[0]} by {angles[1]}, "
                f"range_max {scan.range_max_m}, after {scan.stamp_s:.1f} s; these must be finite and above 0"
            )
    return sorted(scans, key=lambda scan: scan.stamp_s)


def _odometry(bag: Bag, topic: str) -> tuple[Array, str]:
    """(M, 6) seconds, x, y, yaw without jumps at pi, speed, yaw rate; and the frame's name."""
    rows, frame = [], ""
    for seconds, message in bag.messages(topic, ODOMETRY):
        twist, frame = message.twist.twist, message.header.frame_id
        pose = message.pose.pose
        place = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
        rows.append((seconds, *place, twist.linear.x, twist.angular.z))
    table = _ordered(bag, topic, rows)
    table[:, 3] = np.unwrap(table[:, 3])
    return table, frame.strip("/")


def _commands(bag: Bag, topic: str) -> Array:
    """(C, 3) seconds, speed, yaw rate."""
    rows = []
    for seconds, message in bag.messages(topic, TWISTS):
        twist = getattr(message, "twist", message)
        rows.append((seconds, twist.linear.x, twist.angular.z))
    return _ordered(bag, topic, rows)


def _goals(bag: Bag, topic: str | None, odometry_frame: str) -> Array | None:
    """(G, 3) seconds, x, y in the odometry's frame, each goal once; None without a topic."""
    if topic is None:
        topic = next((name for name in GOAL_TOPICS if name in bag.topics), None)
    if topic is None:
        return None
    rows: list[tuple[float, float, float]] = []
    links: dict[str, Array] = {}
    for seconds, message in bag.messages(topic, GOALS):
        frame = message.header.frame_id.strip("/")
        x, y = message.pose.position.x, message.pose.position.y
        if frame != odometry_frame:
            if frame not in links:
                links[frame] = _links(bag, topic, frame, odometry_frame)
            # Static ones are told once; one that comes after the goal is better than none.
            link = links[frame][max(int(np.searchsorted(links[frame][:, 0], seconds, side="right")) - 1, 0)]
            x, y, _ = compose(inverse(link[1:]), (x, y, 0.0))
        if not rows or math.hypot(x - rows[-1][1], y - rows[-1][2]) > SAME_GOAL_M:
            rows.append((seconds, x, y))
    return _ordered(bag, topic, rows)


def _links(bag: Bag, topic: str, frame: str, odometry_frame: str) -> Array:
    """(L, 4) seconds and the odometry's frame as a pose in another."""
    rows = []
    for name in TRANSFORM_TOPICS:
        if name not in bag.topics:
            continue
        for seconds, message in bag.messages(name, TRANSFORMS):
            for link in message.transforms:
                ends = (link.header.frame_id.strip("/"), link.child_frame_id.strip("/"))
                if ends == (frame, odometry_frame):
                    move = link.transform
                    rows.append((seconds, move.translation.x, move.translation.y, yaw_of(move.rotation)))
    if not rows:
        raise DatasetError(
            f"{bag.path}: {topic} is in frame {frame!r}, odometry in {odometry_frame!r}, and /tf does not relate them; "
            f"record /tf, or send goals in {odometry_frame!r}"
        )
    return _ordered(bag, " ".join(TRANSFORM_TOPICS), rows)


def _ordered(bag: Bag, topic: str, rows: list[Any]) -> Array:
    table = np.array(rows, dtype=np.float64)
    if not np.isfinite(table).all():
        raise DatasetError(
            f"{bag.path}: {topic} holds a number that is not finite, or an orientation that is none"
        )
    return table[np.argsort(table[:, 0], kind="stable")]
