"""Figures and tables of adrl reproduce from kept results whose numbers are known by hand."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from adrl.errors import CheckpointError
from adrl.evaluation.results import write_table
from adrl.report import reproduction as kept
from adrl.report.reported import ABLATIONS, LABELS, METHODS, RIVALS, TABLE_I
from adrl.report.reproduction_figures import survival
from adrl.report.reproduction_numbers import (
    Claim,
    claims,
    common_means,
    hard_worlds,
    oscillation,
    steady_episodes,
    success_on,
    summary_rows,
    table_rows,
    times_to,
)
from adrl.report.reproduction_tables import write_report

TASKS, ROWS, SEEDS = 40, 20, 2
GOOD_FROM = {"adrl": 4, "td3": 10}
"""Row of the log from which a method's success is 1; of the others 7."""


def solves(method: str, seed: int, task: int) -> bool:
    """All fail tasks 0 and 1; seed s of a trained method also fails task 2 + s; the planner fails task 0 alone."""
    if method == "astar-dwa":
        return task != 0
    return task > 1 and task != 2 + seed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results as adrl.comparison.reproduce keeps them: two methods' worth of variety, one scenario."""
    out = tmp_path_factory.mktemp("results")
    runs, curves, episodes, routes = [], [], [], []
    parties = [("astar-dwa", kept.NO_SEED, "map")]
    parties += [(m, s, g) for m in METHODS for s in range(SEEDS) for g in ("goal", "replan")]
    for method, seed, guidance in parties:
        ends = [solves(method, seed, task) for task in range(TASKS)]
        time_s = 40.0 if method == "astar-dwa" else 30.0 + METHODS.index(method)
        for task, end in enumerate(ends):
            row = {"scenario": "clutter", "method": method, "seed": seed, "guidance": guidance, "task": task}
            row |= {"success": end, "collision": not end and task == 1, "distance_m": 20.0 + task}
            episodes.append(row | {"time_s": time_s, "shortest_m": 20.0})
        metrics = {"success": float(np.mean(ends)), "collision": 0.1, "timeout": 0.1, "distance_m": 21.0}
        metrics |= {"time_s": time_s, "optimality": 1.05, "spl": 0.9, "train_seconds": 60.0}
        metrics |= {"env_steps": 1000.0, "gradient_updates": 50.0}
        whose = {"scenario": "clutter", "method": method, "guidance": guidance}
        runs.append(whose | {"seed": None if method == "astar-dwa" else seed} | metrics)
        if seed <= 0:
            routes += [whose | {"seed": seed, "task": 0, "x_m": 1.0 + i, "y_m": 2.0} for i in range(3)]
        if guidance == "goal":
            curves += [curve_row(method, seed, i) for i in range(ROWS)]
    for name, rows in (("curves", curves), ("episodes", episodes), ("routes", routes)):
        write_table(out / f"{name}.parquet", pa.Table.from_pylist(rows))
    (out / "runs.json").write_text(json.dumps({"schema_version": 1, "runs": runs}))
    about: dict[str, Any] = {"title": "scenario clutter", "guidance": "goal", "evaluated": ["goal", "replan"]}
    about |= {
        "steps": 1000,
        "seeds": SEEDS,
        "episodes": TASKS,
        "split": "test",
        "robot": "diffbot",
        "missing": [],
    }
    head = {"schema_version": 1, "preset": "quick", "train_seconds": 120.0}
    (out / "about.json").write_text(json.dumps(head | {"scenarios": {"clutter": about}}))
    return out


def curve_row(method: str, seed: int, row: int) -> dict[str, Any]:
    """Q rises by 1 a row up to row 10 and stays; success is 0, then 1."""
    numbers = dict.fromkeys(kept.CURVE_COLUMNS, 0.0)
    numbers |= {"wall_s": row + 1.0, "env_steps": 50.0 * (row + 1), "episode": 10.0 * row, "S": math.nan}
    numbers |= {"q_mean": min(row, 10) * (2.0 if method == "adrl" else 1.0)}
    numbers |= {"success": float(row >= GOOD_FROM.get(method, 7))}
    return {"scenario": "clutter", "method": method, "seed": seed} | numbers


