"""Parameter files of Nav2, and of move_base: costmaps, controllers, velocity smoother, frames."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from adrl.descriptions.controllers import CONTROLLERS, SHIM, Names, class_of, first
from adrl.descriptions.findings import CAR_LIKE, OMNI, Finding, Reading, Standing
from adrl.errors import ConfigError, FileError, brief
from adrl.yaml_files import read_yaml

Parameters = Mapping[str, Any]
NODE = "ros__parameters"
"""Below it are a node's parameters in ROS 2."""
SUBSTITUTION = re.compile(r"\$\(|<\w+>")
"""What a launch file fills in."""
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
CORNER = re.compile(rf"\[\s*({NUMBER})\s*,\s*({NUMBER})\s*\]")
LONGEST_FOOTPRINT = 10_000
MOST_DOTS = 8
"""In a key; one with more is no way to a parameter."""
STAMPING = ("controller_server", "velocity_smoother")
"""Nodes that publish commands."""
LINEAR, SIDEWAYS, TURN = range(3)
"""Numbers of a velocity in the velocity smoother."""


def read_nav2(paths: Sequence[Path], scan_topic: str | None = None) -> Reading:
    """What parameter files say together. scan_topic: of the LiDAR that is meant, where there are several.

    Raises ConfigError for a file that cannot be read, a number that is none, a robot that is omni-directional or
    car-like, and several LiDARs.
    """
    sections = [section for path in paths for section in _sections(path)]
    reader = _Reader(sections, scan_topic)
    for path in paths:
        reader.read([section for section in sections if section.path == path])
    reader.choose_scan()
    return reader.reading


class _Reader:
    def __init__(self, sections: "list[_Section]", scan_topic: str | None) -> None:
        self.reading = Reading()
        self._wanted = scan_topic
        self._scans: list[tuple[str, str, list[Finding]]] = []
        """Topic, place, and what is known of the LiDAR on it."""
        planners = (section.parameters.get("base_local_planner") for section in sections)
        self._planners = {class_of(planner) for planner in planners if planner is not None}
        """Classes of controllers that move_base is to use: its files often have several."""

    def read(self, sections: "list[_Section]") -> None:
        """Add what a file says."""
        before = len(self.reading.findings) + len(self._scans)
        for section in sections:
            self._costmap(section)
            self._controller(section)
            _smoother(section)
            _motion_model(section)
            _frames(section)
            self.reading.findings.extend(section.reading.findings)
            self.reading.notes.extend(section.reading.notes)
        path = sections[0].path
        if len(self.reading.findings) + len(self._scans) == before:
            raise ConfigError(
                f"{path} says nothing of a robot: no costmap, controller, velocity smoother or amcl is in it; give "
                "Nav2's parameter file, or those of move_base"
            )
        ros = "ros2" if any(NODE in section.where for section in sections) else "ros1"
        self.reading.add("ros", ros, str(path), Standing.HINT)

    def _costmap(self, section: "_Section") -> None:
        section.add("radius_m", section.number("robot_radius"), "robot_radius")
        corners = _corners(section)
        if corners is not None:
            section.add("footprint_m", corners, "footprint")
        sources = section.parameters.get("observation_sources")
        names = sources.split() if isinstance(sources, str) else sources if isinstance(sources, list) else []
        for name in map(str, names):
            source = section.parameters.get(name)
            if isinstance(source, Mapping) and source.get("data_type") == "LaserScan":
                self._scan(_Section(section.path, (*section.where, name), source, {}))

    def _scan(self, source: "_Section") -> None:
        topic = source.text("topic")
        self.reading.notes.extend(source.reading.notes)
        if topic is None:
            return
        used_to = [name for name in ("obstacle_max_range", "obstacle_range") if name in source.parameters]
        used_to += [name for name in ("raytrace_max_range", "raytrace_range") if name in source.parameters]
        if used_to:
            name = min(used_to, key=lambda name: source.number(name) or math.inf)
            source.add("lidar.max_range_m", source.number(name), name, Standing.HINT)
        rate = source.number("expected_update_rate")  # seconds, whatever its name says
        source.add("control_period_s", rate or None, "expected_update_rate", Standing.HINT)
        self._scans.append((topic, source.place("topic"), source.reading.findings))

    def choose_scan(self) -> None:
        """Add the LiDAR that is meant."""
        topics: dict[str, str] = {}
        for topic, place, _ in self._scans:
            if self._wanted is None or _absolute(topic) == _absolute(self._wanted):
                topics.setdefault(_absolute(topic), place)
        if len(topics) > 1:
            told = " and ".join(f"{topic} ({place})" for topic, place in topics.items())
            choices = ", or ".join(f"--scan-topic {topic}" for topic in topics)
            raise ConfigError(f"several LiDARs: {told}; ADRL drives by one, say which: {choices}")
        for topic, place, findings in self._scans:
            if _absolute(topic) in topics:
                self.reading.add("scan_topic", _absolute(topic), place)
                self.reading.findings.extend(findings)

    def _controller(self, section: "_Section") -> None:
        name, parameters = section.where[-1] if section.where else "", section.parameters
        used = section.parent.get("controller_plugins")
        plugin = class_of(parameters.get("plugin", name))
        if plugin == SHIM and isinstance(parameters.get("primary_controller"), str):
            plugin = class_of(parameters["primary_controller"])
        if isinstance(used, list) and "plugin" in parameters and name not in used:
            return
        if self._planners and NODE not in section.where and plugin not in self._planners:
            return
        if plugin in CONTROLLERS:
            _limits(section, CONTROLLERS[plugin])
        elif isinstance(used, list) and name in used and plugin != SHIM:
            known = ", ".join(CONTROLLERS)
            self.reading.notes.append(
                f"{section.place('plugin')} is {plugin}, whose numbers are not read; known: {known}"
            )


