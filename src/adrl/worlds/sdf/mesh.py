"""The outline of a mesh between two heights, in convex polygons. Needs the extra `meshes`: trimesh and shapely.

A closed body is solid; any other surface is a wall without inside, as a LiDAR sees it and a robot hits it.
"""

import functools
import io
import logging
import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.errors import FileError, MissingExtra, WorldError
from adrl.types import Array
from adrl.worlds.sdf.document import element_of
from adrl.worlds.sdf.footprint import TOUCH_M, Band, Footprint
from adrl.worlds.shapes import place

MAX_BYTES = 256 * 2**20
MAX_FACES = 1_000_000
KINDS = (".dae", ".stl", ".obj", ".glb", ".gltf", ".ply")
TOLERANCES_M = (0.005, 0.02, 0.08)
"""The outline lies outside the mesh by the first to twice the first; by the next where it has more than MAX_PARTS."""
MAX_PARTS = 4000
"""Convex polygons, a building's. What is more intricate still is read as the hull of what is in the band."""


def extra(load: Callable[[], Any], what: str) -> Any:
    """A module of the extra. Raises MissingExtra."""
    try:
        return load()
    except ModuleNotFoundError:
        raise MissingExtra.named("meshes", what, ", or leave it out with --ignore") from None


def _import_shapely() -> Any:
    import shapely

    return shapely


def _import_trimesh() -> Any:
    import collada  # noqa: F401  trimesh reads .dae with it
    import networkx  # noqa: F401  and composes their scenes with this
    import trimesh

    return trimesh


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles."""

    corners: Array
    """(F, 3, 3) metres, in the mesh's frame."""
    solid: NDArray[np.bool_]
    """(F,) part of a closed body whose normals point outwards,"""
    cavity: NDArray[np.bool_]
    """(F,) or of one whose normals point inwards, which hollows out what holds it."""


@contextmanager
def _quiet() -> Iterator[None]:
    """Nothing of textures that are not there: only the shape counts."""
    logger = logging.getLogger("trimesh")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


@functools.lru_cache(maxsize=256)
def load_surface(path: Path, submesh: str | None = None, centred: bool = False) -> Surface:
    """Of a file: all of it, or the part of that name, its middle moved to the origin if centred.

    As Gazebo reads it: in the file's unit, whatever axis it says is up. Raises WorldError, MissingExtra.
    """
    trimesh = extra(_import_trimesh, f"the mesh {path.name}")
    if path.suffix.lower() not in KINDS:
        raise WorldError(f"is a mesh of kind {path.suffix or 'none'}; give one of {', '.join(KINDS)}")
    try:
        content = files.read_bytes(path, MAX_BYTES)
        with _quiet():
            loaded = trimesh.load_scene(
                io.BytesIO(content), file_type=path.suffix.lower()[1:], skip_materials=True
            )
        mesh = _part(trimesh, loaded, submesh, content)
        if loaded.units is not None:
            mesh.apply_scale(trimesh.units.unit_conversion(loaded.units, "meters"))
    except (FileError, WorldError) as error:
        raise WorldError(str(error)) from None
    except Exception as error:  # a library's readers of seven formats raise whatever comes
        raise WorldError(f"cannot be read as a mesh ({type(error).__name__}: {str(error)[:80]})") from None
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all() or np.abs(mesh.vertices).max() > 1e6:
        raise WorldError("is a mesh without usable triangles")
    if len(mesh.faces) > MAX_FACES:
        raise WorldError(f"is a mesh of more than {MAX_FACES} triangles; give a simpler one for collisions")
    if centred:
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    solid, cavity = _closed(trimesh, mesh)
    return Surface(np.asarray(mesh.triangles, dtype=np.float64), solid, cavity)


def _part(trimesh: Any, scene: Any, submesh: str | None, content: bytes) -> Any:
    """One mesh of all of a scene, or of the nodes and geometries called so."""
    if submesh is None:
        return scene.to_mesh()
    names = {submesh, *_geometries(content, submesh)} if content.lstrip()[:1] == b"<" else {submesh}
    found = []
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        if names & {node, geometry, re.sub(r"_\d+$", "", geometry)}:
            found.append(scene.geometry[geometry].copy().apply_transform(matrix))
    if not found:
        raise WorldError(f"has no submesh {submesh!r}")
    return trimesh.util.concatenate(found)


def _geometries(collada: bytes, name: str) -> set[str]:
    """Ids of what hangs on the nodes of this name: what Gazebo calls a submesh of a COLLADA file."""
    nodes = (node for node in element_of(collada).iter("node") if node.get("name") == name)
    return {part.get("url", "")[1:] for node in nodes for part in node.findall("instance_geometry")}


