"""The supervisor: no command out-drives the brakes, whatever stands around; bad sensors stop the robot."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl import _core
from adrl.deploy import Odometry, Scan, Supervisor, SupervisorConfig, Twist
from adrl.errors import ConfigError
from adrl.types import Array, RobotConfig
from adrl.worlds import ROBOTS
from deploy.closed_loop import drive, obstacle_course, rid_of_noise

DIFFBOT = ROBOTS["diffbot"]
seeds = st.integers(0, 2**32 - 1)
robots = st.builds(
    lambda name, noisy, lag_s, latency_s, slower: dataclasses.replace(
        ROBOTS[name] if noisy else rid_of_noise(ROBOTS[name]),
        lag_s=lag_s,
        latency_s=latency_s,
        max_acceleration_mps2=slower * ROBOTS[name].max_acceleration_mps2,
        max_yaw_acceleration_radps2=slower * ROBOTS[name].max_yaw_acceleration_radps2,
    ),
    st.sampled_from(sorted(ROBOTS)),
    st.booleans(),
    st.sampled_from([0.0, 0.05, 0.2]),
    st.sampled_from([0.0, 0.07, 0.1, 0.25]),
    st.sampled_from([0.2, 0.5, 1.0]),
)


def commands(robot: RobotConfig, seed: int, lasting: int):
    """Mostly fast ahead, turning at random; another one every `lasting` steps."""
    table = np.random.default_rng(seed).uniform(-1.0, 1.0, (200, 64, 2))

    def command(step: int, number: int) -> Twist:
        speed, turn = table[step // lasting, number]
        return np.clip(0.8 + speed, 0.0, 1.0) * robot.max_speed_mps, turn * robot.max_yaw_rate_radps

    return command


@pytest.mark.slow
@settings(max_examples=12)
@given(robots, seeds, st.sampled_from([1, 5, 25]), st.sampled_from([0.0, 0.4]))
def test_no_command_leads_to_a_collision(robot: RobotConfig, seed: int, lasting: int, lost: float):
    """Robots that start at rest could always have stopped, so none may ever hit anything, whichever beams are lost."""
    rng = np.random.default_rng(seed)

    def channel(scan: Scan) -> Scan:
        told = rng.random(len(scan.ranges)) >= lost
        return dataclasses.replace(scan, ranges=np.where(told, scan.ranges, math.nan))

    worlds = [
        obstacle_course(np.random.default_rng((seed, i)), robot.circumscribed_radius_m + 0.1)
        for i in range(6)
    ]
    sim, driven_m = drive(robot, worlds, commands(robot, seed, lasting), 60, channel=channel)
    assert not sim.b["collided"].any()
    assert driven_m.mean() > 0.3


def test_what_it_brakes_for_is_told_where_it_stands_and_nothing_else():
    """A wall across the way in the odometry's frame, and one as near beside it; the robot looks along y."""
    supervisor, lidar = Supervisor(DIFFBOT), DIFFBOT.lidar
    angles = lidar.angles_rad
    ahead = np.where(np.abs(angles) < 1.0, 0.35 / np.maximum(np.cos(angles), 0.5), 4.0)
    ranges = np.where(np.abs(angles - 0.5 * math.pi) < 0.4, 0.35, ahead)
    at, now_s = (1.0, 2.0, 0.5 * math.pi), 10.0
    scan = Scan(
        ranges=ranges,
        angle_min_rad=lidar.angle_min_rad,
        angle_increment_rad=lidar.angle_increment_rad,
        range_max_m=lidar.max_range_m,
        stamp_s=now_s,
    )
    odometry = Odometry(pose=at, twist=(0.5, 0.0), stamp_s=now_s)
    assert len(supervisor.braked_for()) == 0
    assert supervisor.watch(scan, odometry, now_s) == ()
    _, reasons = supervisor.limit((DIFFBOT.max_speed_mps, 0.0), now_s)
    assert "obstacle" in reasons
    hits = supervisor.braked_for()
    assert hits[:, 1] == pytest.approx(2.35, abs=0.05)
    assert np.abs(hits[:, 0] - 1.0).max() < DIFFBOT.circumscribed_radius_m + 0.1
    supervisor.stop(now_s)
    assert len(supervisor.braked_for()) == 0


