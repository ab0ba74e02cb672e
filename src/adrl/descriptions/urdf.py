"""URDF, with what Gazebo's tags in it say: LiDAR, footprint, limits of the drive. Needs the extra `urdf`."""

import io
import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from adrl import files
from adrl.descriptions.findings import CAR_LIKE, OMNI, Reading, Standing, beams_of
from adrl.descriptions.outline import footprint_of
from adrl.descriptions.recording import add_mount
from adrl.errors import ConfigError, FileError, MissingExtra, WorldError, brief
from adrl.geometry import level_mount
from adrl.types import Array
from adrl.worlds.sdf.document import element_of, words
from adrl.worlds.sdf.footprint import Box, Footprint, Solid, cylinder, sphere
from adrl.worlds.sdf.frames import pose_matrix
from adrl.worlds.sdf.library import Library
from adrl.worlds.sdf.mesh import Mesh, Surface, load_surface

MAX_BYTES = 16 * 2**20
TALL_M = 2.0
"""What is higher above the robot's lowest point is above what it drives by, as Nav2's costmaps have it."""
SENSORS = ("ray", "gpu_ray", "lidar", "gpu_lidar")
BASES = ("base_link", "base_footprint")
"""Links that are the robot's frame, by REP 105; else it is the root."""
LIKELY = re.compile("scan|laser|lidar", re.IGNORECASE)
"""Names of links that may be a LiDAR."""
DIFFERENTIAL = re.compile("diff_?drive", re.IGNORECASE)
OTHER_DRIVES = {"planar_?move|mecanum|omni": OMNI, "ackermann|tricycle": CAR_LIKE}
LIMITS = {
    "max_linear_velocity": "max_speed_mps",
    "min_linear_velocity": "min_speed_mps",
    "max_angular_velocity": "max_yaw_rate_radps",
    "max_linear_acceleration": "max_acceleration_mps2",
    "max_angular_acceleration": "max_yaw_acceleration_radps2",
}
"""Of Gazebo's differential drive."""
FRAMES = {"odometry_frame": "odom_frame", "odometryFrame": "odom_frame", "frame_id": "odom_frame"}
REMAPPED = re.compile(r"~/out:=(\S+)")


def read_urdf(path: Path, lidar: str | None = None) -> Reading:
    """What a URDF says.

    lidar: the link or sensor that is the LiDAR, where several or none are marked as one. Raises MissingExtra without
    yourdfpy; ConfigError for a file that is no URDF, and for a robot without a LiDAR, with several, with one that is
    tilted or moves, or that is omni-directional or car-like.
    """
    root = _parse(path)
    reading = Reading()
    try:
        _drive(reading, root, path)
        body = _Body.of(root, path)
        sensor = _choose(list(_sensors(root)), lidar, body, path)
        _scan(reading, sensor, body, path)
        _footprint(reading, body, path)
    except WorldError as error:  # of the numbers in it
        raise ConfigError(f"{path}: {error}") from None
    reading.add("base_frame", body.base, str(path), Standing.HINT)
    return reading


def _parse(path: Path) -> Element:
    """The <robot>. Raises ConfigError."""
    try:
        root = element_of(files.read_bytes(path, MAX_BYTES))
    except FileError as error:
        raise ConfigError(f"{path} {error}; give a URDF") from None
    except expat.ExpatError as error:
        raise ConfigError(f"{path} is not well-formed XML: {error}; give a URDF") from None
    except (LookupError, ValueError, AssertionError):
        raise ConfigError(f"{path} is no XML that can be read; save it as UTF-8, and give a URDF") from None
    except WorldError as error:
        raise ConfigError(f"{path} {error}") from None
    if any(e.tag.startswith("xacro:") or "${" in "".join(e.attrib.values()) for e in root.iter()):
        raise ConfigError(f"{path} is a xacro file; run: xacro {path} > robot.urdf, and give robot.urdf")
    if root.tag != "robot":
        raise ConfigError(f"{path} is no URDF: it has <{brief(root.tag)}> instead of <robot>")
    return root


