"""Both generations of ROS: simulator, node and probe are processes that meet on real topics.

Kilted from .venv-ros2 (make ros2), or what ADRL_ROS2 names, as the environment of Jazzy; ROS 1 from the distribution.
"""

import math
import os
import re
import shlex
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from adrl.geometry import compose, inverse
from adrl.integrations.gazebo.server import gazebo_folder, is_installed
from adrl.worlds import SCENARIOS, load_robot, task_set
from adrl.worlds.map_scenario import MapScenario
from integrations.ros_processes import (
    BRAKING_PERIODS,
    Probe,
    Ros,
    has_ended,
    is_at_speed,
    is_idle,
    stands_from,
)

pytestmark = [pytest.mark.ros, pytest.mark.realtime, pytest.mark.integration]

SOURCE = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_fifty_goals_none_missed_none_collided(ros: Ros, a_map: str) -> None:
    """Goals on the map, the odometry's frame elsewhere, places told by a localisation."""
    goals = [task.goal for task in task_set(MapScenario(a_map), load_robot("diffbot"), "test", 51)[1:]]
    ros.node("sim", "--map", a_map, "--speed", "0")
    ros.node("drive", "--robot", "diffbot", "--map", a_map)
    probe = ros.probe()
    probe.wait(is_idle)
    time.sleep(1.0)  # a pose on the map comes with the first scans
    outcomes = []
    for number, goal in enumerate(goals, 1):
        first = probe.order(goal=goal, frame="map")
        ended = probe.wait(has_ended(number), first)
        outcomes.append(probe.events[ended]["outcome"])
    assert outcomes == ["reached"] * 50
    assert [event["count"] for event in probe.of("collisions")] == [0]


@pytest.mark.gazebo
@pytest.mark.slow
def test_a_goal_is_reached_in_gazebo_in_real_time(ros: Ros) -> None:
    """The driving node is the same; Gazebo is the robot, among the obstacles of a test task."""
    if not is_installed() and os.environ.get("CI") != "true":
        pytest.skip("Gazebo is not set up; run scripts/gazebo-chroot")
    ros.environment["ADRL_GAZEBO"] = str(gazebo_folder())
    task = task_set(SCENARIOS["clutter"], load_robot("diffbot"), "test", 1)[0]
    *goal, _ = compose(inverse(task.start), (*task.goal, 0.0))
    robot = ros.node("sim", "--simulator", "gazebo")
    node = ros.node("drive", "--robot", "diffbot", "--guidance", "goal")
    probe = ros.probe("odom")
    probe.wait(is_idle)
    first = probe.order(goal=goal, frame="odom")
    ended = probe.wait(has_ended(1), first)
    assert probe.events[ended]["outcome"] == "reached"
    assert math.hypot(*goal) > 3.0
    assert math.dist([probe.of("odom")[-1][axis] for axis in "xy"], goal) < 0.5
    told = probe.of("odom")
    assert (told[-1]["t"] - told[0]["t"]) / (told[-1]["at_s"] - told[0]["at_s"]) == pytest.approx(
        1.0, abs=0.1
    )
    assert [event["count"] for event in probe.of("collisions")] == [0]
    assert (node.end(), robot.end()) == (0, 0)


def test_without_gazebo_the_simulated_robot_says_what_to_run(ros: Ros) -> None:
    ros.environment["ADRL_GAZEBO"] = str(ros.folder / "nowhere")
    robot = ros.node("sim", "--simulator", "gazebo")
    assert robot.popen.wait(timeout=30.0) == 2
    assert "scripts/gazebo-chroot" in robot.log.read_text()


