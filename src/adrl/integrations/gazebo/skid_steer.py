"""The Jackal as its makers describe it: four driven wheels that do not steer, and twelve others that differ from it."""

import math
from dataclasses import asdict, dataclass, replace
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from adrl.integrations.gazebo.model import (
    LIDAR_ABOVE_M,
    footprint,
    friction,
    inertial,
    lidar,
    require_showable,
)
from adrl.types import RobotConfig
from adrl.worlds.sdf_write import UNDERCARRIAGE, add, collide_as

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, kw_only=True)
class SkidSteer:
    """Body and controller of a skid-steered robot. As it stands: jackal_description and jackal_control, version 0.8."""

    name: str = "jackal"
    chassis_kg: float = 16.523
    chassis_inertia_kgm2: tuple[float, float, float] = (0.3136, 0.3922, 0.4485)
    """About its centre of mass, along x, y and z."""
    centre_m: tuple[float, float, float] = (0.012, 0.002, 0.1305)
    """Of the chassis' mass: ahead of and left of the wheels' middle, and above the ground."""
    bottom_m: float = 0.0635
    """Ground clearance of the chassis."""
    top_m: float = 0.2475
    wheel_kg: float = 0.477
    wheel_inertia_kgm2: tuple[float, float, float] = (0.0013, 0.0024, 0.0013)
    left_radius_m: float = 0.098
    """Of the wheels on the left."""
    right_radius_m: float = 0.098
    wheel_width_m: float = 0.04
    wheelbase_m: float = 0.262
    """From the front axle to the rear one."""
    track_m: float = 0.37559
    """Between the middles of the wheels of an axle."""
    friction: float = 0.5
    """Of the tyres, lengthwise and across."""
    latency_s: float = 0.0
    """Age of a command when the wheels' controller gets it."""
    mount_x_m: float = 0.0
    """Where the LiDAR sits ahead of where the robot's description has it."""
    mount_y_m: float = 0.0
    mount_yaw_rad: float = 0.0

    @property
    def mass_kg(self) -> float:
        """Of everything."""
        return self.chassis_kg + 4.0 * self.wheel_kg

    def controller(self, robot: RobotConfig) -> dict[str, tuple[float, ...]]:
        """What the plugin has to know: parameters of plugin/lockstep.cpp.

        The wheels' controller is the Jackal's as made, whatever the robot is. It takes the wheels to be 1.5 times as
        far apart as they are, as skidding turns a robot less than its wheels tell. Who drives sends commands that
        change no faster than the robot's config says: the controller would let the tyres slip.
        """
        weight_n = self.mass_kg * GRAVITY_MPS2
        return {
            "radius": (JACKAL.left_radius_m,),
            "separation": (1.5 * JACKAL.track_m,),
            # A wheel's torque: tyres give way before motors do, to which the description sets no limit.
            "torque": (weight_n * max(self.left_radius_m, self.right_radius_m),),
            "speed": (-MAX_SPEED_MPS, MAX_SPEED_MPS),
            "yaw_rate": (MAX_YAW_RATE_RADPS,),
            "acceleration": (min(robot.max_acceleration_mps2, MAX_ACCELERATION_MPS2),),
            "yaw_acceleration": (min(robot.max_yaw_acceleration_radps2, MAX_YAW_ACCELERATION_RADPS2),),
            "lag": (0.0,),
            "latency": (self.latency_s,),
            "imu": (HEADING_STD_RAD, YAW_RATE_STD_RADPS),
        }

    def numbers(self) -> dict[str, float | str]:
        """What may differ from the Jackal as made, by name."""
        varied = (
            *("name", "left_radius_m", "right_radius_m", "wheelbase_m", "track_m", "chassis_kg", "friction"),
            *("latency_s", "mount_x_m", "mount_y_m", "mount_yaw_rad"),
        )
        fields = asdict(self)
        return {name: fields[name] for name in varied} | {
            "centre_x_m": self.centre_m[0],
            "centre_y_m": self.centre_m[1],
        }


JACKAL = SkidSteer()
MAX_SPEED_MPS, MAX_YAW_RATE_RADPS = 2.0, 4.0
"""What the Jackal's controller lets through,"""
MAX_ACCELERATION_MPS2, MAX_YAW_ACCELERATION_RADPS2 = 20.0, 25.0
"""and how fast it lets them change: more than the tyres can follow."""
HEADING_STD_RAD, YAW_RATE_STD_RADPS = 0.005, 0.005
"""Errors of heading and yaw rate, as of its simulated IMU, from which its odometry has both."""

COLD_SEED = 0
"""Of the twelve others."""
COLD = 12


