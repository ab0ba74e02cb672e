"""Localisation tells where the goal is, over and over and never twice the same. What the robot has seen stays."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.deploy import Navigator, Odometry, Pose
from adrl.deploy.driver import Driver
from adrl.deploy.guidance import OwnMapGuide
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.evaluation.supervised import as_scan
from adrl.geometry import compose
from adrl.planning.replanner import Replanner
from adrl.types import World
from adrl.worlds import single_task
from deploy.driver_loop import PERIOD_S, ROBOT, START, Loop, in_odom
from deploy.recorded import Moment, a_policy, record
from env_tasks import room

TRAP = ((0.0, -2.0, 0.0, 2.0), (-1.5, -2.0, 0.0, -2.0), (-1.5, 2.0, 0.0, 2.0))
"""A bay open to the left, between START and GOAL."""
GOAL = (3.0, -1.0)


def trap() -> World:
    return room(segments=TRAP)


def noisy(seed: int, yaw_deg: float, place_m: float, rate_hz: float) -> Callable[[Pose], list[Pose]]:
    """Poses of a localisation at a rate."""
    rng, due = np.random.default_rng(seed), [0.0]

    def poses(true: Pose) -> list[Pose]:
        due[0] += rate_hz * PERIOD_S
        count, due[0] = int(due[0] + 1e-9), due[0] % 1.0
        std = (place_m, place_m, math.radians(yaw_deg))
        return [tuple((np.array(true) + rng.normal(0.0, std)).tolist()) for _ in range(count)]  # pyright: ignore

    return poses


@pytest.fixture(scope="module")
def drive() -> list[Moment]:
    """Out of the trap: guidance replan in the simulator."""
    sim = NavSim(1, ROBOT, guidance="replan")
    return record(sim, a_policy(ROBOT), single_task(trap(), START, GOAL, ROBOT), 120)


def seen(driver: Driver) -> Replanner:
    guide = driver.navigator.guide
    assert isinstance(guide, OwnMapGuide)
    return guide.replanner


def followed(
    drive: list[Moment],
    poses: Callable[[Pose], list[Pose]],
    goal_again: Callable[[int], bool] = lambda k: k == 0,
) -> Driver:
    """A driver after these scans and odometry."""
    driver = Driver(Navigator(a_policy(ROBOT), guidance="replan"))
    for k, moment in enumerate(drive):
        now_s = k * PERIOD_S
        driver.take_odometry(moment.odometry)
        for pose in poses(moment.map_pose) or ([moment.map_pose] if k == 0 else []):
            driver.take_pose(pose, "map", now_s)
        if goal_again(k):
            driver.set_goal(GOAL, "map")
        driver.take_scan(moment.scan, now_s)
    return driver


def own_map(driver: Driver) -> tuple[bytes, ...]:
    """What it has seen, and where."""
    return tuple(
        seen(driver).b[name].tobytes() for name in ("log_odds", "origin", "parity", "places", "clearances")
    )


@given(
    seed=st.integers(0, 99),
    yaw_deg=st.floats(0.0, 3.0),
    place_m=st.floats(0.0, 0.2),
    rate_hz=st.sampled_from([1.0, 10.0, 50.0]),
)
@settings(max_examples=12, deadline=None)
def test_what_was_seen_does_not_depend_on_localisation(
    drive: list[Moment], seed: int, yaw_deg: float, place_m: float, rate_hz: float
) -> None:
    exact = followed(drive, lambda pose: [pose])
    other = followed(drive, noisy(seed, yaw_deg, place_m, rate_hz))
    assert own_map(other) == own_map(exact)
    assert seen(other).following[0] == seen(exact).following[0]


def test_a_goal_given_again_and_again_keeps_route_and_map(drive: list[Moment]) -> None:
    """As one that follows a person publishes it."""
    once = followed(drive[:60], lambda pose: [pose])
    often = followed(drive[:60], lambda pose: [pose], goal_again=lambda k: True)
    assert seen(once).following[0]
    assert own_map(often) == own_map(once)
    assert seen(often).waypoints.tobytes() == seen(once).waypoints.tobytes()


def test_a_robot_that_is_held_maps_every_scan_all_the_same() -> None:
    """Its base is stuck, and half a degree of noise comes with each scan."""
    driver = Driver(Navigator(a_policy(ROBOT), guidance="replan"))
    parities, reasons = [], set()
    for k in range(50):
        now_s = 0.1 * k
        driver.take_odometry(Odometry(pose=(0.0, 0.0, 0.0), twist=(0.0, 0.0), stamp_s=now_s))
        driver.take_pose((0.0, 0.0, math.radians(0.5) * (-1) ** k), "map", now_s)
        if k == 0:
            driver.set_goal((20.0, 0.0), "map")
        report = driver.take_scan(as_scan(np.full(180, 4.0, np.float32), ROBOT.lidar, now_s), now_s)
        assert report is not None
        reasons.update(report.command.reasons)
        parities.append(int(seen(driver).b["parity"][0]))  # it changes with each scan that is entered
    assert "odometry_frozen" in reasons
    assert parities == [1, 0] * 25


def test_after_odometry_has_jumped_nothing_is_left_of_the_map_in_its_old_frame() -> None:
    loop = Loop("replan", trap()).run(2, localised=True)
    loop.driver.set_goal(GOAL, "map")
    loop.run(30, localised=True)
    jumped = lambda o: dataclasses.replace(o, pose=compose((4.0, 1.0, 2.0), o.pose))  # noqa: E731
    assert loop.until_ended(localised=True, odometry=jumped).outcome == "reached"
    assert loop.distance_m(GOAL) < 0.35
    assert loop.base.collisions == 0


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 50.0])
@pytest.mark.parametrize(
    ("guidance", "frame"), [("replan", "map"), ("goal", "map"), ("map", "map"), ("map", "odom")]
)
def test_goals_are_reached_whatever_the_rate(guidance: str, frame: str, rate_hz: float) -> None:
    """Half a degree and 5 cm; the guidances that know of obstacles get out of the trap."""
    world = room() if guidance == "goal" else trap()
    ends = []
    for seed in range(3):
        loop = Loop(guidance, world, known=world).run(2, localised=True)
        loop.driver.set_goal(GOAL if frame == "map" else in_odom(GOAL), frame)
        poses = noisy(seed, 0.5, 0.05, rate_hz)
        report = loop.until_ended(600, localised=True, poses=poses)
        ends.append((report.outcome, loop.base.collisions, loop.distance_m(GOAL) < 0.5))
    assert ends == [("reached", 0, True)] * 3


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 50.0])
def test_a_goal_that_noise_puts_into_a_wall_is_not_failed(rate_hz: float) -> None:
    """In the odometry's frame, with a known map, as near to the wall as a goal may be."""
    loop = Loop("map").run(2, localised=True)
    beside = (5.99 - ROBOT.circumscribed_radius_m - 0.07, 0.0)
    loop.driver.set_goal(in_odom(beside), "odom")
    report = loop.until_ended(600, localised=True, poses=noisy(0, 1.0, 0.05, rate_hz))
    assert (report.outcome, loop.base.collisions) == ("reached", 0)
    assert loop.distance_m(beside) < 0.5


def test_a_goal_that_localisation_finds_elsewhere_is_driven_to_there() -> None:
    """At first it is 2 m and 0.5 rad wrong: that is no noise."""
    for guidance, frame in (("replan", "map"), ("map", "odom")):
        loop = Loop(guidance).run(2)
        loop.driver.take_pose(compose(loop.base.pose, (2.0, 0.0, 0.5)), "map", loop.base.time_s - PERIOD_S)
        loop.driver.set_goal(GOAL if frame == "map" else in_odom(GOAL), frame)
        loop.run(15)
        assert loop.until_ended(localised=True).outcome == "reached"
        assert loop.distance_m(GOAL) < 0.35


def test_a_goal_is_moved_only_where_there_is_one() -> None:
    navigator = Navigator(a_policy(ROBOT), guidance="goal")
    navigator.move_goal((1.0, 0.0))
    assert navigator.goal is None
    with pytest.raises(ConfigError, match="not finite"):
        navigator.set_goal((math.nan, 0.0))