def test_without_the_supervisor_they_collide():
    """So the test above can fail."""

    class Off(Supervisor):
        def limit(self, wanted: Twist, now_s: float):
            return wanted, ()

    worlds = [obstacle_course(np.random.default_rng(i), 0.3) for i in range(6)]
    sim, _ = drive(DIFFBOT, worlds, commands(DIFFBOT, 0, 25), 120, Off)
    assert sim.b["collided"].sum() >= 4


@pytest.mark.slow
@settings(max_examples=12)
@given(robots.filter(lambda robot: robot.latency_s == 0.0), seeds)
def test_who_can_stop_never_collides(robot: RobotConfig, seed: int):
    """Robots that are fast at first: only those collide that would have although they had braked at once."""
    rng = np.random.default_rng(seed)
    worlds = [obstacle_course(rng, robot.circumscribed_radius_m + 0.05) for _ in range(6)]
    speeds = rng.uniform((0.5, -1.0), 1.0, (6, 2)) * (robot.max_speed_mps, robot.max_yaw_rate_radps)
    braked, _ = drive(robot, worlds, lambda *_: (0.0, 0.0), 40, speeds=speeds)
    driven, _ = drive(robot, worlds, commands(robot, seed, 5), 40, speeds=speeds)
    assert not (driven.b["collided"].astype(bool) & ~braked.b["collided"].astype(bool)).any()


# --- the kernel --------------------------------------------------------------------------------------------


def slow_clearances(
    robot: RobotConfig, twist: Twist, orders: Array, points: Array, step_m: float = 1e-3
) -> Array:
    """(P, M) distance from the footprint to points, as the orders and then braking are driven in small steps."""
    dt_s = robot.control_period_s
    response = -math.expm1(-dt_s / robot.lag_s) if robot.lag_s > 0.0 else 1.0
    limits = np.array([robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2]) * dt_s
    now, pose, rows = np.array(twist), np.zeros((1, 3)), []
    whole = [(v, w) for v, w, seconds in orders for _ in range(round(seconds / dt_s))]
    for command in [*whole, *[(0.0, 0.0)] * 200]:
        following = now + np.clip(response * (np.array(command) - now), -limits, limits)
        mean = 0.5 * (now + following)
        pieces = 1 + int(np.abs(mean).sum() * dt_s / step_m)
        for k in range(1, pieces + 1):
            at = _core.integrate(pose, mean[None], dt_s * k / pieces)[0]
            rows.append([distance(robot, at, p) for p in points])
        pose, now = _core.integrate(pose, mean[None], dt_s), following
        if np.abs(now).max() < 1e-3 and len(rows) > len(whole):
            break
    return np.array(rows)


def distance(robot: RobotConfig, pose: Array, point: Array) -> float:
    """From the footprint to a small disc about the point; by the simulator's own collision code."""
    dot = np.array([[*point, 1e-9]])
    world = _core.World(
        dot, np.empty((0, 2)), np.zeros(1, np.int32), np.empty((0, 4)), np.empty((0, 8)),
        np.empty((0, 0), np.uint8), 1.0, (0.0, 0.0, 0.0),
    )  # fmt: skip
    return float(_core.clearance(world, pose[None], robot.radius_m or 0.0, robot.polygon, 5.0)[0])


