"""docs/measure.py: a row is driven when what it says is not what would be driven today."""

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from adrl.baselines.planners import PLANNERS
from adrl.deploy.policies import find_policy
from adrl.types import GUIDANCE
from adrl.worlds import ROBOTS, SCENARIOS

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


@pytest.mark.parametrize("page", ["classical-still", "classical-moving", "people"])
def test_every_row_of_a_page_is_another_drive_that_there_is(measuring: ModuleType, page: str) -> None:
    rows = measuring.PAGES[page](measuring.Options(what=page, episodes=7))
    assert len({tuple(row) for row in rows}) == len(rows) > 10
    for row in rows:
        options = dict(zip(row[::2], row[1::2], strict=True))
        find_policy(options["--policy"], PLANNERS)
        require_a_drive(options)


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
