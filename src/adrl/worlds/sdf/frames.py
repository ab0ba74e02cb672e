"""Frames of SDFormat: where a link, a joint, a frame or a nested model is, by name.

The semantics are those of the specification ("Pose frame semantics", SDFormat 1.7 and later); <pose frame="..."> of
older files means relative_to, as Gazebo reads it. Poses are (4, 4) homogeneous matrices.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from adrl.errors import WorldError
from adrl.types import Array
from adrl.worlds.sdf.document import words

OWN = "__model__"
WORLD = "world"
MAX_CHAIN = 200
"""Frames given relative to frames given relative to ..."""


def pose_matrix(element: Element | None, name: str) -> Array:
    """(4, 4) of a <pose>; the identity where it is left out or empty. Raises WorldError with the owner's name."""
    matrix = np.eye(4)
    text = "" if element is None else (element.text or "").strip()
    if element is None or not text:
        return matrix
    form = element.get("rotation_format", "euler_rpy")
    if form == "quat_xyzw":
        pose = words(text, 7, f"{name}: <pose>")
        if math.hypot(*pose[3:]) < 1e-6:
            raise WorldError(f"{name} has a pose whose quaternion is zero; give one of length 1")
        from scipy.spatial.transform import Rotation  # not at the top: a robot has no SciPy

        matrix[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    elif form == "euler_rpy":
        pose = words(text, 6, f"{name}: <pose>")
        matrix[:3, :3] = _euler(*pose[3:], degrees=element.get("degrees") in ("true", "1"))
    else:
        raise WorldError(f"{name} has a pose in {form!r}; give euler_rpy or quat_xyzw")
    matrix[:3, 3] = pose[:3]
    return matrix


def _euler(roll: float, pitch: float, yaw: float, *, degrees: bool) -> Array:
    """Rotations about the fixed axes x, y and z, in this order."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", (roll, pitch, yaw), degrees=degrees).as_matrix()


def inverse(matrix: Array) -> Array:
    """Of a rigid motion."""
    turned = matrix[:3, :3].T
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turned, -turned @ matrix[:3, 3]
    return result


@dataclass(eq=False)
class Scope:
    """The names of a model, or of the world: each stands for a frame."""

    element: Element
    path: str
    """Its name among all, outer::inner; empty for the world."""
    folder: Path
    """Of its file: relative addresses start there."""
    merged: bool = False
    """Included with merge: its names count as its parent's."""
    parts: dict[str, Element] = field(default_factory=dict)
    """Links, joints and frames by name."""
    nested: dict[str, "Scope"] = field(default_factory=dict)
    """Models by name."""
    _known: dict[str, Array] = field(default_factory=dict)
    _open: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        for part in self.element:
            if part.tag in ("link", "joint", "frame"):
                self.parts.setdefault(part.get("name", ""), part)

    @property
    def label(self) -> str:
        """What it is called in errors."""
        return f"model {self.path!r}" if self.path else "the world"

    @property
    def origin(self) -> str:
        """The name of its own frame."""
        return OWN if self.path else WORLD

    def add(self, scopes: Iterable["Scope"]) -> None:
        """Models nested in it."""
        for scope in scopes:
            self.nested.setdefault(scope.element.get("name", ""), scope)

    def pose(self, owner: Element, default: str = "") -> Array:
        """(4, 4) of an element in this scope. default: the frame that its pose is given in when it names none."""
        element = owner.find("pose")
        frame = default
        if element is not None:
            frame = element.get("relative_to") or element.get("frame") or default
        return self.frame(frame) @ pose_matrix(element, self.label)

    def frame(self, name: str) -> Array:
        """(4, 4) pose of a frame in the scope's own. Raises WorldError where none is called so, or in a circle."""
        if name in ("", self.origin):
            return np.eye(4)
        if name not in self._known:
            if name in self._open:
                raise WorldError(f"{self.label} has frames in a circle: {', '.join(sorted(self._open)[:4])}")
            if len(self._open) >= MAX_CHAIN:
                raise WorldError(f"{self.label} has more than {MAX_CHAIN} frames relative to each other")
            self._open.add(name)
            try:
                self._known[name] = self._resolve(name)
            finally:
                self._open.discard(name)
        return self._known[name]

    def _resolve(self, name: str) -> Array:
        if name in self.parts:
            part = self.parts[name]
            default = {"joint": part.findtext("child"), "frame": part.get("attached_to")}.get(part.tag)
            return self.pose(part, (default or "").strip())
        if name in self.nested:
            return self.place_of(self.nested[name])
        outer, separator, inner = name.partition("::")
        if separator and outer in self.nested:
            return self.frame(outer) @ self.nested[outer].frame(inner)
        for nested in self.nested.values():
            if nested.merged and (name in nested.parts or name in nested.nested):
                return self.place_of(nested) @ nested.frame(name)
        raise WorldError(
            f"{self.label} has a pose relative to {name!r}, which is no frame of it; correct the name"
        )

    def place_of(self, nested: "Scope") -> Array:
        """(4, 4) of a model in it. Its pose puts its placement frame there: X_RM = X_RF X_MF^-1."""
        return self.pose(nested.element) @ inverse(nested.frame(nested.element.get("placement_frame") or ""))
