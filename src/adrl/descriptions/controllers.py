"""Controllers of Nav2 and of move_base: how each calls the limits that it drives a robot by."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Names:
    """Parameters of a controller; of several names for one thing the first that is there."""

    speed: tuple[str, ...]
    yaw_rate: tuple[str, ...]
    least_speed: tuple[str, ...] = ()
    """Below 0 where it drives backwards,"""
    least_when_left_out: float | None = None
    """and what it is, by the controller's documentation, where it is left out;"""
    backwards: tuple[str, ...] = ()
    """or as a number above 0;"""
    reverses: tuple[str, ...] = ()
    """or whether it drives backwards as fast as forwards, which it does not where that is left out."""
    accelerations: tuple[str, ...] = ()
    """All of them hold, whatever their signs: also those for braking."""
    yaw_accelerations: tuple[str, ...] = ()
    turns_on_the_spot: tuple[str, ...] = ()
    """A yaw rate that it uses, and no limit."""
    sideways: tuple[str, ...] = ()
    """Above 0 where the robot is omni-directional."""
    turning_radius: tuple[str, ...] = ()
    """Above 0 where it is car-like."""
    turns: str | None = None
    """Whether it turns the robot on the spot at all."""


_DWA = Names(
    speed=("max_vel_x",),
    least_speed=("min_vel_x",),
    least_when_left_out=0.0,
    yaw_rate=("max_vel_theta", "max_rot_vel", "max_vel_rot", "max_rotational_vel"),
    accelerations=("acc_lim_x", "decel_lim_x"),
    yaw_accelerations=("acc_lim_theta", "acc_lim_th", "decel_lim_theta"),
    sideways=("max_vel_y", "min_vel_y"),
)
_TEB = Names(
    speed=("max_vel_x",),
    backwards=("max_vel_x_backwards",),
    yaw_rate=("max_vel_theta",),
    accelerations=("acc_lim_x",),
    yaw_accelerations=("acc_lim_theta",),
    sideways=("max_vel_y",),
    turning_radius=("min_turning_radius",),
)
_MPPI = Names(
    speed=("vx_max",),
    least_speed=("vx_min",),
    yaw_rate=("wz_max",),
    accelerations=("ax_max", "ax_min"),
    yaw_accelerations=("az_max",),
)
_PURE_PURSUIT = Names(
    speed=("desired_linear_vel", "max_linear_vel"),
    reverses=("allow_reversing",),
    yaw_rate=("max_angular_vel",),
    accelerations=("max_linear_accel", "max_linear_decel"),
    yaw_accelerations=("max_angular_accel",),
    turns_on_the_spot=("rotate_to_heading_angular_vel",),
    turns="use_rotate_to_heading",
)
_GRACEFUL = Names(
    speed=("v_linear_max",),
    reverses=("allow_backward",),
    yaw_rate=("v_angular_max",),
    turns_on_the_spot=("v_angular_max_in_place",),
)
CAR_PLANNERS = ("SmacPlannerHybrid", "SmacPlannerLattice", "SmacPlanner")
"""Global planners that plan curves, and not for cars alone: their minimum_turning_radius hints at a car's."""
CONTROLLERS: dict[str, Names] = {
    **dict.fromkeys(("DWBLocalPlanner", "DWAPlannerROS", "TrajectoryPlannerROS", "NeoLocalPlanner"), _DWA),
    "TebLocalPlannerROS": _TEB,
    "MPPIController": _MPPI,
    "RegulatedPurePursuitController": _PURE_PURSUIT,
    "GracefulController": _GRACEFUL,
    "GracefulControllerROS": _DWA,
}
"""Class of a plugin, without its package -> the names of its parameters."""
SHIM = "RotationShimController"
"""Turns the robot before another controller, its primary_controller, drives it."""


def class_of(plugin: str) -> str:
    """nav2_mppi_controller::MPPIController -> MPPIController."""
    return plugin.replace("::", "/").rpartition("/")[2]
