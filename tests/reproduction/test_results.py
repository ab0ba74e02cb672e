"""Figures and tables of adrl reproduce from kept results whose numbers are known by hand."""

import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from adrl.errors import CheckpointError
from adrl.evaluation.results import read_table, write_table
from adrl.evaluation.statistics import Interval, wilson_interval
from adrl.reproduction import results as kept
from adrl.reproduction.claims import judged
from adrl.reproduction.figures import figures, methods_figure, q_figure, survival
from adrl.reproduction.numbers import (
    beside_planner,
    hard_worlds,
    late_growth,
    oscillation,
    promised_too_much,
    steady_episodes,
    success_on,
    success_rows,
    summary_rows,
    table_rows,
    times_to,
)
from adrl.reproduction.pairs import criteria, difference, paired_rows
from adrl.reproduction.reported import ABLATIONS, CLASSICAL, LABELS, METHODS, RIVALS, TABLE_I
from adrl.reproduction.run import run_lines
from adrl.reproduction.statements import claims, steady_or_end
from adrl.reproduction.tables import write_report

TASKS, ROWS, SEEDS = 40, 20, 2
CALLS = [
    {"wall_s": wall_s, "jobs": jobs, "cores": 2, "machine": "a machine", "versions": {"torch": "1.2"}}
    | {"commit": "abc", "measured_by": "adrl reproduce"}
    for wall_s, jobs in ((3600.0, 10), (125.4, 5))
]
GOOD_FROM = {"adrl": 4, "td3": 10}
"""Row of the log from which a method's success is 1; of the others 7."""


def solves(method: str, seed: int, task: int) -> bool:
    """All fail tasks 0 and 1; seed s of a trained method also fails task 2 + s; the planner fails task 0 alone."""
    if method.startswith("astar"):
        return task != 0
    return task > 1 and task != 2 + seed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results as adrl.reproduction.reproduce keeps them: two methods' worth of variety, one scenario."""
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
    head: dict[str, Any] = {"schema_version": 2, "preset": "quick", "calls": CALLS}
    (out / "about.json").write_text(json.dumps(head | {"scenarios": {"clutter": about}}))
    return out


def job_name(method: str, seed: int) -> str:
    return method if method.startswith("astar") else f"{method}-s{seed}"


def keep_job(folder: Path, method: str, seed: int, driven: Sequence[str] | None = None) -> None:
    """driven: guidance of each evaluation."""
    evaluations, episodes, routes = [], [], []
    for guidance in driven or (("map",) if method == "astar-dwa" else ("goal", "replan")):
        ends = [solves(method, seed, task) for task in range(TASKS)]
        time_s = 30.0 + METHODS.index(method) if method in METHODS else 40.0
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
    if method in METHODS:
        curve = [curve_row(method, i) for i in range(ROWS)]
        write_table(folder / "curve.parquet", pa.Table.from_pylist(curve))
    whose: dict[str, Any] = {"method": method, "seed": seed if method in METHODS else None}
    whose["versions"] = {"python": "3.11.7"}
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
    """A method that drives the planner's very routes but fails the long ones has shorter means and no lead."""
    folder = keep_all(tmp_path)
    for seed in range(SEEDS):
        path = folder / "clutter" / f"adrl-s{seed}" / "episodes.parquet"
        rows = read_table(path).to_pylist()
        for row in rows:
            row |= {"success": 3 < row["task"] < 10, "time_s": 40.0}
        write_table(path, pa.Table.from_pylist(rows))
    found = kept.load(folder)
    for row in paired_rows(found, "clutter"):
        if row["rival"] == "astar-dwa":
            assert [row[f"{metric}{end}"] for metric in ("distance_m", "time_s") for end in ENDS] == [0.0] * 6
            assert row["common_tasks"] == 6
    fastest = claim_of(found, "ADRL has the shortest navigation time").verdicts[0]
    assert fastest.differences["astar-dwa"] == (0.0, 0.0, 0.0)
    assert (
        judged("clutter", {"astar-dwa": fastest.differences["astar-dwa"]}, higher=False).word == "undecided"
    )


