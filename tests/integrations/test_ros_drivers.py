"""What a driving node does with sensors, clocks and threads as they come, and what a simulated robot says; no ROS."""

import logging
import math
import threading

import numpy as np
import pytest

from adrl.bags.messages import laser_scan, odometry, pose_with_covariance
from adrl.deploy import Odometry
from adrl.deploy.driver import Driver, Report
from adrl.errors import ConfigError
from adrl.integrations.ros.config import DriveConfig, SimConfig, with_parameters
from adrl.integrations.ros.drive import CLOCK_PATIENCE_S
from adrl.integrations.ros.obstacles import nearest_obstacle
from adrl.integrations.ros.outbox import STATUS_S
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.types import World
from adrl.worlds import SCENARIOS, load_robot, single_task, task_set
from env_tasks import room
from integrations.test_ros_topics import PERIOD_S, ROBOT, Node, header, new

# --- the end ------------------------------------------------------------------------------------------------


def test_after_the_last_zero_nothing_follows_whatever_thread_is_where() -> None:
    """rospy calls back on a thread a topic: one has made its command, and is about to publish it."""
    node = Node().run(2)
    node.goal(3.0)
    outbox = node.topics._outbox
    deliver, here, go_on = outbox.deliver, threading.Event(), threading.Event()

    def slow(report: Report, now_s: float) -> None:
        here.set()
        assert go_on.wait(10.0)
        deliver(report, now_s)

    outbox.deliver = slow  # a thread may be interrupted before its first line
    thread = threading.Thread(target=lambda: node.run(1))
    thread.start()
    assert here.wait(10.0)
    node.topics.stop()
    go_on.set()
    thread.join()
    node.topics.stop()
    assert node.speeds() == [0.0]


# --- clocks -------------------------------------------------------------------------------------------------


def test_a_simulated_clock_that_stops_is_told_by_the_walls_and_gone_by_again_when_it_goes_on() -> None:
    node = Node().run(2)
    node.goal(3.0)
    node.run(3)
    assert node.speeds()[-1] > 0.0
    node.statuses()
    node.wall_s = node.now_s
    for _ in range(400):  # 10 s
        node.wall_s += 0.25 * PERIOD_S
        node.topics.tick()
    zeros, statuses = node.speeds(), node.statuses()
    assert set(zeros) == {0.0}
    assert len(zeros) == pytest.approx((10.0 - CLOCK_PATIENCE_S) / PERIOD_S, abs=3)
    assert len(statuses) == pytest.approx((10.0 - CLOCK_PATIENCE_S) / STATUS_S, abs=2)
    assert {(values["status"], values["reasons"]) for _, values in statuses} == {("stopped", "clock_stopped")}
    node.wall_s = None
    node.run(3)
    assert node.speeds()[-1] > 0.0
    assert node.statuses()[-1][1]["status"] == "driving"


def test_without_a_goal_a_clock_that_stops_moves_nobodys_base() -> None:
    node = Node().run(2)
    node.wall_s = node.now_s
    for _ in range(100):
        node.wall_s += 0.25 * PERIOD_S
        node.topics.tick()
    assert node.speeds() == []
    assert node.statuses()[-1][1]["reasons"] == "clock_stopped"
    node.goal(3.0)  # a goal that comes then is known, and stood for
    for _ in range(8):
        node.wall_s += 0.25 * PERIOD_S
        node.topics.tick()
    assert node.statuses()[-1][1]["goal"] == "3.000 0.000"


def test_what_is_stamped_0_is_of_the_moment_it_comes_and_that_is_said_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    node = Node().run(12)
    node.goal(3.0)
    with caplog.at_level(logging.WARNING, "adrl"):
        for _ in range(10):
            node.now_s += PERIOD_S
            node.hear("odom", odometry(new, header(0.0, "odom"), "base_link", (0.0, 0.0, 0.0), (0.0, 0.0)))
            ranges = np.full(ROBOT.lidar.num_beams, 5.0 + 0.1 * math.sin(node.now_s))
            node.hear("scan", laser_scan(new, header(0.0, "base_scan"), ROBOT.lidar, ranges, PERIOD_S))
            at = pose_with_covariance(new, (0.0, 0.0, 0.0))
            kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
            node.hear("amcl_pose", new(kind, header=header(0.0, "map"), pose=at))
    assert max(node.speeds()) > 0.0
    for topic in ("scan", "odom", "amcl_pose"):
        assert len([words for words in caplog.messages if words.startswith(f"{topic} is stamped 0")]) == 1


# --- frames -------------------------------------------------------------------------------------------------


