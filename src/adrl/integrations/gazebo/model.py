"""Robots as Gazebo models: a differential drive with mass, wheels, casters and a ray sensor, made of a RobotConfig."""

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from adrl.errors import ConfigError
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds.robots import ROBOTS
from adrl.worlds.sdf_write import UNDERCARRIAGE, add, collide_as

GROUND_GAP_M = 0.02
"""Between the ground and the body, which would touch it when it pitches."""
LIDAR_ABOVE_M = 0.03
"""Height of the LiDAR above the body, which it must not see."""
CASTER_LIFT_M = 0.002
"""Height of the front caster above the ground; it catches the robot when it brakes hard."""
LEAST_RANGE_M = 0.01


@dataclass(frozen=True, kw_only=True)
class Body:
    """What a RobotConfig does not say and physics needs."""

    mass_kg: float
    """Of everything, wheels included."""
    wheel_radius_m: float
    wheel_separation_m: float
    """Between the middles of both wheels."""
    height_m: float
    """From the ground to the top of the body."""


BODIES: dict[str, Body] = {
    # Masses, wheels and heights from turtlebot3_description and jackal_description and both makers' data sheets.
    # The Jackal's four skidding wheels are two that roll here, at its track.
    "turtlebot3_burger": Body(mass_kg=1.0, wheel_radius_m=0.033, wheel_separation_m=0.16, height_m=0.15),
    "turtlebot3_waffle": Body(mass_kg=1.8, wheel_radius_m=0.033, wheel_separation_m=0.288, height_m=0.11),
    "jackal": Body(mass_kg=17.0, wheel_radius_m=0.098, wheel_separation_m=0.376, height_m=0.25),
}
AREA_DENSITY_KGPM2 = 40.0
"""Mass a square metre of a robot whose body we do not know; those we know have 20 to 80."""


def body_of(robot: RobotConfig) -> Body:
    """The body that is known of a shipped robot's name and footprint, else one of the size of the footprint."""
    shipped = ROBOTS.get(robot.name)
    if shipped is not None and (shipped.radius_m, shipped.footprint_m) == (robot.radius_m, robot.footprint_m):
        known = BODIES.get(robot.name)
        if known is not None:
            return known
    inner, length, width = _extents(robot)
    area = math.pi * inner**2 if robot.radius_m is not None else length * width
    return Body(
        mass_kg=AREA_DENSITY_KGPM2 * area,
        wheel_radius_m=0.25 * inner,
        wheel_separation_m=1.5 * inner,
        height_m=0.75 * inner,
    )


def _extents(robot: RobotConfig) -> tuple[float, float, float]:
    """Radius of the greatest disc about the origin in the footprint; length and width of its bounding box."""
    if robot.radius_m is not None:
        return robot.radius_m, 2.0 * robot.radius_m, 2.0 * robot.radius_m
    corners = robot.polygon
    length, width = corners.max(axis=0) - corners.min(axis=0)
    # Counter-clockwise: the origin is so far to the left of each edge.
    sides = np.roll(corners, -1, axis=0) - corners
    left = corners[:, 0] * sides[:, 1] - corners[:, 1] * sides[:, 0]
    inner = float((left / np.hypot(sides[:, 0], sides[:, 1])).min())
    if inner <= 0.0:
        raise ConfigError(
            f"robot {robot.name!r}: the origin is not inside the footprint; a Gazebo model has its wheels there"
        )
    return inner, float(length), float(width)


def wheel_torque_nm(robot: RobotConfig, body: Body) -> float:
    """Greatest torque of a motor: three times what the robot's accelerations take."""
    _, length, width = _extents(robot)
    inertia = body.mass_kg * (length**2 + width**2) / 12.0
    force = 0.5 * body.mass_kg * robot.max_acceleration_mps2
    force += inertia * robot.max_yaw_acceleration_radps2 / body.wheel_separation_m
    return 3.0 * body.wheel_radius_m * force


def controller(robot: RobotConfig) -> dict[str, tuple[float, ...]]:
    """What the plugin has to know of the base: parameters of plugin/lockstep.cpp."""
    body = body_of(robot)
    return {
        "radius": (body.wheel_radius_m,),
        "separation": (body.wheel_separation_m,),
        "torque": (wheel_torque_nm(robot, body),),
        "speed": (robot.min_speed_mps, robot.max_speed_mps),
        "yaw_rate": (robot.max_yaw_rate_radps,),
        "acceleration": (robot.max_acceleration_mps2,),
        "yaw_acceleration": (robot.max_yaw_acceleration_radps2,),
        "lag": (robot.lag_s,),
        "latency": (robot.latency_s,),
    }