@settings(max_examples=40)
@given(st.sampled_from(["diffbot", "jackal"]), seeds, st.floats(0.0, 0.1), st.sampled_from([0.0, 0.1]))
def test_staying_clear_against_a_slow_twin(name: str, seed: int, margin_m: float, lag_s: float):
    """What is let through keeps its distance, or does not come nearer; what keeps more is let through."""
    robot = dataclasses.replace(ROBOTS[name], lag_s=lag_s)
    rng = np.random.default_rng(seed)
    low, high = (0.0, -robot.max_yaw_rate_radps), (robot.max_speed_mps, robot.max_yaw_rate_radps)
    twist, command = rng.uniform(low, high), rng.uniform(low, high)
    angle, reach = rng.uniform(-np.pi, np.pi, 3), robot.circumscribed_radius_m + rng.uniform(0.0, 0.8, 3)
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
    orders = np.array([[*command, 2.0 * robot.control_period_s]])
    response = (robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2, lag_s)
    base = _core.Braking(robot.radius_m or 0.0, robot.polygon, response, robot.control_period_s)
    hits = np.column_stack([points, np.full(3, margin_m)])
    start = np.array([distance(robot, np.zeros(3), p) for p in points])
    least = slow_clearances(robot, (twist[0], twist[1]), orders, points).min(axis=0)
    if base.stays_clear((twist[0], twist[1]), orders, hits, np.empty((0, 6))):
        assert (least >= np.minimum(margin_m, start - 0.005) - 1e-5).all()
    else:
        assert (least < np.minimum(margin_m + 0.01, start + 1e-5)).any()


def test_rolling_is_how_the_simulator_moves():
    robot = dataclasses.replace(rid_of_noise(DIFFBOT), latency_s=0.0)
    told = commands(robot, 3, 1)
    worlds = [obstacle_course(np.random.default_rng(0), 2.0)]
    sim, _ = drive(
        robot, worlds, told, 5, make=lambda robot: Supervisor(robot, SupervisorConfig(margin_m=0.0))
    )
    response = (robot.max_acceleration_mps2, robot.max_yaw_acceleration_radps2, robot.lag_s)
    base = _core.Braking(0.2, robot.polygon, response, 0.1)
    # Limited by acceleration or not, the base makes the same of a command.
    orders = np.array([[*told(k, 0), 0.1] for k in range(5)])
    pose, twist = base.roll((0.0, 0.0, 0.0), (0.0, 0.0), orders)
    np.testing.assert_allclose(pose, sim.b["pose"][0], atol=1e-9)
    np.testing.assert_allclose(twist, sim.b["twist"][0], atol=1e-9)


# --- sensors ------------------------------------------------------------------------------------------------


def corridor(stamp_s: float) -> Array:
    """(K,) ranges in a corridor, 3 m wide, which looks the same all along; yet no two scans are the same."""
    across = np.maximum(np.abs(np.sin(np.linspace(-math.pi, math.pi, 180, endpoint=False))), 1e-9)
    return np.minimum(1.5 / across, 6.0) + 1e-3 * math.sin(stamp_s)


def a_scan(stamp_s: float, ranges: Array | None = None, **changes: Any) -> Scan:
    beams = 180
    fields = dict(
        ranges=corridor(stamp_s) if ranges is None else ranges,
        angle_min_rad=-math.pi,
        angle_increment_rad=2.0 * math.pi / beams,
        range_min_m=0.1,
        range_max_m=6.0,
        stamp_s=stamp_s,
    )
    return Scan(**(fields | changes))  # pyright: ignore


def an_odometry(stamp_s: float, x_m: float | None = None, twist: Twist = (0.5, 0.0)) -> Odometry:
    return Odometry(pose=(0.5 * stamp_s if x_m is None else x_m, 0.0, 0.0), twist=twist, stamp_s=stamp_s)


def under_way(supervisor: Supervisor, periods: int = 10) -> float:
    """Drive straight ahead for some periods; returns when the next one begins."""
    for k in range(periods):
        now_s = 0.1 * k
        assert supervisor.watch(a_scan(now_s), an_odometry(now_s), now_s) == ()
        supervisor.limit((0.5, 0.0), now_s)
    return 0.1 * periods


