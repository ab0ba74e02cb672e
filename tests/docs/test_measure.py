"""docs/measure.py: a row is driven when what it says is not what would be driven today."""

import importlib.util
import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from adrl.baselines.planners import PLANNERS
from adrl.deploy.policies import find_policy
from adrl.envs import NavVectorEnv
from adrl.imitation.best_planner import best_planner
from adrl.types import GUIDANCE
from adrl.worlds import ROBOTS, SCENARIOS, load_robot
from adrl.worlds.place import Place
from adrl.worlds.robot_files import robot_from_fields

ROOT = Path(__file__).resolve().parents[2]
ROW = [
    "--policy",
    "astar-pursuit",
    "--robot",
    "jackal",
    "--scenario",
    "clutter",
    "--guidance",
    "map",
    "--episodes",
    "1",
]


@pytest.fixture(scope="module")
def measuring() -> ModuleType:
    spec = importlib.util.spec_from_file_location("measure", ROOT / "docs" / "measure.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["measure"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("change", "stays"),
    [
        ({}, True),
        ({"driving": 0}, False),
        ({"command": "adrl evaluate"}, False),
        ({"policy_fingerprint": "x"}, False),
    ],
)
def test_a_row_is_driven_anew_when_it_would_be_another_today(
    measuring: ModuleType, tmp_path: Path, change: dict[str, object], stays: bool
) -> None:
    path = tmp_path / "rows" / "00.json"
    measuring.measure(path, ROW)
    first = json.loads(path.read_text())
    assert first["command"] == "adrl evaluate " + " ".join(ROW)
    assert (first["success"], first["episodes"]) == (1.0, 1)
    path.write_text(json.dumps(first | change | {"mark": 1}))
    measuring.measure(path, ROW)
    assert json.loads(path.read_text()) == (first | {"mark": 1} if stays else first)


def test_a_row_that_cannot_be_driven_leaves_no_file_and_says_so(
    measuring: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "RESULTS", tmp_path)
    monkeypatch.setitem(measuring.PAGES, "page", lambda options: [ROW, [*ROW[:-1], "0"]])
    monkeypatch.setattr(sys, "argv", ["measure.py", "page"])
    stale = tmp_path / "page" / "02.json"
    stale.parent.mkdir()
    stale.touch()
    assert measuring.main() != 0
    assert [path.name for path in (tmp_path / "page").iterdir()] == ["00.json"]


@pytest.mark.parametrize("page", ["classical-still", "classical-moving", "people", "planners"])
def test_every_row_of_a_page_is_another_drive_that_there_is(
    measuring: ModuleType, monkeypatch: pytest.MonkeyPatch, page: str
) -> None:
    monkeypatch.setattr(measuring, "demonstrator", lambda robot, place: "astar-mppi")
    rows = measuring.PAGES[page](measuring.Options(what=page, episodes=7))
    assert len({tuple(row) for row in rows}) == len(rows) > 10
    for row in rows:
        options = dict(zip(row[::2], row[1::2], strict=True))
        find_policy(options["--policy"], PLANNERS)
        require_a_drive(options)


