"""What robot.md says to install on a robot is enough, and what is left out is named when it is missing."""

import re
from pathlib import Path

import pytest

from only_packages import COMMAND, run_with

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "robot.md"
DRIVER = """
from adrl.integrations.ros.config import DriveConfig
DriveConfig(robot="diffbot", map=Path(arguments[0])).driver()
"""
NODES = tuple([ros, "drive", "--robot", "diffbot", "--guidance", "goal"] for ros in ("ros2", "ros1"))


def lines() -> list[list[str]]:
    """The packages of each line of step 4 that installs some by name."""
    installs = re.findall(r"^pip install ([a-z][a-z ]*?)(?:  .*)?$", PAGE.read_text(), re.MULTILINE)
    return [line.split() for line in installs]


@pytest.mark.integration
def test_the_listed_packages_are_enough_for_nodes_and_maps(maps: Path) -> None:
    drive, commands, for_maps = lines()
    assert drive == ["msgspec", "numpy", "safetensors"]
    for arguments in NODES:
        done = run_with(drive + commands, COMMAND, arguments)
        assert done.returncode == 2
        assert "ROS" in done.stderr  # which comes last, and is not here
        assert "not installed" not in done.stderr
    done = run_with(drive + for_maps, DRIVER, [str(maps / "turtlebot3_world" / "map.yaml")])
    assert done.returncode == 0, done.stderr


@pytest.mark.integration
def test_what_is_missing_is_named_with_what_to_run(maps: Path) -> None:
    drive, _, for_maps = lines()
    for arguments in NODES:
        done = run_with(drive, COMMAND, arguments)
        assert done.returncode == 2
        assert done.stderr == "adrl: error: the module tyro is not installed; run: pip install tyro\n"
    for missing in for_maps:
        rest = [package for package in for_maps if package != missing]
        done = run_with(drive + rest, DRIVER, [str(maps / "turtlebot3_world" / "map.yaml")])
        assert "MissingExtra" in done.stderr
        assert f"pip install {missing}" in done.stderr