def robot_model(robot: RobotConfig, name: str, pose: tuple[float, float, float]) -> Element:
    """The <model> of a robot that stands at the pose x, y, yaw on the ground.

    The collision `footprint` is the footprint of the config, so contact is what it is in our simulator. Raises
    ConfigError for what Gazebo cannot show: a car, dropouts of single beams, and odometry that drifts otherwise than by
    slip.
    """
    if robot.is_car:
        raise ConfigError(
            f"robot {robot.name!r}: min_turning_radius_m is {robot.min_turning_radius_m}; "
            "the model in Gazebo has two driven wheels and steers none, leave Gazebo out"
        )
    require_showable(robot)
    body = body_of(robot)
    inner, length, width = _extents(robot)
    model = Element("model", name=name)
    add(model, "pose", pose[0], pose[1], 0.0, 0.0, 0.0, pose[2])
    base = SubElement(model, "link", name="base")
    wheel_kg, base_kg = 0.05 * body.mass_kg, 0.9 * body.mass_kg
    # A little behind the axle, so that the robot stands on three points: the load of four would be anyone's guess,
    # and a wheel without its share slips.
    _inertial(base, base_kg, (length, width, body.height_m), x=-0.15 * inner, z=body.wheel_radius_m)
    footprint(base, robot, GROUND_GAP_M, body.height_m)
    caster = 0.5 * body.wheel_radius_m
    for sign in (1.0, -1.0):
        part = SubElement(base, "collision", name=f"caster_{'front' if sign > 0 else 'back'}")
        lift = CASTER_LIFT_M if sign > 0 else 0.0
        add(part, "pose", sign * (inner - caster), 0.0, caster + lift, 0.0, 0.0, 0.0)
        add(SubElement(SubElement(part, "geometry"), "sphere"), "radius", caster)
        friction(part, 0.0)
        collide_as(part, UNDERCARRIAGE)
    mount = robot.lidar.mount
    lidar(base, robot.lidar, (mount[0], mount[1], body.height_m + LIDAR_ABOVE_M), mount[2])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _wheel(model, side, sign * 0.5 * body.wheel_separation_m, body.wheel_radius_m, wheel_kg)
    return model


def require_showable(robot: RobotConfig) -> None:
    """Raises ConfigError for dropouts of single beams, and for odometry that drifts otherwise than by slip."""
    if robot.lidar.dropout_probability > 0.0:
        raise ConfigError(
            f"robot {robot.name!r}: lidar.dropout_probability is {robot.lidar.dropout_probability}; "
            "Gazebo's ray sensor has no dropouts, give 0"
        )
    if robot.odometry_drift > 0.0:
        raise ConfigError(
            f"robot {robot.name!r}: odometry_drift is {robot.odometry_drift}; "
            "in Gazebo odometry errs by the slip of the wheels, give 0"
        )


def footprint(link: Element, robot: RobotConfig, bottom_m: float, top_m: float) -> None:
    """The body between two heights: what collides, and a look."""
    high = top_m - bottom_m
    for kind in ("collision", "visual"):
        part = SubElement(link, kind, name="footprint")
        geometry = SubElement(part, "geometry")
        if robot.radius_m is not None:
            add(part, "pose", 0.0, 0.0, bottom_m + 0.5 * high, 0.0, 0.0, 0.0)
            shape = SubElement(geometry, "cylinder")
            add(shape, "radius", robot.radius_m)
            add(shape, "length", high)
        else:
            _polygon(part, geometry, robot, bottom_m, high)
        if kind == "visual":
            material = SubElement(part, "material")
            add(material, "diffuse", 0.1, 0.35, 0.8, 1)
            add(material, "ambient", 0.1, 0.35, 0.8, 1)


