"""What a recording of a drive shows of the robot: its LiDAR, and how fast it was driven."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adrl.bags import Bag, open_bag
from adrl.bags.mounts import read_mount
from adrl.bags.odometry import OdometryTable, contradiction, driven_twists, one_frame, read_odometry, stamp_of
from adrl.bags.reader import ODOMETRY, ODOMETRY_TOPIC, SCANS, TWISTS
from adrl.bags.transforms import Transforms, frame_name
from adrl.deploy.messages import Scan
from adrl.deploy.scan_reader import ScanReader
from adrl.descriptions.findings import Reading, Standing, beams_of
from adrl.errors import ConfigError, DatasetError
from adrl.types import Array

LEAST_SCANS = 10
SPAN_S = 0.3
"""Accelerations are seen over so long: those over one message are the noise of the odometry."""
SPIKE = 5
"""Speeds are the medians of so many messages."""
PAUSE_S = 1.0
"""No acceleration is taken over a longer silence."""
MOVED = (0.02, 0.02)
"""m/s, rad/s: a robot that was never faster was not driven."""
DIGITS = 3
ANGLE_DIGITS = 6
"""Messages have angles in single precision."""


def read_recorded_robot(path: Path, scan_topic: str | None = None, likely: Sequence[str] = ()) -> Reading:
    """What a bag of ROS 1 or ROS 2 shows.

    scan_topic: of the LiDAR that is meant. likely: topics that other sources name; one of them is taken where the bag
    has several LiDARs. Raises MissingExtra without rosbags; ConfigError for several LiDARs, DatasetError for a bag that
    cannot be read, or that is not of a robot that drives the way it looks.
    """
    reading = Reading()
    with open_bag(path) as bag:
        topic = _scan_topic(bag, scan_topic, likely)
        odometry = _odometry(bag)
        reading.add("scan_topic", topic, str(path))
        reading.add("ros", "ros2" if bag.is_ros2 else "ros1", str(path), Standing.HINT)
        lidar = _read_lidar(bag, topic)
        reading.notes.extend(lidar.notes)
        middle = _lidar(reading, lidar, f"{path}: {topic}")
        if odometry is not None:
            _mount(reading, bag, topic, lidar.frame, odometry[1], middle)
            _speeds(reading, path, *odometry)
        if any(bag.types(name) & {TWISTS[1]} for name in bag.topics if name.endswith("cmd_vel")):
            reading.add("stamped", True, f"{path}: cmd_vel", Standing.HINT)
    return reading


def _scan_topic(bag: Bag, wanted: str | None, likely: Sequence[str]) -> str:
    topics = sorted(topic for topic in bag.topics if bag.types(topic) & set(SCANS))
    if wanted is not None:
        return f"/{wanted.strip('/')}"
    if not topics:
        raise DatasetError(f"{bag.path}: no LiDAR: it has no topic of sensor_msgs/LaserScan; record one")
    named = [topic for topic in topics if topic in likely]
    if len(topics) > 1 and len(named) != 1:
        choices = ", or ".join(f"--scan-topic {topic}" for topic in topics)
        raise ConfigError(
            f"{bag.path}: several LiDARs: {' and '.join(topics)}; ADRL drives by one, say which: {choices}"
        )
    return (named or topics)[0]


def _odometry(bag: Bag) -> tuple[str, OdometryTable] | None:
    """Of the usual topic, else of the only one."""
    topics = sorted(topic for topic in bag.topics if bag.types(topic) & set(ODOMETRY))
    if ODOMETRY_TOPIC in topics:
        topics = [ODOMETRY_TOPIC]
    if len(topics) != 1:
        return None
    return topics[0], read_odometry(bag, topics[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lidar:
    frame: str
    scan: Scan
    """One whose number of beams is the median."""
    periods_s: Array
    """(S - 1,) between scans by their own stamps, or by the recorder's where these stand still."""
    notes: list[str]


