"""Drives from ROS bags: what was recorded is found again, and what is missing is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl.errors import DatasetError
from adrl.evaluation.calibration import calibrate
from adrl.evaluation.drive_bags import read_bag
from adrl.evaluation.drives import Drives
from adrl.worlds import load_robot

DT_S = 0.1
START_NS = 1_700_000_000_000_000_000


def record(path: Path, drives: Drives, silent: tuple[tuple[float, float], ...] = ()) -> None:
    """A ROS 2 bag of one drive: commands at the beginnings of the periods, odometry at 50 Hz.

    silent: from and to which second no command is sent.
    """
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind: Any = store.types

    def twist(v: float, w: float) -> Any:
        vector = kind["geometry_msgs/msg/Vector3"]
        return kind["geometry_msgs/msg/Twist"](vector(v, 0.0, 0.0), vector(0.0, 0.0, w))

    def odometry(v: float, w: float) -> Any:
        header = kind["std_msgs/msg/Header"](kind["builtin_interfaces/msg/Time"](0, 0), "odom")
        point, quaternion = kind["geometry_msgs/msg/Point"], kind["geometry_msgs/msg/Quaternion"]
        pose = kind["geometry_msgs/msg/Pose"](point(0.0, 0.0, 0.0), quaternion(0.0, 0.0, 0.0, 1.0))
        return kind["nav_msgs/msg/Odometry"](
            header,
            "base",
            kind["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            kind["geometry_msgs/msg/TwistWithCovariance"](twist(v, w), np.zeros(36)),
        )

    with Writer(path, version=9) as writer:
        topics = {"/cmd_vel": "geometry_msgs/msg/Twist", "/odom": "nav_msgs/msg/Odometry"}
        lines = {name: writer.add_connection(name, of, typestore=store) for name, of in topics.items()}

        def write(topic: str, seconds: float, message: Any) -> None:
            raw = store.serialize_cdr(message, topics[topic])
            writer.write(lines[topic], START_NS + int(seconds * 1e9), raw)

        for end_s, command in zip(drives.time_s, drives.command, strict=True):
            if any(low < end_s < high for low, high in silent):
                continue
            write("/cmd_vel", 0.037 + end_s - DT_S, twist(*command))
        times = np.concatenate([[0.0], drives.time_s])
        speeds = np.concatenate([np.zeros((1, 2)), drives.twist])
        for seconds in np.arange(0.0, drives.time_s[-1], 0.02):
            now = [float(np.interp(seconds, times, speeds[:, column])) for column in (0, 1)]
            write("/odom", 0.037 + seconds, odometry(*now))


def drive(stops: tuple[tuple[float, float], ...] = ()) -> Drives:
    """One drive of a base with a lag, in closed form. stops: when its watchdog holds it."""
    rng = np.random.default_rng(2)
    command = np.repeat(rng.uniform((0.0, -1.5), (0.6, 1.5), (60, 2)), 5, axis=0)
    twist, now = np.empty_like(command), np.zeros(2)
    for k, wanted in enumerate(command):
        if any(low + 2 * DT_S < DT_S * (k + 1) < high for low, high in stops):
            wanted = np.zeros(2)
        change = (1.0 - np.exp(-DT_S / 0.15)) * (wanted - now)
        now = now + np.clip(change, (-0.2, -0.6), (0.2, 0.6))
        twist[k] = now
    times = DT_S * np.arange(1.0, len(command) + 1.0)
    return Drives(np.zeros(len(command), np.int64), times.astype(np.float64), command, twist)


@pytest.fixture(scope="module")
def drives() -> Drives:
    return drive()


def test_commands_and_speeds_are_resampled_to_periods(tmp_path: Path, drives: Drives) -> None:
    record(tmp_path / "bag", drives)
    read = read_bag(tmp_path / "bag", DT_S)
    assert len(read) == pytest.approx(len(drives), abs=3)
    first = next(k for k in range(4) if np.allclose(drives.command[k : k + 50], read.command[:50]))
    count = len(read)
    np.testing.assert_allclose(read.command, drives.command[first : first + count])
    # Odometry at 50 Hz between two periods: a kink in the speed is cut by at most 0.02 s of acceleration.
    assert np.abs(read.twist - drives.twist[first : first + count]).max() < 0.12
    fit = calibrate(read, load_robot("diffbot"))
    assert fit.robot.lag_s == pytest.approx(0.15, abs=0.03)
    assert fit.robot.latency_s < 0.03


def test_pauses_of_the_commands_are_left_out(tmp_path: Path) -> None:
    """A joystick that is let go: the base stops, and the last command is not what it was told then."""
    pauses = ((4.25, 8.25), (12.25, 16.25), (24.25, 40.0))
    record(tmp_path / "bag", drive(stops=pauses), silent=pauses)
    read = read_bag(tmp_path / "bag", DT_S)
    assert len(np.unique(read.drive)) == 3
    assert len(read) == pytest.approx(10.0 * (4.2 + 4.0 + 8.0), abs=8)
    fit = calibrate(read, load_robot("diffbot"))
    assert fit.robot.lag_s == pytest.approx(0.15, abs=0.03)
    assert fit.robot.latency_s < 0.03
    assert (fit.error_after < (0.02, 0.1)).all()


def test_commands_that_are_not_repeated_are_refused(tmp_path: Path, drives: Drives) -> None:
    """A keyboard's, one a second: how long each held is not in the recording."""
    times = np.arange(-0.05, 30.0, 1.0)
    record(tmp_path / "bag", drives, silent=tuple((low, low + 0.9) for low in times))
    with pytest.raises(DatasetError, match=r"repeats its commands|too few"):
        calibrate(read_bag(tmp_path / "bag", DT_S), load_robot("diffbot"))


def test_what_is_missing_is_named(tmp_path: Path, drives: Drives) -> None:
    with pytest.raises(DatasetError, match=r"gone: no such file"):
        read_bag(tmp_path / "gone", DT_S)
    (tmp_path / "text.bag").write_text("no bag")
    with pytest.raises(DatasetError, match=r"text\.bag: not a readable bag"):
        read_bag(tmp_path / "text.bag", DT_S)
    record(tmp_path / "bag", drives)
    with pytest.raises(DatasetError, match=r"no topic /nav; it has /cmd_vel, /odom"):
        read_bag(tmp_path / "bag", DT_S, "/nav")
