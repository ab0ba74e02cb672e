"""Outlines of meshes: what a closed body holds, what a thin wall is, whatever the file's kind and unit."""

import builtins
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl import _core
from adrl.errors import MissingExtra, WorldError
from adrl.worlds.sdf import SdfWorld, load_sdf
from adrl.worlds.sdf.mesh import TOLERANCES_M, _convex_parts, load_surface

trimesh = pytest.importorskip("trimesh")
shapely = pytest.importorskip("shapely")
SLACK = 2.0 * TOLERANCES_M[0] + 1e-3


def load(folder: Path, mesh: str, *, pose: str = "0 0 0 0 0 0", more: str = "", **options: Any) -> SdfWorld:
    (folder / "w.sdf").write_text(
        f"<sdf version='1.8'><world name='w'><model name='thing'><static>1</static><pose>{pose}</pose><link name='l'>"
        f"<collision name='c'><geometry><mesh><uri>{mesh}</uri>{more}</mesh></geometry></collision></link></model>"
        f"</world></sdf>"
    )
    return load_sdf(folder / "w.sdf", **options)


def solid(world: SdfWorld, points: list[tuple[float, float]]) -> list[bool]:
    """Whether a small disc at each point hits the world."""
    poses = np.column_stack([np.array(points), np.zeros(len(points))])
    return (_core.clearance(world.native, poses, 1e-3, np.empty((0, 2)), 1.0) <= 0.0).tolist()


def area(world: SdfWorld) -> float:
    return shapely.union_all([shapely.Polygon(p) for p in world.polygons]).area


def ring(inner: float, outer: float, height: float) -> Any:
    """A closed round wall."""
    return trimesh.creation.annulus(inner, outer, height, sections=48)


@pytest.mark.parametrize("kind", ["stl", "obj", "dae", "ply", "glb"])
def test_every_kind_of_file_is_read(tmp_path: Path, kind: str) -> None:
    trimesh.creation.box((2.0, 1.0, 3.0)).export(tmp_path / f"box.{kind}")
    world = load(tmp_path, f"box.{kind}", pose="5 0 0 0 0 0.5")
    assert 2.0 <= area(world) <= (2.0 + 2 * SLACK) * (1.0 + 2 * SLACK)
    c, s = math.cos(0.5), math.sin(0.5)
    assert solid(world, [(5.0, 0.0), (5 + 0.95 * c, 0.95 * s), (5 + 1.05 * c, 1.05 * s)]) == [
        True,
        True,
        False,
    ]


def test_a_closed_wall_has_an_inside_that_is_free(tmp_path: Path) -> None:
    """A robot drives within the walls of a building; in the wall itself it does not."""
    ring(3.0, 3.2, 2.0).export(tmp_path / "ring.stl")
    world = load(tmp_path, "ring.stl")
    assert solid(world, [(0.0, 0.0), (2.9, 0.0), (3.1, 0.0), (0.0, -3.1), (3.3, 0.0)]) == [
        False,
        False,
        True,
        True,
        False,
    ]
    exact = math.pi * (3.2**2 - 3.0**2)
    assert exact * 0.98 < area(world) < exact + 2 * math.pi * 6.2 * SLACK


def test_an_open_surface_is_a_wall_without_inside(tmp_path: Path) -> None:
    box = trimesh.creation.box((4.0, 4.0, 2.0))
    sides = box.submesh([np.flatnonzero(np.abs(box.face_normals[:, 2]) < 0.5)], append=True)
    sides.export(tmp_path / "room.stl")
    world = load(tmp_path, "room.stl")
    assert solid(world, [(0.0, 0.0), (1.9, 0.0), (2.0, 0.0), (2.1, 0.0)]) == [False, False, True, False]