def _closed(trimesh: Any, mesh: Any) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(F,), (F,) which faces are of closed bodies, and turned which way."""
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    count = int(labels.max()) + 1
    # Every edge of a closed body is met once in either direction.
    edges = mesh.edges
    _, at, met = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    direction = np.bincount(at, weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))
    open_edges = (met[at] != 2) | (direction[at] != 0.0)
    is_open = np.zeros(count, dtype=bool)
    is_open[labels[np.repeat(np.arange(len(mesh.faces)), 3)[open_edges]]] = True
    a, b, c = (mesh.triangles - mesh.centroid).transpose(1, 0, 2)
    volume = np.bincount(labels, weights=np.einsum("ij,ij->i", a, np.cross(b, c)), minlength=count)
    return (~is_open & (volume > 0.0))[labels], (~is_open & (volume < 0.0))[labels]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface at its place in the world."""

    surface: Surface
    pose: Array
    """(4, 4); a scale may be in it."""

    @functools.cached_property
    def _corners(self) -> Array:
        """(F, 3, 3) in the world."""
        return self.surface.corners @ self.pose[:3, :3].T + self.pose[:3, 3]

    @property
    def extent(self) -> Array:
        points = self._corners.reshape(-1, 3)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def footprint(self, band: Band) -> Footprint:
        """Convex polygons around what it covers."""
        # Copies of a thing differ mostly in where they stand and which way they face: they share an outline.
        axis = int(np.hypot(self.pose[0, :3], self.pose[1, :3]).argmax())
        yaw = math.atan2(self.pose[1, axis], self.pose[0, axis])
        turned = np.column_stack([place(self.pose[:2].T, 0.0, 0.0, -yaw), self.pose[2]])[:3]
        parts, is_rough = _outline(
            self.surface, tuple(turned.round(6).ravel()), round(self.pose[2, 3], 4), band
        )
        found = Footprint(is_rough=is_rough)
        for part in parts:
            found.add_hull(place(part, self.pose[0, 3], self.pose[1, 3], yaw))
        return found


@functools.lru_cache(maxsize=1024)
def _outline(surface: Surface, axes: tuple[float, ...], z: float, band: Band) -> tuple[list[Array], bool]:
    """Convex parts of what a surface covers, and whether they are rough.

    axes: the x, y and z of its x axis, its y axis and its z axis, each as long as its scale. z: of its origin.
    """
    shapely = extra(_import_shapely, "an outline")
    corners = surface.corners @ np.reshape(axes, (3, 3)) + (0.0, 0.0, z)
    band = (band[0] + TOUCH_M, band[1] - TOUCH_M)
    tolerance, region, parts = 0.0, shapely.Polygon(), []
    for tolerance in TOLERANCES_M:
        region = _region(shapely, corners, surface, band, tolerance)
        parts = _convex_parts(shapely, region)
        if len(parts) <= MAX_PARTS:
            return parts, tolerance > TOLERANCES_M[0]
    return [shapely.get_coordinates(region)], True


def _region(shapely: Any, corners: Array, surface: Surface, band: Band, tolerance: float) -> Any:
    """What the triangles (F, 3, 3) cover, and closed bodies inside, grown by a tolerance in metres."""
    z = corners[..., 2]
    here = (z.min(axis=1) <= band[1]) & (z.max(axis=1) >= band[0])
    parts = _distinct(shapely, shapely.convex_hull(_clipped(shapely, corners[here], band, tolerance)))
    flat = shapely.get_dimensions(parts) == 2
    # Areas are united first and grown once: most triangles lie among others.
    grown = [shapely.union_all(parts[flat]).buffer(tolerance, quad_segs=2)]
    grown += [*shapely.buffer(parts[~flat], tolerance, quad_segs=2)]
    # The inside of a closed body in the band: its cut at the lower height, and what its surface covers from there up.
    inside = _cut(shapely, corners[surface.solid], band[0])
    hollow = _cut(shapely, corners[surface.cavity], band[0])
    grown.append(shapely.difference(inside, hollow).buffer(tolerance, quad_segs=2))
    return shapely.union_all(grown).simplify(tolerance)


def _distinct(shapely: Any, shapes: Any) -> Any:
    """Each once."""
    keys = shapely.to_wkb(shapely.normalize(shapes))
    return shapes[sorted({key: i for i, key in enumerate(keys)}.values())]


def _clipped(shapely: Any, corners: Array, band: Band, tolerance: float) -> Any:
    """(F,) of each triangle the points whose hull is its part between the heights, rounded to a part of a tolerance."""
    z = corners[..., 2]
    points, owners = [], []
    rows, columns = np.nonzero((z >= band[0]) & (z <= band[1]))
    points.append(corners[rows, columns, :2])
    owners.append(rows)
    for height in band:
        for i, j in ((0, 1), (1, 2), (2, 0)):
            rows, crossing = _crossing(corners[:, i], corners[:, j], height)
            points.append(crossing)
            owners.append(rows)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    step = tolerance / 4.0
    rounded = np.rint(np.concatenate(points)[order] / step) * step
    return np.atleast_1d(shapely.multipoints(shapely.points(rounded), indices=_numbered(owner[order])))


