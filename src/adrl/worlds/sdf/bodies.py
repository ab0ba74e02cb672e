"""The models of a world as bodies: their solids, and what is known of their staying where they are."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np

from adrl.types import Array
from adrl.worlds.sdf.document import flag, sizes
from adrl.worlds.sdf.footprint import Solid
from adrl.worlds.sdf.frames import Scope, pose_matrix
from adrl.worlds.sdf.geometry import Scale, solids
from adrl.worlds.sdf.models import Builder

DRIVES = re.compile(
    r"diff.?drive|skid.?steer|ackermann|mecanum|omni|tricycle|planar_?move|tracked|multicopter|holonomic"
    r"|velocity_?control|trajectory_?follower|ros2?_?control|move_?model|mobile_?base|rotors|thruster",
    re.IGNORECASE,
)
"""Plugins that move the model they are in."""
SUPPORT_M = 0.05
"""What is nearer than this under a body carries it. The ground at 0 is always there."""


@dataclass
class Body:
    """A model that stands in the world."""

    name: str
    solids: list[Solid] = field(default_factory=list)
    has_looks: bool = False
    """A visual, which a camera sees and nothing hits."""
    static: bool = False
    held: bool = False
    """Free of gravity, or joined to the world."""
    joints: bool = False
    """Parts of it move against each other."""
    drives: bool = False
    plugins: bool = False

    @property
    def extent(self) -> Array:
        """(2, 3) of all its solids."""
        parts = np.array([solid.extent for solid in self.solids])
        return np.stack([parts[:, 0].min(axis=0), parts[:, 1].max(axis=0)])


def read_body(scope: Scope, pose: Array, state: Element | None, builder: Builder) -> Body:
    """A model at its pose (4, 4) in the world, or where the state says that it is. Raises WorldError."""
    body = Body(scope.path, static=flag(scope.element, "static"))
    for element in _elements(scope):
        joints = [joint for joint in element.findall("joint") if joint.get("type") != "fixed"]
        to_world = ["world" in (j.findtext("parent"), j.findtext("child")) for j in element.findall("joint")]
        body.joints |= bool(joints)
        body.held |= any(to_world)
        body.has_looks |= element.find("link/visual") is not None
        plugins = [f"{p.get('name', '')} {p.get('filename', '')}" for p in element.findall("plugin")]
        body.plugins |= bool(plugins)
        body.drives |= any(DRIVES.search(text) for text in plugins)
    links = [link for element in _elements(scope) for link in element.findall("link")]
    body.held |= bool(links) and not any(flag(link, "gravity", default=True) for link in links)
    body.solids = list(_solids(scope, pose, {} if state is None else _states(state, scope.path), builder))
    return body


def _elements(scope: Scope) -> Iterator[Element]:
    yield scope.element
    for nested in scope.nested.values():
        yield from _elements(nested)


def _solids(scope: Scope, pose: Array, states: Mapping[str, Element], builder: Builder) -> Iterator[Solid]:
    told, state = f"the state of {scope.label}", states.get(scope.path)
    scale: Scale = (1.0, 1.0, 1.0)
    if state is not None:  # its poses are the world's
        pose = pose_matrix(state.find("pose"), told)
        x, y, z = sizes(state, "scale", 3, told, default=scale)
        scale = (x, y, z)
    for link in scope.element.findall("link"):
        name = f"{scope.path}::{link.get('name', '')}"
        if name in builder.ignored:
            continue
        link_state = states.get(name)
        # A collision is placed in the model's frames; a state moves the link and what is on it.
        in_model = scope.pose(link)
        moved = pose
        if link_state is not None:
            moved = pose_matrix(link_state.find("pose"), told) @ np.linalg.inv(in_model)
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is None or f"{name}::{collision.get('name', '')}" in builder.ignored:
                continue
            frame = collision.find("pose")
            own = frame is None or not (frame.get("relative_to") or frame.get("frame"))
            place = in_model @ pose_matrix(frame, scope.label) if own else scope.pose(collision)
            yield from solids(geometry, moved @ place, scale, builder.library, scope.folder, scope.label)
    for nested in scope.nested.values():
        yield from _solids(nested, pose @ scope.place_of(nested), states, builder)


def _states(state: Element, path: str) -> dict[str, Element]:
    """What a state says of a model, its links and the models in it, by their names among all.

    Older files have no models in models: there a link is called inner::link.
    """
    found = {path: state}
    for link in state.iterfind("link"):
        found[f"{path}::{link.get('name', '')}"] = link
    for inner in state.iterfind("model"):
        found |= _states(inner, f"{path}::{inner.get('name', '')}")
    return found


def named(parent: Element | None, tag: str, name: str | None) -> Element | None:
    """The child of this tag and name."""
    candidates = () if parent is None else parent.iterfind(tag)
    return next((child for child in candidates if child.get("name") == name), None)


def falling(bodies: list[Body]) -> set[str]:
    """Names of those that are held by nothing, with air under them."""
    solid = [body for body in bodies if body.solids]
    if not solid:
        return set()
    extents = np.array([body.extent for body in solid])
    lowest, highest = extents[:, 0], extents[:, 1]
    found = set()
    for i, body in enumerate(solid):
        if body.static or body.held or lowest[i, 2] <= SUPPORT_M:
            continue
        over = (lowest[:, :2] <= highest[i, :2]).all(axis=1) & (highest[:, :2] >= lowest[i, :2]).all(axis=1)
        near = (highest[:, 2] >= lowest[i, 2] - SUPPORT_M) & (lowest[:, 2] <= lowest[i, 2])
        others = np.arange(len(solid)) != i
        if not (over & near & others).any():
            found.add(body.name)
    return found
