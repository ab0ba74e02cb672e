"""The package for colcon: what it installs, and what its launch files start. Neither colcon nor ROS is needed.

What the launch files import of ROS is stood in for by classes that keep what they are given.
"""

import importlib
import importlib.util
import re
import runpy
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from adrl.commands.options import parse
from adrl.integrations.ros.config import ControllerConfig, DriveConfig, with_parameters
from adrl.integrations.ros.drive import NAME
from adrl.integrations.ros.follow_path import Plugins

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "ros2" / "adrl_bringup"
PARAMETERS = PACKAGE / "params" / "controller_server.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
XML = ElementTree.parse(PACKAGE / "package.xml").getroot()
CONFIGS = {"controller": ControllerConfig, "drive": DriveConfig}
NAMES = {"controller": "controller_server", "drive": NAME}
GIVEN = {
    "policy": "diffbot",
    "robot": "my_robot.toml",
    "odom_frame": "odom_1",
    "map_frame": "map_1",
    "base_frame": "base_1",
    "enable_stamped_cmd_vel": True,
    "map": Path("map.yaml"),
    "guidance": "replan",
    "localisation": "tf",
    "goal_yaw": True,
    "stamped": True,
}
"""For each setting that a launch file takes, a value other than the default."""
ROS1 = {"move_base_msgs", "tf"}
OF_LAUNCH = {"launch", "launch_ros", "ros2launch"}

Start = Callable[..., SimpleNamespace]


def of_xml(tag: str) -> str:
    return XML.findtext(tag) or ""


def test_it_says_of_itself_what_the_project_says() -> None:
    assert (XML.tag, XML.get("format")) == ("package", "3")
    assert (of_xml("name"), of_xml("version")) == (PACKAGE.name, PROJECT["version"])
    assert of_xml("license") == PROJECT["license"]
    assert of_xml("maintainer") == PROJECT["authors"][0]["name"]
    assert of_xml("export/build_type") == "ament_python"


def test_it_depends_on_what_the_nodes_import() -> None:
    kind = re.compile(
        r'"([a-z0-9_]+)/(?:msg|action)/\w+"|from ([a-z0-9_]+)\.msg import|^ *import (rclpy)\b', re.M
    )
    imported: set[str] = set()
    for folder in ("ros", "ros2"):
        for file in (ROOT / "src" / "adrl" / "integrations" / folder).glob("*.py"):
            imported |= {name for names in kind.findall(file.read_text()) for name in names if name}
    assert {depend.text for depend in XML.findall("exec_depend")} == (imported - ROS1) | OF_LAUNCH


def test_what_ros_looks_for_is_installed_where_it_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    told: dict[str, Any] = {}
    monkeypatch.chdir(PACKAGE)
    monkeypatch.setitem(sys.modules, "setuptools", SimpleNamespace(setup=lambda **what: told.update(what)))
    runpy.run_path("setup.py")
    name = PACKAGE.name
    assert (told["name"], told["version"], told["packages"]) == (name, PROJECT["version"], [name])
    installed = {
        f"{folder}/{Path(file).name}": file for folder, files in told["data_files"] for file in files
    }
    assert all(Path(file).is_file() for file in installed.values())
    needed = [f"share/ament_index/resource_index/packages/{name}", f"share/{name}/package.xml"]
    needed += [
        f"share/{name}/launch/{file.name}" for file in (PACKAGE / "launch").iterdir() if file.is_file()
    ]
    needed += [f"share/{name}/params/{PARAMETERS.name}"]
    assert sorted(installed) == sorted(needed)
    assert len(needed) == 5


class Kept:
    """Stands for any class of launch."""

    def __init__(self, *positional: Any, **named: Any) -> None:
        self.positional, self.named = positional, named


class LaunchConfiguration(Kept):
    """The text of a launch argument."""

    def perform(self, context: Any) -> str:
        return context.launch_configurations[self.positional[0]]