def _read_lidar(bag: Bag, topic: str) -> _Lidar:
    reader = ScanReader()
    frames, stamps, times, counts = set[str](), [], [], []
    kept: dict[int, Scan] = {}
    for seconds, message in bag.messages(topic, SCANS):
        frames.add(frame_name(message.header.frame_id))
        stamps.append(stamp_of(message.header))
        times.append(seconds)
        counts.append(message.ranges.size)
        if message.ranges.size not in kept:
            with np.errstate(invalid="ignore"):  # of NaN that signals
                kept[message.ranges.size] = reader(
                    Scan(
                        ranges=message.ranges,
                        angle_min_rad=message.angle_min,
                        angle_increment_rad=message.angle_increment,
                        angle_max_rad=message.angle_max,
                        range_min_m=message.range_min,
                        range_max_m=message.range_max,
                        stamp_s=seconds,
                    )
                )
    if len(counts) < LEAST_SCANS:
        raise DatasetError(
            f"{bag.path}: {topic} has {len(counts)} scans; record {LEAST_SCANS} or more of them"
        )
    usual = sorted(counts)[len(counts) // 2]
    notes = []
    if len(kept) > 1:
        notes.append(
            f"{bag.path}: {topic} has scans of {min(kept)} to {max(kept)} beams; {usual}, the median, is taken"
        )
    own: Array = np.diff(np.sort(np.array(stamps, dtype=np.float64)))
    return _Lidar(
        frame=one_frame(bag.path, topic, "header.frame_id", frames),
        scan=kept[usual],
        periods_s=own if np.median(own) > 0.0 else np.diff(times),
        notes=notes,
    )


def _lidar(reading: Reading, lidar: _Lidar, place: str) -> float:
    """Add what the scans say; returns the angle of their middle in the sensor's frame."""
    scan = lidar.scan
    last = scan.angle_min_rad + scan.angle_increment_rad * (scan.ranges.size - 1)
    if scan.ranges.size == 0 or not math.isfinite(last):
        raise DatasetError(f"{place} has scans whose angles are no numbers; mend the LiDAR's driver")
    first, last = round(scan.angle_min_rad, ANGLE_DIGITS), round(last, ANGLE_DIGITS)
    middle = beams_of(reading, scan.ranges.size, first, last, place)
    if math.isfinite(scan.range_max_m) and scan.range_max_m > 0.0:
        reading.add("lidar.max_range_m", float(scan.range_max_m), f"{place}, range_max")
    period_s = float(np.median(lidar.periods_s))
    if period_s > 0.0:
        digits = DIGITS - 1 - math.floor(math.log10(period_s))
        reading.add("control_period_s", round(period_s, digits), f"{place}, the median of its stamps")
    return middle


def _mount(
    reading: Reading, bag: Bag, topic: str, frame: str, odometry: OdometryTable, middle: float
) -> None:
    mount = read_mount(bag, topic, Transforms.of(bag), frame, odometry)
    reading.add("odom_frame", odometry.frame, str(bag.path))
    if odometry.base:
        reading.add("base_frame", odometry.base, str(bag.path), Standing.HINT)
    if mount is not None:
        add_mount(reading, mount.pose, mount.upside_down, middle, f"{bag.path}: /tf of {frame}")


def add_mount(
    reading: Reading, pose: tuple[float, float, float], upside_down: bool, middle: float, place: str
) -> None:
    """Where a LiDAR sits, and which way the middle of its scan looks.

    pose: of the sensor in the robot's frame. middle: of the scan, in the sensor's frame (rad). The nodes need the
    sensor's own pose where that is another.
    """
    x, y, yaw = pose
    looks = math.remainder(yaw + (-middle if upside_down else middle), 2.0 * math.pi)
    if upside_down:
        place = f"{place}, upside down"
        reading.notes.append(
            f"{place}: its scans run the other way round; for the nodes let its driver publish them as seen from above"
        )
    for name, value in (("x_m", x), ("y_m", y), ("yaw_rad", looks)):
        reading.add(f"lidar.mount_{name}", value, place)
    if middle != 0.0:
        reading.add("sensor_yaw_rad", yaw, place)


def _speeds(reading: Reading, path: Path, topic: str, odometry: OdometryTable) -> None:
    """The fastest that was driven: a robot can do that, and maybe more."""
    reading.add("odom_topic", topic, str(path))
    times, twist = odometry.times_s, odometry.twist
    place = f"{path}: {topic}"
    if odometry.has_poses:
        try:
            wrong = contradiction(odometry)
        except ValueError as error:
            raise DatasetError(f"{path}: {topic}: {error}") from None
        if wrong is not None:
            reading.notes.append(f"{place}: {wrong}: speeds are taken from the poses")
            twist = driven_twists(odometry, times, SPAN_S)
    if len(times) <= SPIKE:
        return
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(twist, SPIKE, axis=0), axis=-1)
    times = times[SPIKE // 2 : SPIKE // 2 + len(smooth)]
    fastest, turning = float(smooth[:, 0].max()), float(np.abs(smooth[:, 1]).max())
    accelerations = _accelerations(times, smooth)
    if fastest > MOVED[0]:
        _seen(reading, "max_speed_mps", fastest, place)
        _seen(reading, "max_acceleration_mps2", accelerations[0], place, Standing.HINT)
        backwards = float(smooth[:, 0].min())
        _seen(reading, "min_speed_mps", backwards if backwards < -MOVED[0] else 0.0, place, Standing.HINT)
    if turning > MOVED[1]:
        _seen(reading, "max_yaw_rate_radps", turning, place)
        _seen(reading, "max_yaw_acceleration_radps2", accelerations[1], place, Standing.HINT)


def _seen(reading: Reading, field: str, value: float, place: str, standing: Standing = Standing.SEEN) -> None:
    reading.add(field, round(value, DIGITS), f"{place}, the most that was driven: a lower bound", standing)


def _accelerations(times: Array, twist: Array) -> tuple[float, float]:
    """The greatest changes of (T, 2) speeds over SPAN_S."""
    ends = np.searchsorted(times, times + SPAN_S)
    starts = np.flatnonzero(ends < len(times))
    ends = ends[starts]
    lasted = times[ends] - times[starts]
    short = (lasted > 0.0) & (lasted < PAUSE_S)
    if not short.any():
        return 0.0, 0.0
    change = np.abs(twist[ends] - twist[starts])[short] / lasted[short][:, None]
    most = change.max(axis=0)
    return float(most[0]), float(most[1])