Step = tuple[str, str, str]
"""From a link to the one that it hangs on, by a joint, of a type."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Body:
    """Links, and where they are on the robot while its joints are at 0."""

    base: str
    """The link that is the robot's frame."""
    shapes: Mapping[str, list[Any]]
    """Link -> its collisions, as yourdfpy has them."""
    parents: Mapping[str, Step]
    poses: Mapping[str, Array]
    """Link -> (4, 4) in the base."""

    @classmethod
    def of(cls, root: Element, path: Path) -> "_Body":
        """Raises ConfigError."""
        try:
            import yourdfpy
        except ModuleNotFoundError:
            raise MissingExtra.named("urdf", "reading a URDF") from None
        try:
            with _quiet():
                urdf: Any = yourdfpy.URDF.load(io.BytesIO(ElementTree.tostring(root)), load_meshes=False)
                links = list(urdf.link_map)
                base = next((name for name in BASES if name in links), urdf.base_link)
                poses = {name: np.asarray(urdf.get_transform(name, base)) for name in links}
            shapes = {name: list(urdf.link_map[name].collisions) for name in links}
            parents = {j.child: (j.parent, j.name, j.type) for j in urdf.robot.joints}
        except Exception as error:  # what a URDF that is none makes yourdfpy raise is not documented
            what = brief(f"{type(error).__name__}: {error}")
            raise ConfigError(f"{path} is no URDF that can be used ({what}); check it: check_urdf") from None
        wrong = _tree_fault(list(shapes), [j.child for j in urdf.robot.joints], parents)
        if wrong is not None:
            raise ConfigError(f"{path} is no tree of links: {wrong}; check it: check_urdf")
        if not all(np.isfinite(pose).all() and np.abs(pose).max() < 1e6 for pose in poses.values()):
            raise ConfigError(f"{path} has a joint whose <origin> is no place; give finite numbers")
        return cls(base=base, shapes=shapes, parents=parents, poses=poses)

    def movable(self, link: str) -> str | None:
        """A joint between a link and the base that is not fixed; None where the link is at rest on the robot."""
        ways = [_way(link, self.parents), _way(self.base, self.parents)]
        apart = [step for way, other in (ways, ways[::-1]) for step in way if step not in other]
        return next((name for _, name, kind in apart if kind != "fixed"), None)


def _way(link: str, parents: Mapping[str, Step]) -> list[Step]:
    """The steps from a link up to the root; in a loop one more than there are links."""
    way: list[Step] = []
    while link in parents and len(way) <= len(parents):
        way.append(parents[link])
        link = parents[link][0]
    return way


def _tree_fault(links: list[str], children: list[str], parents: Mapping[str, Step]) -> str | None:
    """Why links and joints are no tree; None where they are one."""
    twice = next((child for child in children if children.count(child) > 1), None)
    if twice is not None:
        return f"{brief(twice)} hangs on several joints"
    loop = next((link for link in links if len(_way(link, parents)) > len(parents)), None)
    if loop is not None:
        return f"{brief(loop)} hangs on itself"
    roots = [link for link in links if link not in parents]
    return f"{_listed(roots)} hang on no joint, and one has to" if len(roots) > 1 else None


class _quiet:
    """Without yourdfpy's log: what matters of it is an error."""

    def __enter__(self) -> None:
        self._before = logging.root.manager.disable
        logging.disable(logging.CRITICAL)

    def __exit__(self, *_: object) -> None:
        logging.disable(self._before)


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


def _choose(sensors: list[_Sensor], wanted: str | None, body: _Body, path: Path) -> _Sensor | str:
    """The LiDAR, or the link that is one and of which nothing else is known. Raises ConfigError."""
    scanners = [sensor for sensor in sensors if not sensor.is_range_finder]
    if wanted is not None:
        named = [sensor for sensor in scanners if wanted in (sensor.link, sensor.name)]
        if named:
            scanners = named
        elif wanted in body.poses:
            return wanted
        else:
            raise ConfigError(f"{path} has no link {brief(wanted)!r}; it has {_listed(list(body.poses))}")
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
    likely = [name for name in body.poses if LIKELY.search(name)] or list(body.poses)
    raise ConfigError(
        f"{path} has no LiDAR: no <gazebo reference=LINK> holds a <sensor> of type {', '.join(SENSORS)}; give "
        f"--lidar LINK, the link that is one: {_listed(likely)}"
    )


def _listed(names: list[str]) -> str:
    return ", ".join(map(brief, names[:8])) + (", ..." if len(names) > 8 else "")


def _scan(reading: Reading, sensor: _Sensor | str, body: _Body, path: Path) -> None:
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


