"""Our node where ROS 1's move_base is expected: a real master, actionlib, transforms; a client in its own process."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from adrl.geometry import compose, inverse
from adrl.worlds import SCENARIOS, load_robot, task_set
from integrations.conftest import require_ros1
from integrations.ros_processes import Event, Probe, Ros, is_at_speed, stands_from

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.integration]

PREEMPTED, SUCCEEDED, ABORTED = 2, 3, 4
"""actionlib_msgs/GoalStatus."""


@pytest.fixture
def ros1(tmp_path: Path) -> Iterator[Ros]:
    running = Ros(1, require_ros1(), tmp_path)
    yield running
    running.close()


def client_of(ros: Ros) -> Probe:
    command = [sys.executable, str(Path(__file__).parent / "move_base_probe.py")]
    probe = Probe(command, ros.environment, ros.folder / "move_base_probe.log")
    ros.started.append(probe)
    return probe


def ended(client: Probe, first: int) -> Event:
    return client.events[client.wait(lambda e: e["topic"] == "ended", first, timeout_s=90.0)]


def test_goals_of_move_base_are_driven_to_by_tf_replaced_cancelled_and_refused(ros1: Ros) -> None:
    ros1.node("sim", "--tf")
    node = ros1.node("drive", "--guidance", "replan", "--localisation", "tf", "--goal-yaw")
    probe, client = ros1.probe("odom"), client_of(ros1)
    task = task_set(SCENARIOS["clutter"], load_robot("diffbot"), "test", 1)[0]
    while ended(client, client.order(navigate=task.start, frame="map"))["status"] != SUCCEEDED:
        pass  # scans, odometry and transforms come by connections of their own
    first = client.order(navigate=[*task.goal, -2.0], frame="map")
    assert ended(client, first)["status"] == SUCCEEDED
    place = client.of("feedback", first)[-1]["at"]
    assert math.dist(place[:2], task.goal) < 0.4
    assert abs(math.remainder(place[2] + 2.0, 2.0 * math.pi)) < 0.4

    home = [0.0, 0.0, 0.0]
    x, y, _ = compose(inverse(task.start), (*task.goal, 0.0))
    first, at = client.order(navigate=home, frame="odom"), probe.count()
    probe.wait(is_at_speed, at)
    probe.order(goal=(x, y), frame="odom")
    end = ended(client, first)
    assert (end["status"], "another goal" in end["message"]) == (PREEMPTED, True)

    first, at = client.order(navigate=home, frame="odom"), probe.count()
    probe.wait(is_at_speed, at)
    client.order(cancel=True)
    client.order(navigate=home, frame="odom")  # in the same instant
    end = ended(client, first)
    assert end["status"] == PREEMPTED
    client.wait(lambda e: e["topic"] == "feedback" and e["number"] > end["number"], first)
    told, at = probe.count(), client.order(cancel=True)
    assert ended(client, at)["status"] == PREEMPTED
    told = probe.wait(lambda e: e["topic"] == "status" and e["outcome"] == "cancelled", told)
    stands_from(probe, told, 2 + 1 + 6)
    end = ended(client, client.order(navigate=home, frame="camera"))
    assert (end["status"], "camera" in end["message"]) == (ABORTED, True)
    assert node.end() == 0
    assert [event["count"] for event in probe.of("collisions")] == [0]
