"""How two robots differ, in words."""

import dataclasses

from hypothesis import given
from hypothesis import strategies as st

from adrl.deploy.setup import other_robot, robot_differences
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import ROBOTS

NUMBERS = ("max_speed_mps", "max_yaw_rate_radps", "control_period_s", "lag_s", "odometry_drift")


def test_equal_robots_do_not_differ_whatever_they_are_called():
    for robot in ROBOTS.values():
        assert robot_differences(robot, dataclasses.replace(robot, name="other")) == ()
        assert other_robot("default", robot, robot) is None


@given(name=st.sampled_from(NUMBERS), value=st.floats(0.01, 1.0))
def test_the_number_that_differs_is_named_with_both_values(name: str, value: float):
    trained = RobotConfig()
    driven = dataclasses.replace(trained, **{name: value})
    expected = () if driven == trained else (f"{name} {value:.6g} instead of {getattr(trained, name):.6g}",)
    assert robot_differences(trained, driven) == expected


def test_the_line_names_policy_robots_and_numbers():
    own = RobotConfig(
        name="own", radius_m=0.31, max_speed_mps=0.9, control_period_s=0.05, lidar=LidarConfig(num_beams=541)
    )
    assert other_robot("default", RobotConfig(), own) == (
        "policy default was trained for robot diffbot and drives own: radius_m 0.31 instead of 0.2, max_speed_mps 0.9 "
        "instead of 0.6, control_period_s 0.05 instead of 0.1, lidar.num_beams 541 instead of 180"
    )
    jackal = ROBOTS["jackal"]
    assert "footprint_m none instead of ((" in (other_robot("jackal", jackal, RobotConfig()) or "")