STANDS_FOR: dict[str, dict[str, Any]] = {
    "launch": {"LaunchDescription": Kept, "LaunchContext": Kept},
    "launch.actions": {"DeclareLaunchArgument": Kept, "OpaqueFunction": Kept},
    "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
    "launch_ros": {},
    "launch_ros.actions": {"Node": Kept},
    "launch_ros.descriptions": {"ParameterFile": Kept},
}


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """start(kind, argument=text) is what launch would be asked to start. There is a command adrl."""
    for name, classes in STANDS_FOR.items():
        module = ModuleType(name)
        vars(module).update(classes)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    monkeypatch.setattr("shutil.which", lambda command: f"/usr/bin/{command}" if command == "adrl" else None)
    for name in ("adrl_bringup", "adrl_bringup.node"):
        monkeypatch.delitem(sys.modules, name, raising=False)

    def start(kind: str, pushed: str = "", **arguments: str) -> SimpleNamespace:
        file = runpy.run_path(str(PACKAGE / "launch" / f"{kind}.launch.py"))
        *declared, opaque = file["generate_launch_description"]().positional[0]
        known = {argument.positional[0]: argument.named["default_value"] for argument in declared}
        assert set(arguments) <= set(known)
        texts = known | arguments | ({"ros_namespace": pushed} if pushed else {})
        context = SimpleNamespace(launch_configurations=texts)
        (node,) = opaque.named["function"](context)
        *files, given = node.named["parameters"]
        values = {name: yaml.safe_load(value.perform(context)) for name, value in given.items()}
        topics = {source: target for source, target in node.named["remappings"] if not source.startswith("/")}
        settings = set(known) - set(topics) - {"params_file", "namespace", "log_level", "executable"}
        return SimpleNamespace(**node.named, files=files, values=values, topics=topics, settings=settings)

    yield start
    for name in ("adrl_bringup", "adrl_bringup.node"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("kind", CONFIGS)
def test_it_starts_the_command_under_the_name_of_its_node(start: Start, kind: str) -> None:
    node = start(kind)
    assert (node.executable, node.arguments, node.name) == ("adrl", ["ros2", kind], NAMES[kind])
    assert (node.namespace, node.files, node.values) == ("/", [], {})


@pytest.mark.parametrize("kind", CONFIGS)
def test_its_arguments_are_options_of_the_command_and_are_taken_as_such(start: Start, kind: str) -> None:
    """As an option on the command line, so as a parameter from the launch file."""
    settings = start(kind).settings - {"use_sim_time"}
    node = start(kind, use_sim_time="true", **{name: str(GIVEN[name]).lower() for name in settings})
    assert node.values.pop("use_sim_time") is True
    options = []
    for name, value in node.values.items():
        options += [f"--{name.replace('_', '-')}", *([] if value is True else [value])]
    by_options = parse(CONFIGS[kind], options, f"ros2 {kind}", "")
    by_parameters = with_parameters(CONFIGS[kind](), lambda name, default: node.values.get(name, default))
    assert by_options == by_parameters
    assert {name: getattr(by_options, name) for name in settings} == {name: GIVEN[name] for name in settings}


@pytest.mark.parametrize("kind", CONFIGS)
def test_its_topics_are_those_of_the_node(start: Start, kind: str) -> None:
    page = (ROOT / "docs" / "how-to" / "ros.md").read_text()
    known = {*re.findall(r"^\| `([a-z_]+)` \| `", page, re.MULTILINE), "cloud"}
    renamed = start(kind, scan="front/scan").topics
    assert set(renamed) <= known
    assert renamed.pop("scan") == "front/scan"
    assert renamed.pop("cmd_vel") == {"controller": "cmd_vel_nav", "drive": "cmd_vel"}[kind]
    assert all(source == target for source, target in renamed.items())


def test_what_is_given_is_told_after_the_file_and_so_counts(start: Start) -> None:
    node = start("controller", params_file="nav2_params.yaml", policy="runs/mine")
    assert [file.positional for file in node.files] == [("nav2_params.yaml",)]
    assert node.values == {"policy": "runs/mine"}


def test_a_namespace_that_the_including_file_has_pushed_is_not_added_twice(start: Start) -> None:
    assert start("drive", namespace="robot1").namespace == "/robot1"
    assert start("drive", namespace="robot1", pushed="/robot1").namespace == ""


def test_without_the_command_it_says_what_to_install(start: Start) -> None:
    with pytest.raises(RuntimeError, match=r"no command 'nothing': pip install"):
        start("drive", executable="nothing")


def flat(section: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Parameters by their names in ROS."""
    out: dict[str, Any] = {}
    for name, value in section.items():
        out |= flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return out


def test_every_parameter_of_the_file_is_read() -> None:
    section = yaml.safe_load(PARAMETERS.read_text())["controller_server"]["ros__parameters"]
    left = flat(section)
    assert len(left) > 15

    def get(name: str, default: Any) -> Any:
        return left.pop(name, default)

    config = with_parameters(ControllerConfig(), get)
    plugins = Plugins.of(get)
    assert left == {}
    assert (config.policy, config.robot) == ("default", "my_robot.toml")
    assert plugins.controllers == ("FollowPath",)


def test_the_page_shows_the_file() -> None:
    """Where the repository's page links to it, within a list."""
    spec = importlib.util.spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    text = (ROOT / "docs" / "how-to" / "nav2.md").read_text(encoding="utf-8")
    page = SimpleNamespace(file=SimpleNamespace(src_uri="how-to/nav2.md"))
    shown = hooks.on_page_markdown(text, page, SimpleNamespace(config_file_path=str(ROOT / "mkdocs.yml")))
    assert "adrl_bringup/params" not in shown
    for line in PARAMETERS.read_text().splitlines():
        assert f"\n    {line}\n" in shown
