"""Figures and tables of adrl reproduce from kept results whose numbers are known by hand."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from adrl.errors import CheckpointError
from adrl.evaluation.results import read_table, write_table
from adrl.report import reproduction as kept
from adrl.report.reported import ABLATIONS, LABELS, METHODS, RIVALS, TABLE_I
from adrl.report.reproduction_figures import figures, q_figure, survival
from adrl.report.reproduction_numbers import (
    Claim,
    beside_planner,
    claims,
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
    return keep_all(tmp_path_factory.mktemp("results"))


def keep_all(out: Path, seeds: dict[str, int] | None = None) -> Path:
    """seeds: how many of a method have ended; SEEDS of those that are not named."""
    ended = {"astar-dwa": (kept.NO_SEED,)} | {m: tuple(range((seeds or {}).get(m, SEEDS))) for m in METHODS}
    for method, numbers in ended.items():
        for seed in numbers:
            keep_job(out / "clutter" / job_name(method, seed), method, seed)
    about: dict[str, Any] = {"title": "scenario clutter", "guidance": "goal", "evaluated": ["goal", "replan"]}
    about |= {"steps": 1000, "seeds": SEEDS, "episodes": TASKS, "split": "test", "robot": "diffbot"}
    about["jobs"] = ["astar-dwa", *(job_name(m, s) for m in METHODS for s in range(SEEDS))]
    head = {"schema_version": 2, "preset": "quick"}
    (out / "about.json").write_text(json.dumps(head | {"scenarios": {"clutter": about}}))
    return out


def job_name(method: str, seed: int) -> str:
    return method if method == "astar-dwa" else f"{method}-s{seed}"


def keep_job(folder: Path, method: str, seed: int) -> None:
    evaluations, episodes, routes = [], [], []
    for guidance in ("map",) if method == "astar-dwa" else ("goal", "replan"):
        ends = [solves(method, seed, task) for task in range(TASKS)]
        time_s = 40.0 if method == "astar-dwa" else 30.0 + METHODS.index(method)
        for task, end in enumerate(ends):
            row = {"guidance": guidance, "task": task}
            row |= {"success": end, "collision": not end and task == 1, "distance_m": 20.0 + task}
            episodes.append(row | {"time_s": time_s, "shortest_m": 20.0})
        metrics = {"success": float(np.mean(ends)), "collision": 0.1, "timeout": 0.1, "distance_m": 21.0}
        metrics |= {"time_s": time_s, "optimality": 1.05, "spl": 0.9, "train_seconds": 60.0}
        metrics |= {"env_steps": 1000.0, "gradient_updates": 50.0}
        evaluations.append({"guidance": guidance} | metrics)
        routes += [{"guidance": guidance, "task": 0, "x_m": 1.0 + i, "y_m": 2.0} for i in range(3)]
    write_table(folder / "episodes.parquet", pa.Table.from_pylist(episodes))
    if seed <= 0:
        write_table(folder / "routes.parquet", pa.Table.from_pylist(routes))
    if method != "astar-dwa":
        curve = [curve_row(method, i) for i in range(ROWS)]
        write_table(folder / "curve.parquet", pa.Table.from_pylist(curve))
    whose = {"method": method, "seed": None if method == "astar-dwa" else seed}
    (folder / "run.json").write_text(json.dumps(whose | {"evaluations": evaluations}))


def curve_row(method: str, row: int) -> dict[str, Any]:
    """Q rises by 1 a row up to row 10 and stays; success is 0, then 1."""
    numbers = dict.fromkeys(kept.CURVE_COLUMNS, 0.0)
    numbers |= {"wall_s": row + 1.0, "env_steps": 50.0 * (row + 1), "episode": 10.0 * row, "S": math.nan}
    numbers |= {"q_mean": min(row, 10) * (2.0 if method == "adrl" else 1.0)}
    numbers |= {"success": float(row >= GOOD_FROM.get(method, 7))}
    return numbers


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


def test_a_method_and_the_planner_are_compared_on_the_tasks_that_both_reached(results: kept.Results) -> None:
    """The planner also reached tasks 1 and 2 + s, which seed s did not: they are in its row and not beside a method."""
    common = np.mean([np.mean([20 + t for t in range(2, TASKS) if t != 2 + s]) for s in range(SEEDS)])
    means = beside_planner(results, "clutter", "td3bc", "goal")
    assert means["common_tasks"] == TASKS - 3
    for whose in ("", "reference_"):
        assert means[f"{whose}distance_m_common"] == pytest.approx(common)
        assert means[f"{whose}optimality_common"] == pytest.approx(common / 20.0)
    assert means["time_s_common"] == 30.0 + METHODS.index("td3bc")
    assert means["reference_time_s_common"] == 40.0


def test_a_mean_over_easy_tasks_is_no_lead(tmp_path: Path) -> None:
    """A method that drives the planner's very routes but fails the long ones has shorter means and no better share."""
    folder = keep_all(tmp_path)
    for seed in range(SEEDS):
        path = folder / "clutter" / f"adrl-s{seed}" / "episodes.parquet"
        rows = read_table(path).to_pylist()
        for row in rows:
            row |= {"success": 3 < row["task"] < 10, "time_s": 40.0}
        write_table(path, pa.Table.from_pylist(rows))
    verdicts = {(c.where, c.text): c for c in claims(kept.load(folder))}
    fastest = verdicts["Table I, clutter, guidance goal", "ADRL has the shortest navigation time"]
    assert fastest.values["adrl"] == fastest.values["astar-dwa"] == 1.0
    assert fastest.holds is False


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
        label = LABELS[name].replace("*", r"\*")
        numbers = (row["distance_m"], row["time_s"], row["success"], row["optimality"])
        assert f"| {label} | {' | '.join(f'{number:.2f}' for number in numbers)} |" in page
    assert "value estimate" in page
    tables = json.loads((folder / "tables.json").read_text())
    assert tables["paper"]["rows"] == TABLE_I
    assert {row["method"] for row in tables["methods"]} == set(METHODS)