def cold_jackals() -> tuple[SkidSteer, ...]:
    """Twelve Jackals as they may come from a workshop; neither policy nor controller is told.

    Each number is drawn evenly: wheels 5 % larger or smaller, and those of each side another 1.5 % by themselves;
    track 3 % off, so that tyres stay within the footprint; wheelbase 5 %; 10 % lighter to 40 % heavier, with the centre
    of mass up to 4 cm off lengthwise and 2 cm across; friction 0.35 to 0.9; commands up to 0.1 s late; the LiDAR up to
    2 cm and 2 degrees off.
    """
    streams = np.random.SeedSequence(COLD_SEED).spawn(COLD)
    return tuple(_drawn(f"cold-{i}", np.random.default_rng(stream)) for i, stream in enumerate(streams))


def _drawn(name: str, rng: np.random.Generator) -> SkidSteer:
    def about(middle: float, share: float) -> float:
        return middle * float(rng.uniform(1.0 - share, 1.0 + share))

    radius, load = about(JACKAL.left_radius_m, 0.05), float(rng.uniform(0.9, 1.4))
    x, y, z = JACKAL.centre_m
    inertia_x, inertia_y, inertia_z = (load * inertia for inertia in JACKAL.chassis_inertia_kgm2)
    return replace(
        JACKAL,
        name=name,
        left_radius_m=about(radius, 0.015),
        right_radius_m=about(radius, 0.015),
        track_m=about(JACKAL.track_m, 0.03),
        wheelbase_m=about(JACKAL.wheelbase_m, 0.05),
        chassis_kg=load * JACKAL.chassis_kg,
        chassis_inertia_kgm2=(inertia_x, inertia_y, inertia_z),
        centre_m=(x + float(rng.uniform(-0.04, 0.04)), y + float(rng.uniform(-0.02, 0.02)), z),
        friction=float(rng.uniform(0.35, 0.9)),
        latency_s=float(rng.uniform(0.0, 0.1)),
        mount_x_m=float(rng.uniform(-0.02, 0.02)),
        mount_y_m=float(rng.uniform(-0.02, 0.02)),
        mount_yaw_rad=math.radians(float(rng.uniform(-2.0, 2.0))),
    )


def skid_steered_model(
    robot: RobotConfig, base: SkidSteer, name: str, pose: tuple[float, float, float]
) -> Element:
    """The <model> of such a robot that stands at the pose x, y, yaw on the ground.

    Its body is the footprint of the config, which is what a collision is counted by: fenders included, that the
    description leaves out. Wheels touch the ground alone.
    """
    require_showable(robot)
    model = Element("model", name=name)
    add(model, "pose", pose[0], pose[1], 0.0, 0.0, 0.0, pose[2])
    chassis = SubElement(model, "link", name="base")
    inertial(chassis, base.chassis_kg, base.chassis_inertia_kgm2, base.centre_m)
    footprint(chassis, robot, base.bottom_m, base.top_m)
    x, y, yaw = robot.lidar.mount
    at = (x + base.mount_x_m, y + base.mount_y_m, base.top_m + LIDAR_ABOVE_M)
    lidar(chassis, robot.lidar, at, yaw + base.mount_yaw_rad)
    for side, across, radius in (("left", 0.5, base.left_radius_m), ("right", -0.5, base.right_radius_m)):
        for end, along in (("front", 0.5), ("rear", -0.5)):
            at = (along * base.wheelbase_m, across * base.track_m, radius)
            _wheel(model, f"{side}_{end}", at, base)
    return model


def _wheel(model: Element, name: str, at: tuple[float, float, float], base: SkidSteer) -> None:
    """A cylinder on an axle of its own; at: its middle, as high as its radius."""
    link = SubElement(model, "link", name=f"{name}_wheel")
    add(link, "pose", *at, 0.0, 0.0, 0.0)
    inertial(link, base.wheel_kg, base.wheel_inertia_kgm2)
    for kind in ("collision", "visual"):
        part = SubElement(link, kind, name="tyre")
        add(part, "pose", 0.0, 0.0, 0.0, 0.5 * math.pi, 0.0, 0.0)
        shape = SubElement(SubElement(part, "geometry"), "cylinder")
        add(shape, "radius", at[2])
        add(shape, "length", base.wheel_width_m)
        if kind == "collision":
            # As the description has it: along a diameter of the wheel, which turns with it.
            add(friction(part, base.friction), "fdir1", 1, 0, 0)
            collide_as(part, UNDERCARRIAGE)
    joint = SubElement(model, "joint", name=name, type="revolute")
    add(joint, "parent", "base")
    add(joint, "child", f"{name}_wheel")
    add(SubElement(joint, "axis"), "xyz", 0, 1, 0)
