"""The <geometry> of a collision as a solid in the world."""

import math
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from adrl.errors import WorldError
from adrl.types import Array
from adrl.worlds.sdf.document import flag, numbers, sizes, words
from adrl.worlds.sdf.footprint import (
    LEVEL_RAD,
    Band,
    Box,
    Footprint,
    Polytope,
    Solid,
    capsule,
    cone,
    cylinder,
    ellipsoid,
    sphere,
    upright,
)
from adrl.worlds.sdf.library import Library
from adrl.worlds.sdf.mesh import Mesh, load_surface, prisms

Scale = tuple[float, float, float]
PRIMITIVES = {"box", "cylinder", "sphere", "capsule", "ellipsoid", "cone"}


class Prism:
    """A convex polygon (V, 2), extruded upwards from its pose."""

    def __init__(self, corners: Array, height: float, pose: Array) -> None:
        self._corners, self._height, self._pose = corners, height, pose
        ends = [np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, height)]
        self._hull = Polytope(np.concatenate(ends) @ pose[:3, :3].T + pose[:3, 3])

    @property
    def extent(self) -> Array:
        return self._hull.extent

    def footprint(self, band: Band) -> Footprint:
        pose, axis = upright(self._pose, band, np.array((0.0, 0.0, self._height)))
        if axis != 2:
            return self._hull.footprint(band)
        found = Footprint()
        found.add_hull(self._corners @ pose[:2, :2].T + pose[:2, 3])
        return found


class Wall:
    """An upright plane, which covers a segment, or a level one, which is ground and covers nothing."""

    def __init__(self, shape: Element, pose: Array, name: str) -> None:
        normal = np.array(numbers(shape, "normal", 3, name, default=(0.0, 0.0, 1.0)))
        norm = float(np.linalg.norm(normal))
        if norm < 1e-6:
            raise WorldError(f"{name} has a plane without a direction; correct its <normal>")
        normal /= norm
        facing = pose[:3, :3] @ normal
        horizontal = math.hypot(facing[0], facing[1])
        self.is_level = horizontal < math.sin(LEVEL_RAD)
        self._middle = pose[:3, 3]
        if not self.is_level and abs(facing[2]) > math.sin(LEVEL_RAD):
            raise WorldError(
                f"{name} has a slanted plane, normal {tuple(facing.round(4).tolist())}; make it level or upright"
            )
        if self.is_level:
            return
        # The shortest turn from z to the normal carries the size's two axes along.
        size = sizes(shape, "size", 2, name, default=(1.0, 1.0))
        axes = _turned(normal) @ (np.eye(3)[:, :2] * (0.5 * np.array(size)))
        self._reach = np.abs(pose[:3, :3] @ axes).sum(axis=1)
        across = np.array((-facing[1], facing[0])) / horizontal
        self._half = across * np.abs(across @ (pose[:2, :3] @ axes)).sum()

    @property
    def extent(self) -> Array:
        if self.is_level:
            return np.array([(-1e6, -1e6, self._middle[2]), (1e6, 1e6, self._middle[2])])
        return np.stack([self._middle - self._reach, self._middle + self._reach])

    def footprint(self, band: Band) -> Footprint:
        if self.is_level:
            return Footprint()
        a, b = self._middle[:2] - self._half, self._middle[:2] + self._half
        return Footprint(segments=[(a[0], a[1], b[0], b[1])])


def _turned(normal: Array) -> Array:
    """(3, 3) the shortest turn from z to a unit vector."""
    x, y, z = normal
    if z < -1.0 + 1e-9:
        return np.diag((1.0, -1.0, -1.0))
    cross = np.array([(0.0, 0.0, x), (0.0, 0.0, y), (-x, -y, 0.0)])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def solids(
    geometry: Element, pose: Array, scale: Scale, library: Library, folder: Path, name: str
) -> list[Solid]:
    """Of a <geometry> at a pose (4, 4), grown by a state's scale. Raises WorldError, which names the model."""
    found: list[Solid] = []
    lines = geometry.findall("polyline")
    if lines:
        found += _polylines(lines, pose, scale, name)
    for shape in geometry:
        if shape.tag in PRIMITIVES:
            found.append(_primitive(shape, pose, scale, name))
        elif shape.tag == "plane":
            found.append(Wall(shape, pose, name))
        elif shape.tag == "mesh":
            found.append(_mesh(shape, pose, scale, library, folder, name))
        elif shape.tag not in ("empty", "polyline"):
            raise WorldError(
                f"{name} has a collision of kind <{shape.tag}>, which is not read; make it of other shapes"
            )
    return found


def _primitive(shape: Element, pose: Array, scale: Scale, name: str) -> Solid:
    x, y, z = scale
    if shape.tag == "box":
        return Box(pose, 0.5 * np.array(sizes(shape, "size", 3, name)) * scale)
    if shape.tag == "ellipsoid":
        return ellipsoid(pose, np.array(sizes(shape, "radii", 3, name)) * scale)
    (radius,) = sizes(shape, "radius", 1, name)
    if shape.tag == "sphere":
        return sphere(pose, radius * max(scale))
    (length,) = sizes(shape, "length", 1, name)
    make = {"cylinder": cylinder, "capsule": capsule, "cone": cone}[shape.tag]
    return make(pose, radius * max(x, y), length * z)


def _polylines(shapes: list[Element], pose: Array, scale: Scale, name: str) -> list[Solid]:
    outlines, heights = [], []
    for shape in shapes:
        points = [words(point.text, 2, f"{name}: <point>") for point in shape.iterfind("point")]
        outline = np.array(points).reshape(-1, 2) * scale[:2]
        if len(outline) > 1 and (outline[0] == outline[-1]).all():
            outline = outline[:-1]
        if len(outline) < 3:
            raise WorldError(f"{name} has a polyline of {len(outline)} points; give three or more")
        outlines.append(outline)
        heights.append(sizes(shape, "height", 1, name)[0] * scale[2])
    return [
        Prism(part, max(heights), pose) for part in prisms(outlines, f"{name}: a polyline that is not convex")
    ]


def _mesh(shape: Element, pose: Array, scale: Scale, library: Library, folder: Path, name: str) -> Solid:
    uri = (shape.findtext("uri") or "").strip()
    own = np.array(numbers(shape, "scale", 3, name, default=(1.0, 1.0, 1.0))) * scale
    if np.abs(own).min() < 1e-9:
        raise WorldError(f"{name} has a mesh of scale {tuple(own.tolist())}; give numbers that are not 0")
    submesh = shape.find("submesh")
    part = None if submesh is None else (submesh.findtext("name") or "").strip()
    try:
        file = library.find(uri, folder)
    except WorldError as error:
        raise WorldError(f"{name} {error}") from None
    try:
        surface = load_surface(file, part, submesh is not None and flag(submesh, "center"))
    except WorldError as error:
        raise WorldError(f"{name} has the mesh {uri}, which {error}") from None
    return Mesh(surface, pose @ np.diag((*own, 1.0)))
