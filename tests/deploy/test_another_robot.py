"""How two robots differ, in words, and whether a policy's own encoder would see the difference."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.deploy.another_robot import (
    as_trained,
    other_robot,
    outside_family,
    require_encodable,
    robot_differences,
)
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.observation.motion import ScanHistory
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import FAMILIES, ROBOTS

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


def test_a_robot_outside_of_a_policys_family_is_named_with_its_numbers():
    family = FAMILIES["any"]
    assert outside_family("default", family, ROBOTS["jackal"]) is None
    slow = RobotConfig(name="slow", max_speed_mps=0.1, lidar=LidarConfig(num_beams=30))
    assert outside_family("default", family, slow) == (
        "policy default was trained for robots of family any, and slow is outside: max_speed_mps 0.1; the family has "
        "0.2 to 2; lidar.num_beams 30; the family has 60 to 1440"
    )


OTHERS = {
    "radius_m": 0.25,
    "max_speed_mps": 0.9,
    "min_speed_mps": -0.2,
    "min_turning_radius_m": 0.4,
    "max_yaw_rate_radps": 1.0,
    "max_acceleration_mps2": 1.0,
    "max_yaw_acceleration_radps2": 3.0,
    "lag_s": 0.2,
    "latency_s": 0.1,
    "odometry_drift": 0.1,
    "control_period_s": 0.05,
    "lidar.num_beams": 90,
    "lidar.fov_rad": 4.0,
    "lidar.max_range_m": 9.0,
    "lidar.noise_std_m": 0.05,
    "lidar.dropout_probability": 0.1,
    "lidar.mount_x_m": 0.1,
    "lidar.mount_y_m": 0.1,
    "lidar.mount_yaw_rad": 0.5,
}


def test_every_number_of_a_robot_is_tried():
    numbers = {field.name for field in dataclasses.fields(RobotConfig)} - {"name", "lidar", "footprint_m"}
    lidar = {f"lidar.{field.name}" for field in dataclasses.fields(LidarConfig)}
    assert OTHERS.keys() == numbers | lidar


@pytest.mark.parametrize("body", [False, True])
@pytest.mark.parametrize("steps", [0, 2])
@pytest.mark.parametrize("name", OTHERS)
def test_an_encoder_of_another_robot_is_refused_exactly_where_it_would_see_otherwise(
    name: str, steps: int, body: bool
):
    trained = RobotConfig()
    if name.startswith("lidar."):
        lidar = dataclasses.replace(trained.lidar, **{name.removeprefix("lidar."): OTHERS[name]})
        driven = dataclasses.replace(trained, lidar=lidar)
    else:
        driven = dataclasses.replace(trained, **{name: OTHERS[name]})
    config = EncoderConfig(history_steps=steps, body=body)
    taken_as = driven if body else as_trained(driven, trained)
    rng = np.random.default_rng(0)
    beams = driven.lidar.num_beams
    history = ScanHistory(32, beams, steps) if steps else None
    scans = rng.uniform(0.1, 7.0, (2, 32, beams)).astype(np.float32)
    scans = np.minimum(scans, np.float32(trained.lidar.max_range_m))
    if history is not None:
        history.begin(np.arange(32), scans[0], np.zeros((32, 3)))
        for _ in range(steps):
            history.add(scans[1], np.full((32, 3), 0.05))
    goal, twist = rng.uniform(-3.0, 3.0, (2, 32, 2))
    last = rng.uniform(-1.0, 1.0, (32, 2)).astype(np.float32)
    seen = []
    for robot in (trained, taken_as):
        try:
            seen.append(ObservationEncoder(robot, config).encode(scans[1], goal, twist, last, history))
        except (IndexError, ValueError):  # beams of another LiDAR
            seen.append(np.empty(0))
    if np.array_equal(*seen):
        require_encodable("mine", trained, taken_as, steps, body=body)
    else:
        with pytest.raises(ConfigError, match=f"mine holds the encoder of robot diffbot.*{name}"):
            require_encodable("mine", trained, taken_as, steps, body=body)
