"""Both generations of ROS: simulator, node and probe are processes that meet on real topics.

Kilted from .venv-ros2 (make ros2), or what ADRL_ROS2 names, as the environment of Jazzy; ROS 1 from the distribution.
"""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from adrl.integrations.ros1.node import DIST_PACKAGES
from adrl.worlds import load_robot, task_set
from adrl.worlds.map_scenario import MapScenario

SOURCE = Path(__file__).resolve().parents[2]
PERIOD_S = 0.1
BRAKING_PERIODS = 6
"""That diffbot needs from full speed to rest, its lag included."""
Event = dict[str, Any]


class Process:
    """A program in the background, whose words are kept for the failure's report."""

    def __init__(self, command: list[str], environment: dict[str, str], log: Path) -> None:
        self.log = log
        with open(log, "ab") as file:
            self.popen = subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=file
            )

    def end(self, how: int = signal.SIGINT) -> int:
        """Its exit code."""
        if self.popen.poll() is None:
            self.popen.send_signal(how)
        try:
            return self.popen.wait(timeout=15.0)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
            raise AssertionError(f"{self.log.name} did not end: {self.log.read_text()}") from None


class Probe(Process):
    """What topics said, in order; and goals."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.events: list[Event] = []
        self._news = threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            with self._news:
                self.events.append(json.loads(line) | {"at_s": time.monotonic()})
                self._news.notify_all()

    def order(self, **what: Any) -> int:
        """Send it. Returns the number of the next event."""
        assert self.popen.stdin is not None
        count = self.count()
        self.popen.stdin.write(json.dumps(what).encode() + b"\n")
        self.popen.stdin.flush()
        return count

    def count(self) -> int:
        """The number of the next event."""
        with self._news:
            return len(self.events)

    def wait(self, wanted: Callable[[Event], bool], first: int = 0, *, timeout_s: float = 60.0) -> int:
        """The number of the first such event from a number on."""
        give_up_s = time.monotonic() + timeout_s
        with self._news:
            while True:
                for number in range(first, len(self.events)):
                    if wanted(self.events[number]):
                        return number
                first = len(self.events)
                left_s = give_up_s - time.monotonic()
                assert left_s > 0.0, f"not seen in {timeout_s} s; the last were {self.events[-3:]}"
                self._news.wait(left_s)

    def of(self, topic: str, first: int = 0) -> list[Event]:
        """What a topic said from a number on."""
        with self._news:
            return [event for event in self.events[first:] if event["topic"] == topic]


class Ros:
    """One generation: how its programs are started, and those that were."""

    def __init__(self, generation: int, python: Path, folder: Path) -> None:
        self.generation, self.python, self.folder = generation, python, folder
        self.environment = os.environ | {"OMP_NUM_THREADS": "1", "HOME": str(folder)}
        self.started: list[Process] = []
        if generation == 2:
            domain = str(1 + os.getpid() % 100)
            self.environment |= {"ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
            return
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.environment |= {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
        self.start("master", ["rosmaster", "--core", "-p", str(port)])
        wait_for_port(port)
        parameter = "import rosgraph; rosgraph.Master('test').setParam('/use_sim_time', True)"
        subprocess.run(["/usr/bin/python3", "-c", parameter], env=self.environment, check=True)

    def start(self, name: str, command: list[str]) -> Process:
        process = Process(command, self.environment, self.folder / f"{name}.log")
        self.started.append(process)
        return process

    def node(self, kind: str, *options: str, namespace: str = "", **remaps: str) -> Process:
        """adrl ros1 or ros2 with options, parameters (name:=value) among them."""
        ours = [option for option in options if ":=" not in option]
        parameters = [option for option in options if ":=" in option]
        if self.generation == 1:
            theirs = [f"_{parameter}" for parameter in parameters]
            theirs += [f"{name}:={topic}" for name, topic in remaps.items()]
            theirs += [f"__ns:={namespace}"] if namespace else []
        else:
            pairs = [("-p", "use_sim_time:=true")] if kind == "drive" else []
            pairs += [("-p", parameter) for parameter in parameters]
            pairs += [("-r", f"{name}:={topic}") for name, topic in remaps.items()]
            pairs += [("-r", f"__ns:={namespace}")] if namespace else []
            theirs = ["--ros-args", *(word for pair in pairs for word in pair)] if pairs else []
        program = [str(self.python), "-m", "adrl.cli", f"ros{self.generation}", kind]
        return self.start(kind, [*program, *ours, *theirs])

    def probe(self, *watch: str, namespace: str = "", stamped: bool = False, relay: bool = False) -> Probe:
        ask = {"generation": self.generation, "namespace": namespace, "stamped": stamped}
        ask |= {"watch": watch, "relay": relay}
        command = [str(self.python), str(Path(__file__).parent / "ros_probe.py"), json.dumps(ask)]
        environment = self.environment | ({"ROS_NAMESPACE": namespace} if namespace else {})
        probe = Probe(command, environment, self.folder / "probe.log")
        self.started.append(probe)
        return probe

    def close(self) -> None:
        for process in reversed(self.started):
            if process.popen.poll() is None:
                process.popen.kill()
                process.popen.wait()
        for log in self.folder.glob("*.log"):
            print(f"--- {log.name}\n{log.read_text()}")  # noqa: T201 - pytest shows it with a failure


def wait_for_port(port: int) -> None:
    give_up_s = time.monotonic() + 30.0
    while time.monotonic() < give_up_s:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise AssertionError("the master did not start")


def ros2_python() -> Path:
    return Path(os.environ.get("ADRL_ROS2") or SOURCE / ".venv-ros2") / "bin" / "python"


@pytest.fixture(params=["ros2", "ros1"])
def ros(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Ros]:
    """A generation of ROS. Where it is not: skipped, in CI failed."""
    if request.param == "ros2":
        missing = "" if ros2_python().exists() else "no ROS 2; run make ros2"
    else:
        there = (DIST_PACKAGES / "rospy").is_dir() and shutil.which("rosmaster")
        missing = "" if there else "no ROS 1; on Debian: apt-get install python3-rospy python3-rosmaster"
    if missing:
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(missing)
    generation = 2 if request.param == "ros2" else 1
    python = ros2_python() if generation == 2 else Path(sys.executable)
    running = Ros(generation, python, tmp_path)
    yield running
    running.close()


def is_idle(event: Event) -> bool:
    return event["topic"] == "status" and event["status"] == "idle" and not event["reasons"]


def has_ended(number: int) -> Callable[[Event], bool]:
    return lambda event: (
        event["topic"] == "status" and event["goals"] == str(number) and event["outcome"] != ""
    )


def is_at_speed(event: Event) -> bool:
    return event["topic"] == "odom" and event["v"] > 0.4


def stands_from(probe: Probe, first: int, periods: int) -> None:
    """From so many periods after the event on, the robot is at rest; for a second and longer."""
    at = probe.wait(lambda event: event["topic"] == "odom", first)
    begin_s = probe.events[at]["t"] + periods * PERIOD_S
    end = probe.wait(lambda event: event["topic"] == "odom" and event["t"] > begin_s + 1.5, at)
    after = [event for event in probe.of("odom", at) if event["t"] >= begin_s - 1e-6]
    assert probe.events[end]["t"] > begin_s
    assert max(abs(event["v"]) + abs(event["w"]) for event in after) < 0.02


@pytest.fixture
def a_map(shared_data: Path) -> str:
    return str(shared_data / "maps" / "turtlebot3_world" / "map.yaml")


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
def test_fifty_goals_none_missed_none_collided(ros: Ros, a_map: str) -> None:
    """Goals on the map, the odometry's frame elsewhere, places told by a localisation."""
    goals = [task.goal for task in task_set(MapScenario(a_map), load_robot("diffbot"), "test", 51)[1:]]
    ros.node("sim", "--map", a_map, "--speed", "0")
    ros.node("drive", "--map", a_map)
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


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
def test_a_goal_on_the_map_without_localisation_is_refused_and_one_in_odom_driven_to(
    ros: Ros, a_map: str
) -> None:
    ros.node("sim", "--map", a_map, "--speed", "10", "localised:=false")
    ros.node("drive", "guidance:=goal")
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


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
def test_the_node_is_killed_and_started_again(ros: Ros, a_map: str) -> None:
    task = task_set(MapScenario(a_map), load_robot("diffbot"), "test", 1)[0]
    ros.node("sim", "--map", a_map, "--speed", "2")
    node = ros.node("drive", "--map", a_map)
    probe = ros.probe("odom")
    probe.wait(is_idle)
    time.sleep(1.0)
    first = probe.order(goal=task.goal, frame="map")
    probe.wait(is_at_speed, first)
    first = probe.count()
    node.end(signal.SIGKILL)
    stands_from(probe, first, 1 + 2 + BRAKING_PERIODS)
    first = probe.count()
    node = ros.node("drive", "--map", a_map)
    probe.wait(is_idle, first)
    stands_from(probe, first, 0)
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


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
def test_it_stands_while_something_fails_and_drives_on_afterwards(ros: Ros, a_map: str) -> None:
    """Scans, the node's clock, the sensors' clock, all clocks; each fault on the way, then a goal elsewhere."""
    goals = [task.goal for task in task_set(MapScenario(a_map), load_robot("diffbot"), "test", 9)]
    ros.node("sim", "--map", a_map, "--speed", "2")
    relayed = {
        topic: f"relayed/{topic.removeprefix('/')}" for topic in ("scan", "odom", "amcl_pose", "/clock")
    }
    ros.node("drive", "--map", a_map, **relayed)
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
        jumped_s = probe.events[at]["t"]
        again = probe.wait(lambda e, s=jumped_s: is_at_speed(e) and e["t"] > s + 1.0, at)
        assert probe.events[again]["t"] - jumped_s < 3.0
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


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
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


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.integration
def test_the_commands_of_the_page_take_the_robot_to_its_goal(ros: Ros, a_map: str, tmp_path: Path) -> None:
    page = (SOURCE / "docs" / "how-to" / "ros.md").read_text()
    for name, text in re.findall(r'^```python title="(.+?)"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(text)
    blocks = re.findall(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (block,) = (block for block in blocks if f"adrl ros{ros.generation} " in block)
    here = {"map.yaml": [a_map], "adrl": [str(ros.python), "-m", "adrl.cli"], "python": [str(ros.python)]}
    here["goal.py"] = [str(tmp_path / "goal.py")]
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
