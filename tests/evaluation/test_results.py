"""The JSON contract of design section 9, episode files and the comparison table."""

import io
import json
import math
from dataclasses import fields

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from adrl import files
from adrl.errors import CheckpointError
from adrl.evaluation.metrics import RATES, SAMPLES, Episodes
from adrl.evaluation.results import (
    RunMeta,
    compare_paired,
    comparison_table,
    read_episodes,
    summarise,
    write_episodes,
)

ABOUT = (
    "schema_version",
    "policy",
    "method",
    "robot",
    "scenario",
    "guidance",
    "split",
    "simulator",
    "supervised",
    "paper_literal",
    "trained_paper_literal",
    "trained_for",
    "policy_fingerprint",
    "warnings",
    "episodes",
)
MEASURED = ("success", "collision", "timeout", "distance_m", "time_s", "optimality", "spl")
MORE = ("least_clearance_m", "smoothness")
TRAINING = ("train_seconds", "env_steps", "gradient_updates")

PLANNER = RunMeta(
    policy="astar-dwa",
    method="astar-dwa",
    robot="diffbot",
    scenario="clutter",
    guidance="goal",
    split="test",
)
LEARNER = RunMeta(
    policy="runs/demo",
    method="adrl",
    robot="diffbot",
    scenario="clutter",
    guidance="goal",
    split="test",
    train_seconds=60.5,
    env_steps=400_000,
    gradient_updates=25_000,
)


def printed(summaries, width=80) -> str:
    stream = io.StringIO()
    Console(file=stream, width=width).print(comparison_table(summaries))
    return stream.getvalue()


def test_the_document_has_the_keys_of_the_contract(make_episodes):
    summary = summarise(make_episodes(50), LEARNER)
    expected = [*ABOUT, *(name + end for name in MEASURED + MORE for end in ("", "_low", "_high")), *TRAINING]
    assert sorted(summary) == sorted(expected)
    assert summary["episodes"] == 50
    assert (summary["train_seconds"], summary["env_steps"]) == (60.5, 400_000)


def test_a_planner_was_not_trained(make_episodes):
    summary = summarise(make_episodes(5), PLANNER)
    assert [summary[key] for key in TRAINING] == [None, None, None]


@given(st.integers(0, 30), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.9, 1.0]))
def test_the_document_is_strict_json_with_ordered_intervals(make_episodes, count, seed, probability):
    episodes = make_episodes(count, seed=seed, success_probability=probability)
    summary = summarise(episodes, LEARNER)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    for name in MEASURED + MORE:
        estimate, low, high = (summary[name + end] for end in ("", "_low", "_high"))
        if low is not None:
            assert low <= estimate <= high
        else:
            assert high is None


@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_the_document_reports_the_metrics(make_episodes, count, seed):
    episodes = make_episodes(count, seed=seed, success_probability=1.0)
    summary = summarise(episodes, LEARNER)
    for name in RATES:
        assert summary[name] == pytest.approx(getattr(episodes, name).mean()), name
    for name, samples in SAMPLES.items():
        assert summary[name] == pytest.approx(samples(episodes).mean()), name


def test_without_a_success_what_is_over_successes_is_null_and_the_rest_is_not(make_episodes):
    summary = summarise(make_episodes(20, success_probability=0.0), LEARNER)
    for name in ("distance_m", "time_s", "optimality"):
        assert [summary[name + end] for end in ("", "_low", "_high")] == [None] * 3
    assert summary["success"] == 0.0
    assert 0.0 < summary["success_high"] < 0.2
    assert summary["spl"] == 0.0


def test_one_episode_has_an_estimate_but_no_interval_of_a_mean(make_episodes):
    summary = summarise(make_episodes(1, success_probability=1.0), LEARNER)
    assert summary["time_s"] > 0.0
    assert summary["time_s_low"] is None
    assert summary["success_low"] < 1.0


def test_equal_episodes_give_equal_bytes(make_episodes, tmp_path):
    for name in ("a", "b"):
        files.write_json(tmp_path / f"{name}.json", summarise(make_episodes(40), LEARNER))
        write_episodes(tmp_path / f"{name}.parquet", make_episodes(40))
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_the_order_of_the_episodes_does_not_move_an_estimate(make_episodes):
    episodes = make_episodes(60, seed=9)
    shuffled = episodes.select(np.random.default_rng(0).permutation(60))
    first, second = summarise(episodes, LEARNER), summarise(shuffled, LEARNER)
    for name in MEASURED + MORE:
        assert first[name] == pytest.approx(second[name])


def test_a_training_time_that_is_not_finite_becomes_null(make_episodes):
    meta = RunMeta(**{**vars(LEARNER), "train_seconds": math.nan})
    assert summarise(make_episodes(3), meta)["train_seconds"] is None


def test_episodes_survive_the_file(make_episodes, tmp_path):
    episodes = make_episodes(25)
    write_episodes(tmp_path / "run" / "episodes.parquet", episodes)
    back = read_episodes(tmp_path / "run" / "episodes.parquet")
    for field in fields(Episodes):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(episodes, field.name))


