"""What the nodes do on their topics, with the messages of rosbags: no ROS, no clock, no process."""

import math
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from adrl.bags.messages import laser_scan, odometry, pose_stamped, pose_with_covariance
from adrl.deploy.driver import STOPS
from adrl.geometry import yaw_of
from adrl.integrations.ros import drive, sim
from adrl.integrations.ros.config import DriveConfig, SimConfig
from adrl.integrations.ros.outbox import PLAN_S, STATUS_S
from adrl.integrations.ros.robot import SimulatedRobot
from adrl.worlds import ROBOTS, task_set

ROBOT = ROBOTS["diffbot"]
PERIOD_S = ROBOT.control_period_s
STORE = get_typestore(Stores.ROS2_HUMBLE)


def new(kind: str, /, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def header(stamp_s: float, frame: str) -> Any:
    whole, nanoseconds = divmod(round(stamp_s * 1e9), 10**9)
    stamp = new("builtin_interfaces/msg/Time", sec=whole, nanosec=nanoseconds)
    return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


class Publications:
    """What was published, each message whole and of its topic's kind."""

    def __init__(self, kinds: dict[str, str]) -> None:
        self.of: dict[str, list[Any]] = {topic: [] for topic in kinds}
        self.publish = {topic: self._publisher(topic, kind) for topic, kind in kinds.items()}

    def _publisher(self, topic: str, kind: str) -> Any:
        def publish(message: Any) -> None:
            assert message.__msgtype__ == kind
            STORE.serialize_cdr(message, kind)
            self.of[topic].append(message)

        return publish

    def take(self, topic: str) -> list[Any]:
        """Those since the last call."""
        taken, self.of[topic] = self.of[topic], []
        return taken


class Node:
    """The driving node, its robot standing or moved by the test in an empty place."""

    def __init__(self, robot: str = "diffbot", **options: Any) -> None:
        config = DriveConfig(robot=robot, guidance="goal", **options)
        self.out = Publications(drive.publications(config))
        self.now_s, self.clock_late_s = 0.0, 0.0
        self.wall_s: float | None = None
        """The wall's clock; the node's when None."""
        self.topics = drive.DriveTopics(
            config,
            self.out.publish,
            now_s=lambda: self.now_s - self.clock_late_s,
            seconds=seconds,
            header=header,
            simulated=True,
            new=new,
            wall_s=lambda: self.wall_s if self.wall_s is not None else self.now_s,
        )
        self.subscriptions = self.topics.subscriptions()
        self.x_m = 0.0

    def hear(self, topic: str, message: Any) -> None:
        kind, take = self.subscriptions[topic]
        assert message.__msgtype__ == kind
        take(message)

    def goal(self, x_m: float, frame: str = "odom") -> None:
        self.hear("goal_pose", pose_stamped(new, header(self.now_s, frame), (x_m, 0.0, 0.0)))

    def run(self, periods: int, speed_mps: float = 0.0) -> "Node":
        """Scans and odometry of so many periods; of the robot, that it drives straight ahead."""
        for _ in range(periods):
            self.now_s += PERIOD_S
            self.x_m += PERIOD_S * speed_mps
            at, moving = (self.x_m, 0.0, 0.0), (speed_mps, 0.0)
            self.hear("odom", odometry(new, header(self.now_s, "odom"), "base_link", at, moving))
            ranges = np.full(ROBOT.lidar.num_beams, 5.0 + 0.1 * math.sin(self.now_s))
            self.hear("scan", laser_scan(new, header(self.now_s, "base_scan"), ROBOT.lidar, ranges, PERIOD_S))
            self.topics.tick()
        return self

    def statuses(self) -> list[tuple[int, dict[str, str]]]:
        """Level and values of those since the last call."""
        told = [message.status[0] for message in self.out.take("adrl/status")]
        return [(status.level, {pair.key: pair.value for pair in status.values}) for status in told]

    def speeds(self) -> list[float]:
        return [message.linear.x for message in self.out.take("cmd_vel")]


def test_the_two_nodes_drive_to_a_goal_on_the_map() -> None:
    """Of what the simulated robot publishes the driving one makes commands; stamped, in frames of their own."""
    place = SimConfig(scenario="clutter", stamped=True, base_frame="r/base", scan_frame="r/laser")
    config = DriveConfig(robot="diffbot", guidance="goal", stamped=True, base_frame="r/base")
    told, said = Publications(sim.PUBLICATIONS), Publications(drive.publications(config))
    with SimulatedRobot.of(place) as simulated:
        robot = sim.SimTopics(place, simulated, told.publish, header, new)
    clock_s = 0.0
    node = drive.DriveTopics(
        config, said.publish, now_s=lambda: clock_s, seconds=seconds, header=header, simulated=True, new=new
    )
    heard = node.subscriptions()
    goal = task_set(place.load(), ROBOT, "test", 1)[0].goal
    outcome, frames = "", set()
    for period in range(300):
        robot.tick()
        clock_s = seconds(told.take("/clock")[0].clock)
        for topic in ("odom", "amcl_pose", "scan"):
            (message,) = told.take(topic)
            frames.add((topic, message.header.frame_id))
            heard[topic][1](message)
        if period == 2:
            heard["goal_pose"][1](pose_stamped(new, header(clock_s, "map"), (*goal, 0.0)))
        node.tick()
        for command in said.take("cmd_vel"):
            assert command.header.frame_id == "r/base"
            robot.take_command(command)
        for status in said.take("adrl/status"):
            outcome = {pair.key: pair.value for pair in status.status[0].values}["outcome"]
        if outcome:
            break
    assert outcome == "reached"
    assert frames == {("odom", "odom"), ("amcl_pose", "map"), ("scan", "r/laser")}
    assert [message.data for message in told.take("collisions")] == [0]


def test_the_base_is_told_to_stand_at_the_end_by_who_has_it_and_nothing_afterwards() -> None:
    fresh, refused, under_way, done = Node().run(3), Node().run(3), Node().run(3), Node().run(3)
    refused.goal(1.0, "world")
    under_way.goal(3.0)
    done.goal(0.1)
    for node in (refused, under_way):
        node.run(3)
    done.run(STOPS + 2)
    assert refused.speeds() == []
    assert under_way.speeds()[-1] > 0.0
    assert done.speeds() == [0.0] * STOPS
    for node, last in ((fresh, []), (refused, []), (under_way, [0.0]), (done, [])):
        node.topics.stop()
        node.run(3)
        assert node.speeds() == last


def test_a_plan_is_shown_at_once_then_seldom_and_taken_away_at_the_end() -> None:
    node = Node().run(2)
    assert node.out.take("plan") == []
    for goal_m in (3.0, 2.0):
        node.goal(goal_m)
        (first,) = node.run(1).out.take("plan")
        ends = first.poses[-1].pose
        assert (ends.position.x, yaw_of(ends.orientation)) == (goal_m, 0.0)
        assert first.header.frame_id == "odom"
        more = node.run(20, 0.01).out.take("plan")
        assert len(more) == pytest.approx(20 * PERIOD_S / PLAN_S, abs=1)
    node.hear("adrl/cancel", new("std_msgs/msg/Empty", structure_needs_at_least_one_member=0))
    (last,) = node.run(5).out.take("plan")
    assert last.poses == []


def test_a_status_comes_with_each_change_and_each_second() -> None:
    node = Node().run(1)
    assert len(node.statuses()) == 1
    assert len(node.run(40).statuses()) == pytest.approx(40 * PERIOD_S / STATUS_S, abs=1)
    node.goal(3.0)
    ((_, values),) = node.run(1).statuses()
    assert (values["status"], values["goal"], values["goals"]) == ("driving", "3.000 0.000", "1")


def test_a_status_is_an_error_when_a_goal_is_lost_and_a_warning_while_another_goes_on() -> None:
    ok, warning, error = 0, 1, 2
    node = Node().run(2)
    assert [level for level, _ in node.statuses()] == [ok]
    node.goal(1.0, "world")
    ((level, values),) = node.run(1).statuses()
    assert (level, values["refusal"]) == (error, "UnknownFrame")
    node.goal(2.0)
    assert [level for level, _ in node.run(1).statuses()] == [ok]
    node.goal(1.0, "world")
    ((level, values),) = node.run(1).statuses()
    assert (level, values["refusal"], values["status"]) == (warning, "UnknownFrame", "driving")
    node.x_m = 2.0 - 0.2  # as if carried there: its odometry jumps, and the goal in its frame is lost
    told = node.run(2).statuses()
    assert {(level, values["outcome"], values["refusal"]) for level, values in told} == {
        (error, "failed", "")
    }
    node.goal(2.0)
    assert {(level, values["outcome"]) for level, values in node.run(2).statuses()} == {(ok, "reached")}


def test_a_pose_on_the_map_says_where_a_goal_there_is() -> None:
    node = Node().run(2)
    at = pose_with_covariance(new, (5.0, 0.0, 0.5 * math.pi))
    message = new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header(node.now_s, "map"), pose=at)
    node.goal(7.0, "map")
    assert [values["refusal"] for _, values in node.run(1).statuses()][-1] == "NotLocalised"
    node.hear("amcl_pose", message)
    node.goal(7.0, "map")
    plan = node.run(1).out.take("plan")[-1]
    end = plan.poses[-1].pose.position
    # The map's x is the odometry's -y.
    assert (end.x, end.y) == pytest.approx((0.0, -2.0))


