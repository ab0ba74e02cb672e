"""Scans of a recording: of one LiDAR, where the frames say it sits, and good enough to drive by."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from adrl.bags import Bag
from adrl.bags.mounts import STILL_M, STILL_RAD, read_mount
from adrl.bags.odometry import OdometryTable, one_frame
from adrl.bags.reader import SCANS
from adrl.bags.transforms import Transforms, frame_name
from adrl.deploy.messages import Odometry, Scan
from adrl.deploy.scan_reader import ScanReader
from adrl.deploy.supervisor import SupervisorConfig
from adrl.deploy.watch import SensorWatch
from adrl.errors import DatasetError
from adrl.geometry import Pose
from adrl.types import Array, RobotConfig

SAME = 1e-3
"""m, rad: transforms are not told to the last digit. A mount within STILL_M of the robot file's is not worth a word."""
NOTHING_BACK, SELDOM = 0.01, 10.0
"""Zeros or NaN in more than this share of the beams are free where beams that say so themselves are so many times
fewer: indoors some wall is always just at the greatest range."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LidarRecording:
    """The scans to learn from, in order of time, and how to read them."""

    scans: list[Scan]
    times_s: Array
    """(S,)."""
    mount: Pose
    """Of the LiDAR in the robot's frame."""
    notes: tuple[str, ...]
    """What was decided about them, for people."""


def read_scans(
    bag: Bag,
    topic: str,
    transforms: Transforms,
    odometry: OdometryTable,
    robot: RobotConfig,
    *,
    zero_is_free: bool,
    nan_is_free: bool,
) -> LidarRecording:
    """Scans by which the robot's own supervisor would drive.

    Raises DatasetError: see Bag.messages; scans of several LiDARs on one topic; a LiDAR that /tf says is tilted or
    moves on the robot; none that the runtime would drive by.
    """
    scans, frames = [], set[str]()
    for seconds, message in bag.messages(topic, SCANS):
        frames.add(frame_name(message.header.frame_id))
        with np.errstate(invalid="ignore"):  # of NaN that signals
            scan = Scan(
                ranges=message.ranges,
                angle_min_rad=message.angle_min,
                angle_increment_rad=message.angle_increment,
                angle_max_rad=message.angle_max,
                range_min_m=message.range_min,
                range_max_m=message.range_max,
                stamp_s=seconds,
            )
        scans.append(scan)
    frame = one_frame(bag.path, topic, "header.frame_id", frames)
    scans.sort(key=lambda scan: scan.stamp_s)
    scans, free_note = _read(topic, scans, zero_is_free=zero_is_free, nan_is_free=nan_is_free)
    good, fault_note = _good(bag, topic, scans, odometry, robot)
    mount, upside_down, mount_note = _mount(bag, topic, transforms, frame, odometry, robot)
    if upside_down:  # it turns the other way round
        good = [
            replace(scan, angle_min_rad=-scan.angle_min_rad, angle_increment_rad=-scan.angle_increment_rad)
            for scan in good
        ]
    return LidarRecording(
        scans=good,
        times_s=np.array([scan.stamp_s for scan in good]),
        mount=mount,
        notes=tuple(note for note in (free_note, fault_note, mount_note) if note),
    )


def _read(topic: str, scans: list[Scan], *, zero_is_free: bool, nan_is_free: bool) -> tuple[list[Scan], str]:
    """The scans as the runtime reads them, however the LiDAR reports where nothing came back; and what to say."""
    if zero_is_free or nan_is_free:
        return list(map(ScanReader(zero_is_free=zero_is_free, nan_is_free=nan_is_free), scans)), ""
    # A scan that tells nothing at all is of a LiDAR that sees nothing, and not of a place where nothing is.
    telling = [bool((scan.ranges > 0.0).any()) for scan in scans]
    zero, nan, free = _shares([scan for scan, tells in zip(scans, telling, strict=True) if tells])
    as_it_is = ScanReader()
    if max(zero, nan) <= max(NOTHING_BACK, SELDOM * free):
        return list(map(as_it_is, scans)), ""
    what, option = ("0", "--zero-is-free") if zero >= nan else ("NaN", "--nan-is-free")
    freeing = ScanReader(zero_is_free=what == "0", nan_is_free=what == "NaN")
    read = [(freeing if tells else as_it_is)(scan) for scan, tells in zip(scans, telling, strict=True)]
    return read, (
        f"{topic}: {100.0 * max(zero, nan):.0f} % of ranges are {what}, {100.0 * free:.1f} % inf or range_max: {what} "
        f"is taken for nothing within reach, as {option} does"
    )


