"""What a robot has seen about it holds where its LiDAR does not look, or tells nothing."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl import _core
from adrl.deploy import Odometry, Pose, Scan, Supervisor, Twist
from adrl.deploy.surroundings import LASTS_S, Surroundings
from adrl.types import Array, LidarConfig, RobotConfig, World
from adrl.worlds import ROBOTS
from deploy.closed_loop import drive, rid_of_noise

DIFFBOT, JACKAL = ROBOTS["diffbot"], rid_of_noise(ROBOTS["jackal"])
POST_AHEAD = World(bounds=(-2.0, -2.0, 4.0, 2.0), circles=np.array([[1.0, 0.0, 0.015]]))
POST_BESIDE = World(bounds=(-1.0, -2.0, 4.0, 2.0), circles=np.array([[1.0, 0.26, 0.015]]))
AT_REST: Pose = (0.0, 0.0, 0.0)


def ahead(step: int, number: int) -> Twist:
    return 0.5, 0.0


def past_then_round(step: int, number: int) -> Twist:
    return (0.5, 0.0) if step < 18 + number else (0.0, -1.0)


class Forgetful(Supervisor):
    """Knows the newest scan only."""

    def watch(self, scan: Scan | None, odometry: Odometry | None, now_s: float):
        if scan is not None:
            self._surroundings.forget()
        return super().watch(scan, odometry, now_s)


KINDS = pytest.mark.parametrize(("kind", "hits"), [(Supervisor, False), (Forgetful, True)])


def with_lidar(robot: RobotConfig, **changes: float) -> RobotConfig:
    return dataclasses.replace(robot, lidar=dataclasses.replace(robot.lidar, **changes))  # pyright: ignore


# --- closed loops -------------------------------------------------------------------------------------------


@KINDS
@pytest.mark.parametrize("by_another", [False, True])
def test_what_was_passed_is_not_swept_by_the_rear(kind: type[Supervisor], hits: bool, by_another: bool):
    """A Jackal passes a post, which is then behind its LiDAR, and turns on the spot: its rear corner comes round.

    Also where another drove it past.
    """
    sim, _ = drive(
        JACKAL, [POST_BESIDE] * 12, past_then_round, 60, kind, stands_by=lambda k: by_another and k < 18
    )
    assert sim.b["collided"].any() == hits


@pytest.mark.parametrize("reading", [math.nan, 0.0, -math.inf, None])
def test_what_is_too_near_to_be_measured_is_not_driven_into(reading: float | None):
    """A LiDAR that measures from 0.6 m on: a post ahead becomes NaN, 0, -inf, or stays below range_min_m."""

    def blind_near(scan: Scan) -> Scan:
        near = scan.ranges < 0.6
        ranges = scan.ranges if reading is None else np.where(near, reading, scan.ranges)
        return dataclasses.replace(scan, ranges=ranges, range_min_m=0.6)

    others = [[0.5, 1.5, 0.3], [-1.0, -1.0, 0.3]]  # so that scans differ
    world = dataclasses.replace(POST_AHEAD, circles=np.concatenate([POST_AHEAD.circles, others]))
    sim, driven_m = drive(DIFFBOT, [world] * 4, ahead, 60, channel=blind_near)
    assert not sim.b["collided"].any()
    assert (driven_m > 0.6).all()


def test_what_was_never_measured_but_is_nearer_than_the_lidar_measures_may_touch():
    """A robot wakes up before a pillar that is all -inf to it: it does not drive on, and may turn away."""
    supervisor = Supervisor(DIFFBOT)
    front = np.abs(np.arange(180) - 90) < 20
    for k in range(2):
        ranges = np.where(front, -math.inf, 3.0 + 1e-3 * k)
        assert supervisor.watch(a_scan(0.1 * k, ranges=ranges, range_min_m=0.5), at(0.1 * k), 0.1 * k) == ()
    assert supervisor.limit((0.5, 0.0), 0.1)[1][-1] == "obstacle"
    assert supervisor.limit((0.0, 1.0), 0.1)[0][1] > 0.0


@KINDS
def test_beams_that_fail_for_one_scan_do_not_open_the_way(kind: type[Supervisor], hits: bool):
    """A thin post is hit by a few beams, of which each reads free in a fifth of the scans."""
    robot = with_lidar(DIFFBOT, dropout_probability=0.2)
    sim, _ = drive(robot, [POST_AHEAD] * 8, ahead, 200, kind)
    assert sim.b["collided"].any() == hits


@pytest.mark.slow
def test_a_noisy_lidar_does_not_let_the_robot_creep_into_a_post():
    """For a minute the robot is told to go on: the margin is beyond the noise."""
    sim, driven_m = drive(with_lidar(DIFFBOT, noise_std_m=0.03), [POST_AHEAD] * 8, ahead, 600)
    assert not sim.b["collided"].any()
    assert (driven_m > 0.6).all()


# --- the supervisor -----------------------------------------------------------------------------------------


def a_scan(stamp_s: float, range_m: float = 3.0, **changes: Any) -> Scan:
    fields: dict[str, Any] = dict(ranges=np.full(180, range_m) + 1e-3 * math.sin(stamp_s), stamp_s=stamp_s)
    fields |= dict(angle_min_rad=-math.pi, angle_increment_rad=math.pi / 90, range_max_m=6.0)
    return Scan(**(fields | changes))


def at(stamp_s: float, x_m: float = 0.0, twist: Twist = (0.0, 0.0)) -> Odometry:
    return Odometry(pose=(x_m, 0.0, 0.0), twist=twist, stamp_s=stamp_s)


def test_after_a_jump_of_the_odometry_the_last_scan_still_counts():
    """The next scan is late: what the last one shows is where it was about the robot."""
    supervisor = Supervisor(DIFFBOT)
    assert supervisor.watch(a_scan(0.0, 0.23), at(0.0), 0.0) == ()
    assert supervisor.limit((0.5, 0.0), 0.0)[1][-1] == "obstacle"
    assert supervisor.watch(None, at(0.1, x_m=5.0), 0.1) == ("odometry_jumped",)
    assert supervisor.watch(None, at(0.2, x_m=5.0), 0.2) == ()
    assert supervisor.limit((0.5, 0.0), 0.2)[1][-1] == "obstacle"


def beside_a_post(supervisor: Supervisor) -> None:
    """A Jackal sees a post beside its nose, drives on and stands: the post is at its rear, unseen."""
    sees = LidarConfig(num_beams=720, fov_rad=1.5 * math.pi, max_range_m=30.0)
    for k, x_m in enumerate((0.0, 0.02, 0.30, 0.32)):
        dx, dy = 0.1 - x_m, 0.26
        beams = np.abs(np.arctan2(dy, dx - 0.12) - sees.angles_rad) < 0.05
        ranges = np.where(beams, math.hypot(dx - 0.12, dy), 20.0) + 1e-4 * k
        scan = Scan(
            ranges=ranges,
            angle_min_rad=sees.angle_min_rad,
            angle_increment_rad=sees.angle_increment_rad,
            range_max_m=30.0,
            stamp_s=0.1 * k,
        )
        supervisor.watch(scan, at(0.1 * k, x_m), 0.1 * k)


@pytest.mark.parametrize(
    ("jump", "turns"),
    [
        (lambda supervisor: supervisor.watch(a_scan(1e4), None, 0.35), False),
        (lambda supervisor: supervisor.watch(None, at(0.35, x_m=5.0), 0.35), True),
        (lambda supervisor: supervisor.watch(None, None, 0.0), True),
    ],
    ids=["a stamp ahead of the clock", "odometry jumped", "the clock went back"],
)
def test_the_past_holds_for_as_long_as_its_frame(jump: Callable[[Supervisor], object], turns: bool):
    """Where the frame has gone, so have its points; a wrong stamp alone moves nothing."""
    supervisor = Supervisor(JACKAL)
    beside_a_post(supervisor)
    jump(supervisor)
    x_m = 5.0 if turns else 0.32
    free = np.full(720, 20.0)
    scan = Scan(
        ranges=free,
        angle_min_rad=-0.75 * math.pi,
        angle_increment_rad=1.5 * math.pi / 719,
        range_max_m=30.0,
        stamp_s=0.4,
    )
    assert supervisor.watch(scan, at(0.4, x_m), 0.4) == ()
    twist, _ = supervisor.limit((0.0, -1.0), 0.4)
    assert (twist[1] < -0.1) == turns


def test_a_scan_older_than_all_odometry_is_placed_by_its_speed():
    """A node that starts on a moving robot: the wall is by what it has driven since nearer than the scan says."""
    seen_at = []
    for age_s in (0.0, 0.2):
        supervisor = Supervisor(DIFFBOT)
        # Both scans are of one wall, 1 m before where the robot is at 0.2 s.
        supervisor.watch(a_scan(0.2 - age_s, 1.0 + 0.5 * age_s), at(0.2, x_m=0.0, twist=(0.5, 0.0)), 0.2)
        points = supervisor._surroundings.seen_from(AT_REST)
        seen_at.append(points[np.abs(points[:, 1]) < 0.01, 0].max())
    assert seen_at[0] == pytest.approx(seen_at[1], abs=2e-3)


# --- the surroundings alone ---------------------------------------------------------------------------------


def surroundings(robot: RobotConfig = DIFFBOT) -> Surroundings:
    lidar = robot.lidar
    return Surroundings(
        robot,
        (lidar.mount_x_m, lidar.mount_y_m, lidar.mount_yaw_rad),
        margin_m=0.02,
        largest_hole_rad=0.35,
    )


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.8))
def test_no_surface_hides_between_two_hits(seed: int, lost: float):
    """In a round room, whatever beams tell nothing: each place of the wall is kept clear of, holes apart."""
    rng = np.random.default_rng(seed)
    scan = a_scan(0.0, 2.0)
    told = np.flatnonzero(rng.random(180) >= lost)
    if len(told) < 2:
        return
    ranges = np.full(180, math.nan)
    ranges[told] = 2.0
    known = surroundings()
    known.take(dataclasses.replace(scan, ranges=ranges), AT_REST, AT_REST)
    points = known.seen_from(AT_REST)
    angles = rng.uniform(-math.pi, math.pi, 300)
    nearest = np.abs(np.remainder(angles[:, None] - angles_of(points) + math.pi, math.tau) - math.pi)
    wall = np.stack([2.0 * np.cos(angles), 2.0 * np.sin(angles)], axis=1)
    apart = np.hypot(*(wall[:, None] - points[:, :2]).transpose(2, 0, 1))
    covered = (apart <= points[:, 2]).any(axis=1)
    assert covered[nearest.min(axis=1) < 0.5 * 0.35].all()


def angles_of(points: Array) -> Array:
    return np.arctan2(points[:, 1], points[:, 0])


def test_beams_of_a_turning_lidar_are_each_of_their_own_moment():
    """A robot that drives and turns in a round room, its LiDAR going round once in 0.1 s."""
    twist, beams = np.array([[0.6, 1.5]]), 180
    scan = a_scan(0.0, time_increment_s=0.1 / (beams - 1))
    poses = np.concatenate(
        [_core.integrate(np.zeros((1, 3)), twist, k * scan.time_increment_s) for k in range(beams)]
    )
    heading = scan.angle_min_rad + scan.angle_increment_rad * np.arange(beams) + poses[:, 2]
    c, s = np.cos(heading), np.sin(heading)
    along = poses[:, 0] * c + poses[:, 1] * s
    room_m = 2.0
    ranges = -along + np.sqrt(along**2 + room_m**2 - poses[:, 0] ** 2 - poses[:, 1] ** 2)
    off_m = []
    first, last = (tuple(pose) for pose in poses[[0, -1]].tolist())
    for ends in ((first, last), (first, first)):
        known = surroundings()
        known.take(dataclasses.replace(scan, ranges=ranges), *ends)
        points = known.seen_from(AT_REST)
        off_m.append(np.abs(np.hypot(points[:, 0], points[:, 1]) - room_m).max())
    assert off_m[0] < 0.002
    assert off_m[1] > 0.03
    supervisor = Supervisor(DIFFBOT)
    x, y, yaw = last
    supervisor.watch(None, Odometry(pose=AT_REST, twist=(0.6, 1.5), stamp_s=0.0), 0.0)
    odometry = Odometry(pose=(x, y, yaw), twist=(0.6, 1.5), stamp_s=0.1)
    supervisor.watch(dataclasses.replace(scan, ranges=ranges), odometry, 0.1)
    points = supervisor._surroundings.seen_from(AT_REST)
    assert np.abs(np.hypot(points[:, 0], points[:, 1]) - room_m).max() < 0.002


def half(stamp_s: float) -> Scan:
    """Of the half plane ahead: a wall about the robot 0.5 m away."""
    scan = a_scan(stamp_s, 0.5, angle_min_rad=-0.5 * math.pi)
    return dataclasses.replace(scan, ranges=scan.ranges[:90])


def test_what_is_no_longer_told_of_is_forgotten_in_time():
    known = surroundings()
    known.take(half(0.0), AT_REST, AT_REST)
    turned: Pose = (0.0, 0.0, math.pi)
    for stamp_s, behind in ((0.1, True), (LASTS_S - 0.1, True), (LASTS_S + 0.1, False)):
        known.take(half(stamp_s), turned, turned)
        known.take(half(stamp_s + 0.01), turned, turned)
        assert (known.seen_from(turned)[:, 0] < -0.2).any() == behind


def test_odometry_that_trembles_does_not_fill_the_memory():
    known, rng = surroundings(), np.random.default_rng(0)
    sizes = []
    for k in range(2000):
        x, y, yaw = rng.normal(0.0, 0.005, 3).tolist()
        known.take(half(0.01 * k), (x, y, yaw), (x, y, yaw))
        sizes.append(len(known.seen_from(AT_REST)))
    assert max(sizes[1000:]) <= max(sizes[:1000]) + 20
    assert max(sizes) < 400