@pytest.mark.parametrize(("late_s", "stands"), [(0.15, False), (0.5, True)])
def test_a_simulated_clock_may_come_a_little_after_the_scan_of_its_time(late_s: float, stands: bool) -> None:
    node = Node()
    node.clock_late_s = late_s
    node.run(5)
    node.goal(3.0)
    node.run(10)
    assert (max(node.speeds()) == 0.0) == stands


def test_a_command_that_took_long_to_make_is_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a plan on a large map takes its time: what it was checked against is of long ago. The next one is."""
    node = Node().run(2)
    node.goal(3.0)
    node.run(3, 0.3)
    assert all(speed > 0.0 for speed in node.speeds()[1:])
    node.statuses()
    navigator = node.topics.driver.navigator
    step, made = navigator.step, []

    def slow(*arguments: Any, **options: Any) -> Any:
        command = step(*arguments, **options)
        made.append(command.twist[0])
        node.now_s += 0.3
        return command

    with monkeypatch.context() as patch:
        patch.setattr(navigator, "step", slow)
        node.run(1, 0.3)
    assert made[0] > 0.0
    assert not any(node.speeds())
    assert node.statuses()[0][1]["reasons"] == "command_late"
    node.run(2, 0.3)
    assert node.speeds()[-1] > 0.0
    assert node.statuses()[-1][1]["status"] == "driving"