def test_a_planner_that_is_chosen_has_a_row_and_astar_dwa_beside_another(
    measuring: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = {"jackal": "astar-mppi"}
    monkeypatch.setattr(measuring, "demonstrator", lambda robot, place: chosen.get(robot, "astar-dwa"))
    rows = measuring.planners(measuring.Options(what="planners", episodes=7))
    assert {row[3]: [other[1] for other in rows if other[3] == row[3]] for row in rows} == {
        **{
            robot: ["astar-dwa"] * (3 if robot in measuring.DEMONSTRATED[2:5] else 2)
            for robot in measuring.DEMONSTRATED
        },
        "jackal": ["astar-mppi", "astar-dwa"] * 2,
    }


def test_the_demonstrator_is_the_one_that_training_takes(measuring: ModuleType) -> None:
    assert measuring.demonstrator("diffbot", Place(scenario="clutter")) == "astar-dwa"


def test_with_astar_dwa_the_cart_backs_as_the_page_says() -> None:
    env = NavVectorEnv(
        1, scenario="complex", robot=load_robot(ROOT / "docs" / "results" / "planners" / "cart.toml")
    )
    backward = best_planner(env, ("dwa",)).backward
    page = (ROOT / "docs" / "results" / "planners.md").read_text(encoding="utf-8")
    assert f"the cart backs in {100 * backward:.0f} % of the time" in page


def test_the_cart_is_the_robot_of_the_guide(measuring: ModuleType) -> None:
    guide = (ROOT / "docs" / "guide" / "robot.md").read_text(encoding="utf-8")
    text = guide.partition('title="my_robot.toml"\n')[2].partition("```")[0]
    cart = load_robot(ROOT / measuring.DEMONSTRATED[0])
    assert replace(cart, name="diffbot") == robot_from_fields(tomllib.loads(text))


def test_a_row_of_the_benchmark_does_not_tell_where_its_worlds_lie(
    measuring: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[str] = []

    def drive(words: list[str]) -> int:
        asked.extend(words)
        Path(words[-1]).write_text("{}")
        return 0

    monkeypatch.setattr(measuring, "adrl", drive)
    row = measuring.barn(measuring.Options(what="barn"))[0]
    path = tmp_path / "00.json"
    assert measuring.measure(path, row, measuring.BARN, Path("/my/worlds")) == 0
    assert asked[:3] == ["barn", "--worlds", "/my/worlds"]
    assert json.loads(path.read_text())["command"] == "adrl barn --worlds DIR --policy jackal --v-max 2"


def test_of_drives_with_faults_is_kept_how_each_ended(measuring: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "faults.json"
    row = ["--robot", "diffbot", "--scenario", "clutter", "--fault", "none", "mounted backwards"]
    assert measuring.measure_faults(path, row) == 0
    kept = json.loads(path.read_text())
    assert kept["command"] == (
        "adrl bench faults --robot diffbot --scenario clutter --fault none 'mounted backwards'"
    )
    assert set(kept["policies"]) == {"diffbot", "jackal"}
    none, backwards = kept["faults"]
    assert (none["fault"], none["ends"]) == ("none", {"diffbot clutter 0": "arrived"})
    assert (backwards["fault"], backwards["ends"]) == ("mounted backwards", {"diffbot clutter 0": "timeout"})
    assert backwards["reasons"]["mount"] == 1


@pytest.mark.parametrize(
    ("name", "some", "other"), [("default", "any", "jackal"), ("diffbot", "jackal", "any")]
)
def test_every_row_of_a_card_is_another_drive_that_there_is(
    measuring: ModuleType, name: str, some: str, other: str
) -> None:
    policy = find_policy(name)
    sizes = measuring.Options(what=name, robots=50, elsewhere=7, episodes=9)
    rows = measuring.of_policy(policy, sizes)
    assert len({tuple(row) for row in rows}) == len(rows) > 10
    robots = []
    for row in rows:
        options = dict(zip(row[::2], row[1::2], strict=True))
        require_a_drive({"--robot": "diffbot"} | options)
        robots.append(options.get("--robot"))
        if "--robots" in options:
            assert options["--episodes"] == "20", "tasks of each robot of a family"
        else:
            assert options["--episodes"] == "9"
    assert (some in robots, None in robots) == (True, policy.family is None), "its own robot needs no name"
    if policy.family is not None:
        assert rows[0][-1] == "50", "the first row is the one with many robots"
        assert other in robots
    else:
        assert not {other, name} & set(robots)


def require_a_drive(options: dict[str, str]) -> None:
    assert options["--robot"] in {*ROBOTS, "any"} or (ROOT / options["--robot"]).exists()
    assert options.get("--scenario", "clutter") in SCENARIOS
    assert options["--guidance"] in GUIDANCE
    assert (ROOT / options.get("--map", "docs")).exists()