class _Section:
    """The parameters at a place of a file, and what they say."""

    def __init__(
        self, path: Path, where: tuple[str, ...], parameters: Parameters, parent: Parameters
    ) -> None:
        self.path, self.where, self.parameters, self.parent = path, where, parameters, parent
        self.reading = Reading()

    def place(self, name: str) -> str:
        """The file, and the way to a parameter in it."""
        way = ".".join(part for part in (*self.where, name) if part != NODE)
        return f"{self.path}: {brief(way)}"

    def add(self, field: str, value: Any, name: str, standing: Standing = Standing.SAID) -> None:
        """What a parameter says of a field; nothing where the value is None."""
        if value is not None:
            self.reading.add(field, value, self.place(name), standing)

    def number(self, name: str) -> float | None:
        """A parameter; None where it is not there, or is left to a launch file. Raises ConfigError."""
        return self._number(name, self.parameters.get(name))

    def _number(self, name: str, value: Any) -> float | None:
        if value is None or (isinstance(value, str) and self._left_open(name, value)):
            return None
        good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9
        if not good:
            raise ConfigError(f"{self.place(name)} is {brief(repr(value))[:60]}; give a number")
        return float(value)

    def numbers(self, name: str) -> list[float | None]:
        """Up to three numbers of a list, None for those that are not there. Raises ConfigError."""
        value = self.parameters.get(name)
        if value is not None and not isinstance(value, list):
            raise ConfigError(f"{self.place(name)} is {brief(repr(value))[:60]}; give a list of numbers")
        found = [self._number(f"{name}[{i}]", part) for i, part in enumerate((value or [])[:3])]
        return found + [None] * (3 - len(found))

    def text(self, name: str) -> str | None:
        """A parameter that is a text; None where it is not there, empty, or left to a launch file."""
        value = self.parameters.get(name)
        return value if isinstance(value, str) and value and not self._left_open(name, value) else None

    def _left_open(self, name: str, value: str) -> bool:
        if SUBSTITUTION.search(value) is None:
            return False
        self.reading.notes.append(f"{self.place(name)} is {brief(value)[:60]}, which a launch file fills in")
        return True