def _footprint(reading: Reading, body: _Body, path: Path) -> None:
    """The hull of all collisions; nothing where one of them cannot be read."""
    library, solids = Library(), list[Solid]()
    for link, shapes in body.shapes.items():
        for shape in shapes:
            origin = np.eye(4) if shape.origin is None else np.asarray(shape.origin, dtype=float)
            try:
                solids += _solids(shape.geometry, body.poses[link] @ origin, library, path, link)
            except WorldError as error:
                reading.notes.append(f"{path}: the footprint is not known: {error}")
                return
    if not solids:
        reading.notes.append(f"{path}: the footprint is not known: no link has a <collision>")
        return
    low = min(float(solid.extent[0, 2]) for solid in solids)
    parts = Footprint()
    for solid in solids:
        if solid.extent[0, 2] < low + TALL_M:
            parts.add(solid.footprint((low, low + TALL_M)))
    try:
        shape = footprint_of(parts)
    except ConfigError as error:
        reading.notes.append(f"{path}: the footprint is not known: its collisions {error}")
        return
    name = "radius_m" if isinstance(shape, float) else "footprint_m"
    reading.add(name, shape, f"{path}: the hull of its collisions")


def _solids(geometry: Any, pose: Array, library: Library, path: Path, link: str) -> list[Solid]:
    """Of a collision's geometry. Raises WorldError."""
    if not np.isfinite(pose).all() or np.abs(pose).max() > 1e6:
        raise WorldError(f"link {link} has a collision whose <origin> is no place")
    if geometry is None:
        return []
    if geometry.box is not None:
        return [Box(pose, 0.5 * np.array(_lengths(geometry.box.size, 3, link)))]
    if geometry.cylinder is not None:
        radius, length = _lengths((geometry.cylinder.radius, geometry.cylinder.length), 2, link)
        return [cylinder(pose, radius, length)]
    if geometry.sphere is not None:
        return [sphere(pose, *_lengths((geometry.sphere.radius,), 1, link))]
    if geometry.mesh is None:
        return []
    scale = np.broadcast_to(
        np.array(1.0 if geometry.mesh.scale is None else geometry.mesh.scale, dtype=float), 3
    )
    if not np.isfinite(scale).all() or np.abs(scale).min() < 1e-9:
        raise WorldError(f"link {link} has a mesh of scale {tuple(scale.tolist())}")
    surface = _surface(str(geometry.mesh.filename), library, path, link)
    return [Mesh(surface, pose @ np.diag((*scale, 1.0)))]


def _surface(address: str, library: Library, path: Path, link: str) -> Surface:
    """A mesh, in the packages of ROS or by its way in its package beside the URDF. Raises WorldError."""
    for name in (address, address.partition("://")[2].partition("/")[2]):
        with suppress(WorldError):
            return load_surface(library.find(name, path.parent), None, False)
    raise WorldError(
        f"the mesh {brief(address)} of link {link} cannot be read; source the packages of the robot, or put it beside "
        "the URDF"
    )


def _lengths(values: Any, count: int, link: str) -> tuple[float, ...]:
    found = tuple(float(v) for v in np.ravel(values)) if values is not None and None not in values else ()
    if len(found) != count or not all(1e-6 < value < 1e6 for value in found):
        raise WorldError(f"link {link} has a collision of size {found}; give positive numbers")
    return found


def _drive(reading: Reading, root: Element, path: Path) -> None:
    """Limits and frames of the plugin that drives the robot. Raises ConfigError for one of another kind."""
    for plugin in (p for tags in root.iter("gazebo") for p in tags.iter("plugin")):
        kind = f"{plugin.get('filename', '')} {plugin.get('name', '')}"
        for words_of, what in OTHER_DRIVES.items():
            if re.search(words_of, kind, re.IGNORECASE):
                raise ConfigError(f"{path} has the plugin {brief(kind)}: that is {what}")
        if not DIFFERENTIAL.search(kind):
            continue
        for tag, name in LIMITS.items():
            text = plugin.findtext(tag)
            if text is not None:
                (value,) = words(text, 1, f"<{tag}> of the plugin {brief(kind)}")
                reading.add(name, value, f"{path}: {tag}", Standing.LIMIT)
        for tag, name in FRAMES.items():
            if frame := (plugin.findtext(tag) or "").strip().strip("/"):
                reading.add(name, brief(frame), f"{path}: {tag}", Standing.HINT)
