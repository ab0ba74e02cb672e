"""Wall clock until training is good enough."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.evaluation.learning_time import (
    STEADY_ROWS,
    median_seconds_to_level,
    seconds_to_level,
    steady_from,
    steady_level,
)

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


class TestSteady:
    def test_a_step_is_steady_when_the_mean_of_five_rows_is(self) -> None:
        """0 for ten rows, then 1: the trailing mean goes 0.2, 0.4, 0.6, 0.8, 1; only the last is within 10 % of 1."""
        curve = np.r_[np.zeros(10), np.ones(30)]
        assert steady_from(np.arange(40), curve) == 14.0
        assert steady_level(curve) == 1.0

    def test_a_ramp_is_steady_where_it_is_within_a_tenth_of_its_end(self) -> None:
        """Of 0, 1, ... 100 and then still 100: the mean of five lags by two rows, its range is 98, its band 9.8."""
        curve = np.minimum(np.arange(200), 100)
        assert steady_from(np.arange(200), curve) == 93.0

    def test_leaving_the_band_starts_it_anew(self) -> None:
        curve = np.ones(50)
        curve[0], curve[30] = 0.0, 9.0
        assert steady_from(np.arange(50), curve) == 35.0

    def test_what_swings_to_the_end_is_never_steady(self) -> None:
        assert steady_from(np.arange(40), np.tile([*[0.0] * 5, *[1.0] * 5], 4)) == math.inf

    def test_short_or_constant_logs(self) -> None:
        assert math.isnan(steady_from(np.arange(STEADY_ROWS - 1), np.ones(STEADY_ROWS - 1)))
        assert steady_from(np.arange(9), np.full(9, 0.1)) == STEADY_ROWS - 1
        assert math.isnan(steady_level([math.nan]))

    @given(
        curve=st.lists(st.floats(-10.0, 10.0), min_size=STEADY_ROWS, max_size=30),
        scale=st.sampled_from([-2.0, 0.5, 4.0]),
        shift=st.sampled_from([0.0, 8.0]),
    )
    def test_it_does_not_depend_on_the_scale_of_q(
        self, curve: list[float], scale: float, shift: float
    ) -> None:
        """Rewards differ from method to method: Q and a Q + b are steady together. Binary holds all exactly."""
        rounded = np.round(np.array(curve) * 8.0) / 8.0
        rows = np.arange(len(curve))
        assert steady_from(rows, rounded) == steady_from(rows, scale * rounded + shift)
