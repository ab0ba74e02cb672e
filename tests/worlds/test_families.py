"""Families: robots drawn from ranges, the same for ever, sound, and told apart from what is not of the family."""

import dataclasses
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adrl.errors import ConfigError, UnknownName
from adrl.types import SPLITS, LidarConfig, RobotConfig
from adrl.worlds import FAMILIES, ROBOTS, LidarFamily, RobotFamily, load_robot, load_robots
from adrl.worlds.families import family_from_fields
from adrl.worlds.tasks import time_limit_s
from random_robots import robots

ANY = FAMILIES["any"]
NUMBERS = st.integers(0, 5000)


@settings(max_examples=50, deadline=None)
@given(split=st.sampled_from(SPLITS), number=NUMBERS)
def test_a_drawn_robot_is_of_its_family_and_sees_where_it_stops(split: str, number: int) -> None:
    robot = ANY.draw(split, number)
    assert ANY.outside(robot) == ()
    lidar, period = robot.lidar, robot.control_period_s
    assert robot.covers(np.array([lidar.mount_x_m, lidar.mount_y_m]))
    assert robot.latency_s <= 7.0 * period
    front = robot.radius_m if robot.radius_m is not None else float(robot.polygon[:, 0].max())
    half = robot.radius_m if robot.radius_m is not None else float(robot.polygon[:, 1].max())
    stops_m = robot.stop_distance_m + robot.max_speed_mps * period
    for side in (-half, 0.0, half):
        x, y = front + stops_m - lidar.mount_x_m, side - lidar.mount_y_m
        assert math.hypot(x, y) <= lidar.max_range_m
        assert (
            abs(math.remainder(math.atan2(y, x) - lidar.mount_yaw_rad, math.tau))
            <= 0.5 * lidar.fov_rad + 1e-6
        )


def test_a_robot_is_the_same_for_ever() -> None:
    robot = ANY.draw("test", 17)
    assert robot == RobotFamily().draw("test", 17) == load_robot("any:test:17")
    assert robot.name == "any:test:17"
    # Numbers of the first release that draws: a change of them is another family.
    told = (robot.radius_m, robot.max_speed_mps, robot.lidar.num_beams, robot.lidar.max_range_m)
    assert told == pytest.approx((0.320557, 0.325309, 946, 21.5126), rel=1e-4)


def test_splits_share_no_robot() -> None:
    speeds = [ANY.draw(split, number).max_speed_mps for split in SPLITS for number in range(200)]
    assert len(set(speeds)) == len(speeds)


def test_a_family_holds_its_shares_and_fills_its_ranges() -> None:
    robots = [ANY.draw("train", number) for number in range(600)]

    def share(flags: list[bool]) -> float:
        return sum(flags) / len(flags)

    assert share([robot.radius_m is not None for robot in robots]) == pytest.approx(0.5, abs=0.08)
    assert share([robot.min_speed_mps == 0.0 for robot in robots]) == pytest.approx(0.45, abs=0.08)
    cars = [robot for robot in robots if robot.is_car]
    assert share([robot.is_car for robot in robots if robot.radius_m is None]) == pytest.approx(0.2, abs=0.08)
    assert all(robot.radius_m is None and robot.min_speed_mps < 0.0 for robot in cars)
    assert share([robot.lidar.fov_rad == 2.0 * math.pi for robot in robots]) == pytest.approx(0.43, abs=0.08)
    for values, (low, high) in (
        ([robot.max_speed_mps for robot in robots], ANY.max_speed_mps),
        ([robot.lidar.num_beams for robot in robots], ANY.lidar.num_beams),
        ([robot.lidar.max_range_m for robot in robots], ANY.lidar.max_range_m),
    ):
        assert low <= min(values) <= 1.05 * low
        assert 0.95 * high <= max(values) <= high
        assert np.median(values) == pytest.approx(math.sqrt(low * high), rel=0.2), "evenly by their logarithm"
    lengths = [np.ptp(robot.polygon[:, 0]) for robot in robots if robot.radius_m is None]
    assert min(lengths) < 0.25 < 0.95 < max(lengths)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robots_that_we_know_are_of_the_family(name: str) -> None:
    assert ANY.outside(ROBOTS[name]) == ()


def test_a_narrower_range_leaves_the_other_numbers_as_they_are() -> None:
    narrow = RobotFamily(lidar=LidarFamily(noise_std_m=(0.0, 0.0)))
    for number in range(20):
        robot = ANY.draw("train", number)
        lidar = replace(robot.lidar, noise_std_m=0.0)
        assert narrow.draw("train", number) == replace(robot, lidar=lidar)


