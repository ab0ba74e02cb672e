"""The footprint of a robot by the collisions of its URDF."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from adrl.descriptions.findings import Reading
from adrl.descriptions.outline import footprint_of
from adrl.descriptions.urdf_body import Body
from adrl.errors import ConfigError, WorldError, brief
from adrl.types import Array
from adrl.worlds.sdf.footprint import Box, Footprint, Solid, cylinder, sphere
from adrl.worlds.sdf.library import Library
from adrl.worlds.sdf.mesh import Mesh, Surface, load_surface

TALL_M = 2.0
"""What is higher above the robot's lowest point is above what it drives by, as Nav2's costmaps have it."""


def add_footprint(reading: Reading, body: Body, path: Path) -> None:
    """Add the hull of all collisions; a note where one of them cannot be read."""
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
