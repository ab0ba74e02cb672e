"""What the tests of both generations of ROS have."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from adrl.integrations.ros1.node import DIST_PACKAGES
from integrations.ros_processes import Ros

SOURCE = Path(__file__).resolve().parents[2]


def ros2_python() -> Path:
    return Path(os.environ.get("ADRL_ROS2") or SOURCE / ".venv-ros2") / "bin" / "python"


def require(there: object, otherwise: str) -> None:
    """A test that needs what is not there is skipped, in CI failed."""
    if not there:
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(otherwise)


def require_ros2() -> Path:
    """Its Python."""
    require(ros2_python().exists(), "no ROS 2; run make ros2")
    return ros2_python()


def require_ros1() -> Path:
    """Its Python."""
    there = (DIST_PACKAGES / "rospy").is_dir() and shutil.which("rosmaster")
    require(there, "no ROS 1; on Debian: apt-get install python3-rospy python3-rosmaster")
    return Path(sys.executable)


@pytest.fixture(params=["ros2", "ros1"])
def ros(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Ros]:
    """A generation of ROS."""
    python = require_ros2() if request.param == "ros2" else require_ros1()
    running = Ros(2 if request.param == "ros2" else 1, python, tmp_path)
    yield running
    running.close()


@pytest.fixture
def a_map(maps: Path) -> str:
    return str(maps / "turtlebot3_world" / "map.yaml")