@pytest.fixture(scope="module")
def results(folder: Path) -> kept.Results:
    return kept.load(folder)


def test_logs_and_outcomes_come_back(results: kept.Results) -> None:
    assert results.scenarios == ("clutter",)
    assert {key[1] for key in results.curves} == set(METHODS)
    (first, second) = results.curves_of("clutter", "adrl")
    np.testing.assert_array_equal(first["q_mean"], second["q_mean"])
    assert np.isnan(first["S"]).all()
    runs = results.outcomes("clutter", "td3", "replan")
    assert sorted(runs) == [0, 1]
    np.testing.assert_array_equal(runs[1]["task"], np.arange(TASKS))
    assert not runs[1]["success"][[0, 1, 3]].any()
    assert runs[1]["success"].sum() == TASKS - 3


def test_learning_times(results: kept.Results) -> None:
    """Two validations in a row: the second is one row after the first good one."""
    assert times_to(results, "clutter", "adrl", 0.95, "wall_s") == [6.0, 6.0]
    assert times_to(results, "clutter", "adrl", 0.95, "env_steps") == [300.0, 300.0]
    assert times_to(results, "clutter", "td3", 0.8, "wall_s") == [12.0, 12.0]
    # Trailing means of five rows go from 2 to 10, the band is 9.2 to 10.8: row 11 has 8.8, row 12 has 9.4.
    assert steady_episodes(results, "clutter", "td3") == [120.0, 120.0]


def test_hard_worlds_are_those_that_nobody_solves(results: kept.Results) -> None:
    np.testing.assert_array_equal(hard_worlds(results, "clutter"), [0, 1])
    assert success_on(results, "clutter", "adrl", np.array([0, 1])) == [0.0, 0.0]
    assert success_on(results, "clutter", "adrl", np.array([2, 3])) == [0.5, 0.5]


def test_common_tasks_are_solved_by_all_and_by_the_planner(results: kept.Results) -> None:
    common = [np.mean([20 + t for t in range(2, TASKS) if t != 2 + s]) for s in range(SEEDS)]
    for method in ("adrl", "astar-dwa"):
        means = common_means(results, "clutter", method, "goal")
        assert means["distance_common_m"] == pytest.approx(np.mean(common))
        assert means["common_tasks"] == TASKS - 3
    assert common_means(results, "clutter", "astar-dwa", "goal")["time_common_s"] == 40.0


def test_table_rows(results: kept.Results) -> None:
    rows = table_rows(results, "clutter")
    expected = [("astar-dwa", "map")]
    expected += [(m, g) for m in TABLE_I if m != "astar-dwa" for g in ("goal", "replan")]
    assert [(row["method"], row["guidance"]) for row in rows] == expected
    assert rows[0]["seeds"] is None
    assert rows[1]["success"] == pytest.approx((TASKS - 3) / TASKS)
    for row in summary_rows(results, "clutter"):
        assert row["improvement"] == (None if row["method"] == "adrl" else 0.5)
        assert row["hard_success"] == 0.0
        assert row["seeds_to_95"] == SEEDS


def test_claims_are_ranked_by_hand(results: kept.Results) -> None:
    verdicts = {(c.where, c.text): c for c in claims(results)}
    highest = verdicts["Fig. 4, clutter", "ADRL has the highest steady-state mean Q of the ablations"]
    assert (highest.holds, highest.values["adrl"], highest.values["td3"]) == (True, 20.0, 10.0)
    fastest = verdicts["Table I, clutter, guidance goal", "ADRL has the shortest navigation time"]
    assert fastest.holds
    success = verdicts["Table I, clutter, guidance goal", "ADRL has the highest success rate"]
    assert success.holds is False, "the planner's is higher"
    assert "does not reproduce" in success.sentence()
    assert "A*+DWA 0.975" in success.sentence()


