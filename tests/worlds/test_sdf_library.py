"""Where models are found, and which of their files is read."""

from pathlib import Path

import pytest

from adrl.errors import WorldError
from adrl.worlds.sdf import SdfWorld, load_sdf
from adrl.worlds.sdf.library import PATH_VARIABLES

SHAPE = "<geometry><cylinder><radius>{}</radius><length>1</length></cylinder></geometry>"
POST = f"<link name='l'><collision name='c'>{SHAPE}</collision></link>"


@pytest.fixture(autouse=True)
def _nowhere_else(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """This machine's own models are not found."""
    for variable in (
        *PATH_VARIABLES,
        "ROS_PACKAGE_PATH",
        "AMENT_PREFIX_PATH",
        "GZ_FUEL_CACHE_PATH",
        "IGN_FUEL_CACHE_PATH",
    ):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))


def post(
    folder: Path, radius: float = 0.2, *, file: str = "model.sdf", extra: str = "", version: str = "1.6"
) -> None:
    """A model that is a post."""
    folder.mkdir(parents=True, exist_ok=True)
    model = f"<model name='post'><static>1</static>{extra}{POST.format(radius)}</model>"
    (folder / file).write_text(f"<sdf version='{version}'>{model}</sdf>")


def load(folder: Path, content: str, **options: object) -> SdfWorld:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "w.world"
    path.write_text(f"<sdf version='1.6'><world name='w'>{content}</world></sdf>")
    return load_sdf(path, **options)  # type: ignore[arg-type]


def include(uri: str, more: str = "") -> str:
    return f"<include><uri>{uri}</uri>{more}</include>"


def test_an_included_model_stands_where_the_include_puts_it(tmp_path: Path) -> None:
    post(tmp_path / "pkg" / "models" / "post", extra="<pose>7 0 0 0 0 0</pose>")
    both = include("model://post") + include("model://post", "<name>b</name><pose>1 2 0 0 0 0.3</pose>")
    world = load(tmp_path / "pkg" / "worlds", both)
    # Its own pose counts where the include gives none.
    assert world.circles.tolist() == [[7.0, 0.0, 0.2], [1.0, 2.0, 0.2]]
    assert len(load(tmp_path / "pkg" / "worlds", both, ignore=["b"]).circles) == 1


@pytest.mark.parametrize("variable", PATH_VARIABLES)
def test_gazebos_variables_are_looked_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str
) -> None:
    post(tmp_path / "far" / "away" / "post")
    with pytest.raises(WorldError, match=r"needs model://post, .* --models"):
        load(tmp_path / "w", include("model://post"))
    monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'far' / 'away'}")
    assert len(load(tmp_path / "w", include("model://post")).circles) == 1


def test_folders_given_come_first_and_may_be_a_list(tmp_path: Path) -> None:
    post(tmp_path / "w" / "models" / "post", 0.1)
    post(tmp_path / "a" / "post", 0.3)
    post(tmp_path / "b" / "other", 0.4)
    content = include("model://post") + include("model://other", "<name>o</name>")
    world = load(tmp_path / "w", content, models=[f"{tmp_path / 'a'}:{tmp_path / 'b'}"])
    assert world.circles[:, 2].tolist() == [0.3, 0.4]
    with pytest.raises(WorldError, match="no folder"):
        load(tmp_path / "w", content, models=[tmp_path / "none"])


def test_the_newest_file_that_model_config_lists_is_read(tmp_path: Path) -> None:
    place = tmp_path / "models" / "post"
    for version, radius in (("1.5", 0.15), ("1.10", 0.1), ("1.9", 0.19)):
        post(place, radius, file=f"model-{version}.sdf")
    listed = "".join(f"<sdf version='{v}'>model-{v}.sdf</sdf>" for v in ("1.5", "1.10", "1.9"))
    (place / "model.config").write_text(f"<?xml version='1.0'?><model><name>Post</name>{listed}</model>")
    assert load(tmp_path, include("model://post")).circles[0, 2] == 0.1
    # Gazebo minds no ampersand in a description.
    post(place, 0.2)
    (place / "model.config").write_text("<model><description>post & rail</description></model>")
    assert load(tmp_path, include("model://post")).circles[0, 2] == 0.2


