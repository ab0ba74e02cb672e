"""A world of Gazebo as a place: its options, and what the terminal is told."""

from pathlib import Path

import pytest

from adrl.cli import main
from adrl.errors import ConfigError
from adrl.worlds.place import Place
from adrl.worlds.sdf_scenario import SdfScenario

POST = "<geometry><cylinder><radius>0.3</radius><length>1</length></cylinder></geometry>"
WALL = "<geometry><box><size>8 0.2 1</size></box></geometry>"


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    """Two walls, an included post, an actor, and a mesh that is not there."""

    def model(name: str, geometry: str, pose: str) -> str:
        link = f"<link name='l'><collision name='c'>{geometry}</collision></link>"
        return f"<model name='{name}'><static>1</static><pose>{pose}</pose>{link}</model>"

    (tmp_path / "far" / "post").mkdir(parents=True)
    post = model("post", POST, "0 0 0.5 0 0 0")
    (tmp_path / "far" / "post" / "model.sdf").write_text(f"<sdf version='1.6'>{post}</sdf>")
    content = model("north", WALL, "0 3 0.5 0 0 0") + model("south", WALL, "0 -3 0.5 0 0 0")
    content += "<include><uri>model://post</uri></include><actor name='walker'/>"
    content += model("hydrant", "<geometry><mesh><uri>hydrant.dae</uri></mesh></geometry>", "1 1 0 0 0 0")
    path = tmp_path / "yard.world"
    path.write_text(f"<sdf version='1.6'><world name='w'>{content}</world></sdf>")
    return path


@pytest.mark.integration
def test_a_world_with_a_hole_is_driven_and_told(yard: Path, capsys: pytest.CaptureFixture[str]) -> None:
    evaluate = ["evaluate", "--policy", "astar-dwa", "--world", str(yard), "--episodes", "2"]
    assert main([*evaluate, "--models", str(yard.parent / "far")]) == 2
    error = capsys.readouterr().err
    assert "--ignore hydrant" in error
    assert main([*evaluate, "--models", str(yard.parent / "far"), "--ignore", "hydrant"]) == 0
    assert "sdf:yard: left out: walker (actors, which walk)\n" in capsys.readouterr().err


def test_a_run_finds_its_world_again(yard: Path) -> None:
    settings = {"world": str(yard), "models": [str(yard.parent / "far")], "ignore": ["hydrant"]}
    scenario = Place.of(settings).load()
    assert isinstance(scenario, SdfScenario)
    assert len(scenario.world.circles) == 1
    # A run of before these options has none of them.
    assert Place.of({"world": str(yard)}).ignore == ()


def test_options_of_a_world_need_one() -> None:
    with pytest.raises(ConfigError, match="give --world too"):
        Place(ignore=("hydrant",))
    with pytest.raises(ConfigError, match="give --world too"):
        Place(scenario="clutter", models=(Path("models"),))