ENDS = ("", "_low", "_high")


def claim_of(results: kept.Results, text: str) -> Any:
    (found,) = [claim for claim in claims(results) if claim.text.startswith(text)]
    return found


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


def test_success_of_every_method_with_and_without_the_replanner(results: kept.Results) -> None:
    rows = {row["method"]: row for row in success_rows(results, "clutter")}
    assert set(rows) == {*METHODS, "astar-dwa"}
    for method in METHODS:
        row, rate = rows[method], (TASKS - 3) / TASKS
        for guidance in ("goal", "replan"):
            assert [row[f"success_{guidance}{end}"] for end in ENDS] == pytest.approx([rate] * 3)
        assert [row[f"gain{end}"] for end in ENDS] == [0.0] * 3
        assert row["freed"] == 0.0, "what the replanner does not free"
        assert (row["collision_goal"], row["timeout_replan"]) == (0.1, 0.1)
    planner = rows["astar-dwa"]
    assert [planner[f"success_map{end}"] for end in ENDS] == list(wilson_interval(TASKS - 1, TASKS))
    assert planner["seeds"] is None
    assert "gain" not in planner


def test_seeds_are_paired_by_their_number() -> None:
    """Far apart among themselves, 1 apart in every pair: the interval has no width. Seeds of one alone do not count."""
    ours, theirs = {0: 1.0, 1: 30.0, 2: 500.0}, {2: 499.0, 0: 0.0, 1: 29.0, 7: 1e6}
    assert difference(ours, theirs) == (1.0, 1.0, 1.0)
    assert difference({0: 5.0, 1: math.inf}, {0: 3.0, 1: 3.0})[0] == 2.0, (
        "a pair with an unknown number is none"
    )
    assert math.isnan(difference({0: 5.0}, {0: 3.0}).low), "one pair has no interval"
    assert math.isnan(difference({0: 5.0}, {1: 3.0}).estimate)
    wide = ({s: float(s) for s in range(10)}, dict.fromkeys(range(10), 0.0))
    assert difference(*wide) == difference(*wide), "the bootstrap is seeded"
    assert difference(*wide).low < 4.5 < difference(*wide).high


def hand_made(driven: dict[tuple[str, str], list[list[float]]]) -> kept.Results:
    """(method, guidance) -> for each seed, the time of each task of 10 m; a task of infinite time was not reached."""
    about = {"scenarios": {"complex": {"guidance": "goal", "evaluated": ["goal", "replan"]}}}
    found = kept.Results(about, [], {}, {}, {}, {}, [])
    for (method, guidance), seeds in driven.items():
        runs = found.episodes.setdefault(("complex", method, guidance), {})
        for seed, times in enumerate(seeds):
            time_s, success = np.array(times), np.isfinite(times)
            columns = {"task": np.arange(len(times)), "success": success, "collision": ~success}
            columns |= {"time_s": time_s, "distance_m": 0.5 * time_s}
            columns["shortest_m"] = np.full(len(times), 10.0)
            trained = method in METHODS
            runs[seed if trained else kept.NO_SEED] = columns
            whose: dict[str, Any] = {"scenario": "complex", "method": method, "guidance": guidance}
            whose["seed"] = seed if trained else None
            found.runs.append(whose | {"success": float(success.mean()), "collision": 0.0, "timeout": 0.0})
    return found


def test_timeouts_that_the_replanner_frees_are_counted_task_by_task() -> None:
    """Tasks 1 to 3 ran out of time; with the replanner 1 and 2 are reached, 0 is lost. The other seed had none."""
    stuck, freed = [20.0, math.inf, math.inf, math.inf], [math.inf, 20.0, 20.0, math.inf]
    found = hand_made({("adrl", "goal"): [stuck, [20.0] * 4], ("adrl", "replan"): [freed, [20.0] * 4]})
    for run in (
        *found.outcomes("complex", "adrl", "goal").values(),
        *found.outcomes("complex", "adrl", "replan").values(),
    ):
        run["collision"][:] = False
    (row,) = success_rows(found, "complex")
    assert row["freed"] == pytest.approx(2.0 / 3.0)
    assert [row[f"gain{end}"] for end in ENDS] == [0.125, 0.0, 0.25]


