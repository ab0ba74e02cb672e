"""Parameter files of Nav2, and of move_base: costmaps, controllers, velocity smoother, frames."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from adrl.descriptions.controllers import CAR_PLANNERS, CONTROLLERS, SHIM, Names, class_of
from adrl.descriptions.findings import CAR, OMNI, TURNING_RADIUS, Finding, Reading, Standing
from adrl.descriptions.parameters import NODE, Section, read_sections
from adrl.errors import ConfigError, brief

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
CORNER = re.compile(rf"\[\s*({NUMBER})\s*,\s*({NUMBER})\s*\]")
LONGEST_FOOTPRINT = 10_000
STAMPING = ("controller_server", "velocity_smoother")
"""Nodes that publish commands."""
AMCL_FRAMES = {
    "base_frame": "base_frame_id",
    "odom_frame": "odom_frame_id",
    "map_frame": "global_frame_id",
}
LINEAR, SIDEWAYS, TURN = range(3)
"""Numbers of a velocity in the velocity smoother."""


def read_nav2(paths: Sequence[Path], scan_topic: str | None = None) -> Reading:
    """What parameter files say together. scan_topic: of the LiDAR that is meant, where there are several.

    Raises ConfigError for a file that cannot be read, a number that is none, a robot that is omni-directional, and
    several LiDARs.
    """
    sections = [section for path in paths for section in read_sections(path)]
    reader = _Reader(sections, scan_topic)
    for path in paths:
        reader.read([section for section in sections if section.path == path])
    reader.choose_scan()
    reader.choose_kind()
    return reader.reading


class _Reader:
    def __init__(self, sections: list[Section], scan_topic: str | None) -> None:
        self.reading = Reading()
        self._wanted = scan_topic
        self._scans: list[tuple[str, str, list[Finding]]] = []
        """Topic, place, and what is known of the LiDAR on it."""
        planners = (section.parameters.get("base_local_planner") for section in sections)
        self._never_turns: str | None = None
        """Place that says that the robot is not turned on the spot."""
        self._planners = {class_of(planner) for planner in planners if planner is not None}
        """Classes of controllers that move_base is to use: its files often have several."""

    def read(self, sections: list[Section]) -> None:
        """Add what a file says."""
        before = len(self.reading.findings) + len(self._scans)
        for section in sections:
            self._costmap(section)
            self._controller(section)
            _car_planner(section)
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

    def _costmap(self, section: Section) -> None:
        section.add("radius_m", section.number("robot_radius") or None, "robot_radius")
        corners = _corners(section)
        if corners is not None:
            section.add("footprint_m", corners, "footprint")
        sources = section.get("observation_sources")
        names = sources.split() if isinstance(sources, str) else sources if isinstance(sources, list) else []
        for name in map(str, names):
            source = section.parameters.get(name)
            if isinstance(source, Mapping) and source.get("data_type") == "LaserScan":
                self._scan(Section(section.path, (*section.where, name), source, {}))

    def _scan(self, source: Section) -> None:
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

    def choose_kind(self) -> None:
        """A car, where no controller says so: a planner of curves, and a controller that never turns on the spot."""
        said = {finding.field: finding for finding in self.reading.findings}
        if CAR in said or TURNING_RADIUS not in said:
            return
        if self._never_turns is not None:
            self.reading.add(CAR, True, self._never_turns)
        else:
            hint = said[TURNING_RADIUS]
            self.reading.notes.append(
                f"{hint.place} is {hint.value:g}: of a robot that is car-like, which nothing here says; if it is, "
                f"--set {TURNING_RADIUS}={hint.value:g}"
            )

    def _controller(self, section: Section) -> None:
        name = section.where[-1] if section.where else ""
        used = section.parent.get("controller_plugins")
        if isinstance(used, list) and "plugin" in section.parameters and name not in used:
            return
        plugin = class_of(section.text("plugin") or name)
        shim = plugin == SHIM
        if shim:
            plugin = class_of(section.text("primary_controller") or SHIM)
        if self._planners and NODE not in section.where and plugin not in self._planners:
            return
        if plugin in CONTROLLERS:
            names = CONTROLLERS[plugin]
            _limits(section, names)
            if names.turns is not None and section.get(names.turns) is False and not shim:
                self._never_turns = section.place(names.turns)
        elif isinstance(used, list) and name in used and plugin != SHIM:
            known = ", ".join(CONTROLLERS)
            self.reading.notes.append(
                f"{section.place('plugin')} is {plugin}, whose numbers are not read; known: {known}"
            )


def _limits(section: Section, names: Names) -> None:
    """What a controller drives the robot by. Raises ConfigError for a robot of another kind."""
    if section.where[-1] == "TrajectoryPlannerROS" and section.get("holonomic_robot") is True:
        raise ConfigError(f"{section.place('holonomic_robot')} is true: that is {OMNI}")
    for name in names.sideways:
        if abs(section.number(name) or 0.0) > 1e-3:
            raise ConfigError(f"{section.place(name)} is {section.number(name):g}: that is {OMNI}")
    if section.get("motion_model") == "Omni":
        raise ConfigError(f"{section.place('motion_model')} is Omni: that is {OMNI}")
    _turning_radius(section, names)
    speed = section.first(names.speed)
    if speed is not None:
        section.add("max_speed_mps", section.number(speed), speed)
        _least_speed(section, names, section.number(speed) or 0.0)
    for field, group in (
        ("max_acceleration_mps2", names.accelerations),
        ("max_yaw_acceleration_radps2", names.yaw_accelerations),
    ):
        _weakest(section, field, {name: section.number(name) for name in group}, Standing.SAID)
    for group, standing in ((names.yaw_rate, Standing.SAID), (names.turns_on_the_spot, Standing.HINT)):
        name = section.first(group)
        if name is not None:
            section.add("max_yaw_rate_radps", section.number(name), name, standing)


def _turning_radius(section: Section, names: Names) -> None:
    """Whether the controller drives a car, and how tight a curve."""
    name = section.first(names.turning_radius)
    if name is not None and (section.number(name) or 0.0) > 1e-3:
        section.add(CAR, True, name)
        section.add(TURNING_RADIUS, section.number(name), name)
    if section.get("motion_model") == "Ackermann":
        section.add(CAR, True, "motion_model")
        constraints = section.parameters.get("AckermannConstraints")
        if isinstance(constraints, Mapping):
            inner = Section(section.path, (*section.where, "AckermannConstraints"), constraints, {})
            inner.add(TURNING_RADIUS, inner.number("min_turning_r"), "min_turning_r")
            section.reading.findings.extend(inner.reading.findings)
            section.reading.notes.extend(inner.reading.notes)


def _car_planner(section: Section) -> None:
    """A planner of curves, whose radius is a car's where another source says that the robot is one."""
    if class_of(section.text("plugin") or "") in CAR_PLANNERS:
        name = "minimum_turning_radius"
        section.add(TURNING_RADIUS, section.number(name) or None, name, Standing.HINT)


