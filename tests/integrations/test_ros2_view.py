"""adrl view --ros2: a robot is watched over DDS, and a page is told what it does."""

import json
import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from integrations.ros_processes import Ros, is_idle

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.integration,
    pytest.mark.realtime,
    pytest.mark.parametrize("ros", ["ros2"], indirect=True),
]


def view(ros: Ros, *options: str) -> ClientConnection:
    """The page's live line."""
    process = ros.start(
        "view", [str(ros.python), "-m", "adrl.cli", "view", "--ros2", "--port", "0", *options]
    )
    assert process.popen.stdout is not None
    address = process.popen.stdout.readline().decode().strip()
    assert address.startswith("http://127.0.0.1:"), process.log.read_text()
    return connect(address.replace("http", "ws", 1) + "live")


def wait(page: ClientConnection, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first such state of the robot, what was told before included."""
    lane: dict[str, Any] = {}
    for _ in range(2000):
        frame = json.loads(page.recv(timeout=60.0))
        lane |= frame["lanes"][0] if "lanes" in frame else {}
        if lane and wanted(lane):
            return lane
    raise AssertionError(f"not seen; the last was {lane}")


def test_a_page_shows_scan_way_own_map_waypoint_and_what_the_supervisor_says(ros: Ros) -> None:
    sim = ros.node("sim", "--scenario", "clutter", "--speed", "1")
    ros.node("drive", "--guidance", "replan")
    probe = ros.probe()
    probe.wait(is_idle, timeout_s=200.0)
    started = re.search(r"at \(([-\d.]+), ([-\d.]+), ([-\d.]+)\)", sim.log.read_text())
    assert started is not None
    x, y, yaw = map(float, started.groups())
    with view(ros) as page:
        setup = json.loads(page.recv(timeout=60.0))["setup"]
        assert (setup["kind"], setup["lanes"][0]["label"]) == ("robot", "diffbot")
        seen = wait(page, lambda lane: len(lane["ranges"]) > 0 and lane["status"] == "idle")
        assert len(seen["ranges"]) == len(setup["lanes"][0]["shape"]["angles"])
        assert seen["goal"] is None
        probe.order(goal=(6.0, 0.0), frame="odom")
        told = wait(page, lambda lane: bool(lane["waypoint"] and lane["plan"] and lane.get("map")))
        assert told["goal"] == pytest.approx([6.0, 0.0])
        assert told["plan"][-2:] == pytest.approx([6.0, 0.0])
        assert told["status"] in ("driving", "stopped")
        assert "on the way to (6.00, 0.00)" in told["message"]
        moved = wait(page, lambda lane: math.hypot(*lane["pose"][:2]) > 0.3)
        assert moved["time_s"] > seen["time_s"]
        # 4 m before where the odometry began, told in the map's frame: drawn in the odometry's.
        probe.order(goal=(x + 4.0 * math.cos(yaw), y + 4.0 * math.sin(yaw)), frame="map")
        again = wait(page, lambda lane: lane["goal"] is not None and lane["goal"][0] < 5.0)
        assert again["goal"] == pytest.approx([4.0, 0.0], abs=0.3)
        page.send('{"do": "goal", "x": 1.0, "y": 0.0}')
        refused = next(
            frame for _ in range(100) if "errors" in (frame := json.loads(page.recv(timeout=60.0)))
        )
        assert "sends it nothing" in refused["errors"][0]
        sim.end()
        wait(page, lambda lane: "no odom for" in lane["message"] and "no scan for" in lane["message"])