def test_time_is_compared_on_the_tasks_that_both_reached_and_success_on_all() -> None:
    never = math.inf
    adrl = [[20.0, 30.0, never, never], [20.0, 30.0, 40.0, never]]
    found = hand_made(
        {("adrl", "goal"): adrl, ("td3", "goal"): [[never, 29.0, 99.0, 50.0], [25.0, never, 37.0, never]]}
    )
    (row,) = paired_rows(found, "complex")
    assert (row["rival"], row["guidance"], row["seeds"]) == ("td3", "goal", 2)
    # Seed 0: task 1 alone, +1 s; seed 1: tasks 0 and 2, -5 and +3 s. Success: 2 and 3 of 4 against 3 and 2.
    assert [row[f"time_s{end}"] for end in ENDS] == [0.0, -1.0, 1.0]
    assert [row[f"optimality{end}"] for end in ENDS] == pytest.approx([0.0, -0.05, 0.05])
    assert [row[f"success{end}"] for end in ENDS] == [0.0, -0.25, 0.25]
    assert row["common_tasks"] == 1.5


def test_the_criterion_holds_where_intervals_are_apart_and_time_is_no_worse() -> None:
    good, bad, fast = [20.0] * 100, [20.0] * 50 + [math.inf] * 50, [19.0] * 98 + [math.inf] * 2
    planner = [21.0] * 80 + [math.inf] * 20
    driven = {("adrl", "goal"): [good, good], ("td3", "goal"): [bad, bad], ("astar-dwa", "map"): [planner]}
    verdicts = [(c.guidance, c.verdict) for c in criteria(hand_made(driven), "complex")]
    assert verdicts == [("goal", "yes")] * 4, "above both; faster and shorter than the planner"
    both = driven | {("td3bc", "goal"): [good, fast]}
    success, *_ = criteria(hand_made(both), "complex")
    assert success.verdict == "no"
    assert "intervals overlap: TD3+BC (99.0 [98.0, 100.0]; +1.0 [+0.0, +2.0] points)" in success.sentence()
    assert "above, apart: Baseline (TD3) (50.0" in success.sentence()
    slow = driven | {("adrl", "goal"): [[22.0] * 100, [22.0] * 100]}
    assert [c.verdict for c in criteria(hand_made(slow), "complex")] == ["yes", "no", "no", "no"]
    mixed = driven | {("adrl", "goal"): [[22.0] * 100, good]}
    assert [c.verdict for c in criteria(hand_made(mixed), "complex")] == ["yes"] + ["undecided"] * 3


NEVER = math.inf
EVERYWHERE = {
    ("adrl", "goal"): [[20.0] * 4, [20.0] * 4],
    ("adrl", "replan"): [[18.0] * 4, [20.0] * 4],
    ("astar-dwa", "map"): [[25.0] * 4],
    ("astar-dwa", "replan"): [[30.0, 30.0, NEVER, NEVER]],
    ("astar-mppi", "replan"): [[19.0, 19.0, 19.0, NEVER]],
    ("astar-mppi", "map"): [[16.0] * 4],
    ("of-others", "map"): [[21.0] * 4],
}
"""Times of ADRL and of planners with the map and without, one of which the paper has and one of which nobody knows."""


