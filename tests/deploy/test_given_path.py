"""A path of another planner leads; what it does not know of is driven round, near the path."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from adrl.deploy import Navigator
from adrl.deploy.driver import Report
from adrl.deploy.given_path import BLIND_PART, GivenPathGuide
from adrl.deploy.guidance import View
from adrl.errors import BadGoal, ConfigError
from adrl.planning.path_guide import LOOKAHEAD_M
from adrl.planning.replanner import Replanner
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import Array
from adrl.worlds import ROBOTS, get_scenario, task_set
from deploy.path_drives import ROBOT, PathDrive
from env_tasks import room

BEND = np.array([(-4.0, -3.0), (0.0, -3.0), (0.0, 3.0), (4.0, 3.0)])
"""Not the shortest way in an empty room, but that which was planned."""


def after(steps: int, driving: Iterator[Report]) -> Report:
    """The last of so many control periods."""
    return list(itertools.islice(driving, steps))[-1]


def test_the_robot_drives_along_the_path_and_not_straight_at_its_end() -> None:
    drive = PathDrive(room(), (-4.0, -3.0, 0.0))
    report = drive.follow(BEND)
    assert (report.outcome, drive.base.collisions) == ("reached", 0)
    assert math.dist(drive.base.pose[:2], BEND[-1]) < 0.4
    assert drive.off_m(BEND) < 0.6
    left = [r.command.distance_m for r in drive.reports if r.command.distance_m is not None]
    assert left[0] == pytest.approx(14.0, abs=0.1)
    assert max(np.diff(left)) < 0.02


def test_a_path_that_passes_its_own_end_is_driven_to_the_end() -> None:
    loop = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (-0.1, 3.0), (-0.1, 0.1)])
    drive = PathDrive(room(), (0.0, 0.0, 0.0))
    assert drive.follow(loop).outcome == "reached"
    assert max(place[0] for place in drive.places) > 2.5
    assert max(place[1] for place in drive.places) > 2.5


@pytest.mark.parametrize("at", [(0.0, -0.5), (-2.0, -3.0), (1.5, 3.1)])
def test_what_the_planner_did_not_know_of_is_driven_round(at: tuple[float, float]) -> None:
    drive = PathDrive(room(circles=[(*at, 0.35)]), (-4.0, -3.0, 0.0))
    report = drive.follow(BEND)
    assert (report.outcome, drive.base.collisions) == ("reached", 0)
    assert drive.off_m(BEND) < 1.2


def test_a_closed_way_is_waited_at_and_left_to_who_plans() -> None:
    """Only a detour of many metres is left: that is not this one's to choose."""
    drive = PathDrive(room(segments=[(-6.0, 0.5, 4.5, 0.5)]), (-4.0, -3.0, 0.0))
    with pytest.raises(AssertionError, match="still"):
        drive.follow(BEND, steps=400)
    assert drive.base.collisions == 0
    assert max(place[1] for place in drive.places) < 0.5


def test_another_path_takes_over_on_the_way_without_a_stop() -> None:
    """As a behaviour tree plans anew each second."""
    drive = PathDrive(room(), (-4.0, -3.0, 0.0))
    driving = drive.run()
    next(driving)
    for k in range(120):
        x, y, _ = drive.base.pose
        if k % 10 == 0:
            path = np.array([(x, y), (4.0, -3.0)])
            drive.driver.set_goal((4.0, -3.0), "map", path=path)
        report = next(driving)
        assert report.command.status == "driving"
        if k > 20:
            assert report.command.twist[0] > 0.4


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (np.empty((0, 2)), "no points"),
        (np.array([(0.0, math.nan), (1.0, 1.0)]), "not finite"),
        (None, "needs the path"),
    ],
)
def test_what_is_no_path_is_refused(path: Array | None, words: str) -> None:
    drive = PathDrive(room(), (0.0, 0.0, 0.0))
    next(drive.run())
    with pytest.raises(BadGoal, match=words):
        drive.driver.set_goal((1.0, 1.0), "map", path=path)
    with pytest.raises(ConfigError, match="follows a path"):
        Navigator("diffbot", guidance="path").set_goal((1.0, 1.0))


def test_a_path_of_one_point_is_driven_to() -> None:
    drive = PathDrive(room(), (0.0, 0.0, 0.0))
    assert drive.follow(np.array([(2.0, 1.0)])).outcome == "reached"
    assert math.dist(drive.base.pose[:2], (2.0, 1.0)) < 0.4


