"""adrl robot: makes a robot file of what there is, asks for the rest by name, and draws it."""

import os
import pty
import shlex
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

import nav2_files
from adrl._core import Braking
from adrl.commands.options import parse
from adrl.descriptions import Finding, drive_command
from adrl.integrations.ros.config import DriveConfig
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import ROBOTS, load_robot
from adrl.worlds.robot_files import robot_toml
from nav2_files import parameters, write
from small_run import run_cli
from urdf_files import DRIVE, sensor, urdf

CART = RobotConfig(
    name="cart",
    radius_m=None,
    footprint_m=((0.15, 0.2), (-0.35, 0.2), (-0.35, -0.2), (0.15, -0.2)),
    max_speed_mps=0.8,
    min_speed_mps=-0.2,
)
REST = (
    *(
        "lidar.num_beams=180",
        "lidar.fov_rad=4.7",
        "lidar.mount_x_m=0.1",
        "lidar.mount_y_m=0",
        "lidar.mount_yaw_rad=0",
    ),
)


@pytest.fixture
def nav2(tmp_path: Path) -> Path:
    return write(tmp_path / "nav2.yaml", parameters(CART))


def given_by(*texts: str) -> list[str]:
    return [word for text in texts for word in ("--set", text)]


def test_parameters_and_settings_make_a_robot(
    tmp_path: Path, nav2: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.toml"
    assert run_cli("robot", "--from-nav2", nav2, *given_by(*REST), "--out", out) == 0
    robot = load_robot(out)
    assert (robot.name, robot.footprint_m, robot.min_speed_mps) == ("mine", CART.footprint_m, -0.2)
    text = out.read_text()
    assert f"max_speed_mps = 0.8  # {nav2}: controller_server.FollowPath.max_vel_x" in text
    assert "obstacle_max_range, a hint\n" in text
    assert "num_beams = 180  # --set" in text
    assert "lag_s = 0.05  # the default: no source says it; adrl calibrate" in text
    command = f"adrl ros2 drive --robot {out} --odom-frame odom --map-frame map --base-frame base_footprint"
    assert f"{command} --ros-args -r scan:=/front/scan" in text.partition("\n")[0]
    captured = capsys.readouterr()
    assert captured.out == f"{out}\n"
    assert command in captured.err


def test_a_car_is_made_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = parameters(CART)
    drives = content["controller_server"]["ros__parameters"]["FollowPath"]
    drives.clear()
    drives.update(nav2_files.mppi(CART) | {"motion_model": "Ackermann"})
    file, out = write(tmp_path / "nav2.yaml", content), tmp_path / "car.toml"
    assert run_cli("robot", "--from-nav2", file, *given_by(*REST), "--out", out) == 2
    asked = capsys.readouterr().err
    assert (
        f"min_turning_radius_m is not in {file}; give --set min_turning_radius_m=NUMBER (0 to 10 m)" in asked
    )
    drives["AckermannConstraints"] = {"min_turning_r": 0.7}
    write(file, content)
    assert run_cli("robot", "--from-nav2", file, *given_by(*REST), "--out", out) == 0
    assert load_robot(out).min_turning_radius_m == 0.7
    assert run_cli("robot", out, "--out", tmp_path / "car.svg") == 0
    assert "tightest curve, 0.7 m" in (tmp_path / "car.svg").read_text()
    assert "cannot back" not in capsys.readouterr().out
    out.write_text(out.read_text().replace("min_speed_mps = -0.2", "min_speed_mps = 0.0"))
    assert run_cli("robot", out, "--out", tmp_path / "car.svg") == 0
    assert "cannot back" in capsys.readouterr().out


def test_without_out_the_file_is_printed(nav2: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("robot", "--from-nav2", nav2, *given_by(*REST)) == 0
    assert tomllib.loads(capsys.readouterr().out)["lidar"]["num_beams"] == 180


def test_what_is_missing_is_asked_for_by_name_a_line_each(
    tmp_path: Path, nav2: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.toml"
    assert run_cli("robot", "--from-nav2", nav2, "--out", out) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(REST)
    give = "give --set lidar.num_beams=NUMBER (1 to 2048, a whole number)"
    assert lines[0] == f"adrl: error: lidar.num_beams is not in {nav2}; {give}"
    assert "give --set lidar.fov_rad=NUMBER (0.001 to 6.28319 rad)" in lines[1]
    assert not out.exists()


def test_the_numbers_that_it_asks_for_within_may_be_given(tmp_path: Path, nav2: Path) -> None:
    """As they are printed, the greatest too."""
    out = tmp_path / "mine.toml"
    rest = [
        text.replace("fov_rad=4.7", "fov_rad=6.28319").replace("yaw_rad=0", "yaw_rad=6.28319")
        for text in REST
    ]
    assert run_cli("robot", "--from-nav2", nav2, "--out", out, *given_by(*rest)) == 0
    assert load_robot(str(out)).lidar.fov_rad == 2.0 * np.pi


@pytest.mark.integration
def test_at_a_terminal_what_is_missing_is_a_question(tmp_path: Path, nav2: Path) -> None:
    out = tmp_path / "mine.toml"
    terminal, its_end = pty.openpty()
    command = [sys.executable, "-m", "adrl.cli", "robot", "--from-nav2", nav2, "--out", out]
    with subprocess.Popen(command, stdin=its_end, stderr=subprocess.PIPE, text=True) as process:
        os.write(terminal, b"many\n180\n4.7\n0.1\n0\n0\n")
        error = process.communicate(timeout=120)[1]
    os.close(its_end)
    os.close(terminal)
    assert process.returncode == 0, error
    assert "lidar.num_beams (1 to 2048, a whole number): " in error
    assert "lidar.num_beams=many: give 1 to 2048, a whole number" in error
    assert load_robot(out).lidar.num_beams == 180


def test_sources_are_combined(tmp_path: Path, nav2: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yourdfpy")
    body = tmp_path / "cart.urdf"
    body.write_text(urdf(drive=""))
    out = tmp_path / "mine.toml"
    assert run_cli("robot", "--from-nav2", nav2, "--from-urdf", body, "--out", out) == 0
    robot = load_robot(out)
    assert (robot.max_speed_mps, robot.control_period_s, robot.lidar.num_beams) == (0.8, 0.05, 271)
    body.write_text(urdf(drive="", body='<box size="0.7 0.4 0.2"/>'))
    out.unlink()
    assert run_cli("robot", "--from-nav2", nav2, "--from-urdf", body, "--out", out) == 2
    error = capsys.readouterr().err
    for text in (f"{nav2}: local_costmap", f"{body}: the hull of its collisions", "--set 'footprint_m=[["):
        assert text in error
    assert not out.exists()


def test_a_scan_beside_its_sensor_s_axis_gives_the_nodes_the_sensor(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    body, out = tmp_path / "cart.urdf", tmp_path / "mine.toml"
    body.write_text(urdf(tags=sensor(first=0.0, last=2.0), drive=DRIVE))
    assert run_cli("robot", "--from-urdf", body, "--out", out) == 0
    assert load_robot(out).lidar.mount_yaw_rad == 1.0
    assert "--mount 0.25 0.05 0" in out.read_text().partition("\n")[0]


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
def test_the_command_is_one_that_the_nodes_take(tmp_path: Path, ros: str) -> None:
    """In a shell, as it stands, with the names of topics and frames that it has to carry."""
    findings = {
        "ros": ros,
        "scan_topic": "/front/scan",
        "odom_topic": "/odom",
        "odom_frame": "my odom",
        "stamped": True,
    }
    findings |= {"lidar.mount_x_m": 0.25, "lidar.mount_y_m": -0.05, "sensor_yaw_rad": -1.0}
    chosen = {name: Finding(field=name, value=value, place="a") for name, value in findings.items()}
    words = shlex.split(drive_command(chosen, tmp_path / "my robot.toml"))
    assert words[:3] == ["adrl", ros, "drive"]
    ours = words[3 : words.index("--ros-args")] if ros == "ros2" else [w for w in words[3:] if ":=" not in w]
    theirs = [word for word in words[3:] if word not in ours and word not in ("--ros-args", "-r")]
    config = parse(DriveConfig, ours, "drive", "")
    assert (config.robot, config.odom_frame) == (str(tmp_path / "my robot.toml"), "my odom")
    assert (config.stamped, config.mount) == (True, (0.25, -0.05, -1.0))
    assert theirs == ["scan:=/front/scan"]


@pytest.mark.integration
@pytest.mark.parametrize("name", ["drive", "drive.bag"])
def test_a_robot_comes_back_from_a_bag_of_its_drives(tmp_path: Path, name: str) -> None:
    """Of ROS 2 and of ROS 1: the LiDAR as it is, speeds within its own."""
    pytest.importorskip("rosbags")
    toml, bag, out = tmp_path / "cart.toml", tmp_path / name, tmp_path / "again.toml"
    lidar = LidarConfig(num_beams=120, fov_rad=4.0, max_range_m=5.0, mount_x_m=0.1, mount_yaw_rad=0.4)
    driven = replace(CART, lidar=lidar)
    toml.write_text(robot_toml(driven))
    drive = ("evaluate", "--policy", "astar-dwa", "--scenario", "clutter", "--episodes", 2, "--robot", toml)
    assert run_cli(*drive, "--bag", bag) == 0
    assert run_cli("robot", "--from-bag", bag, "--set", "radius_m=0.4", "--out", out) == 0
    again = load_robot(out)
    for field in ("num_beams", "fov_rad", "max_range_m", "mount_x_m", "mount_y_m", "mount_yaw_rad"):
        assert getattr(again.lidar, field) == pytest.approx(getattr(lidar, field), abs=1e-5), field
    assert again.control_period_s == driven.control_period_s
    for field in (
        "max_speed_mps",
        "max_yaw_rate_radps",
        "max_acceleration_mps2",
        "max_yaw_acceleration_radps2",
    ):
        assert 0.0 < getattr(again, field) <= getattr(driven, field) + 1e-3, field
    assert again.max_speed_mps == pytest.approx(driven.max_speed_mps, abs=0.02)
    assert out.read_text().startswith(f"# adrl {'ros1' if name.endswith('.bag') else 'ros2'} drive")


REFUSED = {
    "nothing to do": ([], "give a robot to draw, or --from-nav2, --from-urdf or --from-bag"),
    "both": (["jackal", "--from-nav2", "NAV2"], "--from-nav2 makes a robot, and 'jackal' is one to draw"),
    "no TOML": (["--from-nav2", "NAV2", "--out", "mine.yaml"], "give a name that ends in .toml"),
    "no picture": (["jackal", "--out", "jackal.toml"], "give a name that ends in .png, .svg, .pdf"),
    "no such topic": (
        ["--from-nav2", "NAV2", "--scan-topic", "rear"],
        "--scan-topic /rear is the topic of a LiDAR in none of",
    ),
    "a link without a URDF": (["--from-nav2", "NAV2", "--lidar", "laser"], "give --from-urdf too"),
    "no file": (["--from-nav2", "none.yaml"], "none.yaml does not exist; give Nav2's parameter file"),
    "no robot": (["jackl"], "did you mean 'jackal'"),
    "a bad setting": (["--from-nav2", "NAV2", "--set", "radius=1"], "did you mean 'radius_m'"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_one_line(
    tmp_path: Path, nav2: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, message = REFUSED[name]
    assert run_cli("robot", *(nav2 if word == "NAV2" else word for word in arguments)) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["nav2.yaml"]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_is_drawn_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_cli("robot", name) == 0
    out = capsys.readouterr().out
    assert out.endswith(f"{name}.png\n")
    assert "narrowest gap, straight ahead" in out
    assert len({tuple(pixel) for row in imread(tmp_path / f"{name}.png")[::10, ::10] for pixel in row}) > 5
    assert run_cli("robot", name, "--out", tmp_path / "r.svg") == 0
    assert "<svg" in (tmp_path / "r.svg").read_text()
    assert "family any covers it" in out
    slow = "policy default drives it at 1.2 m/s at most: it stops within 0.3 m then, and turns within 0.6 m"
    assert (slow in out) == (name == "jackal")


def test_a_family_shows_its_ranges_and_some_of_its_robots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "carts.toml").write_text("[family]\nmax_speed_mps = [0.5, 0.9]\nwidth_m = 0.4")
    for name, picture, told in (
        ("any", "any.png", "lidar.fov_rad"),
        ("carts.toml", "carts.png", "[0.5, 0.9] m/s"),
        ("carts.toml:test:17", "carts-test-17.png", "narrowest gap"),
    ):
        assert run_cli("robot", name) == 0
        out = capsys.readouterr().out
        assert told in out
        assert out.endswith(f"{picture}\n")
        assert len({tuple(pixel) for row in imread(tmp_path / picture)[::10, ::10] for pixel in row}) > 5


def test_what_a_family_does_not_have_is_told_line_by_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fast.toml").write_text(
        "max_speed_mps = 3\nmax_acceleration_mps2 = 6\ncontrol_period_s = 0.5"
    )
    assert run_cli("robot", "fast.toml") == 0
    out = capsys.readouterr().out
    assert "outside of family any: max_speed_mps 3; the family has 0.2 to 2\n" in out
    assert "outside of family any: control_period_s 0.5; the family has 0.05 to 0.2\n" in out


@settings(max_examples=60, deadline=None)
@given(
    speed=st.floats(0.1, 3.0),
    acceleration=st.floats(0.2, 5.0),
    lag=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
    latency=st.sampled_from([0.0, 0.2]),
)
def test_a_robot_stops_as_the_core_brakes(
    speed: float, acceleration: float, lag: float, latency: float
) -> None:
    robot = RobotConfig(
        max_speed_mps=speed,
        max_acceleration_mps2=acceleration,
        lag_s=lag,
        latency_s=latency,
    )
    braking = Braking(0.2, np.empty((0, 2)), (acceleration, 6.0, lag), 0.005)

    def after(seconds: float) -> tuple[float, float]:
        orders = np.array([(speed, 0.0, latency), (0.0, 0.0, seconds - latency)])
        (x, _, _), (now_mps, _) = braking.roll((0.0, 0.0, 0.0), (speed, 0.0), orders[int(latency == 0.0) :])
        return x, now_mps

    assert after(robot.stop_time_s + 30.0)[0] == pytest.approx(robot.stop_distance_m, abs=0.01 * speed + 0.02)
    assert after(robot.stop_time_s + 0.02)[1] <= 0.011
    if robot.stop_time_s > latency + 0.1:
        assert after(robot.stop_time_s - 0.08)[1] > 0.009