NOTHING = np.full(180, np.nan)
HOLE = np.where(np.arange(180) < 30, np.nan, corridor(0.0))
HOLE_BEHIND = np.where(np.abs(np.arange(180) - 90) > 75, np.nan, corridor(0.0))
FEW = np.where(np.arange(180) % 4 == 0, corridor(0.0), np.nan)


@pytest.mark.parametrize(("turns_hz", "stale"), [(5.5, False), (7.0, False), (10.0, False), (4.0, True)])
def test_a_lidar_that_turns_slower_than_the_robot_decides_is_stale_when_its_last_beam_is(
    turns_hz: float, stale: bool
):
    """Scans stamped by their first beam come at the end of their turn; a period is 0.1 s, two are the limit."""
    supervisor, turn_s, begins_s, faults = Supervisor(DIFFBOT), 1.0 / turns_hz, 0.0, []
    for k in range(10, 100):
        now_s, scan = 0.1 * k, None
        while begins_s + turn_s <= now_s:
            scan = a_scan(begins_s, time_increment_s=turn_s / 180)
            begins_s += turn_s
        faults += supervisor.watch(scan, an_odometry(now_s), now_s)
    assert set(faults) == ({"scan_stale"} if stale else set())


def test_a_scan_stamped_at_its_end_grows_old_as_soon_as_any():
    supervisor = Supervisor(DIFFBOT)
    assert supervisor.watch(a_scan(1.0, time_increment_s=0.15 / 179), an_odometry(1.0), 1.0) == ()
    assert "scan_stale" in supervisor.watch(None, an_odometry(1.3), 1.3)


def test_a_pose_of_whole_numbers_is_one():
    supervisor = Supervisor(DIFFBOT)
    whole = Odometry(pose=(0, 0, 0), twist=(0, 0), stamp_s=1.0)
    assert supervisor.watch(a_scan(0.95), whole, 1.0) == ()


@pytest.mark.parametrize(
    ("reason", "change"),
    [
        ("scan_invalid", {"ranges": NOTHING}),
        ("scan_invalid", {"ranges": np.full(180, 0.05)}),
        ("scan_invalid", {"ranges": np.empty(0)}),
        ("scan_invalid", {"angle_min_rad": math.nan}),
        ("scan_invalid", {"angle_increment_rad": 0.0}),
        ("scan_invalid", {"angle_increment_rad": 4.0 * math.pi / 180}),
        ("scan_sparse", {"ranges": HOLE}),
        ("scan_sparse", {"ranges": HOLE_BEHIND}),
        ("scan_sparse", {"ranges": FEW}),
        ("clock_jumped", {"stamp_s": 1e4}),
    ],
)
def test_a_bad_scan_stops_at_once(reason: str, change: dict[str, Any]):
    supervisor = Supervisor(DIFFBOT)
    now_s = under_way(supervisor)
    other = {name: value for name, value in change.items() if name != "stamp_s"}
    assert reason in supervisor.watch(
        a_scan(change.get("stamp_s", now_s), **other), an_odometry(now_s), now_s
    )
    assert supervisor.watch(a_scan(now_s + 0.1), an_odometry(now_s + 0.1), now_s + 0.1) == ()


@pytest.mark.parametrize(
    ("reason", "odometry"),
    [
        ("odometry_invalid", an_odometry(1.0, x_m=math.nan)),
        ("odometry_invalid", an_odometry(1.0, twist=(math.inf, 0.0))),
        ("odometry_invalid", an_odometry(1.0, twist=(9.0, 0.0))),
        ("odometry_jumped", an_odometry(1.0, x_m=3.0)),
        ("odometry_frozen", an_odometry(1.0, x_m=0.45)),
        ("clock_jumped", an_odometry(1e4)),
    ],
)
def test_bad_odometry_stops_at_once(reason: str, odometry: Odometry):
    supervisor = Supervisor(DIFFBOT)
    assert under_way(supervisor) == 1.0
    assert reason in supervisor.watch(a_scan(1.0), odometry, 1.0)