def test_transforms_that_stop_hold_the_robot_and_say_why() -> None:
    """It stands two periods after they are stale; goals are refused then, and driving goes on with them."""
    drive = PathDrive(room(), (-4.0, -3.0, 0.0))
    silent = [False]

    def told(parent: str, child: str, *rest: object) -> None:
        if not silent[0]:
            take(parent, child, *rest)  # pyright: ignore

    take, drive.driver.frames.take = drive.driver.frames.take, told  # pyright: ignore
    driving = drive.run()
    next(driving)
    drive.driver.set_goal((4.0, 3.0), "map", path=BEND)
    report = after(30, driving)
    assert report.command.twist[0] > 0.4
    silent[0] = True
    report = after(7, driving)
    assert report.command.twist == (0.0, 0.0)
    assert report.command.reasons == ("not_localised",)
    assert "from 'map' to 'odom' is stale" in report.message
    silent[0] = False
    report = after(30, driving)
    assert report.command.twist[0] > 0.4


@pytest.mark.slow
@pytest.mark.parametrize("hz", [10.0, 50.0])
@pytest.mark.parametrize("robot", ["diffbot", "jackal"])
def test_noise_of_localisation_does_not_hurt(robot: str, hz: float) -> None:
    """1 cm and half a degree, as good as none."""
    rng = np.random.default_rng(0)
    std = np.array([0.01, 0.01, math.radians(0.5)])

    def noisy(pose: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, yaw = (np.array(pose) + rng.normal(0.0, std)).tolist()
        return x, y, yaw

    ends = []
    for task in task_set(get_scenario("complex"), ROBOTS[robot], "test", 6):
        drive = PathDrive(task.world, task.start, ROBOTS[robot])
        assert task.path is not None
        ends.append((drive.follow(task.path, poses=noisy, hz=hz).outcome, drive.base.collisions))
    assert ends == [("reached", 0)] * 6


# --- headings -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [-2.5, -0.5, 1.0, 3.1])
def test_the_robot_turns_to_the_heading_that_is_asked_for(yaw: float) -> None:
    drive = PathDrive(room(), (-1.0, 0.5, 0.3), yaw_tolerance_rad=0.1)
    report = drive.follow(np.array([(-1.0, 0.5), (1.0, 1.0)]), yaw_rad=yaw)
    assert report.outcome == "reached"
    assert abs(math.remainder(drive.base.pose[2] - yaw, 2.0 * math.pi)) < 0.2
    assert math.dist(drive.base.pose[:2], (1.0, 1.0)) < 0.4
    turned = np.abs(np.diff(np.unwrap([place[2] for place in drive.places])))
    assert turned.max() < 1.05 * ROBOT.max_yaw_rate_radps * ROBOT.control_period_s


def test_a_robot_without_room_to_turn_tries_both_ways_and_says_so() -> None:
    """A Jackal, which is oblong, in a lane that is hardly wider than itself."""
    jackal = ROBOTS["jackal"]
    half = 0.27
    lane = [(-6.0, half, 6.0, half), (-6.0, -half, 6.0, -half)]
    drive = PathDrive(room(segments=lane), (-3.0, 0.0, 0.0), jackal)
    report = drive.follow(np.array([(-3.0, 0.0)]), yaw_rad=1.5)
    assert (report.outcome, drive.base.collisions) == ("failed", 0)
    assert "no room to turn" in report.message


def test_a_heading_that_is_none_is_refused() -> None:
    drive = PathDrive(room(), (0.0, 0.0, 0.0))
    next(drive.run())
    with pytest.raises(BadGoal, match="heading"):
        drive.driver.set_goal((1.0, 1.0), "map", path=BEND, yaw_rad=math.nan)
    with pytest.raises(ConfigError, match="heading"):
        Navigator("diffbot", guidance="goal").set_goal((1.0, 1.0), yaw_rad=math.inf)


# --- speed --------------------------------------------------------------------------------------------------


def test_a_speed_limit_holds_on_the_way() -> None:
    drive = PathDrive(room(), (-4.0, -3.0, 0.0))
    drive.driver.navigator.speed_limit_mps = 0.2
    assert drive.follow(BEND, steps=1500).outcome == "reached"
    assert max(abs(report.command.twist[0]) for report in drive.reports) <= 0.2 + 1e-9
    assert drive.off_m(BEND) < 0.6


def test_a_door_that_has_closed_on_the_path_is_waited_at() -> None:
    """Who has come to stand in it may go; that is no way round."""
    angles = ROBOT.lidar.angles_rad
    closed = np.full(len(angles), 1.5, np.float32)
    open_ = np.where(np.abs(angles) < 0.5, ROBOT.lidar.max_range_m, closed).astype(np.float32)
    guide = GivenPathGuide(Replanner(1, ROBOT, ReplannerConfig()))
    guide.set_goal(np.array([(0.0, 0.0), (4.0, 0.0)]))
    here = np.zeros((1, 3))
    scans = [open_] * 30 + [closed] * 30
    headings = [
        guide.head_for(
            View(ranges=scan[None], reckoned=here, place=(0.0, 0.0, 0.0), now_s=0.1 * k), (4.0, 0.0)
        )
        for k, scan in enumerate(scans)
    ]
    assert np.linalg.norm(headings[20].waypoint) > 1.0
    assert np.linalg.norm(headings[-1].waypoint) == pytest.approx(BLIND_PART * LOOKAHEAD_M)