def test_a_bad_episode_file_is_named(make_episodes, tmp_path):
    path = tmp_path / "episodes.parquet"
    with pytest.raises(CheckpointError, match=r"episodes\.parquet: no such file"):
        read_episodes(path)
    with pytest.raises(CheckpointError, match="not a readable Parquet file"):
        read_episodes(tmp_path)
    write_episodes(path, make_episodes(25))
    whole = path.read_bytes()
    for kept in (0, 3, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:kept])
        with pytest.raises(CheckpointError, match=r"episodes\.parquet: not a readable Parquet file"):
            read_episodes(path)
    pq.write_table(make_episodes(3).to_table().drop_columns(["success"]), path)
    with pytest.raises(CheckpointError, match=r"episodes\.parquet: .*'success'"):
        read_episodes(path)


FOREIGN = [["a"] * 3, [b"x"] * 3, [[1]] * 3, [{"a": 1}] * 3, np.zeros(3, "datetime64[s]")]
NO_INTEGERS = [[2**63 - 1] * 3, [1.5] * 3]


@pytest.mark.parametrize(
    ("name", "values"),
    [(name, values) for name in ("task", "success", "distance_m", "start_x_m") for values in FOREIGN]
    + [(name, values) for name in ("task", "success") for values in NO_INTEGERS],
)
def test_columns_of_another_type_are_named(make_episodes, tmp_path, name, values):
    table = make_episodes(3).to_table()
    table = table.set_column(table.column_names.index(name), name, pa.array(values))
    pq.write_table(table, tmp_path / "episodes.parquet")
    with pytest.raises(CheckpointError, match=rf"episodes\.parquet: .*type .*'{name}'"):
        read_episodes(tmp_path / "episodes.parquet")


def test_a_file_of_more_rows_than_are_read_is_refused(make_episodes, tmp_path, monkeypatch):
    monkeypatch.setattr("adrl.evaluation.results.MAX_ROWS", 5)
    write_episodes(tmp_path / "e.parquet", make_episodes(6))
    with pytest.raises(CheckpointError, match=r"e\.parquet: .*6 rows, 5 at most"):
        read_episodes(tmp_path / "e.parquet")


def test_names_that_are_no_text_are_no_traceback(make_episodes, tmp_path):
    path = tmp_path / "e.parquet"
    write_episodes(path, make_episodes(3))
    path.write_bytes(path.read_bytes().replace(b"distance_m", b"distance\xff\xfe"))
    with pytest.raises(CheckpointError, match=r"e\.parquet"):
        read_episodes(path)


def test_paired_differences_vanish_between_equal_policies(make_episodes):
    episodes = make_episodes(30)
    for metric, interval in compare_paired(episodes, episodes).items():
        if metric in RATES:  # 30 tasks leave 11 points open
            assert interval == pytest.approx((0.0, -0.114, 0.114), abs=1e-3)
        else:
            assert interval == (0.0, 0.0, 0.0)


def test_paired_differences_use_the_tasks_both_solved(make_episodes):
    ours, theirs = make_episodes(40, seed=1), make_episodes(40, seed=2)
    differences = compare_paired(ours, theirs)
    both = [i for i in range(40) if ours.success[i] and theirs.success[i]]
    assert differences["time_s"].estimate == pytest.approx(
        np.mean([ours.time_s[i] - theirs.time_s[i] for i in both])
    )
    assert differences["success"].estimate == pytest.approx(ours.success.mean() - theirs.success.mean())


def test_the_table_shows_each_policy_with_its_interval(make_episodes):
    planner, learner = summarise(make_episodes(500), PLANNER), summarise(make_episodes(500, seed=1), LEARNER)
    text = printed([planner, learner])
    for summary in (planner, learner):
        assert summary["policy"] in text
        assert f"{100.0 * summary['success']:.1f}" in text
        assert f"{100.0 * summary['success_low']:.1f}-{100.0 * summary['success_high']:.1f}" in text
        assert f"{summary['time_s_low']:.1f}-{summary['time_s_high']:.1f}" in text
    assert "scenario clutter, robot diffbot, guidance goal, split test, episodes 500" in text


def test_the_table_fits_80_columns_and_prints_in_plain_ascii_terminals(make_episodes):
    summary = summarise(make_episodes(500, success_probability=1.0), LEARNER)
    long = {**summary, "policy": "runs/a-very-long-name-of-a-run/seed-0"}
    text = printed([long, summarise(make_episodes(500), PLANNER)])
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    assert f"{100.0 * summary['success_low']:.1f}-100.0" in text
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    Console(file=stream, width=80).print(comparison_table([summary]))
    stream.flush()


def test_the_table_marks_what_is_undefined_and_what_differs(make_episodes):
    failing = summarise(make_episodes(20, success_probability=0.0), LEARNER)
    elsewhere = {**summarise(make_episodes(20), PLANNER), "scenario": "complex"}
    text = printed([failing, elsewhere], width=100)
    assert "nan" not in text.lower()
    assert "None" not in text
    title, *rows = text.splitlines()
    assert "scenario" not in title
    assert any("scenario clutter" in row for row in rows)
    assert any("scenario complex" in row for row in rows)


def test_a_policy_name_is_never_read_as_markup(make_episodes):
    summary = {**summarise(make_episodes(20), LEARNER), "policy": "[red]x"}
    assert "[red]x" in printed([summary])