OUTSIDE = {
    "max_speed_mps 3; the family has 0.2 to 2": {"max_speed_mps": 3.0, "max_acceleration_mps2": 10.0},
    "radius_m 0.05; the family has 0.1 to 0.5": {"radius_m": 0.05},
    "footprint_m 1.4: its length in m; the family has 0.2 to 1": {
        "radius_m": None,
        "footprint_m": ((0.7, 0.2), (-0.7, 0.2), (-0.7, -0.2), (0.7, -0.2)),
    },
    "footprint_m 0.5: its middle to the left of the origin": {
        "radius_m": None,
        "footprint_m": ((0.3, 0.3), (-0.3, 0.3), (-0.3, -0.1), (0.3, -0.1)),
    },
    "max_acceleration_mps2 3: seconds from full speed to standing; the family has 0.05 to 1.2": {
        "max_acceleration_mps2": 0.2
    },
    "min_speed_mps 2: backward speed": {"min_speed_mps": -1.2},
    "control_period_s 0.4; the family has 0.05 to 0.2": {"control_period_s": 0.4},
    "lidar.num_beams 16; the family has 60 to 1440": {"lidar": LidarConfig(num_beams=16)},
    "lidar.fov_rad 1; the family has 1.571 to 6.283": {"lidar": LidarConfig(fov_rad=1.0)},
    "lidar.mount_yaw_rad 3; the family has -0.8 to 0.8": {
        "lidar": LidarConfig(fov_rad=6.0, mount_yaw_rad=3.0)
    },
    "does not see its whole width": {
        "lidar": LidarConfig(fov_rad=math.pi, mount_yaw_rad=0.8, mount_x_m=0.19)
    },
    "the LiDAR is not on the body": {"lidar": LidarConfig(mount_x_m=0.3)},
    "its stop takes": {"latency_s": 0.2, "max_speed_mps": 2.0, "lidar": LidarConfig(max_range_m=1.0)},
}


@pytest.mark.parametrize("line", OUTSIDE)
def test_what_lies_outside_is_named_with_number_and_range(line: str) -> None:
    found = ANY.outside(RobotConfig(**OUTSIDE[line]))
    assert any(line in told for told in found), found


def test_shares_of_all_or_nothing_are_ranges_too() -> None:
    discs = RobotFamily(disc_share=1.0, forward_only_share=1.0)
    boxes = RobotFamily(disc_share=0.0, forward_only_share=0.0)
    both_ways = RobotConfig(min_speed_mps=-0.3)
    assert boxes.outside(both_ways) == ("radius_m 0.2; the family has rectangles only",)
    assert discs.outside(both_ways) == ("min_speed_mps -0.3; the family drives forward only",)
    assert discs.outside(ROBOTS["jackal"]) == ("footprint_m; the family has discs only",)
    assert boxes.outside(RobotConfig())[-1] == "min_speed_mps 0; the family drives both ways"
    car = replace(ROBOTS["jackal"], min_turning_radius_m=1.0)
    assert ANY.outside(car) == ("min_speed_mps 0; the family's cars drive both ways",)
    assert ANY.outside(replace(car, min_speed_mps=-1.0)) == ()
    assert ANY.outside(replace(car, min_speed_mps=-1.0, min_turning_radius_m=3.0)) == (
        "min_turning_radius_m 3; the family has 0.5 to 1.5",
    )
    on_the_spot = RobotFamily(car_share=0.0)
    assert on_the_spot.outside(car) == ("min_turning_radius_m 1; the family turns on the spot",)


CARTS = """
[family]
disc_share = 0
length_m = [0.5, 0.8]
width_m = 0.4
max_speed_mps = 0.7

[family.lidar]
num_beams = [180, 720]
mount_y_share = 0
"""


def test_a_file_with_ranges_is_a_family(tmp_path: Path) -> None:
    path = tmp_path / "carts.toml"
    path.write_text(CARTS)
    family = load_robots(path)
    assert isinstance(family, RobotFamily)
    assert (family.name, family.length_m, family.width_m) == ("carts", (0.5, 0.8), (0.4, 0.4))
    assert family.lag_s == ANY.lag_s, "what it leaves out is as in family any"
    robot = load_robot(f"{path}:validation:3")
    assert robot == family.draw("validation", 3)
    assert (robot.name, robot.max_speed_mps, robot.lidar.mount_y_m) == ("carts:validation:3", 0.7, 0.0)
    assert np.ptp(robot.polygon[:, 1]) == pytest.approx(0.4)
    assert family_from_fields(json.loads(json.dumps(dataclasses.asdict(family)))) == family