def _least_speed(section: Section, names: Names, speed: float) -> None:
    field = "min_speed_mps"
    if names.reverses:
        name = names.reverses[0]
        section.add(field, -speed if section.get(name) is True else 0.0, name)
    if (name := section.first(names.backwards)) is not None:
        section.add(field, -abs(section.number(name) or 0.0), name)
    if (name := section.first(names.least_speed)) is not None:
        section.add(field, min(section.number(name) or 0.0, 0.0), name)
    elif names.least_when_left_out is not None:
        section.add(field, names.least_when_left_out, f"{names.least_speed[0]}, left out")


def _weakest(section: Section, field: str, values: Mapping[str, float | None], standing: Standing) -> None:
    """The least, as the robot brakes and speeds up by one number; 0 stands for none in several controllers."""
    given = {name: abs(value) for name, value in values.items() if value}
    if given:
        name = min(given, key=lambda name: given[name])
        section.add(field, given[name], name, standing)


def _smoother(section: Section) -> None:
    """The velocity smoother, which bounds whatever a controller says."""
    if not {"max_velocity", "max_accel"} <= section.parameters.keys():
        return
    most, least = section.numbers("max_velocity"), section.numbers("min_velocity")
    for name, speeds in (("max_velocity", most), ("min_velocity", least)):
        sideways = speeds[SIDEWAYS] or 0.0
        if abs(sideways) > 1e-3:
            raise ConfigError(f"{section.place(f'{name}[1]')} is {sideways:g}: that is {OMNI}")
    section.add("max_speed_mps", most[LINEAR], "max_velocity[0]", Standing.LIMIT)
    section.add("max_yaw_rate_radps", most[TURN], "max_velocity[2]", Standing.LIMIT)
    if (reverse := least[LINEAR]) is not None:
        section.add("min_speed_mps", min(reverse, 0.0), "min_velocity[0]", Standing.LIMIT)
    rise, fall = section.numbers("max_accel"), section.numbers("max_decel")
    for axis, field in ((LINEAR, "max_acceleration_mps2"), (TURN, "max_yaw_acceleration_radps2")):
        values = {f"max_accel[{axis}]": rise[axis], f"max_decel[{axis}]": fall[axis]}
        _weakest(section, field, values, Standing.LIMIT)


def _motion_model(section: Section) -> None:
    """Of amcl. Raises ConfigError."""
    for name in ("robot_model_type", "odom_model_type"):
        model = str(section.get(name) or "")
        if "omni" in model.lower():
            raise ConfigError(f"{section.place(name)} is {brief(model)}: that is {OMNI}")


def _frames(section: Section) -> None:
    """Frames, topics and the rate, which the command needs that drives the robot."""
    node = next((part for part in reversed(section.where) if part != NODE), "")
    said = (("local_costmap", "odom_frame", "global_frame"), ("global_costmap", "map_frame", "global_frame"))
    for costmap, field, name in said:
        if node == costmap:
            section.add(field, _frame(section.text(name)), name)
    if node in ("local_costmap", "global_costmap"):
        section.add("base_frame", _frame(section.text("robot_base_frame")), "robot_base_frame")
    if "base_frame_id" in section.parameters:  # amcl, whatever it is called
        for field, name in AMCL_FRAMES.items():
            section.add(field, _frame(section.text(name)), name, Standing.HINT)
    section.add("base_frame", _frame(section.text("robot_base_frame")), "robot_base_frame", Standing.HINT)
    section.add("odom_topic", section.text("odom_topic"), "odom_topic", Standing.HINT)
    if node in STAMPING and section.get("enable_stamped_cmd_vel") is True:
        section.add("stamped", True, "enable_stamped_cmd_vel")
    frequency = section.number("controller_frequency")
    if frequency and node not in CONTROLLERS:
        section.add("control_period_s", 1.0 / frequency, "controller_frequency", Standing.HINT)


def _frame(name: str | None) -> str | None:
    return name.strip("/") if name else None


def _absolute(topic: str) -> str:
    return f"/{topic.strip('/')}"


def _corners(section: Section) -> tuple[tuple[float, float], ...] | None:
    """A costmap's footprint, a text or a list. None where it is left out or empty. Raises ConfigError."""
    value = section.get("footprint")
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
