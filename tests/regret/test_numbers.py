"""Laws of regret, and numbers worked out by hand."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose

from adrl.evaluation.statistics import seed_mean
from adrl.regret.numbers import OUTCOMES, Scores, cell_rows, losses, method_rows, regrets

SHAPES = st.tuples(st.integers(1, 4), st.integers(1, 5), st.integers(1, 4))


def scores(success: Any, time_s: Any) -> Scores:
    success, time_s = np.asarray(success, float), np.asarray(time_s, float)
    names = [tuple(f"{kind}{i}" for i in range(n)) for kind, n in zip("cm", success.shape[:2], strict=True)]
    return Scores(cells=names[0], methods=names[1], success=success, time_s=time_s)


@st.composite
def any_scores(draw) -> Scores:
    shape = draw(SHAPES)
    success = draw(hnp.arrays(np.float64, shape, elements=st.integers(0, 200).map(lambda n: n / 200)))
    time_s = draw(hnp.arrays(np.float64, shape, elements=st.integers(1, 600).map(lambda n: n / 10)))
    return scores(success, time_s)


def mean_regrets(of: Scores) -> dict[str, np.ndarray]:
    return {outcome: regrets(loss).mean(axis=2) for outcome, loss in losses(of).items()}


@given(any_scores())
def test_the_best_of_a_cell_has_none_and_nobody_less(of: Scores) -> None:
    for outcome, found in mean_regrets(of).items():
        assert (found >= -1e-12).all(), outcome
        assert_allclose(found.min(axis=1), 0.0, atol=1e-12)


@given(any_scores(), st.floats(0.0, 1.0), st.floats(1.0, 5.0))
def test_a_worse_method_changes_nobodys(of: Scores, solved: float, slower: float) -> None:
    """One that solves a part of what the worst solves and takes longer than the slowest."""
    success = np.concatenate([of.success, solved * of.success.min(axis=1, keepdims=True)], axis=1)
    time_s = np.concatenate([of.time_s, slower * of.time_s.max(axis=1, keepdims=True)], axis=1)
    before, after = mean_regrets(of), mean_regrets(scores(success, time_s))
    for outcome in OUTCOMES:
        assert_allclose(after[outcome][:, :-1], before[outcome], atol=1e-12)


@given(any_scores(), st.randoms(use_true_random=False))
def test_methods_in_another_order_have_theirs_in_that_order(of: Scores, random: Any) -> None:
    order = list(range(len(of.methods)))
    random.shuffle(order)
    before, after = mean_regrets(of), mean_regrets(scores(of.success[:, order], of.time_s[:, order]))
    for outcome in OUTCOMES:
        assert_allclose(after[outcome], before[outcome][:, order], atol=1e-12)


TWO_CELLS = scores(
    # Two cells, two methods, two seeds.
    [[[0.9, 0.7], [0.5, 0.7]], [[0.6, 0.8], [1.0, 0.8]]],
    [[[10.0, 10.0], [20.0, 10.0]], [[30.0, 30.0], [20.0, 20.0]]],
)


def test_two_cells_by_hand() -> None:
    first, second = method_rows(TWO_CELLS)
    # Means of success 0.8, 0.6 and 0.7, 0.9; of time 10, 15 and 30, 20.
    assert first["regret_success"] == pytest.approx((0.0 + 0.2) / 2)
    assert second["regret_success"] == pytest.approx((0.2 + 0.0) / 2)
    assert first["regret_time"] == pytest.approx((0.0 + 0.5) / 2)
    assert second["regret_time"] == pytest.approx((0.5 + 0.0) / 2)
    assert (first["worst_success"], first["worst_time"]) == pytest.approx((0.2, 0.5))
    assert first["less_first_success"] is None
    assert first["p_success"] is None
    # Loss less the first's, pair by pair: 0.4, 0 and -0.4, 0; time 1, 0 and -0.5, -0.5.
    assert second["less_first_success"] == pytest.approx(0.0)
    assert second["less_first_time"] == pytest.approx(0.0)
    ends = seed_mean([[0.4, -0.4], [0.0, 0.0]])
    assert [second["less_first_success" + end] for end in ("_low", "_high")] == pytest.approx(list(ends[1:]))


def test_cells_tell_their_pairs() -> None:
    rows = cell_rows(TWO_CELLS, {"c0": [9.0, None], "c1": [29.0, 19.0]})
    assert [(row["cell"], row["method"]) for row in rows] == list(
        itertools.product(["c0", "c1"], ["m0", "m1"])
    )
    assert [row["common_time_s"] for row in rows] == [9.0, None, 29.0, 19.0]
    assert rows[1]["less_first_success"] == pytest.approx(0.2)
    assert rows[1]["regret_success"] == pytest.approx(0.2)
    assert rows[3]["regret_success"] == 0.0
    assert rows[0]["less_first_success"] is None


def test_a_method_against_itself_is_no_finding() -> None:
    same = scores(
        np.repeat(TWO_CELLS.success[:, :1], 2, axis=1), np.repeat(TWO_CELLS.time_s[:, :1], 2, axis=1)
    )
    second = method_rows(same)[1]
    for outcome in OUTCOMES:
        assert second[f"less_first_{outcome}"] == 0.0
        assert second[f"p_holm_{outcome}"] == 1.0


def test_one_seed_has_no_ends() -> None:
    row = method_rows(scores([[[0.5], [0.4]]], [[[9.0], [8.0]]]))[1]
    assert row["regret_success"] == pytest.approx(0.1)
    assert row["regret_success_low"] is None
