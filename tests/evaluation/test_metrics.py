"""Laws of the metrics, and a slow Python twin of each."""

import math
from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.errors import CheckpointError
from adrl.evaluation.metrics import (
    RATES,
    SAMPLES,
    Episodes,
    on_common_tasks,
    solved_by_all,
    success_rate,
)

COUNTS = st.integers(0, 40)
SEEDS = st.integers(0, 2**32 - 1)
CHANCES = st.sampled_from([0.0, 0.3, 0.9, 1.0])


def mean_of(metric: str, episodes: Episodes) -> float:
    """What a table shows of one of SAMPLES; NaN for no numbers."""
    samples = SAMPLES[metric](episodes)
    return float(samples.mean()) if len(samples) else math.nan


def assert_equal(ours: Episodes, theirs: Episodes) -> None:
    for field in fields(Episodes):
        np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name), field.name)


@given(COUNTS, SEEDS, CHANCES)
def test_metrics_equal_their_slow_twins(make_episodes, count, seed, probability):
    episodes = make_episodes(count, seed=seed, success_probability=probability)
    distances, times, ratios, weighted, solved = [], [], [], [], 0
    for i in range(count):
        weighted.append(0.0)
        if episodes.success[i]:
            solved += 1
            distances.append(episodes.distance_m[i])
            times.append(episodes.time_s[i])
            ratios.append(episodes.distance_m[i] / episodes.shortest_m[i])
            weighted[-1] = episodes.shortest_m[i] / max(episodes.distance_m[i], episodes.shortest_m[i])

    def mean(values):
        return sum(values) / len(values) if values else math.nan

    assert success_rate(episodes) == pytest.approx(solved / count if count else math.nan, nan_ok=True)
    assert mean_of("distance_m", episodes) == pytest.approx(mean(distances), nan_ok=True)
    assert mean_of("time_s", episodes) == pytest.approx(mean(times), nan_ok=True)
    assert mean_of("optimality", episodes) == pytest.approx(mean(ratios), nan_ok=True)
    assert mean_of("spl", episodes) == pytest.approx(mean(weighted), nan_ok=True)


@given(st.integers(1, 40), SEEDS, CHANCES)
def test_the_three_endings_share_all_episodes(make_episodes, count, seed, probability):
    episodes = make_episodes(count, seed=seed, success_probability=probability)
    assert sum(getattr(episodes, ending).mean() for ending in RATES) == pytest.approx(1.0)


@given(st.integers(1, 40), SEEDS, CHANCES)
def test_spl_is_at_most_success_and_meets_it_on_shortest_paths(make_episodes, count, seed, probability):
    episodes = make_episodes(count, seed=seed, success_probability=probability)
    assert 0.0 <= mean_of("spl", episodes) <= success_rate(episodes) + 1e-12
    straight = replace(episodes, distance_m=episodes.shortest_m)
    assert mean_of("spl", straight) == pytest.approx(success_rate(episodes))


@given(SEEDS, st.floats(1.01, 5.0))
def test_longer_ways_cost_optimality_and_spl(make_episodes, seed, factor):
    episodes = make_episodes(20, seed=seed, success_probability=1.0)
    longer = replace(episodes, distance_m=episodes.distance_m * factor)
    assert mean_of("optimality", longer) == pytest.approx(factor * mean_of("optimality", episodes))
    assert mean_of("spl", longer) < mean_of("spl", episodes)


@given(SEEDS, st.floats(0.1, 100.0))
def test_ratios_do_not_depend_on_the_unit_of_length(make_episodes, seed, unit):
    episodes = make_episodes(20, seed=seed)
    scaled = replace(episodes, distance_m=episodes.distance_m * unit, shortest_m=episodes.shortest_m * unit)
    assert mean_of("optimality", scaled) == pytest.approx(mean_of("optimality", episodes), nan_ok=True)
    assert mean_of("spl", scaled) == pytest.approx(mean_of("spl", episodes))


def test_what_failures_drove_moves_no_metric_of_successes(make_episodes):
    episodes = make_episodes(50, seed=3)
    longer = np.where(episodes.success, episodes.distance_m, 1000.0)
    changed = replace(episodes, distance_m=longer, time_s=longer)
    changed = replace(changed, time_s=np.where(episodes.success, episodes.time_s, 1000.0))
    for metric in ("distance_m", "time_s", "optimality", "spl"):
        assert mean_of(metric, changed) == mean_of(metric, episodes)


