"""The buffer of transforms, held against a plain recomputation with matrices."""

import logging
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from adrl.deploy.frames import KEPT_S, Frames, mount_of, planar
from adrl.errors import TransformError
from adrl.geometry import quaternion_of

ORIGIN = (0.0, 0.0, 0.0)
FLAT = (0.0, 0.0, 0.0, 1.0)
coordinate = st.floats(-50.0, 50.0)
turns = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(p * p for p in q) > 0.1)
rows = st.lists(
    st.tuples(st.integers(0, 400), st.tuples(coordinate, coordinate, coordinate), turns),
    min_size=1,
    max_size=8,
)


def unit(turn: tuple[float, ...]) -> tuple[float, float, float, float]:
    x, y, z, w = (np.array(turn) / np.linalg.norm(turn)).tolist()
    return x, y, z, w


def matrix(place: np.ndarray, rotation: Rotation) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), place
    return out


def plain(told: dict[float, tuple], at_s: float) -> np.ndarray:
    """A link's matrix, by SciPy."""
    times = sorted(told)
    places = np.array([told[time][0] for time in times])
    rotations = Rotation.from_quat([told[time][1] for time in times])
    place = np.array([np.interp(at_s, times, axis) for axis in places.T])
    return matrix(place, rotations[0] if len(times) == 1 else Slerp(times, rotations)(at_s))


@given(first=rows, second=rows, third=rows, share=st.floats(0.0, 1.0), order=st.randoms())
def test_a_lookup_is_the_product_of_the_links_between_the_nearest_stamps(
    first, second, third, share, order
) -> None:
    """Whatever their order of arrival: map -> odom -> base, and a LiDAR that hangs from the map."""
    frames = Frames(tolerance_s=1e9)
    links = [
        ("map", "odom", {0.01 * k: (place, unit(turn)) for k, place, turn in first}),
        ("odom", "base", {0.01 * k: (place, unit(turn)) for k, place, turn in second}),
        ("map", "other", {0.01 * k: (place, unit(turn)) for k, place, turn in third}),
    ]
    news = [(parent, child, stamp_s, *told[stamp_s]) for parent, child, told in links for stamp_s in told]
    order.shuffle(news)
    for parent, child, stamp_s, place, turn in news:
        frames.take(parent, child, stamp_s, place, turn)
    begin = max(min(told) for *_, told in links)
    at_s = begin + share * (4.0 - begin)
    a, b, c = (plain(told, min(at_s, max(told))) for *_, told in links)
    wanted = np.linalg.inv(c) @ a @ b
    found = frames.lookup("/other", "base", at_s)
    assert np.allclose(matrix(np.array(found.place), Rotation.from_quat(found.turn)), wanted, atol=1e-6)
    back = frames.lookup("base", "other", at_s)
    assert np.allclose(
        matrix(np.array(back.place), Rotation.from_quat(back.turn)) @ wanted, np.eye(4), atol=1e-6
    )
    assert (
        abs(math.remainder(planar(found)[2] - math.atan2(wanted[1, 0], wanted[0, 0]), math.tau)) < 1e-4
        or math.hypot(wanted[0, 0], wanted[1, 0]) < 1e-3
    )


def test_it_says_what_is_missing_stale_or_of_the_future() -> None:
    frames = Frames(tolerance_s=0.5)
    with pytest.raises(TransformError, match="nothing has told of 'map' and 'odom'"):
        frames.lookup("map", "odom", 1.0)
    frames.take("map", "odom", 1.0, ORIGIN, FLAT)
    frames.take("base", "scan", 0.0, (0.2, 0.0, 0.1), FLAT, static=True)
    with pytest.raises(TransformError, match="nothing joins the two"):
        frames.lookup("map", "scan", 1.0)
    with pytest.raises(TransformError, match="nothing has told of 'laser'"):
        frames.lookup("map", "laser", 1.0)
    assert planar(frames.lookup("map", "odom", 1.5)) == (0.0, 0.0, 0.0)
    with pytest.raises(TransformError, match=r"from 'map' to 'odom' is stale: it is 0\.51 s old"):
        frames.lookup("map", "odom", 1.51)
    with pytest.raises(TransformError, match=r"is of the future: it begins 0\.10 s after"):
        frames.lookup("map", "odom", 0.9)
    assert planar(frames.lookup("base", "scan", 1e9)) == (0.2, 0.0, 0.0)
    frames.take("odom", "map", 1.0, ORIGIN, FLAT)
    with pytest.raises(TransformError, match="go round"):
        frames.lookup("map", "scan", 1.0)


def test_what_moves_is_remembered_for_a_while_and_begins_anew_with_the_clock() -> None:
    frames = Frames()
    for k in range(30):
        frames.take("map", "odom", float(k), (float(k), 0.0, 0.0), FLAT)
    assert frames.lookup("map", "odom", 29.0 - KEPT_S).place[0] == 29.0 - KEPT_S
    with pytest.raises(TransformError, match="of the future"):
        frames.lookup("map", "odom", 28.0 - KEPT_S)
    frames.take("map", "odom", 2.0, (7.0, 0.0, 0.0), FLAT)  # the bag is played again
    assert frames.lookup("map", "odom", 2.0).place[0] == 7.0
    frames.take("map", "scan", 0.0, (1.0, 0.0, 0.0), FLAT, static=True)
    frames.forget()
    with pytest.raises(TransformError, match="nothing"):
        frames.lookup("map", "odom", 2.0)
    assert frames.lookup("map", "scan", 2.0).place[0] == 1.0


def test_a_frame_has_the_parent_that_was_told_last() -> None:
    frames = Frames()
    frames.take("odom", "base", 1.0, ORIGIN, FLAT)
    frames.take("map", "base", 2.0, (3.0, 0.0, 0.0), FLAT)
    assert frames.lookup("map", "base", 2.0).place[0] == 3.0
    with pytest.raises(TransformError, match="nothing"):
        frames.lookup("odom", "base", 2.0)


def test_what_cannot_be_is_passed_over_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    frames = Frames()
    frames.take("map", "odom", 1.0, (1.0, 0.0, 0.0), FLAT)
    with caplog.at_level(logging.WARNING, "adrl"):
        for place, turn in (((math.nan, 0.0, 0.0), FLAT), (ORIGIN, (0.0, 0.0, 0.0, 0.0))):
            frames.take("map", "odom", 1.1, place, turn)
        frames.take("map", "map", 1.0, ORIGIN, FLAT)
    assert len(caplog.messages) == 2
    assert "'map' -> 'odom'" in caplog.messages[0]
    assert frames.lookup("map", "odom", 1.1).place[0] == 1.0


def test_a_mount_is_level_or_upside_down() -> None:
    frames = Frames()
    half = math.sqrt(0.5)
    frames.take("base", "level", 0.0, (0.1, 0.2, 0.3), quaternion_of(0.5), static=True)
    frames.take("base", "upside_down", 0.0, (0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), static=True)
    frames.take("base", "tilted", 0.0, ORIGIN, (half, 0.0, 0.0, half), static=True)
    assert mount_of(frames.lookup("base", "level", 0.0)) == (pytest.approx((0.1, 0.2, 0.5)), False)
    assert mount_of(frames.lookup("base", "upside_down", 0.0)) == (pytest.approx((0.1, 0.0, 0.0)), True)
    with pytest.raises(TransformError, match="tilted by 90"):
        mount_of(frames.lookup("base", "tilted", 0.0))