@pytest.mark.slow
def test_a_goal_on_the_map_without_localisation_is_refused_and_one_in_odom_driven_to(
    ros: Ros, a_map: str
) -> None:
    ros.node("sim", "--map", a_map, "--speed", "10", "localised:=false")
    ros.node("drive", "robot:=diffbot", "guidance:=goal")
    probe = ros.probe("odom", "plan", "cmd_vel")
    first = probe.wait(is_idle)
    for number, (frame, refusal) in enumerate((("map", "NotLocalised"), ("base_link", "UnknownFrame")), 1):
        first = probe.order(goal=(0.6, 0.0), frame=frame)
        told = probe.wait(lambda e, n=str(number): e["topic"] == "status" and e["goals"] == n, first)
        status = probe.events[told]
        assert (status["refusal"], status["level"]) == (refusal, 2)
        assert status["message"]
        stands_from(probe, first, 0)
    assert not any(event["v"] or event["w"] for event in probe.of("cmd_vel"))
    first = probe.order(goal=(0.6, 0.0), frame="odom")
    ended = probe.wait(has_ended(3), first)
    assert probe.events[ended]["outcome"] == "reached"
    last = probe.of("odom")[-1]
    assert 0.25 < last["x"] < 0.95
    assert {event["frame"] for event in probe.of("plan", first)} == {"odom"}
    # Behind the walls: it tries on, until it is told not to.
    first = probe.order(goal=(20.0, 0.0), frame="odom")
    begin_s = last["t"]
    tried = probe.wait(lambda event: event["topic"] == "odom" and event["t"] > begin_s + 30.0, first)
    assert not any(event["outcome"] for event in probe.of("status", tried))
    first = probe.order(cancel=True)
    ended = probe.wait(has_ended(4), first)
    assert probe.events[ended]["outcome"] == "cancelled"
    assert [event["count"] for event in probe.of("collisions")] == [0]


@pytest.mark.slow
def test_the_node_is_killed_and_started_again(ros: Ros, a_map: str) -> None:
    task = task_set(MapScenario(a_map), load_robot("diffbot"), "test", 1)[0]
    ros.node("sim", "--map", a_map, "--speed", "2")
    node = ros.node("drive", "--robot", "diffbot", "--map", a_map)
    probe = ros.probe("odom")
    probe.wait(is_idle)
    time.sleep(1.0)
    first = probe.order(goal=task.goal, frame="map")
    probe.wait(is_at_speed, first)
    first = probe.count()
    node.end(signal.SIGKILL)
    stands_from(probe, first, 1 + 2 + BRAKING_PERIODS)
    first = probe.count()
    node = ros.node("drive", "--robot", "diffbot", "--map", a_map)
    probe.wait(is_idle, first)
    stands_from(probe, first, 0)
    time.sleep(1.0)  # as above: its pose on the map comes by another connection
    first = probe.order(goal=task.goal, frame="map")
    probe.wait(is_at_speed, first)
    first = probe.order(cancel=True)
    ended = probe.wait(has_ended(1), first)
    assert probe.events[ended]["outcome"] == "cancelled"
    stands_from(probe, ended, BRAKING_PERIODS)
    first = probe.order(goal=task.goal, frame="map")
    ended = probe.wait(has_ended(2), first)
    assert probe.events[ended]["outcome"] == "reached"
    assert [event["count"] for event in probe.of("collisions")] == [0]
    assert node.end() == 0


FAULTS: tuple[dict[str, Any], ...] = (
    {"scans": "drop"},
    {"scans": "freeze"},
    {"scans": "nan"},
    {"scans": "late"},
    {"clock_s": 100.0},
    {"sensors_s": 100.0},
)
HEALTHY = {"scans": "pass"}


@pytest.mark.slow
def test_it_stands_while_something_fails_and_drives_on_afterwards(ros: Ros, a_map: str) -> None:
    """Scans, the node's clock, the sensors' clock, all clocks; each fault on the way, then a goal elsewhere."""
    goals = [task.goal for task in task_set(MapScenario(a_map), load_robot("diffbot"), "test", 9)]
    ros.node("sim", "--map", a_map, "--speed", "2")
    relayed = {
        topic: f"relayed/{topic.removeprefix('/')}" for topic in ("scan", "odom", "amcl_pose", "/clock")
    }
    ros.node("drive", "--robot", "diffbot", "--map", a_map, **relayed)
    probe = ros.probe("odom", relay=True)
    probe.wait(is_idle)
    time.sleep(1.0)
    for goal, fault in zip(goals, FAULTS, strict=False):
        first = probe.order(goal=goal, frame="map")
        probe.wait(is_at_speed, first)
        first = probe.order(**fault)
        # As for scans that stop, below.
        stands_from(probe, first, 1 + 2 + 1 + BRAKING_PERIODS)
        assert "stopped" in {event["status"] for event in probe.of("status", first)}, fault
        probe.order(**HEALTHY)
    for jump in ({"clock_s": 100.0, "sensors_s": 100.0}, HEALTHY):
        first = probe.order(goal=goals[6 + (jump is HEALTHY)], frame="map")
        at = probe.wait(is_at_speed, first)
        probe.order(**jump)
        goes_on(probe, at)
    probe.order(scans="swap")
    first = probe.order(goal=goals[8], frame="map")
    ended = probe.wait(has_ended(9), first)
    assert probe.events[ended]["outcome"] == "reached"
    first = probe.order(goal=(0.0, 50.0), frame="map")
    ended = probe.wait(has_ended(10), first)
    assert probe.events[ended]["outcome"] == "failed"
    assert probe.events[ended]["message"]
    stands_from(probe, ended, BRAKING_PERIODS)
    assert [event["count"] for event in probe.of("collisions")] == [0]