def test_every_planner_is_paired_under_the_guidance_it_was_driven_with() -> None:
    """One with the map is held against each of ADRL's evaluations, one without it against that with the replanner."""
    rows = paired_rows(hand_made(EVERYWHERE), "complex")
    found = {(row["guidance"], row["rival"]): [row[f"time_s{end}"] for end in ENDS] for row in rows}
    assert found == {
        ("goal", "astar-dwa"): [-5.0] * 3,
        ("goal", "astar-mppi"): [4.0] * 3,
        ("goal", "of-others"): [-1.0] * 3,
        ("replan", "astar-dwa"): [-6.0, -7.0, -5.0],
        ("replan", "astar-dwa on its own map"): [-11.0, -12.0, -10.0],
        ("replan", "astar-mppi on its own map"): [0.0, -1.0, 1.0],
        ("replan", "astar-mppi"): [3.0, 2.0, 4.0],
        ("replan", "of-others"): [-2.0, -3.0, -1.0],
    }
    success = {row["rival"]: row["success"] for row in rows if row["guidance"] == "replan"}
    assert success["astar-dwa on its own map"] == 0.5
    assert success["astar-mppi on its own map"] == 0.25


def test_statements_of_adrl_are_also_held_against_planners_that_the_paper_does_not_have() -> None:
    found = hand_made(EVERYWHERE)
    fastest = next(
        c for c in claims(found) if c.where == "Beside Table I" and "shortest navigation time" in c.text
    )
    goal, replan = fastest.verdicts
    assert goal.differences == {"astar-mppi": (4.0, 4.0, 4.0), "of-others": (-1.0, -1.0, -1.0)}
    assert goal.word == "does not reproduce"
    assert replan.differences["astar-mppi on its own map"] == (0.0, -1.0, 1.0)
    assert "less A*+MPPI on its own map +0" in replan.text()
    assert "less of-others -2" in replan.text()
    of_before = (("adrl", "goal"), ("adrl", "replan"), ("astar-dwa", "map"))
    papers = hand_made({who: EVERYWHERE[who] for who in of_before})
    assert not [claim for claim in claims(papers) if claim.where == "Beside Table I"]


@pytest.mark.parametrize(
    ("adrl", "verdict"),
    [
        ([[20.0] * 100] * 2, "yes"),  # above in success, and faster
        ([[21.0] * 100] * 2, "yes"),  # above in success, as fast
        ([[22.0] * 100] * 2, "no"),  # above in success, and slower
        ([[20.0] * 60 + [NEVER] * 40] * 2, "yes"),  # faster, and success is the same
        ([[20.0] * 50 + [NEVER] * 50] * 2, "no"),  # faster, and success is less
        ([[21.0] * 60 + [NEVER] * 40] * 2, "undecided"),  # no better anywhere
        ([[20.0] * 100, [22.0] * 100], "undecided"),
        ([[20.0] * 100], "undecided"),  # one seed has no interval
    ],
)
@pytest.mark.parametrize("driven", [("astar-mppi", "map"), ("astar-dwa", "replan")])
def test_a_planner_is_beaten_in_success_or_in_time(
    adrl: list[list[float]], verdict: str, driven: tuple[str, str]
) -> None:
    planner = [21.0] * 60 + [NEVER] * 40
    found = criteria(hand_made({("adrl", "replan"): adrl, driven: [planner]}), "complex")
    (criterion,) = [c for c in found if "in success or in time" in c.question]
    name = {"map": "A*+MPPI", "replan": "A*+DWA on its own map"}[driven[1]]
    assert (criterion.guidance, criterion.verdict) == ("replan", verdict)
    assert f"ADRL - {name} " in criterion.sentence()
    assert f"{name} (60.0 [" in found[0].sentence(), "beside the trained baselines, too"


