"""Bags that contradict themselves: poses decide what the robot did, and it is said, with topic and field."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adrl.bags.odometry import OdometryTable, contradiction, driven_twists
from adrl.errors import DatasetError
from adrl.evaluation.drive_bags import read_bag
from adrl.imitation import Demonstrations, read_demonstrations
from adrl.types import RobotConfig
from bag_corridor import BEAMS, YAW, corridor_bag
from small_run import run_cli

ROBOT = RobotConfig()
TWIST = slice(36 + 3, 36 + 5)
"""Where an observation has speed and yaw rate, after sectors and goal."""


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    return read(corridor_bag(tmp_path_factory.mktemp("plain") / "bag"))[0]


def read(path: Path, **options: Any) -> tuple[Demonstrations, tuple[str, ...]]:
    data, (summary,) = read_demonstrations([path], ROBOT, **options)
    return data, summary.notes


def with_twist(v: Callable[[float], float], w: Callable[[float], float]) -> Callable[[float, Any], Any]:
    def change(_: float, message: Any) -> Any:
        twist = message.twist.twist
        twist.linear.x, twist.angular.z = v(twist.linear.x), w(twist.angular.z)
        return message

    return change


TWISTS = {
    "always 0": (
        with_twist(lambda v: 0.0 * v, lambda w: w),
        "twist.twist.linear.x is always 0 while pose.pose moves",
    ),
    "in odom": (
        with_twist(lambda v: v * math.cos(YAW), lambda w: w),
        "twist.twist.linear.x is the speed along x of the frame 'odom'",
    ),
    "backwards": (with_twist(lambda v: -v, lambda w: w), "twist.twist.linear.x comes to"),
    "in mm/s": (with_twist(lambda v: 1000.0 * v, lambda w: w), "twist.twist.linear.x comes to 3000.0 m"),
    "turning": (with_twist(lambda v: v, lambda w: w + 0.5), "twist.twist.angular.z comes to"),
}


@pytest.mark.parametrize("name", TWISTS)
def test_twists_that_contradict_the_poses_are_told_and_the_poses_taken(
    tmp_path: Path, plain: Demonstrations, name: str
) -> None:
    edit, message = TWISTS[name]
    path = corridor_bag(tmp_path / "bag", edit={"/odom": edit})
    data, (note,) = read(path)
    assert note.startswith(f"/odom: {message}")
    assert "taken from the poses" in note
    # But for the period in which it starts, whose poses tell half.
    assert_allclose(data.observation[1:, TWIST], plain.observation[1:, TWIST], atol=1e-3)
    with pytest.raises(DatasetError, match=r"/odom: twist\.twist\."):
        read_bag(path, ROBOT.control_period_s)


def test_poses_that_no_differential_drive_has_are_refused(tmp_path: Path) -> None:
    def looks_left(_: float, message: Any) -> Any:
        q = message.pose.pose.orientation
        q.z, q.w = math.sin(0.5 * YAW + 0.25 * math.pi), math.cos(0.5 * YAW + 0.25 * math.pi)
        return message

    path = corridor_bag(tmp_path / "bag", edit={"/odom": looks_left})
    for reader in (read, lambda path: read_bag(path, 0.1)):
        with pytest.raises(
            DatasetError, match=r"/odom: pose\.pose moves 3.0 of 3.0 m across its own heading"
        ):
            reader(path)


def test_a_base_that_measures_no_poses_teaches_nothing_and_calibrates(tmp_path: Path) -> None:
    def lost(_: float, message: Any) -> Any:
        message.pose.pose.position.x = message.pose.pose.position.y = 0.0
        return message

    path = corridor_bag(tmp_path / "bag", edit={"/odom": lost})
    with pytest.raises(
        DatasetError, match=r"/odom: pose\.pose never changes while twist\.twist is up to 0\.4"
    ):
        read(path)
    (note,) = read_bag(path, ROBOT.control_period_s).notes
    assert note.startswith("/odom: pose.pose never changes")


def drive(
    speeds: np.ndarray, rates: np.ndarray, dt_s: float, noise: float = 0.0, seed: int = 0
) -> OdometryTable:
    """Odometry of a robot with these speeds between messages, in closed form (arcs by the heading half way)."""
    yaw = np.concatenate([[0.0], np.cumsum(rates * dt_s)])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    x, y = (np.concatenate([[0.0], np.cumsum(speeds * dt_s * part(middle))]) for part in (np.cos, np.sin))
    rng = np.random.default_rng(seed)
    ends = np.stack([np.append(speeds, speeds[-1]), np.append(rates, rates[-1])], axis=1)
    times = (dt_s * np.arange(len(x))).astype(np.float64)
    pose = np.stack([x, y, yaw], axis=1)
    return OdometryTable(
        times_s=times,
        stamps_s=times,
        pose=pose + noise * rng.standard_normal(pose.shape),
        twist=ends * (1.0 + noise * rng.standard_normal(ends.shape)),
        frame="odom",
        base="base_link",
    )


smooth = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=8)


@settings(max_examples=60, deadline=None)
@given(v=smooth, w=smooth, dt_s=st.sampled_from([0.01, 0.05, 0.1]), seed=st.integers(0, 9))
def test_odometry_that_agrees_is_never_said_to_contradict_itself(
    v: list[float], w: list[float], dt_s: float, seed: int
) -> None:
    times = np.arange(0.0, 20.0, dt_s)
    speeds, rates = (np.interp(times, np.linspace(0.0, 20.0, len(x)), x) for x in (v, w))
    table = drive(speeds, rates, dt_s, noise=0.002, seed=seed)
    assert contradiction(table) is None
    found = driven_twists(drive(speeds, rates, dt_s), times[1:-1], dt_s)
    assert_allclose(found, np.stack([speeds, rates], axis=1)[1:-1], atol=2.0 * dt_s)


def test_a_base_that_averages_its_twists_contradicts_nothing() -> None:
    """As diff_drive_controller does: a real Husky's yaw rates lag by so much that 1 s of them is off by a third."""
    rates = np.repeat(np.random.default_rng(1).uniform(-0.5, 0.5, 40), 15)
    table = drive(np.full(600, 0.5), rates, 0.1)
    table.twist[10:, 1] = np.convolve(table.twist[:, 1], np.full(10, 0.1), mode="valid")[:-1]
    assert contradiction(table) is None