@pytest.mark.parametrize("missing", ["scan", "odometry"])
def test_what_is_older_than_two_periods_stops(missing: str):
    supervisor = Supervisor(DIFFBOT)
    start_s = under_way(supervisor)
    reasons = []
    for k in range(4):
        now_s = start_s + 0.1 * k
        scan = None if missing == "scan" else a_scan(now_s)
        odometry = None if missing == "odometry" else an_odometry(now_s)
        reasons.append(supervisor.watch(scan, odometry, now_s))
    assert reasons == [(), (), (f"{missing}_stale",), (f"{missing}_stale",)]


def test_a_scan_that_stands_still_while_the_robot_drives_is_frozen():
    supervisor = Supervisor(DIFFBOT)
    frozen = a_scan(0.0).ranges
    faults = [supervisor.watch(a_scan(0.1 * k, frozen), an_odometry(0.1 * k), 0.1 * k) for k in range(5)]
    assert faults == [(), (), (), ("scan_frozen",), ("scan_frozen",)]
    assert supervisor.watch(a_scan(0.5), an_odometry(0.5), 0.5) == ()


def test_a_scan_that_comes_twice_with_a_new_stamp_is_old_the_second_time():
    supervisor = Supervisor(DIFFBOT)
    for k in range(30):
        seen = corridor(0.1 * (k - k % 2))
        assert supervisor.watch(a_scan(0.1 * k, seen), an_odometry(0.1 * k), 0.1 * k) == ()
        assert supervisor.newest()[0].stamp_s == pytest.approx(0.1 * (k - k % 2))


def test_nothing_in_reach_is_not_frozen():
    supervisor = Supervisor(DIFFBOT)
    for k in range(5):
        scan = a_scan(0.1 * k, np.full(180, np.inf))
        assert supervisor.watch(scan, an_odometry(0.1 * k), 0.1 * k) == ()


def test_a_base_that_does_not_move_is_not_driven_for_ever_and_is_tried_again():
    """Stuck, or its odometry frozen: stop, and try anew after a second."""
    supervisor = Supervisor(DIFFBOT)
    sent = []
    for k in range(60):
        now_s = 0.1 * k
        faults = supervisor.watch(a_scan(now_s), an_odometry(now_s, x_m=0.0, twist=(0.0, 0.0)), now_s)
        twist, _ = supervisor.stop(now_s, faults) if faults else supervisor.limit((0.5, 0.0), now_s)
        sent.append(twist[0] > 0.0)
    assert 0.1 < np.mean(sent) < 0.6
    assert any(sent[-20:])


@pytest.mark.parametrize("said", [lambda yaw: 0.0, lambda yaw: -0.4, lambda yaw: 0.4 * math.cos(yaw)])
@pytest.mark.parametrize("yaw_rad", [2.0, -1.7, 3.0])
def test_poses_decide_what_the_robot_does(said: Callable[[float], float], yaw_rad: float):
    """It drives 0.4 m/s along its heading; the twist is 0, reversed, or one of the odometry's frame. It is told, and
    the robot may go on as fast as it goes."""
    supervisor, odd, twist = Supervisor(DIFFBOT), [], (0.0, 0.0)
    for k in range(20):
        now_s = 0.1 * k
        x, y = 0.04 * k * math.cos(yaw_rad), 0.04 * k * math.sin(yaw_rad)
        odometry = Odometry(pose=(x, y, yaw_rad), twist=(said(yaw_rad), 0.0), stamp_s=now_s)
        assert supervisor.watch(a_scan(now_s), odometry, now_s) == ()
        twist, reasons = supervisor.limit((0.4, 0.0), now_s)
        odd.append("odometry_contradicts" in reasons)
    assert all(odd[10:])
    assert twist == pytest.approx((0.4, 0.0))
    assert supervisor.newest()[1].twist == pytest.approx((0.4, 0.0))


