"""URDF, with what Gazebo's tags in it say: LiDAR, footprint, limits of the drive. Needs the extra `urdf`."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from adrl.descriptions.findings import CAR, OMNI, TURNING_RADIUS, Reading, Standing, beams_of
from adrl.descriptions.recording import add_mount
from adrl.descriptions.urdf_body import Body, listed, parse
from adrl.descriptions.urdf_shapes import add_footprint
from adrl.errors import ConfigError, WorldError, brief
from adrl.geometry import level_mount
from adrl.worlds.sdf.document import words
from adrl.worlds.sdf.frames import pose_matrix

SENSORS = ("ray", "gpu_ray", "lidar", "gpu_lidar")
LIKELY = re.compile("scan|laser|lidar", re.IGNORECASE)
"""Names of links that may be a LiDAR."""
DIFFERENTIAL = re.compile("diff_?drive", re.IGNORECASE)
OMNI_DRIVE = re.compile("planar_?move|mecanum|omni|holonomic|swerve", re.IGNORECASE)
CAR_DRIVE = re.compile("ackermann|tricycle|car_?like", re.IGNORECASE)
LIMITS = {
    "max_linear_velocity": "max_speed_mps",
    "min_linear_velocity": "min_speed_mps",
    "max_angular_velocity": "max_yaw_rate_radps",
    "max_linear_acceleration": "max_acceleration_mps2",
    "max_angular_acceleration": "max_yaw_acceleration_radps2",
}
"""Of Gazebo's differential drive."""
CAR_LIMITS = {
    "max_velocity": "max_speed_mps",
    "min_velocity": "min_speed_mps",
    "max_acceleration": "max_acceleration_mps2",
}
"""Of its Ackermann steering."""
FRAMES = {"odometry_frame": "odom_frame", "odometryFrame": "odom_frame", "frame_id": "odom_frame"}
REMAPPED = re.compile(r"~/out:=(\S+)")


def read_urdf(path: Path, lidar: str | None = None, base: str | None = None) -> Reading:
    """What a URDF says.

    lidar: the link or sensor that is the LiDAR, where several or none are marked as one. base: the robot's frame by
    other sources, if that is a link of it. Raises MissingExtra without
    yourdfpy; ConfigError for a file that is no URDF, and for a robot without a LiDAR, with several, with one that is
    tilted or moves, or that is omni-directional.
    """
    root = parse(path)
    reading = Reading()
    try:
        _drive(reading, root, path)
        body = Body.of(root, path, base)
        sensor = _choose(list(_sensors(root)), lidar, body, path)
        _scan(reading, sensor, body, path)
        add_footprint(reading, body, path)
    except WorldError as error:  # of the numbers in it
        raise ConfigError(f"{path}: {error}") from None
    reading.add("base_frame", body.base, str(path), Standing.HINT)
    return reading


@dataclass(frozen=True, kw_only=True)
class _Sensor:
    """A LiDAR that Gazebo's tags mark."""

    link: str
    name: str
    element: Element = field(repr=False)

    @property
    def rays(self) -> Element | None:
        """What holds <scan> and <range>."""
        return next((e for tag in ("ray", "lidar") if (e := self.element.find(tag)) is not None), None)

    @property
    def rings(self) -> int:
        """Planes that it scans."""
        text = self.rays.findtext("scan/vertical/samples") if self.rays is not None else None
        return int(words(text, 1, f"<samples> of sensor {self.name!r}")[0]) if text else 1

    @property
    def is_range_finder(self) -> bool:
        """Such as a sonar: it says one distance."""
        plugins = [p.get("filename", "") + p.findtext("output_type", "") for p in self.element.iter("plugin")]
        return any(re.search("gazebo_ros_range|/Range|sonar", text) for text in plugins)


def _sensors(root: Element) -> Iterator[_Sensor]:
    for tags in root.iter("gazebo"):
        for sensor in tags.iter("sensor"):
            if sensor.get("type") in SENSORS:
                yield _Sensor(
                    link=tags.get("reference", ""), name=brief(sensor.get("name", "")), element=sensor
                )


def _choose(sensors: list[_Sensor], wanted: str | None, body: Body, path: Path) -> _Sensor | str:
    """The LiDAR, or the link that is one and of which nothing else is known. Raises ConfigError."""
    scanners = [sensor for sensor in sensors if not sensor.is_range_finder]
    if wanted is not None:
        named = [sensor for sensor in scanners if wanted in (sensor.link, sensor.name)]
        if named:
            scanners = named
        elif wanted in body.poses:
            return wanted
        else:
            raise ConfigError(f"{path} has no link {brief(wanted)!r}; it has {listed(list(body.shapes))}")
    flat = [sensor for sensor in scanners if sensor.rings <= 1]
    if len(flat) == 1:
        return flat[0]
    if flat:
        told = " and ".join(f"{sensor.name} on {sensor.link}" for sensor in flat)
        links = [sensor.link for sensor in flat]
        choices = links if len(set(links)) == len(links) else [sensor.name for sensor in flat]
        options = ", or ".join(f"--lidar {choice}" for choice in choices)
        raise ConfigError(f"{path} has several LiDARs: {told}; ADRL drives by one, say which: {options}")
    if scanners:
        raise ConfigError(
            f"{path}: sensor {scanners[0].name!r} scans {scanners[0].rings} planes, and ADRL drives by one; make a "
            "LaserScan of its points, and give --lidar LINK, the link that is the scan's frame"
        )
    likely = [name for name in body.shapes if LIKELY.search(name)] or list(body.shapes)
    raise ConfigError(
        f"{path} has no LiDAR: no <gazebo reference=LINK> holds a <sensor> of type {', '.join(SENSORS)}; give "
        f"--lidar LINK, the link that is one: {listed(likely)}"
    )


