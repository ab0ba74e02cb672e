"""What several sources come to: agreement, contradiction, and what the user says."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.descriptions import Finding, Standing, given_fields, settle
from adrl.errors import ConfigError

SPEED = "max_speed_mps"
speeds = st.floats(0.05, 20.0)


def said(value: object, place: str = "a", standing: Standing = Standing.SAID, field: str = SPEED) -> Finding:
    return Finding(field=field, value=value, place=place, standing=standing)


@given(value=speeds, share=st.floats(-0.5, 0.5))
def test_two_that_say_the_same_agree_and_two_that_do_not_are_named(value: float, share: float) -> None:
    other = value * (1.0 + share)
    settled = settle([said(value, "here"), said(other, "there")])
    apart = abs(other - value) / max(value, other)
    if apart < 0.0099:
        assert settled.chosen[SPEED].place == "here"
    elif apart > 0.0101:
        (fault,) = settled.faults
        assert "(here)" in fault
        assert "(there)" in fault
        assert SPEED not in settled.chosen


@given(value=speeds, limits=st.lists(speeds, min_size=1, max_size=4))
def test_the_tightest_limit_holds(value: float, limits: list[float]) -> None:
    bounds = [said(limit, f"limit {i}", Standing.LIMIT) for i, limit in enumerate(limits)]
    assert settle(bounds).chosen[SPEED].value == min(limits)
    both = settle([said(value), *bounds]).chosen[SPEED]
    assert both.value == min(value, *limits)


@given(reverse=st.lists(st.floats(-5.0, 0.0), min_size=1, max_size=4))
def test_of_backwards_speeds_the_one_nearest_to_none_is_tightest(reverse: list[float]) -> None:
    field = "min_speed_mps"
    bounds = [said(speed, "limit", Standing.LIMIT, field) for speed in reverse]
    assert settle(bounds).chosen[field].value == max(reverse)


@given(seen=st.lists(speeds, min_size=1, max_size=4), top=speeds)
def test_what_was_seen_holds_where_nothing_else_is_said_and_contradicts_less(
    seen: list[float], top: float
) -> None:
    drives = [said(speed, "bag", Standing.SEEN) for speed in seen]
    assert settle(drives).chosen[SPEED].value == max(seen)
    settled = settle([said(top), *drives])
    assert bool(settled.faults) == (max(seen) > 1.1 * top + 0.02)


def test_hints_contradict_nothing_and_the_user_nothing_at_all() -> None:
    findings = [said(1.0), said(9.0, "hint", Standing.HINT), said(2.0, "b"), said(7.0, "bag", Standing.SEEN)]
    assert settle(findings).faults
    (fixed,) = given_fields([f"{SPEED}=3"])
    settled = settle([*findings, fixed])
    assert settled.faults == ()
    assert settled.chosen[SPEED].value == 3.0
    assert settle([said(1.0), findings[1]]).chosen[SPEED].value == 1.0


def test_a_radius_settles_two_footprints_and_the_other_way_round() -> None:
    square = ((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2))
    findings = [said(0.3, "a", field="radius_m"), said(square, "b", field="footprint_m")]
    assert len(settle(findings).faults) == 1
    for text, field in (
        ("radius_m=0.25", "radius_m"),
        ("footprint_m=[[1, 0], [0, 1], [-1, 0]]", "footprint_m"),
    ):
        settled = settle([*findings, *given_fields([text])])
        assert settled.faults == ()
        assert [name for name in settled.chosen if name in ("radius_m", "footprint_m")] == [field]


def test_headings_agree_over_pi() -> None:
    field = "lidar.mount_yaw_rad"
    turned = [said(math.pi - 0.001, field=field), said(-math.pi + 0.001, "b", field=field)]
    assert settle(turned).faults == ()


def test_what_nobody_says_is_missing() -> None:
    assert settle([]).missing[:3] == ("radius_m", "max_speed_mps", "min_speed_mps")
    assert SPEED not in settle([said(1.0)]).missing
    assert "radius_m" not in settle(given_fields(["footprint_m=[[1, 0], [0, 1], [-1, 0]]"])).missing


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("max_speed_mps", "is no NAME=VALUE"),
        ("max_sped_mps=1", "did you mean 'max_speed_mps'"),
        ("name='x'", "is no field of a robot"),
        ("max_speed_mps=fast", "--set max_speed_mps=fast: give 0.01 to 50 m/s"),
        ("max_speed_mps=", "give 0.01 to 50 m/s"),
        ("max_speed_mps=true", "give 0.01 to 50 m/s"),
        ("max_speed_mps=nan", "give 0.01 to 50 m/s"),
        ("max_speed_mps=1\nx=2", "give 0.01 to 50 m/s"),
        ("lidar.num_beams=90.5", "a whole number"),
        ("lidar.mount_yaw_rad=[1]", "rad"),
        ("footprint_m=3", "give a list of corners [x, y]"),
        ("footprint_m=[[1, 0], [0, 1]]", "give 3 to 16"),
        ("footprint_m=[[1, 0], [0, 1, 2], [-1, 0]]", "give a list of corners [x, y]"),
    ],
)
def test_a_setting_that_is_none_is_refused(text: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        given_fields([text])
    assert says in str(caught.value)


def test_a_field_is_given_once() -> None:
    with pytest.raises(ConfigError, match="radius_m or footprint_m twice"):
        given_fields(["radius_m=0.2", "footprint_m=[[1, 0], [0, 1], [-1, 0]]"])