@pytest.mark.parametrize(
    ("differences", "higher", "lower"),
    [
        ([(2.0, 1.0, 3.0)], "reproduces", "does not reproduce"),
        ([(2.0, 1.0, 3.0), (4.0, 0.1, 9.0)], "reproduces", "does not reproduce"),
        ([(2.0, 1.0, 3.0), (4.0, -0.1, 9.0)], "undecided", "does not reproduce"),
        ([(2.0, 1.0, 3.0), (-4.0, -9.0, -0.1)], "does not reproduce", "does not reproduce"),
        ([(0.0, 0.0, 0.0)], "undecided", "undecided"),
        ([(2.0, math.nan, math.nan)], "undecided", "undecided"),
        ([(2.0, 1.0, 3.0), (math.nan, math.nan, math.nan)], "undecided", "does not reproduce"),
        ([(math.nan, math.nan, math.nan)], "was not measured", "was not measured"),
    ],
)
def test_a_verdict_is_of_the_intervals_against_every_rival(
    differences: list[tuple[float, float, float]], higher: str, lower: str
) -> None:
    against = {name: Interval(*ends) for name, ends in zip(("td3", "td3bc"), differences, strict=False)}
    assert judged("complex", against, higher=True).word == higher
    assert judged("complex", against, higher=False).word == lower
    assert judged("complex", against, higher=True, value=1.0).text().startswith(f"`complex`: **{higher}**")


def test_claims_are_held_against_every_rival(results: kept.Results) -> None:
    highest = claim_of(results, "ADRL has the highest steady-state mean Q of the ablations").verdicts[0]
    assert highest.word == "reproduces"
    assert highest.differences == dict.fromkeys(("rl-bc", "rl-reward", "td3"), (10.0, 10.0, 10.0))
    fastest = claim_of(results, "ADRL has the shortest navigation time").verdicts
    assert [verdict.word for verdict in fastest] == ["reproduces"] * 2
    assert fastest[0].differences["sb3-sac"] == (-5.0, -5.0, -5.0), (
        "time is 30 s and the place among the methods"
    )
    success = claim_of(results, "ADRL has the highest success rate").verdicts[0]
    assert success.word == "does not reproduce", "the planner's is higher"
    every_metric = claim_of(results, "ADRL outperforms fixed BC (TD3+BC) and pure RL").verdicts[0]
    assert "does not reproduce" not in every_metric.text(), "the planner is no rival of this one"


def test_every_statement_has_a_verdict_or_says_why_not(results: kept.Results) -> None:
    found = claims(results)
    for claim in found:
        assert bool(claim.verdicts) != bool(claim.why_not), claim.text
        assert claim.sentence().count("\n") == 0
    assert {claim.where for claim in found} >= {"Fig. 4", "Fig. 5", "Fig. 6", "Fig. 7", "Table I", "IV.B"}


def test_no_claim_of_mean_q_goes_without_its_caveat(results: kept.Results) -> None:
    of_q = [claim for claim in claims(results) if claim.verdicts and claim.where.startswith("Fig")]
    assert len(of_q) > 20
    for claim in of_q:
        assert "Only with this caveat" in claim.sentence(), claim.text
        if claim.unit == "mean Q":
            assert "levels of Q do not compare" in claim.sentence()
    assert "value estimate V" in claim_of(results, "PPO oscillates late").sentence()


def test_the_head_tells_the_sum_of_the_calls_and_what_was_not_recorded(results: kept.Results) -> None:
    told = "\n".join(run_lines(results))
    assert "| machine | 2 cores of a machine |" in told
    assert "| wall clock | 1 h 2 min 5 s, 15 jobs, 2 calls together |" in told
    assert "| versions | python 3.11.7, torch 1.2 |" in told
    assert "| training | 14 core-minutes in 14 runs, evaluation left out |" in told, "a minute each"
    plain = {key: value for key, value in results.about.items() if key != "calls"}
    told = "\n".join(run_lines(replace(results, about=plain)))
    assert "| wall clock | not recorded |" in told
    assert "| commit | not recorded |" in told
    assert "| versions | python 3.11.7 |" in told


def test_late_growth_and_early_promises_by_hand() -> None:
    climbing = {"q_mean": np.arange(20.0)}
    # Rows 18, 19 against rows 10, 11, of a range of 19.
    assert late_growth(climbing) == pytest.approx(8.0 / 19.0)
    assert late_growth({"q_mean": np.r_[np.arange(10.0), np.full(10, 9.0)]}) == 0.0
    assert math.isnan(late_growth({"q_mean": np.arange(9.0)}))
    promised = {
        "q_start": np.r_[1.0, np.nan, 2.0, np.zeros(6)],
        "return_start": np.r_[3.0, 5.0, 3.0, np.zeros(6)],
    }
    assert promised_too_much(promised) == pytest.approx(-1.5), "two of eight known rows: -2 and -1"
    assert math.isnan(promised_too_much({"q_start": np.full(3, np.nan), "return_start": np.zeros(3)}))