def _shares(scans: list[Scan]) -> tuple[float, float, float]:
    """Of zeros, of NaN, and of ranges that say themselves that nothing is within reach; of zeros and NaN those between
    others: what is free is wide, and a single beam that is lost is not free."""
    counts, beams = np.zeros(3), 0
    for scan in scans:
        ranges = scan.ranges
        free = ranges >= scan.range_max_m * (1.0 - 1e-6)
        counts += np.array([_inside(ranges == 0.0), _inside(np.isnan(ranges)), int(free.sum())])
        beams += ranges.size
    zero, nan, free = counts / max(beams, 1)
    return float(zero), float(nan), float(free)


def _inside(beams: NDArray[np.bool_]) -> int:
    """Beams whose two neighbours are alike."""
    return int(np.sum(beams[:-2] & beams[1:-1] & beams[2:]))


def _good(
    bag: Bag, topic: str, scans: list[Scan], odometry: OdometryTable, robot: RobotConfig
) -> tuple[list[Scan], str]:
    """Scans in which the robot's supervisor finds no fault. Raises DatasetError for none."""
    trust = SupervisorConfig()
    watch = SensorWatch(
        robot,
        max_age_s=trust.max_age_periods * robot.control_period_s,
        least_told=trust.least_told,
        largest_hole_rad=trust.largest_hole_rad,
    )
    poses = odometry.poses(np.array([scan.stamp_s for scan in scans]))
    good, faults = [], dict[str, list[Scan]]()
    for scan, (x, y, yaw) in zip(scans, poses, strict=True):
        here = Odometry(pose=(x, y, yaw), twist=(0.0, 0.0), stamp_s=scan.stamp_s)
        newer = watch.scan is None or scan.stamp_s > watch.scan.stamp_s
        reasons = (*watch.take(scan, here, scan.stamp_s), *watch.doubts())
        fault = next((reason for reason in reasons if reason in ("scan_invalid", "scan_sparse")), None)
        if fault is None and newer and watch.scan is not scan:
            fault = "scan_frozen"  # it is held for the one before
        if fault is None:
            good.append(scan)
        else:
            faults.setdefault(fault, []).append(scan)
    if not faults:
        return good, ""
    reason, bad = max(faults.items(), key=lambda item: len(item[1]))
    told = (
        f"{topic}: {len(scans) - len(good)} of {len(scans)} scans are not to be driven by, most of them {reason} as "
        f"the runtime calls it, the first after {bad[0].stamp_s:.1f} s: {_described(bad[0])}"
    )
    if not good:
        raise DatasetError(
            f"{bag.path}: {told}; mend the LiDAR's driver, or give --zero-is-free or --nan-is-free if that is what it "
            "reports where nothing comes back"
        )
    return good, f"{told}; they are left out"


def _described(scan: Scan) -> str:
    ranges = scan.ranges
    counts = {
        "NaN": np.isnan(ranges).sum(),
        "0": (ranges == 0.0).sum(),
        "below range_min": ((ranges != 0.0) & (ranges < scan.range_min_m)).sum(),
    }
    told = ", ".join(f"{count} {name}" for name, count in counts.items() if count > 0)
    return (
        f"{ranges.size} ranges{f' ({told})' if told else ''}, angle_min {scan.angle_min_rad:.3g}, angle_increment "
        f"{scan.angle_increment_rad:.3g}, range_min {scan.range_min_m:.3g}, range_max {scan.range_max_m:.3g}"
    )


def _mount(
    bag: Bag,
    topic: str,
    transforms: Transforms,
    frame: str,
    odometry: OdometryTable,
    robot: RobotConfig,
) -> tuple[Pose, bool, str]:
    """Where the LiDAR sits, whether upside down, and what to say: by /tf, else by the robot's file."""
    lidar = robot.lidar
    configured = lidar.mount
    mount = read_mount(bag, topic, transforms, frame, odometry)
    if mount is None:
        unrelated = frame in transforms.frames
        told = f"/tf does not relate the frames {odometry.base!r} of the odometry and {frame!r} of {topic}: robot "
        return configured, False, f"{told}{robot.name!r} says where the LiDAR is" if unrelated else ""
    apart_m = math.dist(mount.pose[:2], configured[:2])
    apart_rad = abs(math.remainder(mount.pose[2] - configured[2], 2.0 * math.pi))
    if not mount.upside_down and apart_m < SAME and apart_rad < SAME:
        return configured, False, ""
    if not mount.upside_down and apart_m < STILL_M and apart_rad < STILL_RAD:
        return mount.pose, False, ""
    sits = f"{_pose(mount.pose)}{', upside down' if mount.upside_down else ''}"
    has = f"robot {robot.name!r} has {_pose(configured)}"
    return (
        mount.pose,
        mount.upside_down,
        f"{mount.where} sits at {sits}, {has}: that of /tf is used",
    )


def _pose(pose: Pose) -> str:
    x, y, yaw = pose
    return f"({x:.2f} m, {y:.2f} m, {math.degrees(yaw):.0f} degrees)"
