"""LiDAR drivers as they are: what cannot be is passed over and named, once; the rest of the scan is driven by."""

import dataclasses
import logging
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.deploy import Navigator, Odometry, Scan
from adrl.deploy.lidar import LidarAdapter
from adrl.deploy.scan_reader import MANY, OFTEN, ScanReader
from adrl.deploy.supervisor import CAUTIONS
from adrl.types import LidarConfig
from deploy.driver_loop import ROBOT
from deploy.recorded import a_policy

BEAMS = 180
STEP = 2.0 * math.pi / BEAMS


def a_scan(stamp_s: float = 0.0, **fields: Any) -> Scan:
    """All round, of a driver without a fault but for these."""
    usual: dict[str, Any] = {
        "ranges": np.full(BEAMS, 5.0) + 0.01 * math.sin(7.0 * stamp_s),
        "angle_min_rad": -math.pi,
        "angle_increment_rad": STEP,
        "angle_max_rad": math.pi - STEP,
        "range_min_m": 0.1,
        "range_max_m": 6.0,
        "time_increment_s": 0.1 / BEAMS,
    }
    return Scan(stamp_s=stamp_s, **(usual | fields))


def driven(caplog: pytest.LogCaptureFixture, steps: int = 4, **fields: Any) -> tuple[set[str], list[str]]:
    """Reasons of a drive on such scans, and the warnings but the supervisor's."""
    navigator = Navigator(a_policy(ROBOT), guidance="goal")
    navigator.set_goal((3.0, 0.0))
    reasons: set[str] = set()
    with caplog.at_level(logging.WARNING, "adrl.deploy"):
        for k in range(steps):
            now_s = 0.1 * k
            odometry = Odometry(pose=(1e-3 * k, 0.0, 0.0), twist=(0.01, 0.0), stamp_s=now_s)
            reasons |= set(navigator.step(a_scan(now_s, **fields), odometry, now_s).reasons)
    return reasons - CAUTIONS - {"limited"}, [words for words in caplog.messages if "passed over" in words]


@pytest.mark.parametrize(
    ("field", "fields"),
    [
        ("time_increment", {"time_increment_s": 153333.3}),  # YDLIDAR's driver
        ("time_increment", {"time_increment_s": -0.0001}),  # sick_scan_xd
        ("time_increment", {"time_increment_s": math.nan}),
        ("time_increment", {"time_increment_s": math.inf}),
        ("angle_increment", {"angle_increment_rad": 0.0}),
        ("angle_increment", {"angle_increment_rad": math.nan}),
        ("angle_increment", {"angle_increment_rad": 2.0 * STEP}),
        ("angle_max", {"angle_max_rad": 0.5 * math.pi}),
        ("range_max", {"range_max_m": 0.0}),
        ("range_max", {"range_max_m": math.nan}),
        ("range_max", {"range_min_m": 6.0, "range_max_m": 0.1}),
        ("range_min", {"range_min_m": math.nan}),
        ("range_min", {"range_min_m": -1.0}),
    ],
)
def test_what_cannot_be_is_passed_over_and_named_once(
    field: str, fields: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    reasons, warnings = driven(caplog, **fields)
    assert reasons == set()
    (warning,) = warnings
    assert f"the scan's {field} cannot be" in warning


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"angle_max_rad": math.nan},  # not given
        {"angle_max_rad": math.pi},  # the LDS-01 counts one beam more
        {"angle_min_rad": 0.0, "angle_max_rad": -STEP},  # brought into (-pi, pi]
        {"range_max_m": math.inf},
        {"time_increment_s": 0.0},
        {"angle_min_rad": math.pi, "angle_increment_rad": -STEP, "angle_max_rad": STEP - math.pi},
    ],
)
def test_what_drivers_rightly_do_is_not_remarked_on(
    fields: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    assert driven(caplog, **fields) == (set(), [])


@pytest.mark.parametrize(
    "fields",
    [
        {"stamp_s": math.nan},
        {"stamp_s": -math.inf},
        {"angle_min_rad": math.nan},
        {"angle_increment_rad": 0.0, "angle_max_rad": math.nan},
        {"angle_increment_rad": 4.0 * STEP, "angle_max_rad": math.nan},
        {"ranges": np.empty(0)},
    ],
)
def test_a_scan_of_which_nothing_can_be_made_is_invalid_not_missing(fields: dict[str, Any]) -> None:
    """Also in the steps between two of them, and after good ones."""
    for good in (0, 3):
        navigator = Navigator(a_policy(ROBOT), guidance="goal")
        navigator.set_goal((3.0, 0.0))
        for k in range(good + 4):
            now_s = 0.1 * k
            odometry = Odometry(pose=(1e-3 * k, 0.0, 0.0), twist=(0.01, 0.0), stamp_s=now_s)
            scan = dataclasses.replace(a_scan(now_s), **(fields if k >= good else {}))
            command = navigator.step(scan if k != good + 1 or good else None, odometry, now_s)
            if k >= good:
                assert "scan_invalid" in command.reasons
                assert "no_scan" not in command.reasons
            else:
                assert command.status == "driving"


@given(
    ranges=st.lists(
        st.one_of(st.floats(0.2, 5.0), st.sampled_from([math.nan, 0.0, math.inf])), min_size=30, max_size=60
    ),
    zero=st.booleans(),
    nan=st.booleans(),
)
def test_nothing_came_back_reads_as_infinity_and_all_else_as_it_was(
    ranges: list[float], zero: bool, nan: bool
) -> None:
    scan = a_scan(ranges=np.array(ranges), angle_max_rad=math.nan)
    read = ScanReader(zero_is_free=zero, nan_is_free=nan)(scan)
    free = (zero & (scan.ranges == 0.0)) | (nan & np.isnan(scan.ranges))
    assert np.isposinf(read.ranges[free]).all()
    np.testing.assert_array_equal(read.ranges[~free], scan.ranges[~free])
    # And so to the policy: as if the driver had said so.
    adapter = LidarAdapter(LidarConfig(num_beams=30, fov_rad=math.pi))
    said = dataclasses.replace(scan, ranges=np.where(free, np.inf, scan.ranges))
    np.testing.assert_array_equal(adapter(read), adapter(said))


def test_a_lidar_that_says_nan_in_the_open_is_driven_with_when_told_and_hinted_at_when_not(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ranges = np.full(BEAMS, np.nan)
    ranges[: int(BEAMS * (1.0 - 2.0 * MANY))] = 3.0
    for nan_is_free in (True, False):
        navigator = Navigator(a_policy(ROBOT), guidance="goal", nan_is_free=nan_is_free)
        navigator.set_goal((3.0, 0.0))
        statuses = set()
        with caplog.at_level(logging.WARNING, "adrl.deploy"):
            caplog.clear()
            for k in range(2 * OFTEN):
                now_s = 0.1 * k
                odometry = Odometry(pose=(1e-3 * k, 0.0, 0.0), twist=(0.01, 0.0), stamp_s=now_s)
                seen = ranges + 0.001 * math.sin(k)
                statuses.add(navigator.step(a_scan(now_s, ranges=seen), odometry, now_s).status)
        assert statuses == ({"driving"} if nan_is_free else {"stopped"})
        assert [words for words in caplog.messages if "nan_is_free" in words][1:] == []
        assert any("say nan_is_free" in words for words in caplog.messages) == (not nan_is_free)