@pytest.mark.parametrize(
    ("values", "best", "holds"),
    [
        ({"adrl": 2.0, "td3bc": 1.0}, "max", True),
        ({"adrl": 2.0, "td3bc": 1.0}, "min", False),
        ({"adrl": math.inf, "td3bc": math.inf}, "min", False),
        ({"adrl": 1.0, "td3bc": 1.0}, "max", False),
        ({"adrl": math.nan, "td3bc": 1.0}, "min", None),
        ({"adrl": 1.0}, "min", None),
    ],
)
def test_a_claim_is_a_ranking(values: dict[str, float], best: str, holds: bool | None) -> None:
    claim = Claim("Fig. 6", "text", ("adrl",), best, values, "episodes")
    assert claim.holds is holds
    assert "text" in claim.sentence()


def test_one_of_several_methods_is_enough_for_a_claim_about_them() -> None:
    values = {"adrl": 5.0, "sb3-sac": 3.0, "sb3-ppo": math.inf}
    assert Claim("Fig. 6", "text", ("sb3-sac", "sb3-ppo"), "max", values, "episodes").holds
    assert not Claim("Fig. 6", "text", ("sb3-sac",), "max", values, "episodes").holds


def test_survival_falls_by_a_seed_at_each_time() -> None:
    times, share = survival([4.0, math.inf, 2.0, 9.0])
    np.testing.assert_array_equal(times, [0.0, 2.0, 4.0, 9.0])
    np.testing.assert_allclose(share, [1.0, 0.75, 0.5, 0.25])
    np.testing.assert_array_equal(survival([math.inf])[1], [1.0])


def test_a_smooth_curve_does_not_oscillate() -> None:
    still = {"q_mean": np.r_[0.0, np.ones(30)]}
    jagged = {"q_mean": np.r_[0.0, 1.0 + 0.3 * (-1.0) ** np.arange(30)]}
    assert oscillation(still) == 0.0
    assert oscillation(jagged) > 0.1
    assert math.isnan(oscillation({"q_mean": np.ones(30)}))


@pytest.mark.slow
def test_the_report_holds_every_figure_and_the_papers_numbers(folder: Path) -> None:
    written = write_report(folder)
    assert all(path.stat().st_size > 0 for path in written)
    names = {path.stem for path in written if path.suffix == ".png"}
    plain = {"fig4-ablations", "fig5-methods", "fig6-convergence", "success", "promised-and-realised"}
    assert names == plain | {"survival", "methods", "fig7-routes-clutter-goal", "fig7-routes-clutter-replan"}
    page = (folder / "README.md").read_text()
    assert all(f"({name}.png)" in page for name in names)
    for name, row in TABLE_I.items():
        assert (
            f"| {LABELS[name]} | {row['distance_m']:.2f} | {row['time_s']:.2f} | {row['success']:.2f} |"
            in page
        )
    assert "value estimate" in page
    tables = json.loads((folder / "tables.json").read_text())
    assert tables["paper"]["rows"] == TABLE_I
    assert {row["method"] for row in tables["methods"]} == set(METHODS)


def test_the_methods_are_the_papers() -> None:
    assert set(ABLATIONS) | set(RIVALS) == set(METHODS)
    assert set(TABLE_I) == {*RIVALS, "astar-dwa"}
    assert set(LABELS) == {*METHODS, "astar-dwa"}


def test_missing_and_broken_files_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"about\.json: no such file"):
        kept.load(tmp_path)
    for path in folder.iterdir():
        if path.suffix in (".json", ".parquet"):
            (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "curves.parquet").write_bytes(b"PAR1")
    with pytest.raises(CheckpointError, match=r"curves\.parquet: not a readable"):
        kept.load(tmp_path)
