"""What a robot recorded while somebody drove it, read from a bag and laid on control periods."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adrl.bags import open_bag
from adrl.bags.odometry import (
    SILENCE_PERIODS,
    OdometryTable,
    contradiction,
    driven_twists,
    phase_s,
    read_odometry,
    read_twists,
)
from adrl.bags.reader import COMMAND_TOPIC, ODOMETRY_TOPIC, POSE_TOPIC, SCAN_TOPIC
from adrl.bags.transforms import Transforms
from adrl.deploy.lidar import LidarAdapter
from adrl.errors import DatasetError
from adrl.imitation.bag_goals import Goals, read_goals
from adrl.imitation.bag_scans import LidarRecording, read_scans
from adrl.types import Array, RobotConfig

F32 = NDArray[np.float32]

GRACE_PERIODS = 0.25
"""What comes so much later than a period begins still belongs to its beginning; of commands twice as much."""
AT_ONCE_S = 1e-6
"""Times nearer than this are the same."""


@dataclass(frozen=True, kw_only=True)
class BagTopics:
    """Where a bag has what."""

    scan: str = SCAN_TOPIC
    odometry: str = ODOMETRY_TOPIC
    command: str = COMMAND_TOPIC
    goal: str | None = None
    """None: that of GOAL_TOPICS which the bag has; without one, goals are where the robot came to stand."""
    pose: str = POSE_TOPIC
    """Where the robot is on the map: relates goals on the map to the odometry in a bag whose /tf does not."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A bag at M instants, one control period apart where they are joined. Poses are in the odometry's frame."""

    times_s: Array
    """(M,) since the bag began."""
    ranges: F32
    """(M, K) the newest scan, as the robot's configured LiDAR would see it."""
    pose: Array
    """(M, 3)."""
    twist: Array
    """(M, 2) measured speed and yaw rate: the poses', where the odometry's own contradict them."""
    command: Array
    """(M, 2) what the base is told for the period that begins."""
    joined: NDArray[np.bool_]
    """(M - 1,) whether an instant and the next are of one drive."""
    goal: NDArray[np.int64]
    """(M,) number of the newest goal, -1 before the first; all -1 where goals is None."""
    goals: Goals | None
    """None for a bag without a topic of goals."""
    notes: tuple[str, ...]
    """What was decided about data that contradict each other or the robot, for people; each names its topic."""


def read_recording(
    path: Path,
    robot: RobotConfig,
    topics: BagTopics,
    *,
    zero_is_free: bool = False,
    nan_is_free: bool = False,
) -> Recording:
    """Read a bag of ROS 1 or ROS 2. Periods begin when scans come.

    zero_is_free, nan_is_free: the LiDAR reports that where nothing comes back; a LiDAR that never reports anything
    else there is understood without. Raises MissingExtra without rosbags; DatasetError for a topic that is missing,
    empty or of another type, for one that mixes several sources, for goals in a frame that nothing relates to the
    odometry's, for a LiDAR that is tilted, for poses that no robot drives, and for too few scans.
    """
    with open_bag(path) as bag:
        transforms = Transforms.of(bag)
        odometry = read_odometry(bag, topics.odometry)
        lidar = read_scans(
            bag,
            topics.scan,
            transforms,
            odometry,
            robot,
            zero_is_free=zero_is_free,
            nan_is_free=nan_is_free,
        )
        commands = read_twists(bag, topics.command)
        goals = read_goals(bag, topics.goal, topics.pose, transforms, odometry)
    for topic, times in ((topics.scan, lidar.times_s), (topics.odometry, odometry.times_s)):
        _require_rate(path, topic, times, robot)
    number = _instants(lidar.times_s, odometry.times_s, robot.control_period_s)
    if len(number) == 0:
        raise DatasetError(
            f"{path}: {topics.scan} and {topics.odometry} never have messages at the same time; record them together"
        )
    wrong = _contradiction(path, topics.odometry, odometry)
    recording = _on_periods(robot, number, lidar, odometry, commands, goals)
    if wrong is None:
        return recording
    return replace(
        recording,
        twist=driven_twists(odometry, recording.times_s, robot.control_period_s),
        notes=(*recording.notes, f"{topics.odometry}: {wrong}: speeds are taken from the poses"),
    )


