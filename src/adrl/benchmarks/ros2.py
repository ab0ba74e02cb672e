"""What a driving node of ROS 2 costs: from a scan's publication to its command's arrival, and processor time."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adrl.bags.messages import pose_stamped
from adrl.errors import ConfigError, WorldError
from adrl.integrations.ros.config import SimConfig

TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
IDLE_S = 10.0
PATIENCE_S = 60.0
GOALS = ((3.0, 0.0), (0.0, 0.0))
"""In the odometry's frame, in turns."""


def bench_ros2(policy: str, *, scans: int = 600, quota: float = 0.0) -> dict[str, Any]:
    """A simulated robot in this process and the node in another, in real time, joined by DDS. Times in ms.

    cpu: processor time of the node's process, all threads, in percent of one core; idle with sensors but no goal.
    memory: what it has resident. load: of the machine in the minute before the end, this benchmark included.
    Raises ConfigError, MissingExtra where ROS 2 is not, WorldError when the node does not come up.
    quota: of one core, what the node may use, by a cgroup; 0 for all of it.
    """
    if scans < 20:
        raise ConfigError(f"scans is {scans}; give 20 or more")
    if not 0.0 <= quota <= 1.0:
        raise ConfigError(f"quota is {quota}; give a share of one core, or 0 for all of it")
    os.environ.setdefault("ROS_DOMAIN_ID", "101")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    command = [sys.executable, "-m", "adrl.cli", "ros2", "drive", "--policy", policy, "--robot", "diffbot"]
    command += ["--guidance", "goal"]
    node = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        with _limited(node.pid, quota):
            return _measure(node.pid, scans) | {"quota": quota}
    finally:
        node.terminate()
        node.wait()


@contextlib.contextmanager
def _limited(process_id: int, quota: float) -> Iterator[None]:
    """Hold a process, its threads included, to a share of a core by a cgroup of its own. Raises ConfigError."""
    if quota == 0.0:
        yield
        return
    first = Path("/sys/fs/cgroup/cpu")  # cgroups of the first version have a tree a resource
    group = (first if first.is_dir() else first.parent) / f"adrl-bench-{process_id}"
    try:
        group.mkdir()
        if first.is_dir():
            (group / "cpu.cfs_quota_us").write_text(str(int(quota * 100_000)))
        else:
            (group / "cpu.max").write_text(f"{int(quota * 100_000)} 100000")
        (group / "cgroup.procs").write_text(str(process_id))
    except OSError as error:
        with contextlib.suppress(OSError):
            group.rmdir()
        raise ConfigError(
            f"quota: this machine does not let a cgroup be made ({error}); run as root"
        ) from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # it may have ended
            (group.parent / "cgroup.procs").write_text(str(process_id))
        group.rmdir()


def _measure(node_id: int, scans: int) -> dict[str, Any]:
    from adrl.integrations.ros.messages import message_class, new_message
    from adrl.integrations.ros.robot import SimulatedRobot
    from adrl.integrations.ros.sim import LATCHED, PUBLICATIONS, SimTopics, subscription
    from adrl.integrations.ros2 import node as ros

    sent_s: list[float] = [0.0]
    latency_s: list[float] = []
    config = SimConfig(scenario="clutter", localised=False)
    with ros.a_node("adrl_bench", []) as node, SimulatedRobot.of(config) as simulated:
        publish = {
            topic: ros.publisher(node, topic, kind, latched=topic in LATCHED)
            for topic, kind in PUBLICATIONS.items()
        }
        publish_scan = publish["scan"]

        def scan(message: Any) -> None:
            sent_s[0] = time.perf_counter()
            publish_scan(message)

        # A robot's clock, not a simulation's.
        robot = SimTopics(
            config,
            simulated,
            publish | {"scan": scan, "/clock": lambda _: None},
            lambda _, frame: ros.header(time.time(), frame),
        )

        def take(message: Any) -> None:
            if sent_s[0]:
                latency_s.append(time.perf_counter() - sent_s[0])
                sent_s[0] = 0.0
            robot.take_command(message)

        ros.subscribe(node, "cmd_vel", subscription(config), take, ros.RELIABLE)
        goals = node.create_publisher(
            message_class("geometry_msgs/msg/PoseStamped"), "goal_pose", ros.RELIABLE
        )
        node.create_timer(robot.tick_s, robot.tick, clock=ros.steady_clock())

        def drive_to(point: tuple[float, float]) -> None:
            header = ros.header(time.time(), "odom")
            goals.publish(pose_stamped(new_message, header, (*point, 0.0)))

        begin_s = time.monotonic()
        ros.spin(node, lambda: goals.get_subscription_count() > 0 or time.monotonic() - begin_s > PATIENCE_S)
        if not goals.get_subscription_count():
            raise WorldError(f"the node did not come up in {PATIENCE_S:.0f} s; see what it wrote")
        settled_s = time.monotonic() + 3.0
        ros.spin(node, lambda: time.monotonic() > settled_s)
        idle = _share(node_id, lambda: ros.spin(node, _after(IDLE_S)))

        def drive() -> None:
            turn = 0
            while len(latency_s) < scans:
                drive_to(GOALS[turn % len(GOALS)])
                turn, until = turn + 1, _after(10.0)
                ros.spin(node, lambda until=until: until() or len(latency_s) >= scans)

        driving = _share(node_id, drive)
        memory_mb = _resident_mb(node_id)
    ms = 1e3 * np.array(latency_s)
    return {
        "schema_version": 1,
        "scans": len(ms),
        "p50_ms": float(np.median(ms)),
        "p99_ms": float(np.percentile(ms, 99)),
        "max_ms": float(ms.max()),
        "idle_cpu_percent": 100.0 * idle,
        "driving_cpu_percent": 100.0 * driving,
        "memory_mb": memory_mb,
        "load": os.getloadavg()[0],
    }


def _after(seconds: float) -> Any:
    end_s = time.monotonic() + seconds
    return lambda: time.monotonic() > end_s


def _share(process_id: int, work: Any) -> float:
    """Processor seconds a second of a process, while this one works."""
    before, begin_s = _busy_s(process_id), time.monotonic()
    work()
    return (_busy_s(process_id) - before) / (time.monotonic() - begin_s)


def _busy_s(process_id: int) -> float:
    # After the name in brackets: state is field 3, user and system time are 14 and 15.
    words = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return TICK_S * (int(words[11]) + int(words[12]))


def _resident_mb(process_id: int) -> float:
    pages = int(Path(f"/proc/{process_id}/statm").read_text().split()[1])
    return 1e-6 * pages * os.sysconf("SC_PAGE_SIZE")
