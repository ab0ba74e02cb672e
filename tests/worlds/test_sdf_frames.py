"""Frames of SDFormat: relative_to, attached_to, joints, nested models, placement frames; and tilts."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from adrl.errors import WorldError
from adrl.worlds.sdf import SdfWorld, load_sdf

CYLINDER = "<geometry><cylinder><radius>0.3</radius><length>1</length></cylinder></geometry>"
CUBE = "<geometry><box><size>1 1 1</size></box></geometry>"
BODY = f"<collision name='c'>{CYLINDER}</collision>"


def load(folder: Path, content: str) -> SdfWorld:
    path = folder / "test.sdf"
    path.write_text(f"<sdf version='1.8'><world name='w'>{content}</world></sdf>")
    return load_sdf(path)


def at(world: SdfWorld) -> list[float]:
    ((x, y, _),) = world.circles.round(9).tolist()
    return [x, y]


def test_an_empty_pose_is_the_frame_that_it_is_relative_to(tmp_path: Path) -> None:
    joint = "<joint name='j' type='fixed'><pose relative_to='__model__'>0 2 0.5 0 0 0</pose>"
    world = load(
        tmp_path,
        f"<model name='b'><static>1</static><link name='a'><pose>5 0 0.5 0 0 0</pose></link>"
        f"<link name='d'><pose relative_to='j'/>{BODY}</link>{joint}<parent>a</parent><child>d</child></joint></model>",
    )
    assert at(world) == [0.0, 2.0]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        # A joint is given in its child, a frame in what it is attached to.
        (
            "<link name='a'><pose>1 0 0 0 0 0</pose></link><joint name='j' type='fixed'><pose>0 1 0 0 0 0</pose>"
            "<parent>world</parent><child>a</child></joint>"
            "<link name='l'><pose relative_to='j'>1 0 0 0 0 0</pose>{}</link>",
            [2.0, 1.0],
        ),
        (
            "<link name='a'><pose>1 0 0 0 0 1.5707963267948966</pose></link><frame name='f' attached_to='a'>"
            "<pose>1 0 0 0 0 0</pose></frame><link name='l'><pose relative_to='f'>1 0 0 0 0 0</pose>{}</link>",
            [1.0, 2.0],
        ),
        (
            "<frame name='f' attached_to='a'><pose relative_to='__model__'>0 4 0 0 0 0</pose></frame><link name='a'/>"
            "<link name='l'><pose relative_to='f'/>{}</link>",
            [0.0, 4.0],
        ),
        # Names go down into nested models.
        (
            "<model name='n'><pose>0 1 0 0 0 0</pose><link name='a'><pose>1 0 0 0 0 0</pose></link></model>"
            "<link name='l'><pose relative_to='n::a'>1 0 0 0 0 0</pose>{}</link>",
            [2.0, 1.0],
        ),
        (
            "<frame name='f'><pose>3 0 0 0 0 0</pose></frame><model name='n'><pose relative_to='f'>0 1 0 0 0 0</pose>"
            "<link name='l'><pose relative_to='__model__'>0 1 0 0 0 0</pose>{}</link></model>",
            [3.0, 2.0],
        ),
        # SDFormat 1.6 called it frame.
        (
            "<link name='a'><pose>1 0 0 0 0 0</pose></link><link name='l'><pose frame='a'>1 0 0 0 0 0</pose>{}</link>",
            [2.0, 0.0],
        ),
        ("<link name='l'><pose rotation_format='quat_xyzw'>1 0 0 0 0 0.6 0.8</pose>{}</link>", [1.0, 0.0]),
    ],
)
def test_frames_are_resolved_as_the_specification_says(
    tmp_path: Path, content: str, expected: list[float]
) -> None:
    world = load(tmp_path, f"<model name='m'><static>1</static>{content.format(BODY)}</model>")
    assert at(world) == expected


@pytest.mark.parametrize(
    ("frame", "expected"), [("__model__", [1.0, 0.0]), ("a", [1.0, 3.0]), ("", [1.0, 2.0])]
)
def test_a_collision_may_be_relative_to_any_frame_of_its_model(
    tmp_path: Path, frame: str, expected: list[float]
) -> None:
    collision = f"<collision name='c'><pose relative_to='{frame}'>1 0 0 0 0 0</pose>{CYLINDER}</collision>"
    link = f"<link name='l'><pose>0 2 0 0 0 0</pose>{collision}</link><link name='a'><pose>0 3 0 0 0 0</pose></link>"
    assert at(load(tmp_path, f"<model name='m'><static>1</static>{link}</model>")) == expected


def test_a_placement_frame_is_what_the_models_pose_places(tmp_path: Path) -> None:
    links = f"<link name='a'><collision name='c'>{CUBE}</collision></link>"
    links += "<link name='b'><pose>5 0 0 0 0 0</pose></link>"
    model = (
        "<model name='m' placement_frame='b'><static>1</static><pose>2 0 0.5 0 0 {}</pose>"
        + links
        + "</model>"
    )
    (corners,) = load(tmp_path, model.format(0)).polygons
    np.testing.assert_allclose(corners.mean(axis=0), (-3.0, 0.0), atol=1e-12)
    (corners,) = load(tmp_path, model.format(math.pi / 2)).polygons
    np.testing.assert_allclose(corners.mean(axis=0), (2.0, -5.0), atol=1e-12)


def test_the_world_has_frames_too(tmp_path: Path) -> None:
    post = f"<static>1</static><pose relative_to='f'>1 0 0 0 0 0</pose><link name='l'>{BODY}</link>"
    post = f"<model name='post'>{post}</model>"
    base = "<model name='base'><static>1</static><pose>0 5 0 0 0 0</pose><link name='l'/></model>"
    frame = "<frame name='f' attached_to='base::l'><pose>1 0 0 0 0 0</pose></frame>"
    assert at(load(tmp_path, post + base + frame)) == [2.0, 5.0]


def test_models_of_one_name_stand_each_in_its_place(tmp_path: Path) -> None:
    post = f"<model name='post'><static>1</static><pose>{{}} 0 0 0 0 0</pose><link name='l'>{BODY}</link></model>"
    assert load(tmp_path, post.format(1) + post.format(2)).circles[:, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("<link name='l'><pose relative_to='x'/>{}</link>", "relative to 'x'"),
        ("<link name='l'><pose relative_to='world'/>{}</link>", "relative to 'world'"),
        ("<link name='l'><pose relative_to='f'/>{}</link><frame name='f' attached_to='l'/>", "circle"),
        (
            "<link name='l'><pose relative_to='n::x'/>{}</link><model name='n'/>",
            "'m::n' has a pose relative to 'x'",
        ),
        ("<link name='l'><pose rotation_format='matrix'>0</pose>{}</link>", "'matrix'"),
    ],
)
def test_frames_that_are_not_there_are_refused(tmp_path: Path, content: str, says: str) -> None:
    with pytest.raises(WorldError, match="--ignore m") as caught:
        load(tmp_path, f"<model name='m'>{content.format(BODY)}</model>")
    assert says in str(caught.value)


def test_a_chain_of_thousands_of_frames_is_refused_not_a_crash(tmp_path: Path) -> None:
    frames = "".join(f"<frame name='f{i}' attached_to='f{i + 1}'/>" for i in range(5000))
    content = f"<model name='m'><link name='l'><pose relative_to='f0'/>{BODY}</link>{frames}</model>"
    with pytest.raises(WorldError, match="more than 200 frames"):
        load(tmp_path, content)


POSE = st.tuples(*[st.floats(-3.0, 3.0)] * 6)


def matrix(pose: tuple[float, ...]) -> np.ndarray:
    result = np.eye(4)
    x, y, z = (Rotation.from_rotvec(angle * axis) for angle, axis in zip(pose[3:], np.eye(3), strict=True))
    result[:3, :3], result[:3, 3] = (z * y * x).as_matrix(), pose[:3]
    return result


@given(a=POSE, b=POSE, c=POSE)
def test_tilts_compose_in_space(
    tmp_path_factory: pytest.TempPathFactory, a: tuple, b: tuple, c: tuple
) -> None:
    """A ball is where the product of the matrices puts it; it is high enough to be met at any height."""
    folder = tmp_path_factory.mktemp("world")
    text = [" ".join(map(repr, pose)) for pose in (a, b, c)]
    ball = "<geometry><sphere><radius>40</radius></sphere></geometry>"
    world = load(
        folder,
        f"<model name='m'><static>1</static><pose>{text[0]}</pose><link name='l'><pose>{text[1]}</pose>"
        f"<collision name='c'><pose>{text[2]}</pose>{ball}</collision></link></model>",
    )
    centre = (matrix(a) @ matrix(b) @ matrix(c))[:2, 3]
    np.testing.assert_allclose(world.circles[0, :2], centre, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "link", "size", "expected"),
    [
        ("1 0 0.5 1.5707963 0 0", "0 0 0 0 0 0", (1.0, 1.0, 0.2), (1.0, 0.2, 0.0)),
        ("1 0 0.5 3.14159265 0 0.3", "0 0 0 0 0 0", (1.0, 1.0, 1.0), (1.0, 1.0, 0.3)),
        ("1 0 0.5 0.005 -0.002 0.3", "0 0 0 0 0 0", (1.0, 1.0, 1.0), (1.0, 1.0, 0.3)),
        ("1 0 0.5 1.5707963 0 0", "0 0 0 -1.5707963 0 0", (1.0, 1.0, 1.0), (1.0, 1.0, 0.0)),
        ("1 0 0.5 0 1.5707963 0.4", "0 0 0 0 0 0", (1.0, 0.4, 0.2), (0.2, 0.4, 0.4)),
    ],
)
def test_right_angles_and_settled_boxes_are_rectangles(
    tmp_path: Path, model: str, link: str, size: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    box = f"<geometry><box><size>{' '.join(map(str, size))}</size></box></geometry>"
    (corners,) = load(
        tmp_path,
        f"<model name='m'><static>1</static><pose>{model}</pose><link name='l'><pose>{link}</pose>"
        f"<collision name='c'>{box}</collision></link></model>",
    ).polygons
    assert len(corners) == 4
    c, s = math.cos(expected[2]), math.sin(expected[2])
    local = (corners - (1.0, 0.0)) @ np.array([(c, -s), (s, c)])
    np.testing.assert_allclose(np.abs(local), np.tile(0.5 * np.array(expected[:2]), (4, 1)), atol=2e-3)


def test_a_tilted_lamp_above_the_band_is_left_out_and_a_lying_pillar_is_a_rectangle(tmp_path: Path) -> None:
    lamp = (
        "<model name='lamp'><static>1</static><pose>1 0 2.5 0.5 0 0</pose><link name='l'>"
        + BODY
        + "</link></model>"
    )
    pillar = "<pose>1 0 0.3 1.5707963 0 0</pose><link name='l'>" + BODY + "</link>"
    world = load(tmp_path, f"{lamp}<model name='pillar'><static>1</static>{pillar}</model>")
    assert world.left_out == {"above 0.5 m": ("lamp",)}
    assert len(world.circles) == 0
    (corners,) = world.polygons
    np.testing.assert_allclose(np.abs(corners - (1.0, 0.0)), np.tile((0.3, 0.5), (4, 1)), atol=1e-6)
