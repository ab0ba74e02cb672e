"""How nodes end, and what they do when the clock that they go by does: real processes of both generations of ROS."""

import signal
import subprocess
import time

import pytest

from adrl.worlds import SCENARIOS, load_robot, task_set
from integrations.ros_processes import Probe, Process, Ros, is_at_speed, is_idle

pytestmark = [pytest.mark.ros, pytest.mark.realtime, pytest.mark.slow, pytest.mark.integration]


def under_way(ros: Ros, speed: str = "2") -> tuple[Process, Process, Probe, int]:
    """Simulator, node and probe, the robot at speed; the number of the next event."""
    robot = ros.node("sim", "--speed", speed)
    node = ros.node("drive", "--robot", "diffbot", "--guidance", "goal")
    probe = ros.probe("odom", "cmd_vel")
    probe.wait(is_idle)
    first = probe.order(goal=(8.0, 0.0), frame="odom")
    probe.wait(is_at_speed, first)
    return robot, node, probe, probe.count()


def stood_last(probe: Probe, first: int) -> bool:
    """Whether a command to stand came from an event on, and none to move after it."""
    probe.wait(lambda e: e["topic"] == "cmd_vel" and not (e["v"] or e["w"]), first, timeout_s=10.0)
    time.sleep(0.5)
    last = probe.of("cmd_vel")[-1]
    return (last["v"], last["w"]) == (0.0, 0.0)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_zero_is_the_last_command_of_a_node_that_is_told_to_end(ros: Ros, how: signal.Signals) -> None:
    _, node, probe, first = under_way(ros)
    assert node.end(how) == 0
    assert stood_last(probe, first)


def test_a_node_that_another_takes_the_place_of_says_zero_too(ros: Ros) -> None:
    """As rosnode kill does; in ROS 1 the master ends it, by another thread."""
    if ros.generation != 1:
        pytest.skip("in ROS 2 nodes are ended by signals alone")
    _, node, probe, first = under_way(ros)
    end = "import xmlrpc.client as x, rosgraph; u = rosgraph.Master('/t').lookupNode('/adrl'); "
    end += "x.ServerProxy(u).shutdown('/t', 'test')"
    # It may end before it has answered.
    subprocess.run(["/usr/bin/python3", "-c", end], env=ros.environment, check=False)
    assert node.popen.wait(timeout=15.0) == 0
    assert stood_last(probe, first)


@pytest.mark.parametrize("kind", ["sim", "drive"])
def test_it_ends_whatever_it_is_publishing(ros: Ros, kind: str) -> None:
    """Many times, as it takes a signal in the middle of a publication."""
    options = {"sim": ("--speed", "20"), "drive": ("--robot", "diffbot", "--guidance", "goal")}
    beside = "drive" if kind == "sim" else "sim"
    other = ros.node(beside, *options[beside])
    for turn in range(4):
        node = ros.node(kind, *options[kind])
        probe = ros.probe("odom")
        probe.wait(is_idle)
        probe.wait(lambda event: event["topic"] == "odom", timeout_s=20.0)
        time.sleep(0.1 + 0.013 * turn)
        assert node.end(signal.SIGTERM if turn % 2 else signal.SIGINT) == 0
        probe.popen.kill()
    assert other.end(signal.SIGTERM) == 0


def test_when_the_simulated_clock_dies_the_base_is_told_to_stand_by_the_walls(ros: Ros) -> None:
    """And the status says so, again and again; a new clock is gone by at once."""
    robot, node, probe, first = under_way(ros)
    robot.end(signal.SIGKILL)
    told = probe.wait(
        lambda e: e["topic"] == "status" and "clock_stopped" in e["reasons"], first, timeout_s=10.0
    )
    assert probe.events[told]["status"] == "stopped"
    assert probe.events[told]["goal_frame"] == "odom"
    begin_s = time.monotonic()
    probe.wait(lambda e: e["topic"] == "status" and e["at_s"] > begin_s + 2.5, told, timeout_s=10.0)
    after = probe.of("cmd_vel", told)
    assert len(after) > 10
    assert not any(event["v"] or event["w"] for event in after)
    ros.node("sim", "--speed", "2")
    probe.wait(lambda e: e["topic"] == "status" and "clock_stopped" not in e["reasons"], told, timeout_s=30.0)
    assert node.end(signal.SIGTERM) == 0


def test_the_simulated_robot_says_where_it_is_and_on_which_topics(ros: Ros) -> None:
    *at, _ = task_set(SCENARIOS["clutter"], load_robot("diffbot"), "test", 1)[0].start
    place = f"{at[0]:.2f},{at[1]:.2f},0.5"
    robot = ros.node("sim", "--speed", "0", "--start", place)
    probe = ros.probe("odom")
    probe.wait(lambda event: event["topic"] == "odom")
    assert robot.end(signal.SIGTERM) == 0
    assert robot.popen.stdout is not None
    words = (
        robot.log.read_text() + robot.popen.stdout.read().decode()
    )  # rospy tells such things to standard output
    assert f"robot diffbot at ({place.replace(',', ', ')}0) in map" in words
    assert all(topic in words for topic in ("scan", "odom", "amcl_pose", "cmd_vel"))
    refused = ros.node("sim", "--start", "nan,0,0")
    assert refused.popen.wait(timeout=60.0) == 2
    assert "start is (nan" in refused.log.read_text()
