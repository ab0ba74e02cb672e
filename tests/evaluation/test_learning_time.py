"""Wall clock until training is good enough."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.evaluation.learning_time import median_seconds_to_level, seconds_to_level

RATES = st.lists(st.one_of(st.sampled_from([math.nan, 0.9]), st.floats(0.0, 1.0)), max_size=12)


@pytest.mark.parametrize(
    ("success", "expected"),
    [
        ([0.5, 0.9, 0.95], 30.0),  # the second of the first two in a row; 0.9 itself counts
        ([0.95, 0.5, 0.9, 0.9, 1.0], 40.0),  # one alone may be luck
        ([math.nan, 0.95, math.nan, 0.95], 40.0),  # rows without an evaluation between them do not part them
        ([0.95], math.inf),
        ([0.95, 0.5, 0.95, 0.5], math.inf),
        ([0.1, 0.2], math.inf),
    ],
)
def test_known_runs(success: list[float], expected: float) -> None:
    assert seconds_to_level(10.0 * np.arange(1, len(success) + 1), success) == expected


@pytest.mark.parametrize("success", [[], [math.nan, math.nan]])
def test_without_an_evaluation_it_is_not_a_number(success: list[float]) -> None:
    assert math.isnan(seconds_to_level(np.arange(len(success)), success))


@given(success=RATES, level=st.floats(0.05, 1.0), successive=st.integers(1, 3))
def test_a_later_row_never_makes_it_later(success: list[float], level: float, successive: int) -> None:
    """What is known cannot be undone: a longer log gives the same time once there is one."""
    clock = np.cumsum(np.ones(len(success)))
    before = math.inf
    for rows in range(len(success) + 1):
        now = seconds_to_level(clock[:rows], success[:rows], level=level, successive=successive)
        if math.isfinite(before):
            assert now == before
        elif math.isfinite(now):
            assert now == rows, "it was reached by the row just added"
            before = now


@given(success=RATES)
def test_a_lower_level_and_fewer_in_a_row_never_take_longer(success: list[float]) -> None:
    clock = np.arange(float(len(success)))
    hard = seconds_to_level(clock, success, level=0.9, successive=2)
    for level, successive in ((0.8, 2), (0.9, 1)):
        easy = seconds_to_level(clock, success, level=level, successive=successive)
        assert easy <= hard or (math.isnan(easy) and math.isnan(hard))


def test_columns_must_fit() -> None:
    with pytest.raises(ValueError, match="equal length"):
        seconds_to_level([1.0, 2.0], [0.5])


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ([30.0, 10.0, 20.0], 20.0),
        ([10.0, 20.0], 15.0),
        ([10.0, math.inf, math.inf], math.inf),
        ([10.0, 20.0, math.inf, math.inf], math.inf),
        ([math.inf, math.inf], math.inf),
        ([10.0, 12.0, math.inf], 12.0),
    ],
)
def test_median_counts_a_seed_that_never_gets_there_as_infinite(
    seconds: list[float], expected: float
) -> None:
    assert median_seconds_to_level(seconds) == expected


@pytest.mark.parametrize("seconds", [[], [10.0, math.nan]])
def test_median_of_what_was_not_measured_is_not_a_number(seconds: list[float]) -> None:
    assert math.isnan(median_seconds_to_level(seconds))
