"""Worlds as Gazebo models: the counterpart of adrl.worlds.sdf, and true to it within half a wall's thickness."""

import math
import os
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.types import Array, World
from adrl.worlds.shapes import place

HEIGHT_M = 1.0
"""All that stands in the way is this high."""
WALL_M = 0.01
"""Thickness given to walls, which have none: a plane is endless in Gazebo's physics."""

OBSTACLE, UNDERCARRIAGE = 1, 2
"""Bits of collide_as. Wheels and casters carry the robot; what it hits is its footprint's affair."""


def save_sdf(path: str | os.PathLike[str], world: World) -> None:
    """Write the world as a file that Gazebo 11 and load_sdf read, with ground and light. Raises OSError.

    Moving discs stand where they are at time 0.
    """
    files.atomic_write_bytes(path, to_bytes(document(models(world), ground=True)))


def document(content: list[Element], *, ground: bool) -> Element:
    """<sdf> with one <world> of the elements; ground: and what they stand on, and the sun."""
    root = Element("sdf", version="1.6")
    world = SubElement(root, "world", name="default")
    if ground:
        world.append(_ground())
        world.append(_sun())
    world.extend(content)
    return root


def to_bytes(root: Element) -> bytes:
    """The document as text."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


@dataclass(frozen=True, eq=False)
class Parts:
    """What stands still in a world, in shapes that Gazebo has."""

    boxes: Array
    """(B, 5) x, y, yaw, length, width: rectangles, walls and rectangles of solid cells."""
    cylinders: Array
    """(C, 3) x, y, radius."""
    prisms: list[Array]
    """Convex polygons (V, 2) that are no rectangles."""


def parts(world: World) -> Parts:
    """Taken apart."""
    boxes, prisms = [], []
    for corners in world.polygons:
        rectangle = _rectangle(corners)
        boxes += [] if rectangle is None else [rectangle]
        prisms += [corners] if rectangle is None else []
    for x1, y1, x2, y2 in world.segments:
        middle, along = (0.5 * (x1 + x2), 0.5 * (y1 + y2)), math.atan2(y2 - y1, x2 - x1)
        boxes.append((*middle, along, math.hypot(x2 - x1, y2 - y1), WALL_M))
    if world.grid is not None:
        x, y, yaw = world.grid.origin
        for part in cover(world.grid.solid):
            column, row, width, height = np.array(part) * world.grid.resolution_m
            middle = place(np.array([(column + 0.5 * width, row + 0.5 * height)]), x, y, yaw)[0]
            boxes.append((*middle, yaw, width, height))
    return Parts(np.array(boxes, dtype=np.float64).reshape(-1, 5), world.circles, prisms)


def models(world: World, suffix: str = "") -> list[Element]:
    """One model `obstacles` of all that stands still, and a model `disc_<j>` of each moving disc.

    suffix: to the names, before a disc's number.
    """
    standing = parts(world)
    shapes = [_box(*box) for box in standing.boxes]
    shapes += [_cylinder(*cylinder) for cylinder in standing.cylinders]
    shapes += [_prism(corners) for corners in standing.prisms]
    found = [model(f"obstacles{suffix}", shapes)] if shapes else []
    starts = world.coordinates(0.0)[len(world.circles) + len(world.segments) + len(world.polygons) :]
    for j, (disc, (x, y)) in enumerate(zip(world.discs, starts, strict=False)):
        found.append(model(f"disc{suffix}_{j}", [_cylinder(0.0, 0.0, disc[4])], (x, y)))
    return found


def unit_shapes(boxes: int, cylinders: int) -> list["Shape"]:
    """Shapes of 1 m to be given sizes and places later."""
    return [_box(0.0, 0.0, 0.0, 1.0, 1.0)] * boxes + [_cylinder(0.0, 0.0, 0.5)] * cylinders


def prism_shapes(prisms: list[Array]) -> list["Shape"]:
    """Extruded polygons."""
    return [_prism(corners) for corners in prisms]


def cover(solid: NDArray[np.uint8]) -> list[tuple[int, int, int, int]]:
    """Rectangles column, row, width, height, none upon another, that are the cells (H, W) that are not 0.

    Runs of a row, each grown over the rows in which the same run stands.
    """
    open_runs: dict[tuple[int, int], int] = {}
    found = []
    for row in range(len(solid) + 1):
        runs: set[tuple[int, int]] = set()
        if row < len(solid):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], solid[row] != 0, [0]]).astype(np.int8)))
            runs = {(int(first), int(end)) for first, end in edges.reshape(-1, 2)}
        for run in [run for run in open_runs if run not in runs]:
            began = open_runs.pop(run)
            found.append((run[0], began, run[1] - run[0], row - began))
        for run in runs:
            open_runs.setdefault(run, row)
    return found


Shape = tuple[Element, tuple[float, float, float]]
"""A <geometry>, and where its middle is: x, y, yaw."""


def _cylinder(x: float, y: float, radius: float) -> Shape:
    geometry = Element("geometry")
    shape = SubElement(geometry, "cylinder")
    add(shape, "radius", radius)
    add(shape, "length", HEIGHT_M)
    return geometry, (x, y, 0.0)


def _box(x: float, y: float, yaw: float, length: float, width: float) -> Shape:
    geometry = Element("geometry")
    add(SubElement(geometry, "box"), "size", length, width, HEIGHT_M)
    return geometry, (x, y, yaw)


def _rectangle(corners: Array) -> tuple[float, float, float, float, float] | None:
    """x, y, yaw, length and width of a rectangle with these corners; None for another shape."""
    sides = np.roll(corners, -1, axis=0) - corners
    if len(corners) != 4 or max(abs(sides[0] + sides[2]).max(), abs(sides[0] @ sides[1])) > 1e-9:
        return None
    x, y = corners.mean(axis=0)
    yaw = math.atan2(sides[0, 1], sides[0, 0])
    return float(x), float(y), yaw, float(np.hypot(*sides[0])), float(np.hypot(*sides[1]))


def _prism(corners: Array) -> Shape:
    x, y = corners.mean(axis=0)
    geometry = Element("geometry")
    shape = SubElement(geometry, "polyline")
    for corner in corners - (x, y):
        add(shape, "point", *corner)
    add(shape, "height", HEIGHT_M)
    return geometry, (x, y, 0.0)


def model(
    name: str, shapes: list[Shape], at: tuple[float, float] = (0.0, 0.0), *, visible: bool = True
) -> Element:
    """A model that stands still. visible: has a look, too, not only a body."""
    whole = Element("model", name=name)
    add(whole, "static", "true")
    add(whole, "pose", *at, 0.0, 0.0, 0.0, 0.0)
    link = SubElement(whole, "link", name="link")
    for i, (geometry, (x, y, yaw)) in enumerate(shapes):
        # A polyline is extruded upwards from its pose, all else stands about it.
        z = 0.0 if geometry.find("polyline") is not None else 0.5 * HEIGHT_M
        for kind in ("collision", "visual") if visible else ("collision",):
            part = SubElement(link, kind, name=f"{kind}_{i}")
            add(part, "pose", x, y, z, 0.0, 0.0, yaw)
            part.append(geometry)
            if kind == "visual":
                _paint(part, 0.75, 0.45, 0.2)
            else:
                collide_as(part, OBSTACLE)
    return whole


def collide_as(collision: Element, bits: int) -> None:
    """Two bodies collide when they have a bit in common; one that says nothing has all."""
    surface = collision.find("surface")
    surface = SubElement(collision, "surface") if surface is None else surface
    SubElement(SubElement(surface, "contact"), "collide_bitmask").text = str(bits)


def _ground() -> Element:
    model = Element("model", name="ground_plane")
    add(model, "static", "true")
    link = SubElement(model, "link", name="link")
    for kind in ("collision", "visual"):
        part = SubElement(link, kind, name=kind)
        plane = SubElement(SubElement(part, "geometry"), "plane")
        add(plane, "normal", 0, 0, 1)
        add(plane, "size", 1000, 1000)
        if kind == "visual":
            _paint(part, 0.6, 0.6, 0.6)
    return model


def _paint(visual: Element, *colour: float) -> None:
    material = SubElement(visual, "material")
    for light in ("ambient", "diffuse"):
        add(material, light, *colour, 1)


def _sun() -> Element:
    light = Element("light", name="sun", type="directional")
    add(light, "cast_shadows", "false")
    add(light, "pose", 0, 0, 10, 0, 0, 0)
    add(light, "diffuse", 0.6, 0.6, 0.6, 1)
    add(light, "direction", -0.5, 0.2, -0.9)
    return light


def add(parent: Element, tag: str, *values: float | str) -> Element:
    """A child of this tag; numbers are written so that reading them gives the same ones."""
    child = SubElement(parent, tag)
    child.text = " ".join(value if isinstance(value, str) else repr(float(value)) for value in values)
    return child