def _numbered(sorted_owners: NDArray[np.intp]) -> NDArray[np.intp]:
    """0, 0, 1, 1, 1, ...: the same groups without gaps."""
    return np.concatenate([[0], np.cumsum(np.diff(sorted_owners) != 0)]).astype(np.intp)[: len(sorted_owners)]


def _crossing(a: Array, b: Array, height: float) -> tuple[NDArray[np.intp], Array]:
    """Where edges (F, 3), (F, 3) cross a height: their rows, and (M, 2) x, y, the same from either end."""
    rows = np.flatnonzero((a[:, 2] < height) != (b[:, 2] < height))
    a, b = a[rows], b[rows]
    swap = a[:, 2] > b[:, 2]
    a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
    share = (height - a[:, 2]) / (b[:, 2] - a[:, 2])
    return rows, a[:, :2] + share[:, None] * (b[:, :2] - a[:, :2])


def _cut(shapely: Any, corners: Array, height: float) -> Any:
    """The area inside closed bodies of triangles (F, 3, 3) at a height."""
    rows, points = zip(
        *(_crossing(corners[:, i], corners[:, j], height) for i, j in ((0, 1), (1, 2), (2, 0))), strict=True
    )
    owner, ends = np.concatenate(rows), np.concatenate(points)
    order = np.argsort(owner, kind="stable")
    segments = ends[order].reshape(-1, 2, 2)  # a triangle crosses a height with two edges or none
    lines = shapely.set_precision(shapely.linestrings(segments), 1e-6)
    return shapely.build_area(shapely.node(shapely.multilinestrings(lines[~shapely.is_empty(lines)])))


def _convex_parts(shapely: Any, region: Any) -> list[Array]:
    """Convex polygons that are the region: its triangles, neighbours made one where they are convex together."""
    triangles = shapely.get_parts(shapely.get_parts(shapely.constrained_delaunay_triangles(region)))
    rings = [np.ascontiguousarray(shapely.get_coordinates(t)[:-1]) for t in triangles]
    polygons = {
        i: [tuple(p) for p in (ring if _area(ring) > 0.0 else ring[::-1])] for i, ring in enumerate(rings)
    }
    owner = {
        (a, b): i for i, ring in polygons.items() for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
    }
    for a, b in sorted(owner, key=lambda edge: -np.hypot(edge[0][0] - edge[1][0], edge[0][1] - edge[1][1])):
        one, other = owner.get((a, b)), owner.get((b, a))
        if one is None or other is None or one == other:
            continue
        first, second = polygons[one], polygons[other]
        i, j = first.index(b), second.index(a)
        # From b round to a, then what the other has between a and b.
        joined = first[i:] + first[:i] + (second[j:] + second[:j])[1:-1]
        if _is_convex(np.array(joined)):
            polygons[one] = joined
            del polygons[other], owner[a, b], owner[b, a]
            for edge in zip(joined, joined[1:] + joined[:1], strict=True):
                owner[edge] = one
    return [np.array(ring) for ring in polygons.values()]


def _area(ring: Array) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _is_convex(ring: Array) -> bool:
    ahead = np.roll(ring, -1, axis=0) - ring
    turn = ahead[:, 0] * np.roll(ahead[:, 1], -1) - ahead[:, 1] * np.roll(ahead[:, 0], -1)
    return bool((turn >= -1e-9).all())


def _turns_once(ring: Array) -> bool:
    """Whether it is convex, either way round, and no star."""
    ahead = np.roll(ring, -1, axis=0) - ring
    following = np.roll(ahead, -1, axis=0)
    angles = np.arctan2(
        ahead[:, 0] * following[:, 1] - ahead[:, 1] * following[:, 0], (ahead * following).sum(axis=1)
    )
    return bool((angles > 0.0).all() or (angles < 0.0).all()) and abs(angles.sum()) < 7.0


def prisms(outlines: list[Array], what: str) -> list[Array]:
    """Convex parts (V, 2) of extruded outlines, each (N, 2): what lies within an odd number of them."""
    if len(outlines) == 1 and _turns_once(outlines[0]):
        return outlines
    shapely = extra(_import_shapely, what)
    region = shapely.Polygon()
    for outline in outlines:
        region = region.symmetric_difference(shapely.make_valid(shapely.Polygon(outline)))
    return _convex_parts(shapely, region)