def test_a_run_that_is_never_steady_counts_with_all_its_episodes() -> None:
    rows = np.arange(20.0)
    assert steady_or_end({"episode": 10.0 * rows, "q_mean": np.minimum(rows, 10.0)}) == 120.0
    wild = {"episode": 10.0 * rows, "q_mean": np.r_[np.zeros(15), 9.0, -9.0, 30.0, 50.0, 90.0]}
    assert steady_or_end(wild) == 190.0


def test_the_methods_figure_shows_success_with_the_replanner_below_that_without(tmp_path: Path) -> None:
    folder = keep_all(tmp_path)
    for method, rate in (("adrl", 0.25), ("td3", 0.5)):
        for seed in range(SEEDS):
            path = folder / "clutter" / job_name(method, seed) / "run.json"
            run = json.loads(path.read_text())
            for evaluation in run["evaluations"]:
                evaluation["success"] = rate if evaluation["guidance"] == "replan" else 0.75
            path.write_text(json.dumps(run))
    axes = methods_figure(kept.load(folder)).axes[0]
    marks = [line for line in axes.lines if line.get_marker() == "o"]
    dots = [(float(np.ravel(mark.get_xdata())[0]), float(np.ravel(mark.get_ydata())[0])) for mark in marks]
    without = {METHODS[int(y)]: x for x, y in dots if y == int(y)}
    with_it = {METHODS[int(y)]: x for x, y in dots if y != int(y)}
    assert set(without) == set(with_it) == set(METHODS)
    assert (without["adrl"], with_it["adrl"], without["td3"], with_it["td3"]) == (75.0, 25.0, 75.0, 50.0)


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
    row = "| 92.5 [92.5, 92.5] | 10.0 | 10.0 | 92.5 [92.5, 92.5] | 10.0 | 10.0 | +0.0 [+0.0, +0.0] |"
    assert all(f"| {LABELS[method]} | 2 {row}" in page for method in METHODS)
    assert "1 h 2 min 5 s, 15 jobs, 2 calls together" in page
    assert "2 seeds are too few" in page
    tables = json.loads((folder / "tables.json").read_text())
    assert tables["paper"]["rows"] == TABLE_I
    assert {row["method"] for row in tables["methods"]} == set(METHODS)
    assert {row["rival"] for row in tables["pairs"]} == {*METHODS, "astar-dwa"} - {"adrl"}
    sentences = [entry["sentence"] for entry in (*tables["claims"], *tables["criteria"])]
    plain_page = page.replace("**", "").replace(r"\*", "*")
    assert all(f"- {sentence}\n" in plain_page for sentence in sentences)


def test_the_methods_are_the_papers() -> None:
    assert set(ABLATIONS) | set(RIVALS) == set(METHODS)
    assert set(TABLE_I) == {*RIVALS, "astar-dwa"}
    assert set(LABELS) == {*METHODS, "astar-dwa", *CLASSICAL}