def test_a_twist_that_is_right_contradicts_nothing():
    """Nor one that is noisy, or of odometry that drifts, stands and turns."""
    rng, supervisor = np.random.default_rng(0), Supervisor(DIFFBOT)
    pose = np.zeros((1, 3))
    for k in range(300):
        v, w = 0.25 + 0.25 * math.sin(0.05 * k), math.sin(0.1 * k)
        noisy = Odometry(pose=tuple(pose[0].tolist()), twist=(v + rng.normal(0.0, 0.05), w), stamp_s=0.1 * k)
        supervisor.watch(None, noisy, 0.1 * k)
        assert "odometry_contradicts" not in supervisor.cautions
        pose = _core.integrate(pose, np.array([[1.05 * v, 0.95 * w]]), 0.1)


@pytest.mark.parametrize("lost", [0.1, 0.3, 0.5])
def test_a_message_that_is_lost_contradicts_nothing(lost: float):
    """A policy turns to and fro, from one period to the next: of two messages around a lost one both say the same."""
    rng, supervisor = np.random.default_rng(3), Supervisor(DIFFBOT)
    pose = np.zeros((1, 3))
    for k in range(600):
        twist, following = ((0.4, 0.6 if step % 2 else -0.6) for step in (k, k + 1))
        if rng.random() >= lost:
            odometry = Odometry(pose=tuple(pose[0].tolist()), twist=twist, stamp_s=0.1 * k)
            supervisor.watch(None, odometry, 0.1 * k)
        assert "odometry_contradicts" not in supervisor.cautions
        pose = _core.integrate(pose, np.array([np.mean([twist, following], axis=0)]), 0.1)


def test_a_base_that_another_drove_is_taken_over_as_if_it_had_been_ours():
    """What it is about to do follows from how it moves, not from who told it to."""

    def at_a_wall(before: Callable[[Supervisor, float], object], wall_m: float) -> tuple[Twist, Any]:
        supervisor = Supervisor(dataclasses.replace(DIFFBOT, latency_s=0.25))
        for k in range(10):
            now_s = 0.1 * k
            assert supervisor.watch(a_scan(now_s), an_odometry(now_s), now_s) == ()
            before(supervisor, now_s)
        assert supervisor.watch(a_scan(1.0, np.full(180, wall_m)), an_odometry(1.0), 1.0) == ()
        return supervisor.limit((0.5, 0.0), 1.0)

    for wall_m in np.linspace(0.3, 1.0, 36):
        ours = at_a_wall(lambda supervisor, now_s: supervisor.limit((0.5, 0.0), now_s), wall_m)
        assert at_a_wall(Supervisor.stand_by, wall_m) == ours


def test_scans_that_were_overtaken_are_passed_over():
    supervisor = Supervisor(DIFFBOT)
    now_s = under_way(supervisor)
    wall = np.full(180, 0.25)
    assert supervisor.watch(a_scan(now_s), an_odometry(now_s), now_s) == ()
    assert supervisor.watch(a_scan(now_s - 0.05, wall), an_odometry(now_s + 0.1), now_s + 0.1) == ()
    assert supervisor.newest()[0].stamp_s == now_s


@pytest.mark.parametrize("back_s", [0.3, 1e6])
def test_a_clock_that_goes_back_stops_once(back_s: float):
    supervisor = Supervisor(DIFFBOT)
    now_s = under_way(supervisor) - back_s
    assert "clock_jumped" in supervisor.watch(None, None, now_s)
    after_s = now_s + 0.1
    assert supervisor.watch(a_scan(after_s), an_odometry(after_s, x_m=0.0), after_s) == ()
    assert supervisor.limit((0.5, 0.0), after_s)[0][0] > 0.0