def _sections(path: Path) -> "list[_Section]":
    """All mappings of a file. Raises ConfigError."""
    try:
        content = read_yaml(path)
    except FileError as error:
        raise ConfigError(f"{path} {error}; give Nav2's parameter file") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds no parameters; give Nav2's parameter file")
    return [_Section(path, *found) for found in _walk((), _nested(content, path), {})]


def _walk(
    where: tuple[str, ...], parameters: Parameters, parent: Parameters
) -> Iterator[tuple[tuple[str, ...], Parameters, Parameters]]:
    """The way to a mapping, itself and the one around it; then those in it."""
    yield where, parameters, parent
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from _walk((*where, name), value, parameters)


def _nested(content: Parameters, path: Path) -> dict[str, Any]:
    """With a.b written out as b in a, as ROS 2 reads it. Raises ConfigError for what is then there twice."""
    nested: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            value = _nested(value, path)
        *outer, last = str(key).split(".") if str(key).count(".") < MOST_DOTS else [str(key)]
        place = nested
        for name in outer:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise ConfigError(f"{path} has {brief(key)!r} and a value for {name!r}; leave one")
        if isinstance(value, dict) and isinstance(place.get(last), dict):
            value = place[last] | value
        elif last in place:
            raise ConfigError(f"{path} has {brief(key)!r} twice; leave one")
        place[last] = value
    return nested


def _limits(section: _Section, names: Names) -> None:
    """What a controller drives the robot by. Raises ConfigError for a robot of another kind."""
    parameters = section.parameters
    if section.where[-1] == "TrajectoryPlannerROS" and parameters.get("holonomic_robot") is True:
        raise ConfigError(f"{section.place('holonomic_robot')} is true: that is {OMNI}")
    for group, kind in ((names.sideways, OMNI), (names.turning_radius, CAR_LIKE)):
        name = first(parameters, group)
        if name is not None and (section.number(name) or 0.0) > 1e-3:
            raise ConfigError(f"{section.place(name)} is {section.number(name):g}: that is {kind}")
    model = parameters.get("motion_model")
    for word, kind in (("Omni", OMNI), ("Ackermann", CAR_LIKE)):
        if model == word:
            raise ConfigError(f"{section.place('motion_model')} is {model}: that is {kind}")
    speed = first(parameters, names.speed)
    if speed is not None:
        section.add("max_speed_mps", section.number(speed), speed)
        _least_speed(section, names, section.number(speed) or 0.0)
    for field, group in (
        ("max_acceleration_mps2", names.accelerations),
        ("max_yaw_acceleration_radps2", names.yaw_accelerations),
    ):
        _weakest(section, field, {name: section.number(name) for name in group}, Standing.SAID)
    for group, standing in ((names.yaw_rate, Standing.SAID), (names.turns_on_the_spot, Standing.HINT)):
        name = first(parameters, group)
        if name is not None:
            section.add("max_yaw_rate_radps", section.number(name), name, standing)


def _least_speed(section: _Section, names: Names, speed: float) -> None:
    field = "min_speed_mps"
    if names.reverses:
        name = names.reverses[0]
        section.add(field, -speed if section.parameters.get(name) is True else 0.0, name)
    if (name := first(section.parameters, names.backwards)) is not None:
        section.add(field, -abs(section.number(name) or 0.0), name)
    if (name := first(section.parameters, names.least_speed)) is not None:
        section.add(field, min(section.number(name) or 0.0, 0.0), name)
    elif names.least_when_left_out is not None:
        section.add(field, names.least_when_left_out, f"{names.least_speed[0]}, left out")


def _weakest(section: _Section, field: str, values: Mapping[str, float | None], standing: Standing) -> None:
    """The least, as the robot brakes and speeds up by one number; 0 stands for none in several controllers."""
    given = {name: abs(value) for name, value in values.items() if value}
    if given:
        name = min(given, key=lambda name: given[name])
        section.add(field, given[name], name, standing)


