"""A world of Gazebo: what stands in it, what was left out of it, and what was guessed."""

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from adrl.errors import MissingExtra, WorldError
from adrl.types import World
from adrl.worlds.sdf.bodies import Body, falling, named, read_body
from adrl.worlds.sdf.document import root_of
from adrl.worlds.sdf.footprint import TOUCH_M, Band, Footprint, Solid
from adrl.worlds.sdf.frames import Scope
from adrl.worlds.sdf.geometry import Wall
from adrl.worlds.sdf.library import Library
from adrl.worlds.sdf.models import Builder, Ignored, include_name

HEIGHT_BAND_M = (0.05, 0.5)
"""Heights at which things stand in a robot's way; floors below and lintels above are left out."""
MARGIN_M = 1.0
"""Bounds reach this far beyond the geometry."""
SHOWN, IGNORABLE = 3, 30
"""Names in a line for the terminal; and where they are to be copied from it."""
FLOOR_SHARE, FLOOR_M2 = 0.5, 4.0
"""What covers more of the world than this, and more than this, may be a floor."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SdfWorld(World):
    """A world read from SDF. Names of models by what was done to them."""

    left_out: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Why -> which models are no obstacles though the file has them."""
    guessed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Why -> which are obstacles where they start, though they may not stay there or not have this shape."""

    @property
    def notes(self) -> tuple[str, ...]:
        """left_out and guessed in a line each, for the terminal; nothing to tell, no line."""
        return _told("left out", self.left_out) + _told("taken for obstacles on a guess", self.guessed)


def load_sdf(
    path: str | os.PathLike[str],
    margin_m: float = MARGIN_M,
    height_band_m: tuple[float, float] = HEIGHT_BAND_M,
    *,
    models: Sequence[str | os.PathLike[str]] = (),
    ignore: Sequence[str] = (),
) -> SdfWorld:
    """The world of an SDF file: its collision geometry, standing still.

    Boxes, cylinders, spheres, capsules, ellipsoids, cones, extruded polylines and meshes become what they cover between
    the two heights: circles and convex polygons. Upright planes are segments of their size; level ones are ground.
    Frames are resolved as SDFormat says. Poses in the <state> section replace those of the models, as Gazebo does when
    it loads a world. Robots and actors are left out: the result says what was, and what was guessed.

    models: folders where <include> and meshes are looked for, before Gazebo's variables and the folders beside
    the file. ignore: names of models to leave out; patterns such as 'tree_*', and outer::inner, model::link,
    model::link::collision.
    Raises WorldError, which names the file and all models that cannot be read; MissingExtra for meshes
    without the extra `meshes`.
    """
    path = Path(path)
    try:
        world = Scope(root_of(path, "world"), "", path.parent)
        reader = _Reader(Builder(Library.of(models), Ignored(tuple(ignore))), world, height_band_m)
        return reader.read(margin_m)
    except (WorldError, MissingExtra) as error:
        raise type(error)(f"world {path}: {error}") from None


class _Reader:
    """Reads the models one by one, so that all that cannot be read is named at once."""

    def __init__(self, builder: Builder, world: Scope, band: Band) -> None:
        self._builder, self._world, self._band = builder, world, band
        self._problems: dict[str, WorldError | MissingExtra] = {}
        self._names: list[str] = []
        self._left_out: dict[str, list[str]] = {}
        self._guessed: dict[str, list[str]] = {}

    def read(self, margin_m: float) -> SdfWorld:
        """What stands in the band, and bounds this far around it."""
        state = self._world.element.find("state")
        self._world.add(scopes := list(self._scopes(state)))
        bodies = []
        for scope in scopes:
            with self._noting(scope.path):
                pose = self._world.place_of(scope)
                bodies.append(read_body(scope, pose, named(state, "model", scope.path), self._builder))
        falls = falling(bodies)
        footprints = []
        for body in bodies:
            with self._noting(body.name):
                footprints.append((body.name, self._footprint(body, body.name in falls)))
        self._refuse()
        return self._flat(footprints, margin_m)

    @contextmanager
    def _noting(self, name: str) -> Iterator[None]:
        """Goes on after what cannot be read."""
        try:
            yield
        except (WorldError, MissingExtra) as error:
            self._problems.setdefault(name, error)

    def _scopes(self, state: Element | None) -> Iterator[Scope]:
        """The models of the world, included ones and those that the state has put in, too."""
        changes = Element("state") if state is None else state
        deleted = {(name.text or "").strip() for name in changes.iterfind("deletions/name")}
        for element in (*self._world.element, *changes.iterfind("insertions/model")):
            if element.tag not in ("model", "include", "actor", "population"):
                continue
            name = include_name(element) if element.tag == "include" else element.get("name", "")
            if name in deleted or self._is_ignored(name):
                continue
            with self._noting(name):
                scope = self._scope(element, name)
                if scope is not None:
                    yield scope

    def _is_ignored(self, name: str) -> bool:
        self._names.append(name)
        return name in self._builder.ignored

    def _scope(self, element: Element, name: str) -> Scope | None:
        folder = self._world.folder
        if element.tag == "include":
            found, folder = self._builder.included(element, folder, f"model {name!r}")
            if found is None:
                return None
            if found.get("name", "") != name and self._is_ignored(name := found.get("name", "")):
                return None
            element = found
        if element.tag == "population":
            raise WorldError(f"population {name!r} is drawn anew each time; write its models out one by one")
        if element.tag == "actor":
            self._left_out.setdefault("actors, which walk", []).append(name)
        return self._builder.model(element, folder, "") if element.tag == "model" else None

    def _footprint(self, body: Body, falls: bool) -> Footprint:
        """What a body covers in the band; notes why it is left out or not sure."""
        found = Footprint()
        solids = [solid for solid in body.solids if not (isinstance(solid, Wall) and solid.is_level)]
        if body.drives and not body.static:
            self._left_out.setdefault("robots, which drive", []).append(body.name)
            return found
        for solid in solids:
            low, high = solid.extent[:, 2]
            if low < self._band[1] - TOUCH_M and high > self._band[0] + TOUCH_M:
                found.add(solid.footprint(self._band))
        reason = _doubt(body, falls) if found else self._absence(body, solids, falls)
        if reason:
            (self._guessed if found else self._left_out).setdefault(reason, []).append(body.name)
        if found.is_rough:
            self._guessed.setdefault("meshes too intricate to be read closely", []).append(body.name)
        return found

    def _absence(self, body: Body, solids: Sequence[Solid], falls: bool) -> str | None:
        """Why a body that the file has is no obstacle; None for the ground and what nobody sees."""
        if not solids:
            return "without a collision shape" if body.has_looks and not body.solids else None
        if falls:
            return "not static, and nothing under them: they will fall"
        if all(solid.extent[1, 2] <= self._band[0] + TOUCH_M for solid in solids):
            return f"below {self._band[0]:g} m"
        return f"above {self._band[1]:g} m"

    def _refuse(self) -> None:
        """Raises an error that names all that cannot be read, or an --ignore that matches nothing."""
        if self._problems:
            first, *others = self._problems.values()
            names = " ".join(shlex.quote(name) for name in [*self._problems][:IGNORABLE])
            more = f" (and {len(others)} more models cannot be read)" if others else ""
            kind = (
                MissingExtra
                if any(isinstance(e, MissingExtra) for e in self._problems.values())
                else WorldError
            )
            cut = " ..." if len(self._problems) > IGNORABLE else ""
            raise kind(f"{first}{more}; or leave it out with --ignore {names}{cut}")
        for pattern in self._builder.ignored.unused:
            near = get_close_matches(pattern, self._names, n=1, cutoff=0.4)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise WorldError(f"has no model {pattern!r} to ignore{hint}")

    def _flat(self, footprints: list[tuple[str, Footprint]], margin_m: float) -> SdfWorld:
        """All footprints in one world. Raises WorldError when there are none."""
        whole = Footprint()
        for _, footprint in footprints:
            whole.add(footprint)
        if not whole:
            raise WorldError(
                f"has nothing in a robot's way, between {self._band[0]:g} and {self._band[1]:g} m of height"
                + "".join(f"; {line}" for line in _told("left out", self._left_out))
            )
        low, high = whole.extent
        for name, footprint in footprints:
            others = [other.middles for _, other in footprints if other and other is not footprint]
            if not others or footprint.area <= max(FLOOR_M2, FLOOR_SHARE * float(np.prod(high - low))):
                continue
            if footprint.covers(np.concatenate(others)).all():
                raise WorldError(
                    f"has {name!r} under all else that stands in it: a floor higher than {self._band[0]:g} m, beside "
                    f"which there is nothing to drive through; leave it out with --ignore {name}"
                )
            why = "cover more than half of the world: a floor? leave it out with --ignore"
            self._guessed.setdefault(why, []).append(name)
        return SdfWorld(
            bounds=(*(low - margin_m).tolist(), *(high + margin_m).tolist()),
            circles=np.array(whole.circles).reshape(-1, 3),
            polygons=tuple(whole.polygons),
            segments=np.array(whole.segments).reshape(-1, 4),
            left_out={why: tuple(names) for why, names in self._left_out.items()},
            guessed={why: tuple(names) for why, names in self._guessed.items()},
        )


def _doubt(body: Body, falls: bool) -> str | None:
    """Why an obstacle may not stay as it is read; None where it will."""
    if body.static:
        return None
    if falls:
        return "not static, and nothing under them: they will fall"
    if body.joints:
        return "their joints move"
    if body.plugins:
        return "their plugins may move them"
    return None if body.held else "not static: they move when pushed"


def _told(what: str, found: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """A line, or none where there is nothing to tell."""
    parts = [f"{_some(names)} ({why})" for why, names in found.items()]
    return (f"{what}: {'; '.join(parts)}",) if parts else ()


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