@pytest.mark.parametrize("yaw", [0.5, 1.0, 2.0, 3.0])
def test_speeds_along_the_odometry_s_x_are_told_from_the_robot_s_own(yaw: float) -> None:
    table = drive(np.full(300, 0.5), np.zeros(300), 0.1)
    c, s = math.cos(yaw), math.sin(yaw)
    table.pose[:, 1] = s * table.pose[:, 0]
    table.pose[:, 0] *= c
    table.pose[:, 2] += yaw
    assert contradiction(table) is None
    table.twist[:, 0] *= c
    assert "along x of the frame 'odom'" in str(contradiction(table))


def test_standing_and_a_new_beginning_contradict_nothing() -> None:
    still = drive(np.zeros(600), np.zeros(600), 0.1, noise=0.003)
    assert contradiction(still) is None
    moving = drive(np.full(300, 0.5), np.zeros(300), 0.1)
    moving.pose[150:, 0] -= 20.0
    assert contradiction(moving) is None


def test_zero_where_nothing_came_back_is_understood_and_told(tmp_path: Path, plain: Demonstrations) -> None:
    for number, (value, option) in enumerate(((0.0, "zero_is_free"), (math.nan, "nan_is_free"))):

        def change(_: float, scan: Any, value: float = value) -> Any:
            scan.ranges = np.where(np.isinf(scan.ranges), np.float32(value), scan.ranges)
            return scan

        path = corridor_bag(tmp_path / str(number), edit={"/scan": change})
        data, (note,) = read(path)
        assert_allclose(data.observation, plain.observation)
        assert note.startswith("/scan: ")
        assert f"--{option.replace('_', '-')}" in note
        asked, notes = read(path, **{option: True})
        assert_allclose(asked.observation, plain.observation)
        assert notes == ()


def test_zeros_of_a_lidar_that_says_itself_what_is_free_stay_unknown(
    tmp_path: Path, plain: Demonstrations
) -> None:
    def blind_to_the_left(_: float, scan: Any) -> Any:
        scan.ranges[130:140] = 0.0
        return scan

    data, notes = read(corridor_bag(tmp_path / "bag", edit={"/scan": blind_to_the_left}))
    assert notes == ()
    assert_allclose(data.observation[:, 10:25], plain.observation[:, 10:25], atol=1e-6)


def test_single_beams_that_are_lost_are_not_free(tmp_path: Path) -> None:
    """Every third beam is NaN, and the wall goes on behind it."""

    def lossy(_: float, scan: Any) -> Any:
        scan.ranges = np.minimum(scan.ranges, np.float32(5.9))
        scan.ranges[::3] = np.nan
        return scan

    data, notes = read(corridor_bag(tmp_path / "bag", edit={"/scan": lossy}))
    whole, _ = read(corridor_bag(tmp_path / "whole", edit={"/scan": lambda _, m: change_ranges(m)}))
    assert notes == ()
    assert_allclose(data.observation[:, :36], whole.observation[:, :36], atol=0.05)


def change_ranges(scan: Any) -> Any:
    scan.ranges = np.minimum(scan.ranges, np.float32(5.9))
    return scan