def test_the_methods_are_the_papers() -> None:
    assert set(ABLATIONS) | set(RIVALS) == set(METHODS)
    assert set(TABLE_I) == {*RIVALS, "astar-dwa"}
    assert set(LABELS) == {*METHODS, "astar-dwa"}


@pytest.mark.slow
def test_a_part_of_the_seeds_makes_tables_and_figures_that_say_so(tmp_path: Path) -> None:
    folder = keep_all(tmp_path, {"adrl": 1, "sb3-ppo": 0})
    results = kept.load(folder)
    assert results.missing == {"clutter": ["adrl-s1", "sb3-ppo-s0", "sb3-ppo-s1"]}
    seeds = {row["method"]: row["seeds"] for row in table_rows(results, "clutter")}
    assert (seeds["adrl"], seeds["td3bc"]) == (1, SEEDS)
    assert "sb3-ppo" not in seeds
    write_report(folder)
    page = (folder / "README.md").read_text()
    assert "3 of 15 runs are not in it yet: adrl-s1, sb3-ppo-s0, sb3-ppo-s1." in page
    assert "| ADRL | without replanner | 1 |" in page
    assert "| TD3+BC | without replanner | 2 |" in page
    labels = q_figure(results, RIVALS).axes[0].get_legend_handles_labels()[1]
    assert labels == ["ADRL, 1 of 2 seeds", "TD3+BC", "SAC"]


@pytest.mark.parametrize("ended", ["planner", "one method"])
def test_the_first_jobs_alone_make_tables_and_figures(tmp_path: Path, ended: str) -> None:
    folder = keep_all(tmp_path, dict.fromkeys(METHODS, 0) | ({"td3": 1} if ended == "one method" else {}))
    results = kept.load(folder)
    assert figures(results)
    assert all(claim.holds is None or ended == "one method" for claim in claims(results))
    assert [row["method"] for row in table_rows(results, "clutter")] == ["astar-dwa"]


def test_missing_and_broken_files_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"about\.json: no such file"):
        kept.load(tmp_path)
    shutil.copy(folder / "about.json", tmp_path)
    with pytest.raises(CheckpointError, match="no job has ended yet"):
        kept.load(tmp_path)
    shutil.copytree(folder / "clutter" / "td3-s0", tmp_path / "clutter" / "td3-s0")
    (tmp_path / "clutter" / "td3-s0" / "curve.parquet").write_bytes(b"PAR1")
    with pytest.raises(CheckpointError, match=r"curve\.parquet: not a readable"):
        kept.load(tmp_path)
