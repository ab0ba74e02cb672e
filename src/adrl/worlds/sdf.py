"""Gazebo worlds (SDF) of boxes, cylinders, spheres and planes, flattened to what a planar robot meets."""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from adrl.errors import ConfigError, WorldError
from adrl.types import Array, World
from adrl.worlds.shapes import box, place

HEIGHT_BAND_M = (0.05, 0.5)
"""Heights at which things stand in a robot's way; floors below and lintels above are left out."""
MARGIN_M = 1.0
"""Bounds reach this far beyond the geometry."""
LEVEL_RAD = 1e-3
"""Roll and pitch up to here count as none."""
NOT_SOLID = ("ground_plane", "sun")
"""Models that <include> may name: they hold nothing a robot runs into."""
MAX_DEPTH = 32


def load_sdf(
    path: str | os.PathLike[str],
    margin_m: float = MARGIN_M,
    height_band_m: tuple[float, float] = HEIGHT_BAND_M,
) -> World:
    """The world of an SDF file: its collision geometry, standing still.

    Cylinders and spheres become circles, boxes and extruded polylines polygons, vertical planes segments of their
    size; horizontal planes are ground. What does not reach into height_band_m is left out. Poses in the <state> section
    replace those of the models, as Gazebo does when it loads a world; in the BARN worlds both are the same.
    Poses are composed model * link * collision and must be upright. Raises WorldError, which names the file
    and the model and says what to do.
    """
    path = Path(path)
    try:
        world = _parse(path).find("world")
        if world is None:
            raise WorldError("has no <world>; give a Gazebo .world or .sdf file")
        reader = _Reader(height_band_m)
        reader.read(world)
        return reader.world(margin_m)
    except WorldError as error:
        raise WorldError(f"world {path}: {error}") from None


@dataclass(frozen=True)
class _Pose:
    """An upright pose: rotation about z only."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0

    def __mul__(self, child: "_Pose") -> "_Pose":
        """The child's pose, given in this frame, in the frame this pose is given in."""
        x, y = place(np.array([(child.x, child.y)]), self.x, self.y, self.yaw)[0]
        return _Pose(float(x), float(y), self.z + child.z, self.yaw + child.yaw)