@pytest.mark.parametrize("wanted", [(math.nan, 0.0), (0.1, math.inf)])
def test_a_command_that_is_no_number_stops(wanted: Twist):
    supervisor = Supervisor(DIFFBOT)
    under_way(supervisor)
    assert supervisor.limit(wanted, 1.0) == ((0.0, 0.0), ("command_invalid",))


@given(st.floats(-5.0, 5.0), st.floats(-9.0, 9.0), st.floats(0.0, 0.6), st.floats(-1.5, 1.5))
def test_commands_stay_within_the_limits(v: float, w: float, speed: float, yaw_rate: float):
    """Speeds are the robot's; what the base makes of it in a period is within its accelerations."""
    supervisor = Supervisor(DIFFBOT)
    odometry = Odometry(pose=(0.0, 0.0, 0.0), twist=(speed, yaw_rate), stamp_s=0.0)
    supervisor.watch(a_scan(0.0), odometry, 0.0)
    twist, reasons = supervisor.limit((v, w), 0.0)
    assert 0.0 <= twist[0] <= 0.6
    assert abs(twist[1]) <= 1.5
    share = -math.expm1(-0.1 / DIFFBOT.lag_s)
    assert abs(twist[0] - speed) * share <= 0.2 + 1e-9
    assert abs(twist[1] - yaw_rate) * share <= 0.6 + 1e-9
    assert ("limited" in reasons) == (math.dist(twist, (v, w)) > 1e-6)


def test_reverse_needs_eyes_behind():
    robot = dataclasses.replace(DIFFBOT, min_speed_mps=-0.3)
    supervisor = Supervisor(robot)
    half = a_scan(0.0, np.full(90, 3.0), angle_min_rad=-0.5 * math.pi)
    supervisor.watch(half, an_odometry(0.0, twist=(0.0, 0.0)), 0.0)
    assert supervisor.limit((-0.2, 0.0), 0.0) == ((0.0, 0.0), ("unseen",))
    around = Supervisor(robot)
    around.watch(a_scan(0.0), an_odometry(0.0, twist=(0.0, 0.0)), 0.0)
    assert around.limit((-0.2, 0.0), 0.0)[0][0] == -0.2
    # Behind, the LiDAR sees nothing but the robot's own body.
    body = np.where(np.abs(np.arange(180) - 90) > 60, 0.15, 3.0)
    supervisor = Supervisor(robot)
    supervisor.watch(a_scan(0.0, body), an_odometry(0.0, twist=(0.0, 0.0)), 0.0)
    assert supervisor.limit((-0.2, 0.0), 0.0) == ((0.0, 0.0), ("unseen",))


@pytest.mark.parametrize(("yaw_rad", "reasons"), [(0.0, ()), (math.pi, ("unseen",))])
def test_driving_ahead_needs_eyes_there(yaw_rad: float, reasons: tuple[str, ...]):
    supervisor = Supervisor(DIFFBOT, mount=(0.0, 0.0, yaw_rad))
    half = a_scan(0.0, np.full(90, 3.0), angle_min_rad=-0.5 * math.pi)
    supervisor.watch(half, an_odometry(0.0, twist=(0.0, 0.0)), 0.0)
    assert supervisor.limit((0.2, 0.0), 0.0) == ((0.0 if reasons else 0.2, 0.0), reasons)


def test_what_stops_it_is_logged_once(caplog: pytest.LogCaptureFixture):
    supervisor = Supervisor(DIFFBOT)
    for k in range(4):
        faults = supervisor.watch(None, None, 0.1 * k)
        supervisor.stop(0.1 * k, faults)
    assert [record.getMessage() for record in caplog.records] == ["held: no_scan, no_odometry"]
    assert caplog.records[0].levelname == "WARNING"


@pytest.mark.parametrize("name", ["max_age_periods", "hold_periods", "margin_m", "least_told"])
def test_settings_have_a_domain(name: str):
    for value in (-1.0, math.nan, math.inf):
        with pytest.raises(ConfigError, match=name):
            SupervisorConfig(**{name: value})