def _scan(reading: Reading, sensor: _Sensor | str, body: Body, path: Path) -> None:
    """Where the LiDAR sits, and what it sees. Raises ConfigError, WorldError."""
    link = sensor if isinstance(sensor, str) else sensor.link
    if link not in body.poses:
        raise ConfigError(
            f"{path} has a LiDAR on {brief(link)!r}, which is no link of it; mend its reference"
        )
    joint = body.movable(link)
    if joint is not None:
        raise ConfigError(
            f"{path}: the LiDAR on {link} moves on the robot, by joint {joint!r}; only a fixed one can be used"
        )
    pose, middle, place = body.poses[link], 0.0, f"{path}: link {link}"
    if not isinstance(sensor, str):
        pose = pose @ pose_matrix(sensor.element.find("pose"), f"sensor {sensor.name!r}")
        middle = _beams(reading, sensor, f"{path}: sensor {sensor.name}")
    try:
        mount, upside_down = level_mount(pose[:3, 3], pose[:3, :3])
    except ValueError as error:
        raise ConfigError(f"{path}: the LiDAR on {link} {error}: mend its joints") from None
    add_mount(reading, mount, upside_down, middle, place)


def _beams(reading: Reading, sensor: _Sensor, place: str) -> float:
    """Add what the sensor's tags say; returns the angle of the scan's middle."""

    def number(owner: Element, way: str) -> float | None:
        text = owner.findtext(way)
        return None if text is None else words(text, 1, f"<{way}> of {place}")[0]

    rate = number(sensor.element, "update_rate")
    if rate:
        reading.add("control_period_s", 1.0 / rate, f"{place}, update_rate")
    topic = sensor.element.findtext("topic") or _plugin_topic(sensor.element)
    if topic:
        reading.add("scan_topic", f"/{topic.strip().strip('/')}", place, Standing.HINT)
    rays = sensor.rays
    if rays is None:
        return 0.0
    for way, name in (("range/max", "lidar.max_range_m"), ("noise/stddev", "lidar.noise_std_m")):
        value = number(rays, way)
        if value is not None:
            reading.add(name, value, f"{place}, {way}")
    across = "scan/horizontal"
    count, first, last = (number(rays, f"{across}/{name}") for name in ("samples", "min_angle", "max_angle"))
    if count is None or first is None or last is None or count < 1:
        return 0.0
    return beams_of(reading, int(count), first, last, f"{place}, {across}")


def _plugin_topic(sensor: Element) -> str | None:
    for plugin in sensor.iter("plugin"):
        texts = [e.text or "" for e in plugin.iter() if e.tag in ("argument", "remapping")]
        found = [match[1] for text in texts if (match := REMAPPED.search(text))]
        if found or plugin.findtext("topicName"):
            return found[0] if found else plugin.findtext("topicName")
    return None


def _drive(reading: Reading, root: Element, path: Path) -> None:
    """Limits and frames of the plugin that drives the robot. Raises ConfigError for one of another kind."""
    for plugin in (p for tags in root.iter("gazebo") for p in tags.iter("plugin")):
        kind = f"{plugin.get('filename', '')} {plugin.get('name', '')}"
        if OMNI_DRIVE.search(kind):
            raise ConfigError(f"{path} has the plugin {brief(kind)}: that is {OMNI}")
        if CAR_DRIVE.search(kind):
            reading.add(CAR, True, f"{path}: plugin {brief(kind)}")
            _steering(reading, plugin, f"the plugin {brief(kind)}", path)
        elif not DIFFERENTIAL.search(kind):
            continue
        for tag, name in (CAR_LIMITS if CAR_DRIVE.search(kind) else LIMITS).items():
            text = plugin.findtext(tag)
            if text is not None:
                (value,) = words(text, 1, f"<{tag}> of the plugin {brief(kind)}")
                reading.add(name, value, f"{path}: {tag}", Standing.LIMIT)
        for tag, name in FRAMES.items():
            if frame := (plugin.findtext(tag) or "").strip().strip("/"):
                reading.add(name, brief(frame), f"{path}: {tag}", Standing.HINT)


def _steering(reading: Reading, plugin: Element, what: str, path: Path) -> None:
    """The tightest curve of a car whose wheel base and greatest steering angle its plugin tells."""
    texts = [plugin.findtext(tag) for tag in ("wheel_base", "steering_limit")]
    if texts[0] is None or texts[1] is None:
        return
    (wheel_base,) = words(texts[0], 1, f"<wheel_base> of {what}")
    (steering,) = words(texts[1], 1, f"<steering_limit> of {what}")
    if wheel_base > 0.0 and 0.0 < steering < 0.5 * math.pi:
        place = f"{path}: wheel_base over the tangent of steering_limit"
        reading.add(TURNING_RADIUS, wheel_base / math.tan(steering), place)