@dataclass
class _Reader:
    """Walks the models of a world and gathers their geometry."""

    band_m: tuple[float, float]
    circles: list[tuple[float, float, float]] = field(default_factory=list)
    polygons: list[Array] = field(default_factory=list)
    segments: list[tuple[float, float, float, float]] = field(default_factory=list)

    def read(self, world: Element) -> None:
        _check_includes(world, "the world")
        if world.find("population") is not None:
            raise WorldError("holds a <population>; write its models out one by one")
        state = world.find("state")
        for model in world.findall("model"):
            self._read_model(model, _Pose(), _named(state, "model", model.get("name")), depth=0)

    def world(self, margin_m: float) -> World:
        """What was gathered. Raises WorldError when that is nothing."""
        parts = list(self.polygons)
        parts += [np.array([(x - r, y - r), (x + r, y + r)]) for x, y, r in self.circles]
        parts += [np.array(segment).reshape(2, 2) for segment in self.segments]
        if not parts:
            raise WorldError("has no box, cylinder, sphere or wall in a robot's way")
        points = np.concatenate(parts)
        (x_min, y_min), (x_max, y_max) = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
        return World(
            bounds=(float(x_min), float(y_min), float(x_max), float(y_max)),
            circles=np.array(self.circles).reshape(-1, 3),
            polygons=tuple(self.polygons),
            segments=np.array(self.segments).reshape(-1, 4),
        )

    def _read_model(self, model: Element, parent: _Pose, state: Element | None, depth: int) -> None:
        name = f"model {model.get('name', '?')!r}"
        if depth > MAX_DEPTH:
            raise WorldError(f"{name} is nested more than {MAX_DEPTH} deep")
        _check_includes(model, name)
        state_name = f"the state of {name}"
        pose, scale = parent * _pose(model, name), (1.0, 1.0, 1.0)
        if state is not None:  # its poses are the world's
            pose = _pose(state, state_name)
            scale = _positive(_numbers(state, "scale", 3, state_name, default=scale), state_name)
        for link in model.findall("link"):
            link_state = _named(state, "link", link.get("name"))
            link_pose = pose * _pose(link, name) if link_state is None else _pose(link_state, state_name)
            for collision in link.findall("collision"):
                self._read_geometry(collision, link_pose * _pose(collision, name), scale, name)
        for child in model.findall("model"):
            self._read_model(child, pose, _named(state, "model", child.get("name")), depth + 1)

    def _read_geometry(self, collision: Element, pose: _Pose, scale: tuple[float, ...], name: str) -> None:
        for shape in collision.iterfind("geometry/*"):
            if shape.tag == "box":
                size = _positive(_numbers(shape, "size", 3, name), name)
                length, width, height = (a * b for a, b in zip(size, scale, strict=True))
                if self._in_the_way(pose.z, 0.5 * height):
                    self.polygons.append(box(pose.x, pose.y, length, width, pose.yaw))
            elif shape.tag == "cylinder":
                radius, height = _positive(
                    (*_numbers(shape, "radius", 1, name), *_numbers(shape, "length", 1, name)), name
                )
                if self._in_the_way(pose.z, 0.5 * height * scale[2]):
                    self.circles.append((pose.x, pose.y, radius * max(scale[:2])))
            elif shape.tag == "sphere":
                self._add_sphere(pose, _positive(_numbers(shape, "radius", 1, name), name)[0] * max(scale))
            elif shape.tag == "polyline":
                self._add_polyline(shape, pose, scale, name)
            elif shape.tag == "plane":
                self._add_plane(shape, pose, name)
            elif shape.tag != "empty":
                raise WorldError(f"{name} has a collision of kind <{shape.tag}>; make it of primitives")

    def _in_the_way(self, middle_m: float, half_height_m: float) -> bool:
        return middle_m - half_height_m < self.band_m[1] and middle_m + half_height_m > self.band_m[0]

    def _add_sphere(self, pose: _Pose, radius_m: float) -> None:
        """The sphere's widest cut in the band."""
        height = min(max(pose.z, self.band_m[0]), self.band_m[1]) - pose.z
        if abs(height) < radius_m:
            self.circles.append((pose.x, pose.y, math.sqrt(radius_m**2 - height**2)))

    def _add_polyline(self, shape: Element, pose: _Pose, scale: tuple[float, ...], name: str) -> None:
        """The convex polygon that is extruded upwards from the pose."""
        height = _positive(_numbers(shape, "height", 1, name), name)[0] * scale[2]
        if not self._in_the_way(pose.z + 0.5 * height, 0.5 * height):
            return
        points = np.array([_words(point.text, 2, f"{name}: <point>") for point in shape.iterfind("point")])
        corners = place(points.reshape(-1, 2) * scale[:2], pose.x, pose.y, pose.yaw)
        x, y = corners.T
        clockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0
        corners = np.ascontiguousarray(corners[::-1] if clockwise else corners)
        try:
            World(bounds=(0.0, 0.0, 1.0, 1.0), polygons=(corners,))
        except ConfigError:
            raise WorldError(f"{name} has a polyline that is not convex; make it of convex parts") from None
        self.polygons.append(corners)

    def _add_plane(self, shape: Element, pose: _Pose, name: str) -> None:
        """A wall of the plane's size, for a vertical one. SDF turns the size's z axis into the normal."""
        normal = np.array(_numbers(shape, "normal", 3, name, default=(0.0, 0.0, 1.0)))
        norm = float(np.linalg.norm(normal))
        if norm == 0.0:
            raise WorldError(f"{name} has a plane without a direction; correct its <normal>")
        normal /= norm
        horizontal = math.hypot(normal[0], normal[1])
        if horizontal < LEVEL_RAD:
            return
        if abs(normal[2]) > LEVEL_RAD:
            raise WorldError(f"{name} has a slanted plane, normal {tuple(normal)}; make it level or vertical")
        size = _positive(_numbers(shape, "size", 2, name, default=(1.0, 1.0)), name)
        # The turn from z to the normal leaves the direction across both, (-n_y, n_x), where it is.
        across = (-normal[1] / horizontal, normal[0] / horizontal)
        half = 0.5 * (abs(across[0]) * size[0] + abs(across[1]) * size[1])
        ends = place(np.array([across, across]) * [[-half], [half]], pose.x, pose.y, pose.yaw)
        self.segments.append((*ends[0], *ends[1]))