def test_a_folder_of_the_same_name_without_a_model_is_passed_by(tmp_path: Path) -> None:
    post(tmp_path / "models" / "house")
    assert len(load(tmp_path / "house" / "worlds", include("model://house")).circles) == 1


@pytest.mark.parametrize(
    ("where", "uri"),
    [
        ("models/post", "file://models/post"),
        ("models/post", "models/post"),
        ("pkg/models/post", "package://pkg/models/post"),
        ("models/Big Post", "https://fuel.gazebosim.org/1.0/Owner/models/Big Post"),
        (
            "home/.gz/fuel/fuel.gazebosim.org/owner/models/big post/3",
            "https://fuel.gazebosim.org/1.0/Owner/models/Big%20Post",
        ),
        (
            "home/.gz/fuel/fuel.gazebosim.org/owner/models/big post/2",
            "https://fuel.gazebosim.org/1.0/Owner/models/Big Post/2",
        ),
        ("home/.gazebo/models/post", "model://post"),
    ],
)
def test_every_kind_of_address(tmp_path: Path, where: str, uri: str) -> None:
    post(tmp_path / where)
    assert len(load(tmp_path, include(uri)).circles) == 1


def test_includes_in_models_and_static_and_placement_frames(tmp_path: Path) -> None:
    post(tmp_path / "models" / "post")
    frame = "<frame name='top'><pose>0 1 0 0 0 0</pose></frame>"
    post(tmp_path / "models" / "framed", extra=frame, version="1.8")
    inner = include("model://post", "<pose>1 0 0 0 0 0</pose>")
    pair = f"<model name='pair'><static>1</static><pose>0 5 0 0 0 0</pose>{inner}</model>"
    assert load(tmp_path, pair).circles.tolist() == [[1.0, 5.0, 0.2]]
    placed = include("model://framed", "<placement_frame>top</placement_frame><pose>3 3 0 0 0 0</pose>")
    assert load(tmp_path, placed).circles.tolist() == [[3.0, 2.0, 0.2]]
    loose = load(tmp_path, include("model://post", "<static>false</static>"))
    assert loose.guessed == {"not static: they move when pushed": ("post",)}


def test_names_of_a_merged_model_are_its_parents(tmp_path: Path) -> None:
    post(tmp_path / "models" / "post")
    merged = "<include merge='true'><uri>model://post</uri><pose>1 0 0 0 0 0</pose></include>"
    body = f"<pose relative_to='l'>0 1 0 0 0 0</pose><collision name='c'>{SHAPE.format(0.1)}</collision>"
    link = f"<link name='m'>{body}</link>"
    world = load(tmp_path, f"<model name='two'><static>1</static>{link}{merged}</model>")
    assert sorted(world.circles[:, :2].tolist()) == [[1.0, 0.0], [1.0, 1.0]]


def test_includes_in_a_circle_are_refused(tmp_path: Path) -> None:
    place = tmp_path / "models" / "ring"
    place.mkdir(parents=True)
    twice = include("model://ring") + include("model://ring", "<name>b</name>")
    (place / "model.sdf").write_text(f"<sdf version='1.7'><model name='ring'>{twice}</model></sdf>")
    with pytest.raises(WorldError, match="nested more than"):
        load(tmp_path, include("model://ring"))


def test_actors_that_are_included_are_named(tmp_path: Path) -> None:
    place = tmp_path / "models" / "walker"
    place.mkdir(parents=True)
    (place / "model.sdf").write_text("<sdf version='1.6'><actor name='walker'/></sdf>")
    post(tmp_path / "models" / "post")
    world = load(tmp_path, include("model://walker") + include("model://post"))
    assert world.left_out == {"actors, which walk": ("walker",)}


@pytest.mark.parametrize(
    "content", ["<sdf", "<sdf version='1.6'/>", "<robot name='r'/>", "<!DOCTYPE a><sdf/>"]
)
def test_a_model_that_cannot_be_read_is_named_with_its_file(tmp_path: Path, content: str) -> None:
    place = tmp_path / "models" / "bad"
    place.mkdir(parents=True)
    (place / "model.sdf").write_text(content)
    with pytest.raises(WorldError, match=r"needs model://bad, but .*model\.sdf .*--ignore bad"):
        load(tmp_path, include("model://bad"))
