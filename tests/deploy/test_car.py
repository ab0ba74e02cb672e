"""A car behind its supervisor: braked on arcs that it can steer, helped without turning on the spot."""

import dataclasses
import logging
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl import _core
from adrl.deploy import Navigator, Supervisor, Twist
from adrl.deploy.given_path import GivenPathGuide
from adrl.deploy.guidance import View
from adrl.deploy.recovery import MOST_TRIES, Recovery
from adrl.planning.replanner import Replanner
from adrl.types import RobotConfig, World
from deploy.closed_loop import drive, obstacle_course, rid_of_noise
from deploy.recorded import a_policy
from deploy.test_recovery import WALL_AHEAD, standing_in

CAR = rid_of_noise(
    RobotConfig(name="car", min_speed_mps=-0.4, max_speed_mps=0.8, min_turning_radius_m=0.6, latency_s=0.1)
)
seeds = st.integers(0, 2**32 - 1)


def commands(seed: int, lasting: int = 5):
    """Anything, much of which no car can steer."""
    table = np.random.default_rng(seed).uniform((-0.5, -2.0), (0.9, 2.0), (200, 64, 2))

    def command(step: int, number: int) -> Twist:
        speed, turn = table[step // lasting, number].tolist()
        return speed, turn

    return command


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(seeds, st.sampled_from([0.3, 0.6, 1.5]), st.sampled_from([0.0, 0.1, 0.25]))
def test_no_command_leads_to_a_collision_and_all_can_be_steered(seed: int, radius_m: float, latency_s: float):
    car = dataclasses.replace(CAR, min_turning_radius_m=radius_m, latency_s=latency_s)
    told: list[Twist] = []

    class Listening(Supervisor):
        def limit(self, wanted: Twist, now_s: float):
            twist, reasons = super().limit(wanted, now_s)
            told.append(twist)
            return twist, reasons

    worlds = [obstacle_course(np.random.default_rng((seed, i)), 0.4) for i in range(4)]
    sim, driven_m = drive(car, worlds, commands(seed), 60, Listening)
    assert not sim.b["collided"].any()
    assert driven_m.mean() > 0.2
    v, w = np.abs(np.array(told)).T
    assert (w * radius_m <= v + 1e-9).all()


def test_rolling_is_how_the_simulator_moves_a_car():
    car, sent = dataclasses.replace(CAR, latency_s=0.0), []

    class Listening(Supervisor):
        def limit(self, wanted: Twist, now_s: float):
            twist, reasons = super().limit(wanted, now_s)
            sent.append((*twist, 0.1))
            return twist, reasons

    sim, _ = drive(car, [World(bounds=(-9.0, -9.0, 9.0, 9.0))], commands(3, 1), 20, Listening)
    response = (car.max_acceleration_mps2, car.max_yaw_acceleration_radps2, car.lag_s)
    base = _core.Braking(0.2, car.polygon, response, 0.1, car.min_turning_radius_m)
    pose, twist = base.roll((0.0, 0.0, 0.0), (0.0, 0.0), np.array(sent))
    np.testing.assert_allclose(pose, sim.b["pose"][0], atol=1e-9)
    np.testing.assert_allclose(twist, sim.b["twist"][0], atol=1e-9)


def test_a_car_is_slowed_on_its_curve():
    """Before a wall half as fast is half the yaw rate, too: it would brake on the way that was asked for."""
    wall = World(bounds=(-3.0, -3.0, 3.0, 3.0), segments=np.array([[0.245, -3.0, 0.245, 3.0]]))
    supervisor = standing_in(wall, dataclasses.replace(CAR, lag_s=0.0, latency_s=0.0))
    wanted = (0.2, 0.2)
    twist, reasons = supervisor.limit(wanted, 0.0)
    assert "obstacle" in reasons
    assert 0.0 < twist[0] < wanted[0]
    assert twist[1] == pytest.approx(twist[0] * wanted[1] / wanted[0])


def arcs(recovery: Recovery, bearing_rad: float, tries: int) -> list[Twist]:
    """What is asked for at the beginnings of so many tries, of a robot that does not move at all."""
    found, now_s = [], 0.0
    for _ in range(tries):
        while (helped := recovery.twist(bearing_rad, now_s)) is None:
            recovery.watch(now_s)
            now_s += 0.1
            assert now_s < 1e3
        found.append(helped)
        while recovery.twist(bearing_rad, now_s) is not None:
            now_s += 0.1
    return found


@pytest.mark.parametrize("bearing_rad", [0.6, -0.6])
def test_a_stuck_car_backs_and_turns_its_nose_to_the_waypoint(bearing_rad: float):
    first, *others = arcs(Recovery(standing_in(WALL_AHEAD, CAR)), bearing_rad, MOST_TRIES)
    assert first[0] < 0.0
    assert first[1] * bearing_rad > 0.0
    for speed, yaw_rate in (first, *others):
        assert abs(yaw_rate) * CAR.min_turning_radius_m <= abs(speed) + 1e-12
        assert speed < 0.0  # the wall is ahead


def test_what_lies_behind_is_got_to_by_driving_on_first():
    open_world = World(bounds=(-3.0, -3.0, 3.0, 3.0), segments=np.array([[-0.3, -3.0, -0.3, 3.0]]))
    assert arcs(Recovery(standing_in(open_world, CAR)), 3.0, 1)[0][0] > 0.0


def test_a_car_that_cannot_back_is_helped_forward_or_not_at_all():
    ahead_only = dataclasses.replace(CAR, min_speed_mps=0.0)
    recovery, now_s = Recovery(standing_in(WALL_AHEAD, ahead_only)), 0.0
    for _ in range(100):
        assert recovery.twist(0.0, now_s) is None
        recovery.watch(now_s)
        now_s += 0.1


def test_a_goals_heading_is_left_out_and_told(caplog: pytest.LogCaptureFixture):
    navigator = Navigator(a_policy(CAR), robot=CAR, guidance="goal")
    with caplog.at_level(logging.WARNING, "adrl.deploy"):
        navigator.set_goal((2.0, 0.0), yaw_rad=1.0)
    assert "robot car cannot turn on the spot: the goal's heading is left out" in caplog.text


def test_a_stuck_car_gets_away_in_the_closed_loop():
    """It wants straight on, before a wall; helped, it backs out in arcs and touches nothing."""
    supervised: list[tuple[Supervisor, Recovery]] = []

    def make(robot: RobotConfig) -> Supervisor:
        supervisor = Supervisor(robot)
        supervised.append((supervisor, Recovery(supervisor)))
        return supervisor

    def command(step: int, number: int) -> Twist:
        recovery, now_s = supervised[number][1], step * CAR.control_period_s
        recovery.watch(now_s)
        return recovery.twist(math.pi / 4, now_s) or (0.5, 0.0)

    walls = World(bounds=(-3.0, -3.0, 3.0, 3.0), segments=np.array([[0.5, -3.0, 0.5, 3.0]]))
    sim, driven_m = drive(CAR, [walls], command, 250, make)
    assert not sim.b["collided"].any()
    assert driven_m[0] > 1.0


def test_the_path_of_another_planner_is_followed_from_cusp_to_cusp():
    """As those of Nav2's Smac planners, which turn back."""
    forward = [(x, 0.0) for x in np.linspace(0.0, 2.0, 21)]
    back = [(2.0 - 0.8 * math.sin(a), 0.8 - 0.8 * math.cos(a)) for a in np.linspace(0.0, 1.5, 16)[1:]]
    guide = GivenPathGuide(Replanner(1, CAR), car=True)
    guide.set_goal(np.array([*forward, *back]))
    ranges = np.full((1, CAR.lidar.num_beams), CAR.lidar.max_range_m, np.float32)

    def waypoint(x: float, y: float) -> tuple[float, float]:
        view = View(ranges=ranges, reckoned=np.array([[x, y, 0.0]]), place=(x, y, 0.0), now_s=0.0)
        return guide.head_for(view, back[-1]).waypoint

    assert waypoint(0.0, 0.0) == pytest.approx((1.5, 0.0))
    for x in (1.0, 1.6, 1.9):
        assert waypoint(x, 0.0) == pytest.approx((2.0, 0.0))
    assert waypoint(1.98, 0.0)[0] < 1.5
    assert waypoint(2.2, 0.0)[0] < 1.5  # it has passed it
    assert waypoint(1.9, 0.01)[0] < 1.5  # and is not led back to it
