"""docs/tables.py: what stands in a page is what stands in its file."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from adrl.comparison.config import DRIVING
from adrl.deploy.policies import find_policy
from adrl.errors import ConfigError

ROOT = Path(__file__).resolve().parents[2]
BLOCK = "before\n\n<!-- table: compare compare/complex.json -->\n<!-- end of table -->\n\nafter\n"


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_table_is_that_of_its_file_and_the_rest_of_the_page_stays(tables: ModuleType) -> None:
    page = tables.rewritten(BLOCK)
    assert page.startswith("before\n\n<!-- table: compare compare/complex.json -->\n")
    assert page.endswith("\n<!-- end of table -->\n\nafter\n")
    assert "| ADRL | `map` | 10 | 99.6 [99.3, 99.9] | 98.4 |" in page
    assert tables.rewritten(page) == page


def test_a_number_that_is_not_in_its_file_is_found(tables: ModuleType) -> None:
    page = tables.rewritten(BLOCK)
    assert tables.rewritten(page.replace("99.6", "99.9")) == page


def test_all_columns_are_told_of_a_file_of_before_too(tables: ModuleType) -> None:
    lines = tables.compare_all(tables.RESULTS / "compare" / "clutter.json")
    assert "| td3 | goal, n=10 | 98.5 [98.2-98.8] | 98.6 | 97.6 | 0.5 | 1.0 |" in "\n".join(lines)
    assert lines[0].count("|") == lines[2].count("|")


def test_runs_become_a_row_a_method_and_guidance_with_means_over_seeds(
    tables: ModuleType, tmp_path: Path
) -> None:
    def run(seed: int, method: str, success: float, time_s: float | None) -> dict[str, Any]:
        metrics = {"success": success, "collision": 0.0, "time_s": time_s, "optimality": time_s}
        return {"seed": seed, "method": method, "guidance": "map", "S": 0.5, **metrics}

    path = tmp_path / "runs.json"
    path.write_text(json.dumps([run(0, "td3", 0.8, 10.0), run(0, "bc", 0.0, None), run(1, "td3", 1.0, 12.0)]))
    headings, _, *rows = (line.split(" | ") for line in tables.runs(path) if line)
    assert headings[0] == "| method"
    assert headings[-1] == "S at the end |"
    bc, td3 = rows
    assert bc[:5] == ["| bc", "`map`", "1", "0.0", "0.0"]
    assert bc[6:8] == ["-", "-"]  # who never arrives has neither time nor path
    assert td3[:5] == ["| Baseline (TD3)", "`map`", "2", "90.0 [80.0, 100.0]", "80.0"]
    assert td3[6] == "11.0 [10.0, 12.0]"


def test_runs_without_a_method_are_told_by_their_map(tables: ModuleType) -> None:
    headings, _, *rows = (
        line for line in tables.runs(tables.RESULTS / "compare" / "complex-on-maps.json") if line
    )
    assert headings.startswith("| map | guidance | seeds | success, % |")
    assert "S at the end" not in headings
    assert [row.split(" | ")[0] for row in rows] == ["| depot", "| tb3", "| willow"]


def test_sentences_have_the_numbers_of_the_files_that_they_are_about(tables: ModuleType) -> None:
    barn = json.loads((tables.RESULTS / "barn" / "00.json").read_text())
    said = f"has {100 * barn['success']:.1f} % and {barn['score']:.3f} at 2 m/s"
    assert said in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    worlds = {row["world"]: row for row in barn["per_world"] if row["success"] < 1.0}
    assert {number: (row["collision"], row["timeout"]) for number, row in worlds.items()} == {
        276: (0.1, 0.0),
        286: (0.0, 0.1),
    }
    jackals = json.loads((tables.RESULTS / "faults-jackal.json").read_text())["faults"]
    ends = {(row["fault"], drive): end for row in jackals for drive, end in row["ends"].items()}
    assert len(ends) == 50
    assert [key for key, end in ends.items() if end == "hit_standing"] == [
        ("scan late by 2, unsaid, for 2 s", "jackal rooms 10")
    ]


def test_an_unknown_form_and_an_absent_file_are_told(tables: ModuleType) -> None:
    with pytest.raises(KeyError, match="guess"):
        tables.rewritten(BLOCK.replace("table: compare", "table: guess"))
    with pytest.raises(FileNotFoundError):
        tables.rewritten(BLOCK.replace("complex", "absent"))


def test_the_pages_tell_what_their_files_say(tables: ModuleType) -> None:
    for path in tables.pages():
        text = path.read_text(encoding="utf-8")
        assert tables.rewritten(text) == text, f"{path}: run python docs/tables.py"


def summary(**others: Any) -> dict[str, Any]:
    rates = {"success": 0.5, "collision": 0.3, "timeout": 0.2, "at_fault": 0.1}
    means = {"time_s": 12.0, "optimality": 1.25, "person_distance_m": 0.25}
    low = {f"{name}_low": value - 0.05 for name, value in (rates | means).items()}
    high = {f"{name}_high": value + 0.1 for name, value in (rates | means).items()}
    who = {"policy": "astar-mppi", "robot": "jackal", "scenario": "crowd", "guidance": "map", "episodes": 200}
    how = {"command": "adrl evaluate", "driving": DRIVING, "policy_fingerprint": None}
    return (
        who
        | how
        | rates
        | means
        | low
        | high
        | {"near_person_s": 4.0, "frozen_s": 0.02, "lost_s": 1.5}
        | others
    )


def test_measured_rows_stand_in_the_order_of_their_files(tables: ModuleType, tmp_path: Path) -> None:
    for number, name in ((1, "orca"), (0, "astar-mppi")):
        (tmp_path / f"{number:02}.json").write_text(json.dumps(summary(policy=name)))
    (tmp_path / "02.json").write_text(json.dumps(summary(lost_s=None)))  # who never arrives loses no time
    planners = [line.strip("| ").split(" | ") for line in tables.planner_rows(tmp_path) if line]
    assert dict(zip(planners[0], planners[2], strict=True)) == {
        "robot": "jackal",
        "place": "`crowd`",
        "guidance": "`map`",
        "planner": "`astar-mppi`",
        "drives": "200",
        "success, %": "50.0 [45.0, 60.0]",
        "hit, %": "30.0",
        "late, %": "20.0",
        "Av.T, s": "12.0 [11.9, 12.1]",
        "path / shortest": "1.25 [1.20, 1.35]",
    }
    people = [line.strip("| ").split(" | ") for line in tables.people_rows(tmp_path) if line]
    first, second, third = (dict(zip(people[0], row, strict=True)) for row in people[2:])
    assert first == {
        "place": "`crowd`",
        "what drives": "`astar-mppi`",
        "guidance": "`map`",
        "drives": "200",
        "success, %": "50.0 [45.0, 60.0]",
        "collision, %": "30.0 [25.0, 40.0]",
        "at fault, %": "10.0 [5.0, 20.0]",
        "nearest, m": "0.25 [0.20, 0.35]",
        "within 0.5 m, s": "4.00",
        "frozen, s": "0.02",
        "lost, s": "1.50",
    }
    assert second["what drives"] == planners[3][3] == "`orca`"
    assert third["lost, s"] == "-"


@pytest.mark.parametrize(
    "change", [{"driving": DRIVING - 1}, {"policy": "default", "policy_fingerprint": "other"}]
)
def test_drives_of_before_are_in_no_table(tables: ModuleType, tmp_path: Path, change: dict[str, Any]) -> None:
    with pytest.raises(FileNotFoundError, match="nothing is measured"):
        tables.planner_rows(tmp_path)
    (tmp_path / "00.json").write_text(json.dumps(summary(**change)))
    with pytest.raises(ConfigError, match=r"adrl evaluate: is of before; run python docs/measure.py"):
        tables.people_rows(tmp_path)


def test_a_row_of_the_benchmark_has_its_score(tables: ModuleType, tmp_path: Path) -> None:
    score = {"score": 0.25, "score_low": 0.2, "score_high": 0.3125}
    (tmp_path / "00.json").write_text(json.dumps(summary(v_max_mps=2.0) | score))
    headings, _, row, _ = (line.strip("| ").split(" | ") for line in tables.barn_rows(tmp_path))
    assert dict(zip(headings, row, strict=True)) == {
        "what drives": "`astar-mppi`",
        "guidance": "`map`",
        "v_max, m/s": "2",
        "runs": "200",
        "success, %": "50.0 [45.0, 60.0]",
        "hit, %": "30.0 [25.0, 40.0]",
        "score": "0.250 [0.200, 0.312]",
    }


def test_robots_are_shown_as_their_files_have_them(tables: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "fast.toml").write_text("max_speed_mps = 2.0\n")
    assert tables.robots(tmp_path) == ['```toml title="fast.toml"', "max_speed_mps = 2.0", "```", ""]


def faults(**others: Any) -> dict[str, Any]:
    ends = ("arrived", "hit_standing", "hit_moving", "timeout")
    drives = {f"jackal rooms {task}": end for task, end in enumerate(ends)}
    return {
        "command": "adrl bench faults",
        "driving": DRIVING,
        "policies": {"jackal": find_policy("jackal").fingerprint},
        "faults": [
            {"fault": "none", "ends": drives, "reasons": {"limited": 4, "base_late": 1}},
            {"fault": "glass", "ends": drives, "reasons": {}},  # nothing tells of it
            {
                "fault": "beams NaN, 80 %",  # leaves not enough to drive by
                "ends": {"diffbot rooms 0": "timeout"},
                "reasons": {"scan_sparse": 1, "no_scan": 1},
            },
        ],
    } | others


def test_drives_with_faults_are_counted_by_what_the_fault_leaves(tables: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "faults.json"
    path.write_text(json.dumps(faults()))
    told, untold, late, _, _, _, *rows, _ = tables.fault_counts(path)
    assert "1 of 5 drives, 20.0 [3.6, 62.4] %" in told
    assert "1 of 4 drives, 25.0 [4.6, 69.9] %" in untold
    assert "2 of 8 drives, 25.0 [7.1, 59.1] %" in late
    assert rows == [
        "| `jackal` | `rooms` | 8 | 1 | 2 | 2 of 8 |",
        "| `diffbot` | `rooms` | 1 | 0 | 0 | 0 of 0 |",
    ]
    assert tables.fault_rows(path)[2:] == [
        "| none | 1 / 1 / 1 / 1 | `base_late` |",
        "| glass | 1 / 1 / 1 / 1 |  |",
        "| beams NaN, 80 % | 0 / 0 / 0 / 1 | `scan_sparse`, `no_scan` |",
        "",
    ]


@pytest.mark.parametrize("change", [{"driving": DRIVING - 1}, {"policies": {"jackal": "other"}}])
def test_drives_with_faults_of_before_are_in_no_table(
    tables: ModuleType, tmp_path: Path, change: dict[str, Any]
) -> None:
    path = tmp_path / "faults.json"
    path.write_text(json.dumps(faults(**change)))
    with pytest.raises(ConfigError, match=r"is of before; run python docs/measure.py faults"):
        tables.fault_rows(path)