def _parse(path: Path) -> Element:
    """The root element. A DOCTYPE is refused: entities can be made to fill the memory."""
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data

    def refuse(*_: object) -> None:
        raise WorldError("has a DOCTYPE; remove it, no world needs one")

    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(path.read_bytes(), True)
    except FileNotFoundError:
        raise WorldError("does not exist; give a Gazebo .world or .sdf file") from None
    except OSError as error:
        raise WorldError(f"cannot be read: {error}") from None
    except expat.ExpatError as error:
        raise WorldError(f"is not well-formed XML: {error}") from None
    return builder.close()


def _named(parent: Element | None, tag: str, name: str | None) -> Element | None:
    """The child of this tag and name."""
    candidates: Iterator[Element] | tuple[()] = () if parent is None else parent.iterfind(tag)
    return next((child for child in candidates if child.get("name") == name), None)


def _check_includes(element: Element, owner: str) -> None:
    for include in element.findall("include"):
        uri = (include.findtext("uri") or "").strip()
        if uri.rstrip("/").rsplit("/", 1)[-1].lower().replace(" ", "_") not in NOT_SOLID:
            raise WorldError(
                f"{owner} includes {uri or 'a model without <uri>'}, whose shape is not in this file; "
                "save the world from Gazebo, which writes included models out, or add its boxes and cylinders"
            )


def _pose(owner: Element, name: str) -> _Pose:
    """The owner's <pose>, or the identity. Raises WorldError when it is tilted or in another frame."""
    element = owner.find("pose")
    if element is None or not (element.text or "").strip():
        return _Pose()
    frame = element.get("relative_to") or element.get("frame") or ""
    if frame not in ("", "world", "__model__"):
        raise WorldError(f"{name} has a pose relative to {frame!r}; give it relative to its parent")
    if element.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise WorldError(f"{name} has a pose in {element.get('rotation_format')}; give roll, pitch and yaw")
    x, y, z, roll, pitch, yaw = _numbers(owner, "pose", 6, name)
    if element.get("degrees") in ("true", "1"):
        roll, pitch, yaw = math.radians(roll), math.radians(pitch), math.radians(yaw)
    if max(abs(roll), abs(pitch)) > LEVEL_RAD:
        raise WorldError(f"{name} is tilted: roll {roll:.4g}, pitch {pitch:.4g} rad; set it upright")
    return _Pose(x, y, z, yaw)


def _numbers(
    owner: Element, tag: str, count: int, name: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """The numbers in the owner's child of this tag."""
    text = owner.findtext(tag)
    if text is None and default is not None:
        return default
    return _words(text, count, f"{name}: <{tag}> of <{owner.tag}>")


def _words(text: str | None, count: int, what: str) -> tuple[float, ...]:
    """So many numbers of a text. Raises WorldError that says what is not."""
    try:
        numbers = tuple(float(word) for word in (text or "").split())
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise WorldError(f"{what} is {text!r}; give {count} finite numbers")
    return numbers


def _positive(numbers: tuple[float, ...], name: str) -> tuple[float, ...]:
    if min(numbers) <= 0.0:
        raise WorldError(f"{name} has a shape of size {numbers}; give positive numbers")
    return numbers