def goes_on(probe: Probe, jumped: int) -> None:
    """Three seconds after an event the node drives, and by then the base has moved, or the node says what is in its
    way: how fast it is depends on where it was. Or it has arrived.
    """
    jumped_s = probe.events[jumped]["t"]

    def later(seconds: float) -> int:
        return probe.wait(lambda e: e["topic"] == "odom" and e["t"] - jumped_s > seconds, jumped)

    first, last = later(1.0), later(3.0)
    told = [event for event in probe.events[jumped:last] if event["topic"] == "status"][-1]
    speeds = [abs(event["v"]) + abs(event["w"]) for event in probe.events[first:last] if "v" in event]
    if told["outcome"] != "reached":
        assert told["status"] == "driving", told
        assert max(speeds) > 0.1 or "obstacle" in told["reasons"], told


@pytest.mark.slow
def test_names_parameters_and_stamped_commands_and_scans_that_stop(ros: Ros, a_map: str) -> None:
    """A namespace, scans from another topic, TwistStamped. The scans stop, and the node ends, under way."""
    task = task_set(MapScenario(a_map), load_robot("diffbot"), "test", 1)[0]
    ros.node("sim", "--map", a_map, "--speed", "2", "stamped:=true", namespace="/robot1")
    options = ("--map", a_map, "stamped:=true", "base_frame:=robot1/base_link")
    node = ros.node("drive", *options, namespace="/robot1", scan="relayed/scan")
    probe = ros.probe("odom", "cmd_vel", namespace="/robot1", stamped=True, relay=True)
    probe.wait(is_idle)
    time.sleep(1.0)
    first = probe.order(goal=task.goal, frame="map")
    probe.wait(is_at_speed, first)
    assert {event["frame"] for event in probe.of("cmd_vel", first)} == {"robot1/base_link"}
    first = probe.order(scans="drop")
    held = probe.wait(lambda e: e["topic"] == "status" and "scan_stale" in e["reasons"], first)
    assert probe.events[held]["status"] == "stopped"
    # The first scan that is missing is due a period later; the pause of a message between processes is one more.
    stands_from(probe, first, 1 + 2 + 1 + BRAKING_PERIODS)
    first = probe.order(scans="pass")
    probe.wait(is_at_speed, first)
    first = probe.count()
    assert node.end(signal.SIGTERM) == 0
    stands_from(probe, first, 1 + 2 + BRAKING_PERIODS)
    assert [event["count"] for event in probe.of("collisions")] == [0]


@pytest.mark.slow
def test_the_commands_of_the_page_take_the_robot_to_its_goal(ros: Ros, a_map: str, tmp_path: Path) -> None:
    page = (SOURCE / "docs" / "how-to" / "ros.md").read_text()
    for name, text in re.findall(r'^```python title="(.+?)"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(text)
    blocks = re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (block,) = (block for block in blocks if f"adrl ros{ros.generation} " in block)
    here = {"adrl": [str(ros.python), "-m", "adrl.cli"], "python": [str(ros.python)]}
    here |= {"tests/data/maps/turtlebot3_world/map.yaml": [a_map], "goal.py": [str(tmp_path / "goal.py")]}
    sim, drive, goal = (
        [part for word in shlex.split(line) for part in here.get(word, [word])] for line in block.splitlines()
    )
    ros.start("sim", sim)
    ros.start("drive", drive)
    probe = ros.probe()
    probe.wait(is_idle)
    time.sleep(1.0)
    first = probe.count()
    ros.start("goal", goal)
    ended = probe.wait(has_ended(1), first)
    assert probe.events[ended]["outcome"] == "reached"
    assert [event["count"] for event in probe.of("collisions")] == [0]