FAULTS = [
    (
        "[family]\nmax_speed_mps = [1.0, 0.5]",
        "max_speed_mps is [1.0, 0.5]: its ends are crossed; give [low, high]",
    ),
    ("[family]\nmax_speed_mps = []", "max_speed_mps is []; give a number, or [low, high]"),
    ("[family]\nmax_speed_mps = [1.0]", "max_speed_mps is [1.0]; give a number, or [low, high]"),
    ("[family]\nmax_speed_mps = [0.1, 0.2, 0.3]", "give a number, or [low, high]"),
    ("[family]\nmax_speed_mps = [0.0, 1.0]", "give a number, or [low, high], each from 0.01 to 50"),
    ("[family]\nmax_speed_mps = [nan, 1.0]", "max_speed_mps is [nan, 1.0]"),
    ("[family]\nmax_speed_mps = [0.1, inf]", "max_speed_mps is [0.1, inf]"),
    ("[family]\nmax_speed_mps = 'fast'", "max_speed_mps is fast; give a number, or [low, high]"),
    ("[family]\nmax_speed_mps = [true, 1]", "max_speed_mps is [True, 1]"),
    ("[family]\nlatency_s = 1" + "0" * 400, "latency_s is inf"),
    ("[family]\ndisc_share = [0.1, 0.2]", "disc_share is [0.1, 0.2]; give a number"),
    ("[family]\ndisc_share = 1.5", "disc_share is 1.5; give a number, each from 0 to 1"),
    ("[family]\nmax_sped_mps = 1", "did you mean 'max_speed_mps'"),
    ("[family]\nfootprint_m = [[1, 0], [0, 1], [-1, 0]]", "unknown key 'family.footprint_m'"),
    ("[family.lidar]\nbeams = 90", "'lidar.beams'"),
    ("[family.lidar]\nnum_beams = [90.5, 100]", "lidar.num_beams is [90.5, 100.0]; give whole numbers"),
    ("[family.lidar]\nfov_rad = [3, 9]", "lidar.fov_rad is [3, 9]; give a number, or [low, high], each from"),
    ("[family]\nlidar = 3", "lidar must be a table"),
    ("family = 3", "family must be a table"),
    ("max_speed_mps = 1\n[family]", "'max_speed_mps' is beside [family]"),
    ("name = 3\n[family]", "name is 3; give a text"),
    ("[family]\nmax_speed_mps = [50, 50]\nlatency_s = [1, 1]", "can drive; the last one: "),
]


@pytest.mark.parametrize(("text", "says"), FAULTS)
def test_a_bad_family_is_one_line_that_names_field_and_file(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_robots(path)
    told = str(caught.value)
    assert f"robot file {path}: " in told
    assert says in told
    assert "\n" not in told


def test_a_family_is_no_robot_and_a_robot_no_family(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match="is a family of robots, and this takes one: give one of it, such as any:test:0"
    ):
        load_robot("any")
    with pytest.raises(ConfigError, match="'jackal' is one robot, no family"):
        load_robot("jackal:test:3")
    with pytest.raises(UnknownName, match="did you mean 'any'"):
        load_robot("amy:test:3")
    with pytest.raises(UnknownName, match="did you mean 'test'"):
        ANY.draw("tests", 0)
    with pytest.raises(ConfigError, match="give 0 or more"):
        ANY.draw("test", -1)


@settings(deadline=None)
@given(robots(), st.floats(0.02, 1.5))
def test_a_slowed_robot_stops_and_turns_within_the_metres_and_is_no_slower_than_that_asks(
    robot: RobotConfig, within_m: float
):
    slowed = robot.slowed(within_m)
    turns_in_m = slowed.max_speed_mps / slowed.max_yaw_rate_radps
    assert slowed.stop_distance_m <= within_m * (1.0 + 1e-9)
    assert turns_in_m <= 2.0 * within_m * (1.0 + 1e-9)
    if slowed is robot:
        return
    as_far, as_tight = pytest.approx(within_m), pytest.approx(2.0 * within_m)
    assert slowed.stop_distance_m == as_far or turns_in_m == as_tight
    assert slowed.max_speed_mps < robot.max_speed_mps
    assert slowed.min_speed_mps == max(robot.min_speed_mps, -slowed.max_speed_mps)
    same = replace(slowed, max_speed_mps=robot.max_speed_mps, min_speed_mps=robot.min_speed_mps)
    assert same == robot, "nothing else is changed"


@settings(deadline=None)
@given(robots(), st.floats(1.0, 50.0))
def test_time_limits_go_by_a_speed_at_which_the_robot_turns_within_a_metre(robot: RobotConfig, way_m: float):
    tight = robot.max_yaw_rate_radps * 1.0
    speed = (way_m * 2.5) / (time_limit_s(way_m, robot) - 10.0)
    assert speed == pytest.approx(min(robot.max_speed_mps, tight))


def test_a_slowed_robot_backs_no_faster_and_is_a_robot_still() -> None:
    backs = RobotConfig(
        max_speed_mps=0.5, min_speed_mps=-1.0, max_yaw_rate_radps=1.0, max_acceleration_mps2=5.0
    )
    assert (backs.slowed(0.3).max_speed_mps, backs.slowed(0.3).min_speed_mps) == (0.5, -0.6)
    assert RobotConfig(max_yaw_rate_radps=0.01).slowed(0.3).max_speed_mps == 0.01
