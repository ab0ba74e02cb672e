"""When a base acts on commands, measured from what it was told and what odometry says it did."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.deploy import Supervisor, Twist
from adrl.deploy.response import LATEST_PERIODS
from adrl.types import World
from adrl.worlds import ROBOTS
from deploy.closed_loop import drive, rid_of_noise

OPEN = World(bounds=(-50.0, -50.0, 50.0, 50.0), circles=np.array([[20.0, 20.0, 0.5]]))
DIFFBOT = rid_of_noise(ROBOTS["diffbot"])


def zigzag(step: int, number: int) -> Twist:
    return (0.5, 0.8) if step // 4 % 2 else (0.2, -0.8)


@settings(max_examples=20)
@given(st.integers(0, LATEST_PERIODS), st.floats(0.0, 0.15), st.floats(0.0, 0.1))
def test_a_base_is_found_as_late_as_it_is(late: int, latency_s: float, lag_s: float):
    """Beyond the latency of its configuration."""
    known = dataclasses.replace(DIFFBOT, latency_s=latency_s, lag_s=lag_s)
    actual = dataclasses.replace(known, latency_s=latency_s + 0.1 * late)
    supervisor = Supervisor(known)
    drive(actual, [OPEN], zigzag, 60, lambda robot: supervisor)
    assert supervisor.base_late_s == pytest.approx(0.1 * late)
    assert ("base_late" in supervisor.cautions) == (late > 0)


@settings(max_examples=20)
@given(st.integers(0, 2), st.floats(0.4, 1.0), st.floats(0.0, 0.1))
def test_a_base_that_is_half_as_strong_is_braked_as_one(late: int, strength: float, lag_s: float):
    """And is as late as it is; one of nearly all its strength is taken for what it is configured as."""
    known = dataclasses.replace(
        DIFFBOT, max_acceleration_mps2=0.8, max_yaw_acceleration_radps2=2.4, lag_s=lag_s
    )
    actual = dataclasses.replace(
        known,
        max_acceleration_mps2=strength * 0.8,
        max_yaw_acceleration_radps2=strength * 2.4,
        latency_s=0.1 * late,
    )
    supervisor = Supervisor(known)
    drive(actual, [OPEN], zigzag, 60, lambda robot: supervisor)
    if strength < 0.55:
        assert "base_weak" in supervisor.cautions
        assert supervisor.base_late_s == pytest.approx(0.1 * late)
    if strength > 0.9:
        assert "base_weak" not in supervisor.cautions
