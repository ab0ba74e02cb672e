"""Gazebo worlds: poses compose, states win, and what cannot be read is named."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.errors import WorldError
from adrl.worlds import load_sdf
from adrl.worlds.sdf import SdfWorld

CYLINDER = "<geometry><cylinder><radius>0.2</radius><length>1</length></cylinder></geometry>"
BOX = "<geometry><box><size>2 0.5 1</size></box></geometry>"
POSE = st.tuples(*[st.floats(-5.0, 5.0)] * 2, st.just(0.0), st.just(0.0), st.just(0.0), st.floats(-4.0, 4.0))


def pose(numbers: tuple[float, ...] | str, attributes: str = "") -> str:
    text = numbers if isinstance(numbers, str) else " ".join(repr(n) for n in numbers)
    return f"<pose {attributes}>{text}</pose>"


def model(
    geometry: str, *, model_pose: str = "", link_pose: str = "", pose: str = "", name: str = "m"
) -> str:
    return (
        f"<model name='{name}'>{model_pose}<link name='l'>{link_pose}"
        f"<collision name='c'>{pose}{geometry}</collision></link></model>"
    )


def load(folder: Path, content: str, **options: Any) -> SdfWorld:
    path = folder / "test.world"
    path.write_text(f"<?xml version='1.0'?><sdf version='1.6'><world name='w'>{content}</world></sdf>")
    return load_sdf(path, **options)


def matrix(p: tuple[float, ...]) -> np.ndarray:
    c, s = math.cos(p[5]), math.sin(p[5])
    return np.array([(c, -s, p[0]), (s, c, p[1]), (0.0, 0.0, 1.0)])


@given(a=POSE, b=POSE, c=POSE)
def test_poses_compose_from_model_to_link_to_collision(
    tmp_path_factory: pytest.TempPathFactory, a: tuple, b: tuple, c: tuple
) -> None:
    folder = tmp_path_factory.mktemp("world")
    world = load(folder, model(BOX, model_pose=pose(a), link_pose=pose(b), pose=pose(c)))
    corners = np.array([(1, 0.25, 1), (-1, 0.25, 1), (-1, -0.25, 1), (1, -0.25, 1)])
    expected = (matrix(a) @ matrix(b) @ matrix(c) @ corners.T).T[:, :2]
    np.testing.assert_allclose(world.polygons[0], expected, atol=1e-9)
    world = load(folder, model(CYLINDER, model_pose=pose(a), link_pose=pose(b), pose=pose(c)))
    centre = matrix(a) @ matrix(b) @ matrix(c) @ (0, 0, 1)
    np.testing.assert_allclose(world.circles, [(*centre[:2], 0.2)], atol=1e-9)


def test_nested_models_compose_too(tmp_path: Path) -> None:
    inner = model(CYLINDER, model_pose=pose("1 0 0 0 0 0"), name="inner")
    world = load(tmp_path, f"<model name='outer'>{pose('0 3 0 0 0 1.5707963267948966')}{inner}</model>")
    np.testing.assert_allclose(world.circles, [(0.0, 4.0, 0.2)], atol=1e-12)


def test_degrees_are_read_where_they_are_declared(tmp_path: Path) -> None:
    world = load(
        tmp_path, model(CYLINDER, model_pose=pose("0 0 0 0 0 90", "degrees='true'"), pose=pose("1 0 0 0 0 0"))
    )
    np.testing.assert_allclose(world.circles, [(0.0, 1.0, 0.2)], atol=1e-12)


def test_a_state_moves_and_scales_its_model(tmp_path: Path) -> None:
    placed = model(BOX, model_pose=pose("9 9 0 0 0 0"), pose=pose("1 0 0 0 0 0"))
    state = f"<state><model name='m'>{pose('2 3 0 0 0 0')}<scale>1 2 1</scale></model></state>"
    (corners,) = load(tmp_path, placed + state).polygons
    assert (corners.min(axis=0).tolist(), corners.max(axis=0).tolist()) == ([2.0, 2.5], [4.0, 3.5])
    (circle,) = load(tmp_path, model(CYLINDER) + state).circles
    assert circle.tolist() == [2.0, 3.0, 0.4]
    link = f"<link name='l'>{pose('5 6 0 0 0 0')}</link>"
    state = f"<state><model name='m'>{pose('0 0 0 0 0 0')}{link}</model></state>"
    np.testing.assert_allclose(load(tmp_path, placed + state).polygons[0].mean(axis=0), [6.0, 6.0])


@pytest.mark.parametrize(
    "told",
    [f"<link name='in::l'>{pose('5 6 0 0 0 0')}</link>", f"<model name='in'>{pose('5 6 0 0 0 0')}</model>"],
)
def test_a_state_moves_models_in_models(tmp_path: Path, told: str) -> None:
    """Gazebo wrote a nested model's links into the outer model's state, and its own state later."""
    outer = f"<model name='m'>{model(CYLINDER, name='in', model_pose=pose('1 1 0 0 0 0'))}</model>"
    state = f"<state><model name='m'>{pose('0 0 0 0 0 0')}{told}</model></state>"
    assert load(tmp_path, outer + state).circles.tolist() == [[5.0, 6.0, 0.2]]


def test_planes_are_ground_or_walls(tmp_path: Path) -> None:
    def plane(normal: str) -> str:
        return f"<geometry><plane><normal>{normal}</normal><size>4 6</size></plane></geometry>"

    def wall(normal: str, **poses: str) -> list[list[float]]:
        ends = load(tmp_path, model(plane("0 0 1"), name="ground") + model(plane(normal), **poses)).segments
        return sorted(np.round(ends, 9).reshape(2, 2).tolist())

    # A plane facing x keeps its y side level, one facing y its x side.
    assert wall("1 0 0") == [[0.0, -3.0], [0.0, 3.0]]
    assert wall("0 -2 0") == [[-2.0, 0.0], [2.0, 0.0]]
    assert wall("1 0 0", model_pose=pose("1 1 0 0 0 1.5707963267948966")) == [[-2.0, 1.0], [4.0, 1.0]]


@pytest.mark.parametrize(
    ("geometry", "z", "radius"),
    [
        (CYLINDER, 0.0, 0.2),
        (CYLINDER, -0.46, None),
        (CYLINDER, 1.01, None),
        ("<geometry><sphere><radius>0.5</radius></sphere></geometry>", 0.2, 0.5),
        ("<geometry><sphere><radius>0.5</radius></sphere></geometry>", 0.8, 0.4),
        ("<geometry><sphere><radius>0.5</radius></sphere></geometry>", -0.35, 0.3),
        ("<geometry><sphere><radius>0.5</radius></sphere></geometry>", 1.1, None),
    ],
)
def test_only_what_reaches_the_robots_heights_counts(
    tmp_path: Path, geometry: str, z: float, radius: float | None
) -> None:
    world = load(tmp_path, model(BOX) + model(geometry, pose=pose(f"0 0 {z} 0 0 0"), name="n"))
    assert [c[2] for c in world.circles.tolist()] == ([] if radius is None else pytest.approx([radius]))


def test_what_only_touches_the_band_is_not_in_it(tmp_path: Path) -> None:
    """A shelf board from 0.5 m up or to 0.05 m, its middle rounded this way and that."""
    board = "<geometry><box><size>1 1 0.02</size></box></geometry>"
    for z in (0.51, 0.1 + 0.41, 1.0 - 0.49, 0.04):
        world = load(tmp_path, model(CYLINDER) + model(board, pose=pose(f"0 0 {z!r} 0 0 0"), name="board"))
        assert len(world.polygons) == 0
    assert len(load(tmp_path, model(board, pose=pose("0 0 0.509 0 0 0"))).polygons) == 1


def test_bounds_hold_the_geometry_and_a_margin(tmp_path: Path) -> None:
    world = load(tmp_path, model(CYLINDER, pose=pose("1 2 0 0 0 0")) + model(BOX, name="n"))
    assert world.bounds == pytest.approx((-2.0, -1.25, 2.2, 3.2))


def test_ground_and_sun_may_be_included_and_visuals_are_not_solid(tmp_path: Path) -> None:
    includes = "<include><uri>model://ground_plane</uri></include><include><uri>model://sun</uri></include>"
    visual = f"<model name='v'><link name='l'><visual name='v'>{BOX}</visual></link></model>"
    world = load(tmp_path, includes + visual + model(CYLINDER))
    assert (len(world.circles), len(world.polygons)) == (1, 0)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "nothing in a robot's way"),
        (model(CYLINDER, model_pose=pose("0 0 0", "")), "6 finite numbers"),
        (model(CYLINDER, model_pose=pose("0 0 0 0 0 nan")), "6 finite numbers"),
        (model(CYLINDER, model_pose=pose("0 0 0 0 0 0", "relative_to='other'")), "relative to 'other'"),
        (model(CYLINDER, model_pose=pose("0 0 0 0 0 0", "frame='other'")), "relative to 'other'"),
        (
            model("<geometry><mesh><uri>a.dae</uri></mesh></geometry>", name="chair"),
            "'chair' needs a.dae",
        ),
        (model("<geometry><box><size>1 1</size></box></geometry>"), "3 finite numbers"),
        (model("<geometry><box/></geometry>"), "3 finite numbers"),
        (model("<geometry><box><size>1 0 1</size></box></geometry>"), "positive"),
        (model("<geometry><sphere><radius>-1</radius></sphere></geometry>"), "positive"),
        (
            model("<geometry><plane><normal>1 0 1</normal></plane></geometry>", name="ramp"),
            "'ramp' has a slanted",
        ),
        (model("<geometry><plane><normal>0 0 0</normal></plane></geometry>"), "direction"),
        (model("<geometry><heightmap/></geometry>", name="hills"), "--ignore hills"),
        (model("<geometry><box><size>1e308 1 1</size></box></geometry>"), "numbers up to 1e+09"),
        (model("<geometry><sphere><radius>1e308</radius></sphere></geometry>"), "numbers up to 1e+09"),
        (model("<geometry><box><size>1e-300 1 1</size></box></geometry>"), "from 1e-06 m"),
        (model(CYLINDER, model_pose=pose("1" + "0" * 5000 + " 0 0 0 0 0", "")), "6 finite numbers"),
        (
            model("<geometry><polyline><point>0 0</point><height>1</height></polyline></geometry>"),
            "of 1 points",
        ),
        (model(CYLINDER, pose=pose("0 0 0 0 0 0 0", "rotation_format='quat_xyzw'")), "quaternion is zero"),
        ("<include><uri>model://cafe_table</uri></include>", "model://cafe_table"),
        (
            "<include><uri>https://fuel.gazebosim.org/1.0/a/models/Cafe Table/2</uri></include>",
            "--ignore cafe_table",
        ),
        ("<include/>", "without <uri>"),
        ("<model name='m'><include><uri>model://x</uri></include></model>", "model 'm' needs model://x"),
        ("<population name='p'/>", "population"),
        (model(BOX) + "<state><model name='m'><scale>0 1 1</scale></model></state>", "state of model 'm'"),
        ("<model name='m'>" * 40 + "</model>" * 40, "nested"),
        ("<model name='m'>", "not well-formed"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, content: str, says: str) -> None:
    with pytest.raises(WorldError) as caught:
        load(tmp_path, content)
    assert says in str(caught.value)
    assert "test.world" in str(caught.value)


def test_all_that_cannot_be_read_is_named_at_once_and_can_be_left_out(tmp_path: Path) -> None:
    broken = model("<geometry><mesh><uri>a.dae</uri></mesh></geometry>", name="chair 1")
    broken += "<population name='crowd'/>" + model("<geometry><heightmap/></geometry>", name="hills")
    content = model(CYLINDER, name="post") + broken
    with pytest.raises(WorldError, match=r"2 more models .* --ignore 'chair 1' crowd hills|--ignore crowd"):
        load(tmp_path, content)
    world = load(tmp_path, content, ignore=["chair*", "crowd", "hills"])
    assert len(world.circles) == 1
    with pytest.raises(WorldError, match="no model 'hill' to ignore; did you mean 'hills'"):
        load(tmp_path, model(CYLINDER, name="hills") + model(CYLINDER), ignore=["hill"])


def test_links_and_collisions_can_be_left_out_too(tmp_path: Path) -> None:
    content = model(CYLINDER, name="a") + model(BOX, name="b")
    assert len(load(tmp_path, content, ignore=["a::l"]).circles) == 0
    assert len(load(tmp_path, content, ignore=["b::l::c"]).polygons) == 0


def test_what_is_left_out_or_guessed_is_named(tmp_path: Path) -> None:
    static, up = "<static>1</static>", pose("9 9 3 0 0 0")
    plugin = "<plugin name='drive' filename='libgazebo_ros_diff_drive.so'/>"
    joint = "<joint name='hinge' type='revolute'><parent>l</parent><child>l</child></joint>"
    link = f"<link name='l'><collision name='c'>{CYLINDER}</collision></link>"
    visual = f"<link name='l'><visual name='v'>{CYLINDER}</visual></link>"
    world = load(
        tmp_path,
        f"<model name='post'>{static}{link}</model>"
        f"<model name='box'>{link}</model>"
        f"<model name='robot'>{link}{plugin}</model>"
        f"<model name='door'>{link}{joint}</model>"
        f"<model name='lamp'>{static}{up}{link}</model>"
        f"<model name='ball'>{pose('-9 9 3 0 0 0')}{link}</model>"
        f"<model name='drop'>{pose('20 0 1 0 0 0')}<link name='l'><pose>0 0 -0.2 0 0 0</pose><collision name='c'>"
        f"{CYLINDER}</collision></link></model>"
        f"<model name='picture'>{static}{visual}</model>"
        f"<model name='rug'>{static}{pose('0 0 -0.5 0 0 0')}{link}</model>"
        "<actor name='walker'/>",
    )
    assert world.left_out == {
        "actors, which walk": ("walker",),
        "robots, which drive": ("robot",),
        "above 0.5 m": ("lamp",),
        "not static, and nothing under them: they will fall": ("ball",),
        "without a collision shape": ("picture",),
        "below 0.05 m": ("rug",),
    }
    assert world.guessed == {
        "not static: they move when pushed": ("box",),
        "their joints move": ("door",),
        "not static, and nothing under them: they will fall": ("drop",),
    }
    assert len(world.notes) == 2
    assert not any("\n" in note for note in world.notes)


def test_what_stands_on_another_thing_does_not_fall(tmp_path: Path) -> None:
    cup = model(CYLINDER, name="cup", model_pose=pose("0 0 1.5 0 0 0"))
    table = model(BOX, name="table", model_pose=pose("0 0 0.5 0 0 0"))
    assert load(tmp_path, table + cup).left_out == {"above 0.5 m": ("cup",)}
    beside = model(BOX, name="table", model_pose=pose("5 0 0.5 0 0 0"))
    (reason,) = load(tmp_path, beside + cup).left_out
    assert "fall" in reason


SLAB = "<geometry><box><size>20 20 0.2</size></box></geometry>"


def test_a_slab_under_all_that_stands_there_is_refused(tmp_path: Path) -> None:
    """Tasks would lie on the ring around it. Without it the world is what stands on it; alone it is an obstacle."""
    content = model(SLAB, name="slab") + model(CYLINDER, pose=pose("9 9 0 0 0 0")) + model(BOX)
    with pytest.raises(WorldError, match=r"has 'slab' under all else.* --ignore slab$"):
        load(tmp_path, content)
    assert (
        load(tmp_path, content, ignore=["slab"]).notes == load(tmp_path, model(CYLINDER) + model(BOX)).notes
    )
    assert len(load(tmp_path, model(SLAB, name="slab")).polygons) == 1


def test_a_slab_beside_which_things_stand_is_named(tmp_path: Path) -> None:
    (reason,) = (
        why
        for why, names in load(
            tmp_path, model(SLAB, name="slab") + model(CYLINDER, pose=pose("12 0 0 0 0 0"))
        ).guessed.items()
        if "slab" in names[:1] and "floor" in why
    )
    assert "--ignore" in reason


@pytest.mark.parametrize("text", ["", "not xml", "<sdf version='1.6'><model name='m'/></sdf>"])
def test_a_file_without_a_world_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.world").write_text(text)
    with pytest.raises(WorldError, match=r"bad\.world"):
        load_sdf(tmp_path / "bad.world")
    with pytest.raises(WorldError, match="does not exist"):
        load_sdf(tmp_path / "none.world")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b'<?xml version="1.0" encoding="x"?><sdf/>', "encoding"),
        (b'<?xml version="1.0" encoding="shift_jis"?><sdf/>', "encoding"),
        (b"<a>" * 100_000, "nested"),
        (b"\xff\xfe\x00\xd8", "well-formed"),
        (b"define block model\n(\n  size [1 1 1]\n)\nwindow ( size [ 1 1 ] )\n", "a world of Stage"),
        (b"<robot name='r'/>", "URDF"),
    ],
)
def test_what_is_no_sdf_is_refused_in_a_line(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "bad.world").write_bytes(content)
    with pytest.raises(WorldError, match=says) as caught:
        load_sdf(tmp_path / "bad.world")
    assert "\n" not in str(caught.value)


def test_a_file_of_countless_elements_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adrl.worlds.sdf.document.MAX_ELEMENTS", 1000)
    (tmp_path / "bad.world").write_bytes(b"<sdf>" + b"<a/>" * 1001 + b"</sdf>")
    with pytest.raises(WorldError, match="more than 1000 elements"):
        load_sdf(tmp_path / "bad.world")


def test_a_comment_may_hold_two_hyphens(tmp_path: Path) -> None:
    """No XML, but Gazebo's own examples have it: the command line that runs them."""
    comment = "<!-- gz sim\n -r --levels w.sdf -->"
    (tmp_path / "w.world").write_text(
        f"<sdf version='1.6'>{comment}<world name='w'>{model(CYLINDER)}</world></sdf>"
    )
    assert len(load_sdf(tmp_path / "w.world").circles) == 1
    (tmp_path / "w.world").write_text(f"<sdf version='1.6'>{comment}<world name='w'>\n<&</world></sdf>")
    with pytest.raises(WorldError, match="line 3"):
        load_sdf(tmp_path / "w.world")


