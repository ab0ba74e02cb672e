"""Bags: the LiDAR as it scans and is mounted, and speeds as lower bounds."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from adrl.bags import messages
from adrl.descriptions import Reading, Standing, read_recorded_robot, settle
from adrl.errors import ConfigError, DatasetError
from bag_corridor import BEAMS, DT_S, REACH_M, SPEED_MPS, Link, corridor_bag, header, new

MOUNT = ("lidar.mount_x_m", "lidar.mount_y_m", "lidar.mount_yaw_rad")


def values(reading: Reading) -> dict[str, Any]:
    settled = settle(reading.findings)
    assert settled.faults == ()
    return {name: finding.value for name, finding in settled.chosen.items()}


def test_a_drive_shows_lidar_mount_and_speeds(tmp_path: Path) -> None:
    path = corridor_bag(
        tmp_path / "bag",
        lidar=Link(parent="base_link", child="laser", place=(0.2, 0.1, 0.3), turn=(0.0, 0.0, 0.5)),
    )
    reading = read_recorded_robot(path)
    found = values(reading)
    assert (found["lidar.num_beams"], found["lidar.max_range_m"]) == (BEAMS, REACH_M)
    assert found["lidar.fov_rad"] == pytest.approx(2.0 * math.pi, abs=1e-9)
    assert [found[name] for name in MOUNT] == pytest.approx([0.2, 0.1, 0.5], abs=1e-6)
    assert found["control_period_s"] == DT_S
    assert found["max_speed_mps"] == SPEED_MPS
    # From 0 to full speed in a message: over the span of three messages.
    assert found["max_acceleration_mps2"] == pytest.approx(SPEED_MPS / 0.3, abs=0.01)
    assert found["min_speed_mps"] == 0.0
    assert (found["scan_topic"], found["odom_frame"], found["base_frame"]) == ("/scan", "odom", "base_link")
    speed = next(f for f in reading.findings if f.field == "max_speed_mps")
    assert speed.standing is Standing.SEEN
    assert "a lower bound" in speed.place
    # It went straight on: how fast it turns was not seen, and no bag says its shape.
    missing = settle(reading.findings).missing
    assert missing == ("radius_m", "max_yaw_rate_radps", "max_yaw_acceleration_radps2")


def narrow(_: float, scan: Any) -> Any:
    """The right half of the scan, from -pi to 0."""
    scan.ranges = scan.ranges[: BEAMS // 2 + 1]
    scan.angle_max = 0.0
    return scan


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_scan_to_one_side_looks_where_its_middle_is(tmp_path: Path, upside_down: bool) -> None:
    lidar = Link(parent="base_link", child="laser", turn=(math.pi if upside_down else 0.0, 0.0, 0.2))
    reading = read_recorded_robot(corridor_bag(tmp_path / "bag", lidar=lidar, edit={"/scan": narrow}))
    found = values(reading)
    assert (found["lidar.num_beams"], found["lidar.fov_rad"]) == (91, pytest.approx(math.pi, abs=1e-6))
    assert found["lidar.mount_yaw_rad"] == pytest.approx(
        0.2 + (0.5 if upside_down else -0.5) * math.pi, abs=1e-6
    )
    assert found["sensor_yaw_rad"] == pytest.approx(0.2, abs=1e-6)
    assert any("upside down" in note for note in reading.notes) == upside_down


def test_speeds_are_those_of_the_poses_where_twists_contradict_them(tmp_path: Path) -> None:
    def none(_: float, odometry: Any) -> Any:
        odometry.twist.twist.linear.x = 0.0
        return odometry

    reading = read_recorded_robot(corridor_bag(tmp_path / "bag", edit={"/odom": none}))
    assert values(reading)["max_speed_mps"] == pytest.approx(SPEED_MPS, abs=0.01)
    assert any("twist.twist.linear.x is always 0" in note for note in reading.notes)


def test_a_single_message_of_nonsense_is_no_speed(tmp_path: Path) -> None:
    def spike(now_s: float, odometry: Any) -> Any:
        if abs(now_s - 5.0) < 0.01:
            odometry.twist.twist.linear.x = 9.0
        return odometry

    reading = read_recorded_robot(corridor_bag(tmp_path / "bag", edit={"/odom": spike}))
    assert values(reading)["max_speed_mps"] == SPEED_MPS


def test_more_than_nav2_allows_was_driven_is_a_contradiction(tmp_path: Path) -> None:
    reading = read_recorded_robot(corridor_bag(tmp_path / "bag"))
    said = Reading()
    said.add("max_speed_mps", 0.3, "nav2.yaml: max_vel_x")
    said.add("max_acceleration_mps2", 0.1, "nav2.yaml: acc_lim_x")
    (fault,) = settle([*said.findings, *reading.findings]).faults
    for text in ("nav2.yaml: max_vel_x", "/odom", "--set max_speed_mps=0.3, or --set max_speed_mps=0.4"):
        assert text in fault
    said.findings[0] = said.findings[0].__class__(field="max_speed_mps", value=0.9, place="nav2.yaml")
    assert settle([*said.findings, *reading.findings]).chosen["max_speed_mps"].value == 0.9


def with_rear(tmp_path: Path) -> Path:
    """A bag with a second LiDAR on /rear, of 90 beams."""
    scans = []
    for k in range(110):
        scan = new(
            "sensor_msgs/msg/LaserScan",
            header=header(1.0 + DT_S * k, "laser"),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=2.0 / 89,
            time_increment=0.0,
            scan_time=DT_S,
            range_min=0.0,
            range_max=4.0,
            ranges=np.full(90, 2.0 + 0.01 * k, np.float32),
            intensities=np.empty(0, np.float32),
        )
        scans.append(("/rear", 1.0 + DT_S * k, scan))
    return corridor_bag(tmp_path / "bag", more=scans)


def test_of_two_lidars_the_topic_chooses(tmp_path: Path) -> None:
    path = with_rear(tmp_path)
    with pytest.raises(ConfigError, match=r"several LiDARs: /rear and /scan; .*: --scan-topic /rear, or"):
        read_recorded_robot(path)
    assert values(read_recorded_robot(path, "rear"))["lidar.num_beams"] == 90
    assert values(read_recorded_robot(path, likely=["/scan"]))["lidar.num_beams"] == BEAMS


REFUSED = {
    "tilted": (Link(parent="base_link", child="laser", turn=(0.0, 0.3, 0.0)), "is tilted by 17.2 degrees"),
    "moving": (
        Link(
            parent="base_link", child="laser", at=lambda s: ((0.0, 0.0, 0.0), (0.0, 0.0, 0.3 * math.sin(s)))
        ),
        "moves on the robot",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_lidar_that_does_not_scan_the_plane_is_refused(tmp_path: Path, name: str) -> None:
    link, message = REFUSED[name]
    moving = link.at is not None
    lidar = Link(parent="elsewhere", child="nothing") if moving else link
    path = corridor_bag(tmp_path / "bag", lidar=lidar, links=[link] if moving else ())
    with pytest.raises(DatasetError, match=message):
        read_recorded_robot(path)


def test_a_bag_without_a_lidar_or_of_a_few_scans_is_refused(tmp_path: Path) -> None:
    path = corridor_bag(tmp_path / "none", edit={"/scan": lambda *_: None})
    with pytest.raises(DatasetError, match="no LiDAR: it has no topic of sensor_msgs/LaserScan"):
        read_recorded_robot(path)
    path = corridor_bag(tmp_path / "few", edit={"/scan": lambda s, m: m if s < 1.45 else None})
    with pytest.raises(DatasetError, match="/scan has 5 scans; record 10 or more"):
        read_recorded_robot(path)


def test_a_mount_that_no_transform_says_is_asked_for(tmp_path: Path) -> None:
    path = corridor_bag(tmp_path / "bag", lidar=Link(parent="body", child="laser"))
    assert set(MOUNT) <= set(settle(read_recorded_robot(path).findings).missing)


def test_a_robot_that_drives_sideways_is_refused(tmp_path: Path) -> None:
    def sideways(_: float, odometry: Any) -> Any:
        odometry.pose.pose.orientation = messages.pose(new, (0.0, 0.0, 0.5 * math.pi + 2.0)).orientation
        return odometry

    path = corridor_bag(tmp_path / "bag", edit={"/odom": sideways})
    with pytest.raises(DatasetError, match="across its own heading, which a differential drive cannot"):
        read_recorded_robot(path)
