"""A real recording of our own ROS 1 nodes: they send no /tf, and their goals are on the map."""

import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from adrl.imitation import read_demonstrations
from adrl.integrations.ros1.node import DIST_PACKAGES
from adrl.worlds import SCENARIOS, load_robot, task_set
from integrations.ros_processes import Ros
from waiting import wait_until


@pytest.fixture
def ros1(tmp_path: Path) -> Iterator[Ros]:
    if not ((DIST_PACKAGES / "rospy").is_dir() and shutil.which("rosmaster") and shutil.which("rosbag")):
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(
            "no ROS 1; on Debian: apt-get install python3-rospy python3-rosmaster python3-rosbag"
        )
    running = Ros(1, Path(sys.executable), tmp_path)
    yield running
    running.close()


@pytest.mark.ros
@pytest.mark.realtime
@pytest.mark.slow
@pytest.mark.integration
def test_what_our_nodes_of_ros_1_drove_is_collected(ros1: Ros, tmp_path: Path) -> None:
    robot = load_robot("diffbot")
    task = task_set(SCENARIOS["clutter"], robot, "test", 1)[0]
    ros1.node("sim", "--speed", "2")
    ros1.node("drive", "--robot", "diffbot", "--guidance", "goal")
    bag = tmp_path / "drive.bag"
    recorder = ros1.start("record", ["rosbag", "record", "-a", "-O", str(bag)])
    # `rosbag` is a script: the recorder proper is its child, which starts later than it and ends later.
    wait_until(bag.with_suffix(".bag.active").exists)
    probe = ros1.probe("odom")
    probe.wait(
        lambda event: event["topic"] == "status" and event["status"] == "idle" and not event["reasons"]
    )
    time.sleep(3.0)  # the recorder looks for new topics once a second
    first = probe.order(goal=task.goal, frame="map")
    ended = probe.wait(lambda event: event["topic"] == "status" and event["outcome"] != "", first)
    assert probe.events[ended]["outcome"] == "reached"
    time.sleep(1.0)
    assert recorder.end() == 0
    wait_until(bag.exists)
    data, (summary,) = read_demonstrations([bag], robot)
    assert summary.goals_from_topic
    assert summary.arrivals == 1
    assert summary.notes == ()
    # It drove from its start to the goal, at most as fast as it can.
    assert len(data) * robot.control_period_s > (task.shortest_m - 0.3) / robot.max_speed_mps - 0.5
