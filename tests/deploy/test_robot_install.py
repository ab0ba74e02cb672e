"""What robot.md says to install on a robot is enough, and what is left out is named when it is missing."""

import json
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "robot.md"
ONLY = """
import json, sys
from pathlib import Path
allowed, arguments = json.loads(sys.argv[1]), json.loads(sys.argv[2])
class Only:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top in allowed or top.startswith("_adrl") or top == "adrl":
            return None
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Only())
"""
DRIVER = """
from adrl.integrations.ros.config import DriveConfig
DriveConfig(robot="diffbot", map=Path(arguments[0])).driver()
"""
COMMAND = "from adrl.cli import main; sys.exit(main(arguments))"
NODES = tuple([ros, "drive", "--robot", "diffbot", "--guidance", "goal"] for ros in ("ros2", "ros1"))


def lines() -> list[list[str]]:
    """The packages of each line of step 4 that installs some by name."""
    installs = re.findall(r"^pip install ([a-z][a-z ]*?)(?:  .*)?$", PAGE.read_text(), re.MULTILINE)
    return [line.split() for line in installs]


def modules_of(packages: list[str]) -> list[str]:
    """Top-level modules that installing these would bring, with what they depend on."""
    found: set[str] = set()
    waiting = list(packages)
    while waiting:
        package = canonical(re.split(r"[^\w.-]", waiting.pop())[0])
        if package in found:
            continue
        try:
            needs = requires(package) or []
        except PackageNotFoundError:  # for another Python or system
            continue
        found.add(package)
        waiting += [need for need in needs if "extra ==" not in need]
    return [
        module for module, names in packages_distributions().items() if found & set(map(canonical, names))
    ]


def canonical(name: str) -> str:
    """A package's name, however it is written."""
    return re.sub(r"[-_.]+", "-", name).lower()


def run(packages: list[str], code: str, arguments: list[str]) -> subprocess.CompletedProcess[str]:
    allowed, given = json.dumps(modules_of(packages)), json.dumps(arguments)
    return subprocess.run(
        [sys.executable, "-c", ONLY + code, allowed, given], capture_output=True, text=True, check=False
    )


@pytest.mark.integration
def test_the_listed_packages_are_enough_for_nodes_and_maps(maps: Path) -> None:
    drive, commands, for_maps = lines()
    assert drive == ["msgspec", "numpy", "safetensors"]
    for arguments in NODES:
        done = run(drive + commands, COMMAND, arguments)
        assert done.returncode == 2
        assert "ROS" in done.stderr  # which comes last, and is not here
        assert "not installed" not in done.stderr
    done = run(drive + for_maps, DRIVER, [str(maps / "turtlebot3_world" / "map.yaml")])
    assert done.returncode == 0, done.stderr


@pytest.mark.integration
def test_what_is_missing_is_named_with_what_to_run(maps: Path) -> None:
    drive, _, for_maps = lines()
    for arguments in NODES:
        done = run(drive, COMMAND, arguments)
        assert done.returncode == 2
        assert done.stderr == "adrl: error: the module tyro is not installed; run: pip install tyro\n"
    for missing in for_maps:
        rest = [package for package in for_maps if package != missing]
        done = run(drive + rest, DRIVER, [str(maps / "turtlebot3_world" / "map.yaml")])
        assert "MissingExtra" in done.stderr
        assert f"pip install {missing}" in done.stderr