def test_odometry_in_another_frame_is_not_used_and_named_once(caplog: pytest.LogCaptureFixture) -> None:
    driver = DriveConfig(robot="diffbot", guidance="goal").driver()
    at = Odometry(pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0), stamp_s=0.1)
    with caplog.at_level(logging.WARNING, "adrl.driver"):
        for _ in range(2):
            driver.take_odometry(at, "robot1/odom")
        report = driver.tick(1.0)
    assert report is not None
    assert "no_odometry" in report.command.reasons
    assert [words for words in caplog.messages if "robot1/odom" in words] == [
        "odometry in frame 'robot1/odom': not used; this robot's is 'odom'"
    ]
    for frames in ("odom", "/odom", ""):
        driver.take_odometry(at, frames)
        report = driver.tick(driver._now_s + PERIOD_S)
        assert report is not None
        assert "no_odometry" not in report.command.reasons
    Driver(driver.navigator, localisation="odometry").take_odometry(at, "map")


def test_goals_are_named_in_their_frame(caplog: pytest.LogCaptureFixture) -> None:
    node = Node().run(2)
    with caplog.at_level(logging.INFO, "adrl"):
        node.goal(3.0)
        message = node.run(1).out.take("adrl/status")[-1].status[0].message
        node.goal(0.1)
        node.run(2)
    assert message.startswith("driving on the way to (3.00, 0.00) in odom")
    assert "goal (3.00, 0.00) in odom" in caplog.messages
    assert "goal (0.10, 0.00) in odom reached" in caplog.messages


# --- another robot ------------------------------------------------------------------------------------------


def test_a_robot_that_the_policy_was_not_trained_for_is_guarded_as_it_is_and_said(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING, "adrl"):
        node = Node(policy="diffbot", robot="turtlebot3_waffle").run(1)
    navigator = node.topics.driver.navigator
    assert navigator.robot == load_robot("turtlebot3_waffle")
    assert navigator.supervisor is not None
    assert navigator.supervisor.robot == navigator.robot
    (status,) = [message.status[0] for message in node.out.take("adrl/status")]
    said = {pair.key: pair.value for pair in status.values}["policy"]
    assert status.hardware_id == "turtlebot3_waffle"
    for words in (
        "was trained for robot diffbot",
        "max_speed_mps 0.26 instead of 0.6",
        "radius_m 0.22 instead of 0.2",
    ):
        assert words in said
        assert words in caplog.text
    own = Node(policy="diffbot").run(1).out.take("adrl/status")[0].status[0]
    assert "policy" not in {pair.key for pair in own.values}


# --- the simulated robot ------------------------------------------------------------------------------------


def test_it_starts_where_it_is_told_to() -> None:
    *at, _ = task_set(SCENARIOS["clutter"], ROBOT, "test", 1)[0].start
    config = SimConfig()
    told = with_parameters(config, lambda name, default: [*at, 0.5] if name == "start" else default)
    with SimulatedRobot.of(told) as robot:
        assert robot.pose == pytest.approx((*at, 0.5))
        assert robot.odometry.pose == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    with SimulatedRobot.of(config) as robot:
        pillar = robot._task.world.circles[0]
    for start, words in (
        ((math.nan, 0.0, 0.0), "give x, y and yaw"),
        ((*pillar[:2], 0.0), "would overlap a pillar"),
    ):
        with pytest.raises(ConfigError, match=words), SimulatedRobot.of(SimConfig(start=start)):
            pass


def test_what_it_hit_is_said(caplog: pytest.LogCaptureFixture) -> None:
    world = room(circles=[(1.0, 0.0, 0.3)])
    robot = SimulatedRobot(single_task(world, (-0.5, 0.0, 0.0), (3.0, -1.0), ROBOT), ROBOT)
    with caplog.at_level(logging.WARNING, "adrl.sim"):
        while robot.collisions == 0:
            robot.command((0.6, 0.0))
            robot.advance()
    (words,) = caplog.messages
    assert "collision 1" in words
    assert "hit a pillar at (0.70, 0.00)" in words
    assert "start (-0.50, 0.00, 0.00)" in words


def test_the_nearest_of_each_kind_of_obstacle_is_named() -> None:
    square = np.array([[2.0, -1.0], [3.0, -1.0], [3.0, 1.0], [2.0, 1.0]])
    disc = np.array([[0.0, 3.0, 0.0, 3.0, 0.5, 0.0, 0.0, math.inf]])
    bounds = (-6.0, -6.0, 6.0, 6.0)
    world = World(bounds=bounds, polygons=(square,), segments=np.array([[-4.0, -6.0, -4.0, 6.0]]), discs=disc)
    for at, words in (
        ((1.5, 0.2), "an obstacle's side at (2.00, 0.20)"),
        ((-3.5, 5.0), "a wall at (-4.00, 5.00)"),
        ((0.0, 2.0), "a moving disc at (0.00, 2.50)"),
    ):
        assert nearest_obstacle(world, at, 0.0) == words
    assert "nothing" in nearest_obstacle(World(bounds=bounds), (0.0, 0.0), 0.0)