def test_a_hollow_in_a_body_is_hollow(tmp_path: Path) -> None:
    outer, inner = trimesh.creation.box((4.0, 4.0, 2.0)), trimesh.creation.box((2.0, 2.0, 1.2))
    inner.invert()
    trimesh.util.concatenate([outer, inner]).export(tmp_path / "hollow.stl")
    world = load(tmp_path, "hollow.stl")
    assert solid(world, [(0.0, 0.0), (1.5, 0.0), (2.1, 0.0)]) == [False, True, False]
    # A mirror leaves it so.
    mirrored = load(tmp_path, "hollow.stl", more="<scale>-1 1 1</scale>")
    assert solid(mirrored, [(0.0, 0.0), (1.5, 0.0), (2.1, 0.0)]) == [False, True, False]


def test_only_the_band_counts(tmp_path: Path) -> None:
    """A table: four legs in the band, a top of 1.6 m above it."""
    parts = [trimesh.creation.box((1.6, 0.8, 0.04))]
    parts[0].apply_translation((0.0, 0.0, 0.72))
    for x in (-0.7, 0.7):
        for y in (-0.3, 0.3):
            leg = trimesh.creation.cylinder(0.03, 0.7)
            leg.apply_translation((x, y, 0.35))
            parts.append(leg)
    trimesh.util.concatenate(parts).export(tmp_path / "table.obj")
    world = load(tmp_path, "table.obj")
    assert solid(world, [(0.0, 0.0), (0.7, 0.3), (-0.7, -0.3), (0.7, 0.0)]) == [False, True, True, False]
    assert load_sdf(tmp_path / "w.sdf", height_band_m=(0.05, 0.8)).polygons
    assert solid(load_sdf(tmp_path / "w.sdf", height_band_m=(0.05, 0.8)), [(0.0, 0.0)]) == [True]
    assert solid(load(tmp_path, "table.obj", pose="0 0 0.5 0.5 0 0"), [(0.7, 0.3)]) == [False]


@pytest.mark.parametrize("pose", ["0 0 0.3 0.4 0.2 1.0", "1 2 0.1 1.5707963 0 0", "0 0 0.2 0.003 0 0"])
def test_a_mesh_covers_what_the_primitive_of_its_shape_covers(tmp_path: Path, pose: str) -> None:
    trimesh.creation.cylinder(0.3, 0.8, sections=64).export(tmp_path / "c.stl")
    from_mesh = load(tmp_path, "c.stl", pose=pose)
    text = (tmp_path / "w.sdf").read_text()
    start, end = text.index("<mesh>"), text.index("</mesh>") + len("</mesh>")
    primitive = "<cylinder><radius>0.3</radius><length>0.8</length></cylinder>"
    (tmp_path / "p.sdf").write_text(text[:start] + primitive + text[end:])
    exact = load_sdf(tmp_path / "p.sdf")
    a = shapely.union_all([shapely.Polygon(p) for p in from_mesh.polygons])
    parts = [shapely.Polygon(p) for p in exact.polygons]
    parts += [shapely.Point(x, y).buffer(r, quad_segs=32) for x, y, r in exact.circles]
    assert a.hausdorff_distance(shapely.union_all(parts)) < 0.02


def test_units_scale_and_submesh(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((100.0, 100.0, 100.0)), geom_name="big", node_name="big")
    small = trimesh.creation.box((40.0, 40.0, 100.0))
    small.apply_translation((300.0, 0.0, 0.0))
    scene.add_geometry(small, geom_name="small", node_name="small")
    scene.export(tmp_path / "two.glb")
    scale = "<scale>0.01 0.01 0.01</scale>"
    whole = load(tmp_path, "two.glb", more=scale)
    assert solid(whole, [(0.0, 0.0), (3.0, 0.0)]) == [True, True]
    part = load(tmp_path, "two.glb", more=f"{scale}<submesh><name>small</name></submesh>")
    assert solid(part, [(0.0, 0.0), (3.0, 0.0)]) == [False, True]
    centred = load(
        tmp_path, "two.glb", more=f"{scale}<submesh><name>small</name><center>1</center></submesh>"
    )
    assert solid(centred, [(0.0, 0.0), (3.0, 0.0)]) == [True, False]
    with pytest.raises(WorldError, match="no submesh 'none'"):
        load(tmp_path, "two.glb", more="<submesh><name>none</name></submesh>")
    box = trimesh.creation.box((100.0, 100.0, 100.0))
    text = box.export(file_type="dae").decode()
    assert "<up_axis>" in text
    (tmp_path / "cm.dae").write_text(text.replace("<up_axis>", '<unit name="cm" meter="0.01"/><up_axis>'))
    assert np.ptp(load_surface(tmp_path / "cm.dae").corners) == pytest.approx(1.0)


