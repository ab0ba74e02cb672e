"""The programs of a test of ROS: nodes, a master, a probe; started, listened to and ended."""

import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from waiting import wait_until

Event = dict[str, Any]
PERIOD_S = 0.1
BRAKING_PERIODS = 6
"""That diffbot needs from full speed to rest, its lag included."""


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
        wait_until(lambda: listens(port))
        parameter = "import rosgraph; rosgraph.Master('test').setParam('/use_sim_time', True)"
        subprocess.run(["/usr/bin/python3", "-c", parameter], env=self.environment, check=True)

    def start(self, name: str, command: list[str]) -> Process:
        process = Process(command, self.environment, self.folder / f"{name}.log")
        self.started.append(process)
        return process

    def node(self, kind: str, *options: str, namespace: str = "", **remaps: str) -> Process:
        """adrl ros1 or ros2 with options, parameters (name:=value) among them. What drives has the diffbot's policy."""
        ours = [option for option in options if ":=" not in option]
        if kind != "sim" and "--policy" not in ours:
            ours += ["--policy", "diffbot"]
        parameters = [option for option in options if ":=" in option]
        if self.generation == 1:
            theirs = [f"_{parameter}" for parameter in parameters]
            theirs += [f"{name}:={topic}" for name, topic in remaps.items()]
            theirs += [f"__ns:={namespace}"] if namespace else []
        else:
            pairs = [("-p", "use_sim_time:=true")] if kind != "sim" else []
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


def listens(port: int) -> bool:
    """Whether a program of this machine answers there."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


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
    probe.wait(lambda event: event["topic"] == "odom" and event["t"] > begin_s + 1.5, at)
    after = [event for event in probe.of("odom", at) if event["t"] >= begin_s - 1e-6]
    assert max(abs(event["v"]) + abs(event["w"]) for event in after) < 0.02