def test_a_start_at_the_goal_is_a_full_success_without_a_ratio(make_episodes):
    episodes = make_episodes(2, success_probability=1.0)
    at_goal = replace(episodes, shortest_m=np.zeros(2), distance_m=np.zeros(2))
    assert mean_of("spl", at_goal) == 1.0
    assert math.isnan(mean_of("optimality", at_goal))


@given(COUNTS, SEEDS)
def test_a_table_gives_the_episodes_back(make_episodes, count, seed):
    episodes = make_episodes(count, seed=seed)
    table = episodes.to_table().append_column("a_later_version", pa.array(np.zeros(count)))
    assert_equal(Episodes.from_table(table), episodes)


def test_a_table_has_one_plain_row_an_episode(make_episodes):
    episodes = make_episodes(5)
    row = episodes.to_table().to_pylist()[3]
    assert row["task"] == 3
    assert (row["goal_x_m"], row["goal_y_m"]) == tuple(episodes.goal_xy_m[3])
    assert row["final_yaw_rad"] == episodes.final_pose[3, 2]
    assert row["success"] is bool(episodes.success[3])


def test_a_foreign_table_is_named_as_such(make_episodes):
    table = make_episodes(3).to_table()
    with pytest.raises(CheckpointError, match="'shortest_m'"):
        Episodes.from_table(table.drop_columns(["shortest_m"]))
    with pytest.raises(CheckpointError, match="'time_s'"):
        Episodes.from_table(_with(table, "time_s", pa.array([1.0, None, 2.0])))
    with pytest.raises(CheckpointError, match="string in column 'time_s'"):
        Episodes.from_table(_with(table, "time_s", pa.array(["fast", "slow", "slow"])))
    with pytest.raises(CheckpointError, match=r"episodes\.time_s"):
        Episodes.from_table(_with(table, "time_s", pa.array([1.0, math.nan, 2.0])))


def _with(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"timeout": np.ones(4, bool), "success": np.ones(4, bool)}, "2 endings"),
        ({"success": np.zeros(4, bool), "timeout": np.zeros(4, bool)}, "0 endings"),
        ({"distance_m": np.array([1.0, np.nan, 1.0, 1.0])}, r"episodes\.distance_m"),
        ({"time_s": np.array([1.0, -1.0, 1.0, 1.0])}, "negative"),
        ({"smoothness": np.ones(3)}, r"episodes\.smoothness has shape"),
        ({"final_pose": np.ones((4, 2))}, r"episodes\.final_pose has shape"),
        ({"task": np.int32(3)}, r"episodes\.task has shape"),
    ],
)
def test_a_broken_record_is_refused(make_episodes, change, message):
    episodes = replace(
        make_episodes(4),
        success=np.ones(4, bool),
        collision=np.zeros(4, bool),
        timeout=np.zeros(4, bool),
    )
    with pytest.raises(ValueError, match=message):
        replace(episodes, **change)


def test_episodes_own_their_arrays(make_episodes):
    buffer = np.ones(4)
    episodes = replace(make_episodes(4), time_s=buffer)
    buffer[:] = 7.0
    assert (episodes.time_s == 1.0).all()
    with pytest.raises(ValueError, match="read-only"):
        episodes.time_s[0] = 2.0


@given(SEEDS, SEEDS)
def test_pairing_is_by_task_whatever_the_order(make_episodes, seed, order):
    ours = make_episodes(30, seed=seed)
    theirs = make_episodes(30, seed=seed + 1)
    shuffled = theirs.select(np.random.default_rng(order).permutation(30)[:20])
    first, second = on_common_tasks([ours, shuffled])
    np.testing.assert_array_equal(first.task, np.sort(shuffled.task))
    assert_equal(first, ours.select(np.sort(shuffled.task)))
    assert_equal(second, theirs.select(np.sort(shuffled.task)))


@given(SEEDS)
def test_tasks_solved_by_all_are_solved_by_each(make_episodes, seed):
    several = [make_episodes(30, seed=seed + i) for i in range(3)]
    solved = solved_by_all(several)
    expected = [i for i in range(30) if all(episodes.success[i] for episodes in several)]
    for episodes in solved:
        assert episodes.success.all()
        assert episodes.task.tolist() == expected


def test_a_task_driven_twice_cannot_be_paired(make_episodes):
    episodes = make_episodes(3)
    twice = episodes.select(np.array([0, 1, 1]))
    with pytest.raises(ValueError, match="more than once"):
        on_common_tasks([episodes, twice])