def _smoother(section: _Section) -> None:
    """The velocity smoother, which bounds whatever a controller says."""
    if not {"max_velocity", "max_accel"} <= section.parameters.keys():
        return
    most, least = section.numbers("max_velocity"), section.numbers("min_velocity")
    if (most[SIDEWAYS] or 0.0) > 1e-3:
        raise ConfigError(f"{section.place('max_velocity[1]')} is {most[SIDEWAYS]:g}: that is {OMNI}")
    section.add("max_speed_mps", most[LINEAR], "max_velocity[0]", Standing.LIMIT)
    section.add("max_yaw_rate_radps", most[TURN], "max_velocity[2]", Standing.LIMIT)
    if (reverse := least[LINEAR]) is not None:
        section.add("min_speed_mps", min(reverse, 0.0), "min_velocity[0]", Standing.LIMIT)
    rise, fall = section.numbers("max_accel"), section.numbers("max_decel")
    for axis, field in ((LINEAR, "max_acceleration_mps2"), (TURN, "max_yaw_acceleration_radps2")):
        values = {f"max_accel[{axis}]": rise[axis], f"max_decel[{axis}]": fall[axis]}
        _weakest(section, field, values, Standing.LIMIT)


def _motion_model(section: _Section) -> None:
    """Of amcl. Raises ConfigError."""
    for name in ("robot_model_type", "odom_model_type"):
        model = str(section.parameters.get(name, ""))
        if "omni" in model.lower():
            raise ConfigError(f"{section.place(name)} is {brief(model)}: that is {OMNI}")


def _frames(section: _Section) -> None:
    """Frames, topics and the rate, which the command needs that drives the robot."""
    node = next((part for part in reversed(section.where) if part != NODE), "")
    said = (("local_costmap", "odom_frame", "global_frame"), ("global_costmap", "map_frame", "global_frame"))
    for costmap, field, name in said:
        if node == costmap:
            section.add(field, _frame(section.text(name)), name)
    if node in ("local_costmap", "global_costmap"):
        section.add("base_frame", _frame(section.text("robot_base_frame")), "robot_base_frame")
    amcl = (
        ("base_frame", "base_frame_id"),
        ("odom_frame", "odom_frame_id"),
        ("map_frame", "global_frame_id"),
    )
    for field, name in amcl:
        section.add(field, _frame(section.text(name)), name, Standing.HINT)
    section.add("base_frame", _frame(section.text("robot_base_frame")), "robot_base_frame", Standing.HINT)
    section.add("odom_topic", section.text("odom_topic"), "odom_topic", Standing.HINT)
    if node in STAMPING and section.parameters.get("enable_stamped_cmd_vel") is True:
        section.add("stamped", True, "enable_stamped_cmd_vel")
    frequency = section.number("controller_frequency")
    if frequency and node not in CONTROLLERS:
        section.add("control_period_s", 1.0 / frequency, "controller_frequency", Standing.HINT)


def _frame(name: str | None) -> str | None:
    return name.strip("/") if name else None


def _absolute(topic: str) -> str:
    return f"/{topic.strip('/')}"


def _corners(section: _Section) -> tuple[tuple[float, float], ...] | None:
    """A costmap's footprint, a text or a list. None where it is left out or empty. Raises ConfigError."""
    value = section.parameters.get("footprint")
    if value is None or value == [] or (isinstance(value, str) and value.strip() in ("", "[]")):
        return None
    text = value if isinstance(value, str) else repr(value) if isinstance(value, list) else ""
    if isinstance(value, str) and section.text("footprint") is None:
        return None
    inner = text.strip()[1:-1] if len(text) <= LONGEST_FOOTPRINT and text.strip().startswith("[") else ""
    corners = CORNER.findall(inner)
    if not corners or re.sub(r"[\s,]", "", CORNER.sub("", inner)):
        raise ConfigError(
            f"{section.place('footprint')} is {brief(value)[:60]!r}; give corners, [[x, y], [x, y], [x, y]]"
        )
    return tuple((round(float(x), 6), round(float(y), 6)) for x, y in corners)
