"""Robots as Gazebo models, without Gazebo: bodies, wheels, sensors, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from adrl.errors import ConfigError
from adrl.integrations.gazebo import Gazebo
from adrl.integrations.gazebo.model import body_of, robot_model, wheel_torque_nm
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import ROBOTS, load_robot

FOOTPRINTS = {
    "diamond": ((0.3, 0.0), (0.0, 0.3), (-0.3, 0.0), (0.0, -0.3)),
    "wedge": ((-0.1, -0.3), (0.5, 0.0), (-0.1, 0.3)),
    "slim": ((0.6, 0.1), (-0.2, 0.1), (-0.2, -0.15), (0.6, -0.15)),
}


@pytest.mark.parametrize("name", [*ROBOTS, *FOOTPRINTS])
def test_wheels_and_casters_stand_within_the_footprint(name: str) -> None:
    footprint = FOOTPRINTS.get(name)
    robot = load_robot(name) if footprint is None else RobotConfig(radius_m=None, footprint_m=footprint)
    model = robot_model(robot, "r", (0.0, 0.0, 0.0))

    def is_within(x: float, y: float) -> bool:
        if robot.radius_m is not None:
            return math.hypot(x, y) <= robot.radius_m + 1e-9
        corners = robot.polygon
        sides, to = np.roll(corners, -1, axis=0) - corners, np.array([x, y]) - corners
        return bool((sides[:, 0] * to[:, 1] - sides[:, 1] * to[:, 0] >= -1e-9).all())

    for side in ("left", "right"):
        link = model.find(f"link[@name='{side}_wheel']")
        assert link is not None
        y = float(link.findtext("pose", "").split()[1])
        wheel = link.find("visual/geometry/cylinder")
        assert wheel is not None
        radius, half = float(wheel.findtext("radius", "")), 0.5 * float(wheel.findtext("length", ""))
        for ahead in (-radius, radius):
            assert all(is_within(ahead, y + across) for across in (-half, half))
    casters = [part for part in model.iter("collision") if part.get("name", "").startswith("caster")]
    assert len(casters) == 2
    for caster in casters:
        x, radius = float(caster.findtext("pose", "").split()[0]), float(caster.findtext(".//radius", ""))
        around = np.linspace(0.0, 2.0 * math.pi, 24)
        assert all(
            is_within(x + radius * c, radius * s) for c, s in zip(np.cos(around), np.sin(around), strict=True)
        )


def test_a_known_body_is_that_of_a_robot_of_this_name_and_footprint() -> None:
    jackal = load_robot("jackal")
    assert body_of(jackal).mass_kg == 17.0
    assert body_of(replace(jackal, max_speed_mps=1.0)).mass_kg == 17.0
    smaller = replace(jackal, footprint_m=None, radius_m=0.1)
    assert body_of(smaller) == body_of(replace(smaller, name="mine"))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_model_weighs_what_its_body_does_and_sees_what_its_lidar_does(name: str) -> None:
    robot = load_robot(name)
    model, body = robot_model(robot, "r", (1.0, 2.0, 0.3)), body_of(robot)
    masses = [float(mass.text or "") for mass in model.iter("mass")]
    assert sum(masses) == pytest.approx(body.mass_kg)
    horizontal = model.find("link/sensor/ray/scan/horizontal")
    assert horizontal is not None
    assert horizontal.findtext("samples") == str(robot.lidar.num_beams)
    assert float(horizontal.findtext("max_angle") or "") == pytest.approx(robot.lidar.angles_rad[-1])
    # Torque enough for both wheels to accelerate the mass as the config says.
    force = 2.0 * wheel_torque_nm(robot, body) / body.wheel_radius_m
    assert force > body.mass_kg * robot.max_acceleration_mps2


def test_what_gazebo_cannot_show_is_refused() -> None:
    for refused in (
        RobotConfig(lidar=LidarConfig(dropout_probability=0.1)),
        RobotConfig(odometry_drift=0.02),
        RobotConfig(min_turning_radius_m=0.5),
    ):
        with pytest.raises(
            ConfigError, match=r"(dropout_probability|odometry_drift|turning_radius_m) is 0\."
        ):
            robot_model(refused, "r", (0.0, 0.0, 0.0))
    outside = RobotConfig(radius_m=None, footprint_m=((0.1, -0.2), (0.5, -0.2), (0.5, 0.2), (0.1, 0.2)))
    with pytest.raises(ConfigError, match="origin"):
        body_of(outside)
    with pytest.raises(ConfigError, match="physics_step_s"):
        Gazebo(RobotConfig(), physics_step_s=0.5)
    with pytest.raises(ConfigError, match="num_envs"):
        Gazebo(RobotConfig(), 0)