def change(**fields: Any) -> Callable[[float, Any], Any]:
    def edit(_: float, scan: Any) -> Any:
        for name, value in fields.items():
            setattr(scan, name, value)
        return scan

    return edit


SCANS: dict[str, tuple[dict[str, Any], str]] = {
    "no beam": ({"ranges": np.empty(0, np.float32)}, "scan_invalid .*: 0 ranges"),
    "all NaN": ({"ranges": np.full(BEAMS, np.nan, np.float32)}, r"180 ranges"),
    "all too near": (
        {"ranges": np.full(BEAMS, 0.05, np.float32), "range_min": 0.1},
        r"180 below range_min",
    ),
    "NaN angle": ({"angle_min": math.nan}, "angle_min nan"),
    "no increment": ({"angle_increment": 0.0, "angle_max": math.nan}, "angle_increment 0,"),
    "a sliver": ({"ranges": np.full(20, 2.0, np.float32)}, "scan_sparse .*: 20 ranges"),
}


@pytest.mark.parametrize("name", SCANS)
def test_scans_that_the_runtime_would_not_drive_by_are_refused(tmp_path: Path, name: str) -> None:
    fields, message = SCANS[name]
    path = corridor_bag(tmp_path / "bag", edit={"/scan": change(**fields)})
    with pytest.raises(DatasetError, match=f"/scan: .*{message}"):
        read(path)


@pytest.mark.parametrize(
    "fields", [{"range_max": 0.0}, {"range_min": 7.0}, {"range_min": -1.0}, {"angle_increment": 0.0}]
)
def test_fields_that_cannot_be_are_read_as_the_runtime_reads_them(
    tmp_path: Path, plain: Demonstrations, fields: dict[str, float]
) -> None:
    data, _ = read(corridor_bag(tmp_path / "bag", edit={"/scan": change(**fields)}))
    np.testing.assert_allclose(data.observation, plain.observation, atol=1e-4)


def test_a_few_bad_scans_are_left_out_and_told(tmp_path: Path, plain: Demonstrations) -> None:
    def one_in_ten(now_s: float, scan: Any) -> Any:
        return (
            change(angle_increment=0.0, angle_max=math.nan)(now_s, scan)
            if round(now_s * 10) % 10 == 3
            else scan
        )

    data, (note,) = read(corridor_bag(tmp_path / "bag", edit={"/scan": one_in_ten}))
    for text in ("/scan: 12 of 120 scans", "left out", "angle_increment 0"):
        assert text in note
    assert len(data) == len(plain)


def test_scans_that_never_change_while_the_robot_drives_are_refused(tmp_path: Path) -> None:
    frozen = np.full(BEAMS, 3.0, np.float32)
    path = corridor_bag(tmp_path / "bag", edit={"/scan": change(ranges=frozen)})
    with pytest.raises(DatasetError, match="scan_frozen"):
        read(path)


def test_the_commands_say_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = corridor_bag(tmp_path / "bag", edit={"/odom": TWISTS["always 0"][0]})
    assert run_cli("collect", "--bag", path, "--out", tmp_path / "demos") == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "1 episodes, 1 arrivals" in told
    assert "/odom: twist.twist.linear.x is always 0" in told
    assert run_cli("calibrate", path) == 2
    assert "/odom: twist.twist.linear.x is always 0" in " ".join(capsys.readouterr().err.split())


def test_topics_that_are_never_recorded_together_are_refused(tmp_path: Path) -> None:
    edit = {
        "/scan": lambda now_s, message: message if now_s < 5.0 else None,
        "/odom": lambda now_s, message: message if now_s > 6.0 else None,
    }
    path = corridor_bag(tmp_path / "bag", edit=edit)
    with pytest.raises(DatasetError, match="/scan and /odom never have messages at the same time"):
        read(path)


def test_times_of_two_centuries_take_no_more_memory_than_messages(
    tmp_path: Path, plain: Demonstrations
) -> None:
    """A clock that was set while the bag was recorded: the drive before stays whole, and so does what follows."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    corridor_bag(tmp_path / "a")
    with (
        AnyReader([tmp_path / "a"]) as reader,
        Writer(tmp_path / "b", version=8, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        store = get_typestore(Stores.ROS2_HUMBLE)
        lines = {
            line.topic: writer.add_connection(line.topic, line.msgtype, typestore=store)
            for line in reader.connections
        }
        kept = list(reader.messages())
        for offset_ns in (0, 4_100_000_000_000_000_000):
            for line, time_ns, raw in kept:
                writer.write(lines[line.topic], time_ns + offset_ns, raw)
    data, _ = read(tmp_path / "b")
    assert data.terminated.sum() == 2
    assert_allclose(data.observation[: len(plain)], plain.observation, atol=1e-6)
    assert len(data) == pytest.approx(2 * len(plain), abs=2)
    assert len(read_bag(tmp_path / "b", 0.1)) > 200
