"""Bags of evaluations: standard messages that rosbags reads, with the frames and times of ROS."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

import adrl
from adrl.bags import BagWriter
from adrl.errors import ConfigError
from adrl.types import LidarConfig, RobotConfig
from small_run import run_cli

ROBOT = RobotConfig(
    control_period_s=0.2,
    lidar=LidarConfig(num_beams=90, mount_x_m=0.05, mount_yaw_rad=0.5),
    odometry_drift=0.02,
)
FORMATS = ["bag.bag", "bag"]


def contents(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic -> [(nanoseconds, message)]."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([path]) as reader:
        for line, time_ns, raw in reader.messages():
            found.setdefault(line.topic, []).append((time_ns, reader.deserialize(raw, line.msgtype)))
    return found


def nanoseconds(stamp: Any) -> int:
    return stamp.sec * 10**9 + stamp.nanosec


def yaw(quaternion: Any) -> float:
    assert (quaternion.x, quaternion.y) == (0.0, 0.0)
    return 2.0 * math.atan2(quaternion.z, quaternion.w)


def placed(frame: tuple[float, float, float], x: float, y: float) -> tuple[float, float]:
    c, s = math.cos(frame[2]), math.sin(frame[2])
    return frame[0] + c * x - s * y, frame[1] + s * x + c * y


class Turns:
    """On the spot, until the time is up."""

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.tile(np.array([-1.0, 0.5], np.float32), (len(observation), 1))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("guidance", ["goal", "map"])
def test_messages_are_those_of_the_evaluation(tmp_path: Path, name: str, guidance: str) -> None:
    path = tmp_path / name
    policy = "astar-dwa" if guidance == "map" else Turns()
    result = adrl.evaluate(
        policy, robot=ROBOT, guidance=guidance, episodes=3, num_threads=1, bag=path, record=3
    )
    found = contents(path)
    topics = {"/scan", "/odom", "/cmd_vel", "/goal_pose", "/tf"} | ({"/plan"} if guidance == "map" else set())
    assert found.keys() == topics
    world = "map" if guidance == "map" else "odom"
    frames = {"/scan": "base_scan", "/odom": "odom", "/goal_pose": world, "/plan": world}
    for topic, messages in found.items():
        times = [time_ns for time_ns, _ in messages]
        assert times == sorted(times)
        for time_ns, message in messages:
            if topic in frames:
                assert message.header.frame_id == frames[topic]
                assert nanoseconds(message.header.stamp) == time_ns
    states = sum(map(len, result.rollout.routes))
    assert {len(found[topic]) for topic in ("/scan", "/odom", "/cmd_vel", "/tf")} == {states}
    goals = [(goal.pose.position.x, goal.pose.position.y) for _, goal in found["/goal_pose"]]
    assert goals == [task.goal for task in result.tasks]
    times = np.array([time_ns for time_ns, _ in found["/odom"]])
    apart = np.unique(np.diff(times))
    assert apart.tolist() == [200_000_000, 2_200_000_000], "control periods, and a pause between episodes"
    assert [message.child_frame_id for _, message in found["/odom"]] == ["base_link"] * states
    if guidance == "map":
        for (_, plan), task in zip(found["/plan"], result.tasks, strict=True):
            assert_array_equal([(p.pose.position.x, p.pose.position.y) for p in plan.poses], task.path)
            yaws = [yaw(p.pose.orientation) for p in plan.poses]
            ahead = np.diff(task.path, axis=0)
            assert_allclose(yaws[:-1], np.arctan2(ahead[:, 1], ahead[:, 0]))
            assert yaws[-1] == yaws[-2], "at the goal it looks on as it came"


@pytest.mark.parametrize("name", FORMATS)
def test_transforms_put_the_robot_where_it_is(tmp_path: Path, name: str) -> None:
    """map -> odom -> base_link is the true pose, odom -> base_link the odometry, though that drifts."""
    result = adrl.evaluate("astar-dwa", robot=ROBOT, episodes=2, num_threads=1, bag=tmp_path / name, record=2)
    found, drift = contents(tmp_path / name), 0.0
    true = np.concatenate(result.rollout.routes)
    for (_, tree), (_, odometry), (x, y) in zip(found["/tf"], found["/odom"], true, strict=True):
        links = {(t.header.frame_id, t.child_frame_id): t.transform for t in tree.transforms}
        poses = {ends: (m.translation.x, m.translation.y, yaw(m.rotation)) for ends, m in links.items()}
        assert poses.keys() == {("map", "odom"), ("odom", "base_link"), ("base_link", "base_scan")}
        told = odometry.pose.pose
        reckoned = (told.position.x, told.position.y, yaw(told.orientation))
        assert_allclose(poses["odom", "base_link"], reckoned)
        assert_allclose(placed(poses["map", "odom"], *reckoned[:2]), (x, y), atol=1e-9)
        assert_allclose(poses["base_link", "base_scan"], (0.05, 0.0, 0.5))
        drift = max(drift, math.dist(reckoned[:2], (x, y)))
    assert drift > 0.01


@pytest.mark.parametrize("name", FORMATS)
def test_scans_are_those_of_the_lidar_and_free_beams_are_infinite(tmp_path: Path, name: str) -> None:
    with BagWriter(tmp_path / name, ROBOT) as bag:
        bag.scan(1.0, np.linspace(0.1, 6.0, 90))
    ((_, scan),) = contents(tmp_path / name)["/scan"]
    lidar = ROBOT.lidar
    expected = np.linspace(0.1, 6.0, 90).astype(np.float32)
    assert_array_equal(scan.ranges[:-1], expected[:-1])
    assert scan.ranges[-1] == np.inf
    geometry = (scan.angle_min, scan.angle_max, scan.angle_increment, scan.range_max, scan.scan_time)
    ends = (lidar.angle_min_rad, lidar.angles_rad[-1], lidar.angle_increment_rad, lidar.max_range_m, 0.2)
    assert_allclose(geometry, ends, rtol=1e-6)


def test_a_replanner_s_ways_are_plans(tmp_path: Path) -> None:
    options = {"scenario": "complex", "guidance": "replan", "episodes": 2, "num_threads": 1}
    result = adrl.evaluate("diffbot", **options, bag=tmp_path / "bag")
    found = contents(tmp_path / "bag")
    assert result.rollout.replans.sum() > 0
    assert len(found["/plan"]) > result.rollout.replans.sum()
    goals = {(goal.pose.position.x, goal.pose.position.y) for _, goal in found["/goal_pose"]}
    for _, plan in found["/plan"]:
        end = plan.poses[-1].pose.position
        assert (end.x, end.y) in goals


def test_equal_evaluations_give_equal_bags_of_the_tasks_asked_for(tmp_path: Path) -> None:
    for name, tasks in (("a.bag", [3, 1]), ("b.bag", [1, 3]), ("all.bag", None)):
        adrl.evaluate("astar-dwa", episodes=4, num_threads=1, bag=tmp_path / name, bag_tasks=tasks)
    assert (tmp_path / "a.bag").read_bytes() == (tmp_path / "b.bag").read_bytes()
    chosen, every = (contents(tmp_path / name)["/goal_pose"] for name in ("a.bag", "all.bag"))
    place = [(goal.pose.position.x, goal.pose.position.y) for _, goal in every]
    assert [(goal.pose.position.x, goal.pose.position.y) for _, goal in chosen] == [place[1], place[3]]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bag", "all.bag", "b.bag"]


def test_a_bag_is_whole_or_not_there(tmp_path: Path) -> None:
    def interrupted(path: Path) -> None:
        with BagWriter(path, ROBOT) as bag:
            bag.command(1.0, (0.0, 0.0))
            raise KeyboardInterrupt

    for name in FORMATS:
        with pytest.raises(KeyboardInterrupt):
            interrupted(tmp_path / name)
    with pytest.raises(OSError, match="name too long"):  # of the file in the folder
        interrupted(tmp_path / ("b" * 253))
    assert list(tmp_path.iterdir()) == []


def test_without_rosbags_it_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    for command in (
        ("evaluate", "--bag", tmp_path / "a.bag"),
        ("collect", "--bag", "b.bag", "--out", tmp_path / "d"),
    ):
        assert run_cli(*command) == 2
        assert "adrl[bags]" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_bad_requests_are_refused_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "there.bag").write_text("mine")
    requests = {
        "there.bag exists already": ("--bag", tmp_path / "there.bag"),
        "a bag of ROS 2 is a folder": ("--bag", tmp_path / "a.mcap"),
        "the tasks are 0 to 1": ("--bag", tmp_path / "a", "--bag-tasks", 2),
        "give bag too": ("--bag-tasks", 1),
    }
    for message, options in requests.items():
        assert run_cli("evaluate", "--policy", "astar-dwa", "--episodes", 2, *options) == 2
        assert message in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "there.bag").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 1
    with pytest.raises(ConfigError, match="the tasks are 0 to 0"):
        adrl.evaluate("astar-dwa", episodes=1, bag=tmp_path / "a", bag_tasks=[1])