@pytest.mark.slow
def test_a_place_of_its_own_has_a_part_of_the_methods_and_planners_without_the_map(tmp_path: Path) -> None:
    """The Jackal in complex: evaluated on the map and with the replanner; a planner in both; no TD3+BC, SAC and PPO."""
    out = keep_all(tmp_path)
    place = out / "complex-jackal"
    methods = ("adrl", "td3", "rl-bc", "rl-reward")
    for method in ("astar-dwa", "astar-pursuit", *methods):
        for seed in (kept.NO_SEED,) if method.startswith("astar") else range(SEEDS):
            keep_job(place / job_name(method, seed), method, seed, ("map", "replan"))
    about = json.loads((out / "about.json").read_text())
    jobs = ["astar-dwa", "astar-pursuit", *(job_name(m, s) for m in methods for s in range(SEEDS))]
    mine = {"guidance": "map", "evaluated": ["map", "replan"], "robot": "jackal", "scenario": "complex"}
    about["scenarios"]["complex-jackal"] = (
        about["scenarios"]["clutter"]
        | mine
        | {
            "jobs": jobs,
            "methods": list(methods),
        }
    )
    (out / "about.json").write_text(json.dumps(about))
    results = kept.load(out)
    assert results.scenario_of("complex-jackal") == "complex"
    assert results.untrained("complex-jackal") == {
        n: ["map", "replan"] for n in ("astar-dwa", "astar-pursuit")
    }
    assert results.untrained("clutter") == {"astar-dwa": ["map"]}
    assert results.lacks("complex-jackal", {"adrl", "td3bc"})
    assert not results.lacks("complex-jackal", {"adrl", "td3", "astar-dwa"})
    assert not results.lacks("clutter", {"adrl", "td3bc"}), "results of before name no methods"

    rows = table_rows(results, "complex-jackal")
    driven = [(row["method"], row["guidance"]) for row in rows if row["seeds"] is None]
    assert driven == [(m, g) for m in ("astar-dwa", "astar-pursuit") for g in ("map", "replan")]
    planners = {"astar-dwa", "astar-pursuit", *(f"astar-{n} on its own map" for n in ("dwa", "pursuit"))}
    paired = paired_rows(results, "complex-jackal")
    assert {row["rival"] for row in paired if row["guidance"] == "replan"} == planners | set(methods[1:])
    assert {row["rival"] for row in paired if row["guidance"] == "map"} == {
        *("astar-dwa", "astar-pursuit"),
        *methods[1:],
    }
    for claim in claims(results):
        judged_in = {verdict.place.partition(",")[0] for verdict in claim.verdicts}
        if "TD3+BC" in claim.text or "SAC" in claim.text or "PPO" in claim.text:
            assert "complex-jackal" not in judged_in, claim.text
    assert any("complex-jackal" in v.place for claim in claims(results) for v in claim.verdicts)
    write_report(out)
    page = (out / "README.md").read_text()
    assert "on a map of its own scans" in page
    assert r"| A\*+pure pursuit on its own map | with the replanner | 2 |" in page
    assert "success on the known map, %" in page
    assert (out / "fig7-routes-complex-jackal-map.png").exists()


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
    assert "| ADRL | without the replanner | 1 |" in page
    assert "| TD3+BC | without the replanner | 2 |" in page
    labels = q_figure(results, RIVALS).axes[0].get_legend_handles_labels()[1]
    assert labels == ["ADRL, 1 of 2 seeds", "TD3+BC", "SAC"]


@pytest.mark.parametrize("ended", ["planner", "one method"])
def test_the_first_jobs_alone_make_tables_and_figures(tmp_path: Path, ended: str) -> None:
    folder = keep_all(tmp_path, dict.fromkeys(METHODS, 0) | ({"td3": 1} if ended == "one method" else {}))
    results = kept.load(folder)
    assert figures(results)
    words = {verdict.word for claim in claims(results) for verdict in claim.verdicts}
    assert words == {"was not measured"}
    assert criteria(results, "clutter") == []
    assert [row["method"] for row in table_rows(results, "clutter")] == ["astar-dwa"]


def test_missing_and_broken_files_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"about\.json does not exist"):
        kept.load(tmp_path)
    shutil.copy(folder / "about.json", tmp_path)
    with pytest.raises(CheckpointError, match="no job has ended yet"):
        kept.load(tmp_path)
    shutil.copytree(folder / "clutter" / "td3-s0", tmp_path / "clutter" / "td3-s0")
    (tmp_path / "clutter" / "td3-s0" / "curve.parquet").write_bytes(b"PAR1")
    with pytest.raises(CheckpointError, match=r"curve\.parquet: not a readable"):
        kept.load(tmp_path)