def _polygon(part: Element, geometry: Element, robot: RobotConfig, bottom: float, high: float) -> None:
    """A box where the footprint is one along the axes, else the extruded polygon."""
    corners = robot.polygon
    low, top = corners.min(axis=0), corners.max(axis=0)
    along_axes = len(corners) == 4 and bool(((corners == low) | (corners == top)).all())
    if along_axes:
        x, y = 0.5 * (low + top)
        add(part, "pose", x, y, bottom + 0.5 * high, 0.0, 0.0, 0.0)
        add(SubElement(geometry, "box"), "size", *(top - low), high)
        return
    add(part, "pose", 0.0, 0.0, bottom, 0.0, 0.0, 0.0)
    shape = SubElement(geometry, "polyline")
    for corner in corners:
        add(shape, "point", *corner)
    add(shape, "height", high)


def _wheel(model: Element, side: str, y: float, radius: float, mass_kg: float) -> None:
    link = SubElement(model, "link", name=f"{side}_wheel")
    add(link, "pose", 0.0, y, radius, 0.0, 0.0, 0.0)
    _inertial(link, mass_kg, (1.7 * radius, 0.5 * radius, 1.7 * radius))
    # A sphere touches the ground in one point: the track is exact, and a turn scrubs no edges. It is wider than the
    # wheel, and collides with the ground alone.
    part = SubElement(link, "collision", name="tyre")
    add(SubElement(SubElement(part, "geometry"), "sphere"), "radius", radius)
    friction(part, 1.0)
    collide_as(part, UNDERCARRIAGE)
    visual = SubElement(link, "visual", name="tyre")
    add(visual, "pose", 0.0, 0.0, 0.0, 0.5 * math.pi, 0.0, 0.0)
    shape = SubElement(SubElement(visual, "geometry"), "cylinder")
    add(shape, "radius", radius)
    add(shape, "length", 0.5 * radius)
    joint = SubElement(model, "joint", name=side, type="revolute")
    add(joint, "parent", "base")
    add(joint, "child", f"{side}_wheel")
    axis = SubElement(joint, "axis")
    add(axis, "xyz", 0, 1, 0)


def _inertial(
    link: Element, mass_kg: float, size: tuple[float, float, float], x: float = 0.0, z: float = 0.0
) -> None:
    """Of a box of this size about (x, 0, z)."""
    a, b, c = (mass_kg * side**2 / 12.0 for side in size)
    inertial(link, mass_kg, (b + c, a + c, a + b), (x, 0.0, z))


def inertial(
    link: Element,
    mass_kg: float,
    moments_kgm2: tuple[float, float, float],
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Mass and moments of inertia about the axes through its centre, which is there."""
    element = SubElement(link, "inertial")
    add(element, "mass", mass_kg)
    add(element, "pose", *at, 0.0, 0.0, 0.0)
    inertia = SubElement(element, "inertia")
    for tag, moment in zip(("ixx", "iyy", "izz"), moments_kgm2, strict=True):
        add(inertia, tag, moment)


def friction(collision: Element, coefficient: float) -> Element:
    """The same in both directions; the element of it, which may name the first of them."""
    ode = SubElement(SubElement(SubElement(collision, "surface"), "friction"), "ode")
    add(ode, "mu", coefficient)
    add(ode, "mu2", coefficient)
    return ode


def lidar(link: Element, config: LidarConfig, at: tuple[float, float, float], yaw_rad: float) -> None:
    """A ray sensor at x, y, z of the link."""
    sensor = SubElement(link, "sensor", name="lidar", type="ray")
    add(sensor, "pose", *at, 0.0, 0.0, yaw_rad)
    # Asked for by the plugin once a control period, never by Gazebo's own clock, whose thread would wake at each step.
    add(sensor, "always_on", "false")
    add(sensor, "update_rate", 0.001)
    ray = SubElement(sensor, "ray")
    horizontal = SubElement(SubElement(ray, "scan"), "horizontal")
    angles = config.angles_rad
    SubElement(horizontal, "samples").text = str(config.num_beams)
    add(horizontal, "resolution", 1)
    add(horizontal, "min_angle", angles[0])
    add(horizontal, "max_angle", angles[-1])
    limits = SubElement(ray, "range")
    add(limits, "min", LEAST_RANGE_M)
    add(limits, "max", config.max_range_m)
    if config.noise_std_m > 0.0:
        noise = SubElement(ray, "noise")
        add(noise, "type", "gaussian")
        add(noise, "mean", 0.0)
        add(noise, "stddev", config.noise_std_m)