def _on_periods(
    robot: RobotConfig,
    number: Array,
    lidar: LidarRecording,
    odometry: OdometryTable,
    commands: Array,
    goals: Goals | None,
) -> Recording:
    """What there was when the periods (M,) of these numbers began."""
    period_s = robot.control_period_s
    grace_s, silence_s = GRACE_PERIODS * period_s, SILENCE_PERIODS * period_s
    instants = phase_s(lidar.times_s, period_s) + number * period_s
    newest = np.searchsorted(lidar.times_s, instants + grace_s, side="right") - 1
    adapter = LidarAdapter(robot.lidar, lidar.mount)
    used, which = np.unique(newest, return_inverse=True)
    seen = np.stack([adapter(lidar.scans[i]) for i in used])
    pose, twist, gap_s = _at(odometry, instants)
    heard = np.maximum(instants - lidar.times_s[newest], gap_s) <= silence_s
    told = np.searchsorted(commands[:, 0], instants + 2.0 * grace_s, side="right") - 1
    command = np.where(told[:, None] >= 0, commands[np.maximum(told, 0), 1:], 0.0)  # none yet: it stands
    moved_m = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    jumped = robot.cannot_have_driven(moved_m, np.diff(pose[:, 2]), period_s)
    goal = np.full(len(instants), -1)
    if goals is not None:
        goal = np.searchsorted(goals.times_s, instants + grace_s, side="right") - 1
    return Recording(
        times_s=instants,
        ranges=seen[which],
        pose=pose,
        twist=twist,
        command=command,
        joined=heard[:-1] & heard[1:] & ~jumped & (np.diff(number) == 1),
        goal=goal,
        goals=goals,
        notes=lidar.notes,
    )


def _contradiction(path: Path, topic: str, odometry: OdometryTable) -> str | None:
    """How twists contradict poses, which decide. Raises DatasetError for poses that cannot."""
    if not odometry.has_poses and odometry.twist.any():
        raise DatasetError(
            f"{path}: {topic}: pose.pose never changes while twist.twist is up to {np.abs(odometry.twist).max():.2g}; "
            "demonstrations need where the robot was: give a topic of odometry that says it"
        )
    try:
        return contradiction(odometry)
    except ValueError as error:
        raise DatasetError(f"{path}: {topic}: {error}") from None


def _instants(scan_times: Array, odometry_times: Array, period_s: float) -> Array:
    """(M,) numbers of the control periods that begin while there are scans and odometry, none in their silences.

    So many as there are scans, not as there is time: a bag may hold stamps of two centuries.
    """
    phase, grace_s = phase_s(scan_times, period_s), GRACE_PERIODS * period_s
    low = max(scan_times[0], odometry_times[0]) - grace_s
    high = min(scan_times[-1], odometry_times[-1]) + grace_s
    ends = np.minimum(scan_times[1:], scan_times[:-1] + SILENCE_PERIODS * period_s)
    numbers = [
        np.arange(math.ceil((begin - phase) / period_s), math.floor((end - phase) / period_s) + 1)
        for begin, end in zip(scan_times - grace_s, np.append(ends, scan_times[-1]) + grace_s, strict=True)
    ]
    number = np.unique(np.concatenate(numbers)).astype(np.float64)
    return number[(phase + number * period_s >= low) & (phase + number * period_s <= high)]


def _require_rate(path: Path, topic: str, times: Array, robot: RobotConfig) -> None:
    """Raises DatasetError where messages are fewer than the robot's control needs."""
    longest_s = SILENCE_PERIODS * robot.control_period_s
    if len(times) < 2 or np.median(np.diff(times)) > longest_s:
        raise DatasetError(
            f"{path}: too few messages on {topic}: {len(times)} in {times[-1] - times[0]:.1f} s; robot "
            f"{robot.name!r} is controlled every {robot.control_period_s} s; record one every {longest_s:.2g} s or more"
        )


def _at(odometry: OdometryTable, instants: Array) -> tuple[Array, Array, Array]:
    """(M, 3) poses and (M, 2) twists between the messages; (M,) how long these are apart, 0 at a message."""
    times = odometry.times_s
    twist = np.stack([np.interp(instants, times, column) for column in odometry.twist.T], axis=1)
    after = np.clip(np.searchsorted(times, instants), 1, len(times) - 1)
    near = np.minimum(np.abs(instants - times[after - 1]), np.abs(times[after] - instants))
    gap_s = np.where(near < AT_ONCE_S, 0.0, times[after] - times[after - 1])
    return odometry.poses(instants), twist, gap_s
