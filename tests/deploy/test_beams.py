"""What beams say, held against the scan before: what cannot vanish, and what can."""

import dataclasses
import math

import numpy as np
import pytest

from adrl.deploy import Pose, Scan
from adrl.deploy.beams import LASTS_S, BeamWatch
from adrl.types import Array

BEAMS, PERIOD_S = 180, 0.1
ANGLES = -math.pi + 2.0 * math.pi / BEAMS * np.arange(BEAMS)
ROOM = np.full(BEAMS, 3.0)
HERE: Pose = (0.0, 0.0, 0.0)


def a_scan(step: int, ranges: Array, range_min_m: float = 0.0) -> Scan:
    return Scan(
        ranges=ranges,
        angle_min_rad=-math.pi,
        angle_increment_rad=2.0 * math.pi / BEAMS,
        range_min_m=range_min_m,
        range_max_m=6.0,
        stamp_s=PERIOD_S * step,
    )


def a_disc(x: float, y: float, radius_m: float = 0.3) -> Array:
    """(K,) ranges to a disc in the open."""
    along = x * np.cos(ANGLES) + y * np.sin(ANGLES)
    off = radius_m**2 - (x**2 + y**2 - along**2)
    hit = (off > 0.0) & (along > 0.0)
    return np.where(hit, along - np.sqrt(np.maximum(off, 0.0)), np.inf)


def seen(*scans: Scan, pose: Pose = HERE) -> tuple[BeamWatch, Scan]:
    """What is believed of the last one."""
    watch = BeamWatch(HERE)
    believed = [watch.believable(scan, pose) for scan in scans]
    return watch, believed[-1]


@pytest.mark.parametrize("width_rad", [0.4, math.pi, 2.0 * math.pi])
def test_a_wall_does_not_vanish_between_two_scans(width_rad: float):
    """All beams, half of them, an arc: they tell nothing for as long as they say so, and all is well after that."""
    blind = np.abs(ANGLES) <= 0.5 * width_rad
    empty = np.where(blind, np.inf, ROOM)
    watch = BeamWatch(HERE)
    assert watch.believable(a_scan(0, ROOM), HERE).ranges is ROOM
    for step in range(1, 50):
        believed = watch.believable(a_scan(step, empty), HERE)
        assert watch.empty
        told = ~np.isnan(believed.ranges)
        # What is within a step of the next hit may have gone behind that.
        assert not told[np.abs(ANGLES) < 0.5 * width_rad - 0.15].any()
        assert told[~blind].all()
    assert watch.believable(a_scan(50, ROOM), HERE).ranges is ROOM
    assert not watch.empty


def test_an_arc_that_goes_blind_in_a_turn_does_not_hide_behind_what_is_seen_anew():
    """The robot turns by 0.2 rad a scan in a room with a doorway, as the ranges show: they are dated right."""
    watch = BeamWatch(HERE)
    for step in range(12):
        yaw = 0.2 * step
        world = np.remainder(ANGLES + yaw + math.pi, 2.0 * math.pi) - math.pi
        ranges = np.where(np.abs(world - 1.0) < 0.2, 4.5, 3.0)
        blind = step >= 8
        watch.believable(
            a_scan(step, np.where(blind & (np.abs(ANGLES - 0.3) < 0.5), np.inf, ranges)), (0.0, 0.0, yaw)
        )
        assert watch.empty == blind


def test_who_walks_away_in_the_open_is_believed_to_be_gone():
    """In any direction, at a person's speed: nothing else is there to confirm the LiDAR."""
    for heading in np.linspace(-math.pi, math.pi, 12):
        watch = BeamWatch(HERE)
        for step in range(60):
            way_m = 1.5 * PERIOD_S * step
            x, y = 1.0 + way_m * math.cos(heading), 0.4 + way_m * math.sin(heading)
            if math.hypot(x, y) < 0.4:
                break
            scan = a_scan(step, a_disc(x, y))
            assert watch.believable(scan, HERE) is scan


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_single_beams_may_fail(share: float):
    rng = np.random.default_rng(0)
    watch = BeamWatch(HERE)
    for step in range(50):
        scan = a_scan(step, np.where(rng.random(BEAMS) < share, np.inf, ROOM))
        assert watch.believable(scan, HERE) is scan


def test_what_was_out_of_reach_soon_may_vanish():
    watch, believed = seen(a_scan(0, np.full(BEAMS, 5.8)), a_scan(1, np.full(BEAMS, np.inf)))
    assert not watch.empty
    assert np.isinf(believed.ranges).all()


def test_what_has_vanished_is_given_up_in_the_end_if_the_lidar_sees_other_things():
    """One that sees nothing at all is not believed, ever."""
    for sees, given_up in ((ANGLES > 0.0, True), (ANGLES > 9.0, False)):
        watch = BeamWatch(HERE)
        watch.believable(a_scan(0, ROOM), HERE)
        for step in range(1, round(LASTS_S / PERIOD_S) + 10):
            watch.believable(a_scan(step, np.where(sees, ROOM, np.inf)), HERE)
        assert watch.empty != given_up


def test_the_robots_own_motion_is_taken_out():
    """It turns on the spot before a wall in the open: the wall leaves no beam without a hit elsewhere."""
    watch = BeamWatch(HERE)
    for step in range(40):
        yaw = 0.15 * step
        world = np.remainder(ANGLES + yaw + math.pi, 2.0 * math.pi) - math.pi
        ahead = np.abs(world) < 1.0
        scan = a_scan(step, np.where(ahead, 2.0 / np.cos(np.where(ahead, world, 0.0)), np.inf))
        assert watch.believable(scan, (0.0, 0.0, yaw)) is scan


NEAR = np.where(np.arange(BEAMS) == 40, -np.inf, ROOM)


def test_nothing_jumps_to_the_lidar():
    """A beam that says "too near" where a scan ago all was far tells nothing, unless it insists."""
    _, believed = seen(a_scan(0, ROOM, 0.3), a_scan(1, NEAR, 0.3))
    assert np.isnan(believed.ranges[40])
    assert np.count_nonzero(np.isnan(believed.ranges)) == 1
    _, insists = seen(a_scan(0, ROOM, 0.3), *(a_scan(k, NEAR, 0.3) for k in (1, 2, 3)))
    assert np.isneginf(insists.ranges[40])


def test_what_was_near_or_there_from_the_start_is_believed():
    came = np.where(np.arange(BEAMS) == 40, 0.35, ROOM)
    for first in (came, NEAR):
        _, believed = seen(a_scan(0, first, 0.3), a_scan(1, NEAR, 0.3))
        assert np.isneginf(believed.ranges[40])


def test_scans_may_change_their_beams():
    watch = BeamWatch(HERE)
    watch.believable(a_scan(0, ROOM), HERE)
    fewer = dataclasses.replace(a_scan(1, ROOM[:90]), angle_increment_rad=4.0 * math.pi / BEAMS)
    assert watch.believable(fewer, HERE) is fewer