def test_a_submesh_of_collada_is_a_node_by_its_name(tmp_path: Path) -> None:
    far = trimesh.creation.box((1.0, 1.0, 1.0))
    far.apply_translation((3.0, 0.0, 0.0))
    text = trimesh.exchange.dae.export_collada([trimesh.creation.box((1.0, 1.0, 1.0)), far]).decode()
    assert 'name="node1"' in text
    (tmp_path / "two.dae").write_text(text.replace('name="node1"', 'name="Far"'))
    part = load(tmp_path, "two.dae", more="<submesh><name>Far</name></submesh>")
    assert solid(part, [(0.0, 0.0), (3.0, 0.0)]) == [False, True]


@pytest.mark.parametrize("content", [b"", b"solid x", b"\0" * 200, b"<COLLADA", bytes(range(256)) * 9])
@pytest.mark.parametrize("kind", ["stl", "dae", "obj", "glb"])
def test_a_broken_mesh_is_named(tmp_path: Path, kind: str, content: bytes) -> None:
    (tmp_path / f"bad.{kind}").write_bytes(content)
    with pytest.raises(
        WorldError, match=rf"'thing' has the mesh bad\.{kind}, which .*--ignore thing"
    ) as caught:
        load(tmp_path, f"bad.{kind}")
    assert "\n" not in str(caught.value)


def test_without_the_extra_the_message_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "crate.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    real: Callable[..., Any] = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name in ("trimesh", "shapely"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(
        MissingExtra,
        match=r"crate\.stl needs the extra meshes; run: pip install 'adrl\[meshes\]'.*--ignore thing",
    ):
        load(tmp_path, "crate.stl")


def test_convex_parts_tile_their_region() -> None:
    region = (
        shapely.box(0, 0, 4, 3)
        .difference(shapely.box(1, 1, 2, 2))
        .difference(shapely.Point(3, 1).buffer(0.4))
    )
    parts = [shapely.Polygon(ring) for ring in _convex_parts(shapely, region)]
    assert sum(part.area for part in parts) == pytest.approx(region.area)
    assert shapely.union_all(parts).symmetric_difference(region).area < 1e-9
    assert all(part.convex_hull.area == pytest.approx(part.area) for part in parts)
    assert len(_convex_parts(shapely, shapely.box(0, 0, 4, 3).difference(shapely.box(1, 1, 2, 2)))) <= 5


def test_polylines_may_be_bent_and_have_holes(tmp_path: Path) -> None:
    def line(*points: tuple[float, float]) -> str:
        return (
            "<polyline>"
            + "".join(f"<point>{x} {y}</point>" for x, y in points)
            + "<height>1</height></polyline>"
        )

    bent = line((0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3))
    hole = line((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8))
    (tmp_path / "w.sdf").write_text(
        f"<sdf version='1.8'><world name='w'><model name='m'><static>1</static><link name='l'><collision name='c'>"
        f"<geometry>{bent}{hole}</geometry></collision></link></model></world></sdf>"
    )
    world = load_sdf(tmp_path / "w.sdf")
    assert area(world) == pytest.approx(5.0 - 0.36)
    assert solid(world, [(0.5, 0.5), (2.5, 0.5), (0.5, 2.5), (2.0, 2.0)]) == [False, True, True, False]