def test_a_device_is_no_world() -> None:
    with pytest.raises(WorldError, match="no ordinary file"):
        load_sdf("/dev/zero")


@pytest.mark.parametrize("before", ["\n\n", "<!-- made by hand -->\n", "\ufeff"])
def test_lines_before_the_xml_head_are_passed_over(tmp_path: Path, before: str) -> None:
    text = f"{before}<?xml version='1.0'?><sdf version='1.6'><world name='w'>{model(CYLINDER)}</world></sdf>"
    (tmp_path / "w.world").write_text(text, encoding="utf-8")
    assert len(load_sdf(tmp_path / "w.world").circles) == 1


def test_a_comment_that_is_not_in_the_files_encoding_does_not_matter(tmp_path: Path) -> None:
    text = f"<sdf version='1.6'><!-- caf\xe9 --><world name='w'>{model(CYLINDER)}</world></sdf>"
    (tmp_path / "w.world").write_bytes(text.encode("latin-1"))
    assert len(load_sdf(tmp_path / "w.world").circles) == 1


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    bomb = "<!DOCTYPE sdf [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;&a;'>]>"
    text = f"{bomb}<sdf version='1.6'><world name='&b;'>{model(CYLINDER)}</world></sdf>"
    (tmp_path / "bomb.world").write_bytes(text.encode(encoding))
    with pytest.raises(WorldError, match="DOCTYPE"):
        load_sdf(tmp_path / "bomb.world")


@pytest.mark.slow
def test_every_barn_world_loads_and_its_published_path_is_free(barn: Path) -> None:
    """Ties our frame to the benchmark's: its paths, made for a Jackal, keep well away from the cylinders."""
    files = sorted((barn / "worlds").glob("*.world"))
    assert len(files) == 50
    for file in files:
        world = load_sdf(file)
        assert len(world.circles) > 150
        assert (world.circles[:, 2] == 0.075).all()
        cells = np.load(barn / "paths" / f"path_{file.stem.split('_')[1]}.npy")
        points = np.column_stack(
            [cells[:, 0] * 0.15 - 4.575, cells[:, 1] * 0.15 + 5.075, np.zeros(len(cells))]
        )
        clearance = _core.clearance(world.native, points, 0.22, np.empty((0, 2)), 1.0)
        assert clearance.min() > 0.0, file.name
