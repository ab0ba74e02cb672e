"""Parameter files of Nav2, made of a robot: the opposite of what adrl.descriptions reads."""

from pathlib import Path
from typing import Any

import yaml

from adrl.types import RobotConfig


def dwb(robot: RobotConfig) -> dict[str, Any]:
    """As dwb_core calls it; brakes have a sign."""
    return {
        "plugin": "dwb_core::DWBLocalPlanner",
        "max_vel_x": robot.max_speed_mps,
        "min_vel_x": robot.min_speed_mps,
        "max_vel_y": 0.0,
        "max_vel_theta": robot.max_yaw_rate_radps,
        "acc_lim_x": robot.max_acceleration_mps2,
        "decel_lim_x": -robot.max_acceleration_mps2,
        "acc_lim_theta": robot.max_yaw_acceleration_radps2,
        "decel_lim_theta": -robot.max_yaw_acceleration_radps2,
    }


def mppi(robot: RobotConfig) -> dict[str, Any]:
    """As nav2_mppi_controller calls it."""
    return {
        "plugin": "nav2_mppi_controller::MPPIController",
        "motion_model": "DiffDrive",
        "vx_max": robot.max_speed_mps,
        "vx_min": robot.min_speed_mps,
        "vy_max": 0.5,
        "wz_max": robot.max_yaw_rate_radps,
        "ax_max": robot.max_acceleration_mps2,
        "ax_min": -robot.max_acceleration_mps2,
        "az_max": robot.max_yaw_acceleration_radps2,
    }


def teb(robot: RobotConfig) -> dict[str, Any]:
    """As teb_local_planner calls it."""
    return {
        "plugin": "teb_local_planner::TebLocalPlannerROS",
        "max_vel_x": robot.max_speed_mps,
        "max_vel_x_backwards": -robot.min_speed_mps,
        "max_vel_y": 0.0,
        "max_vel_theta": robot.max_yaw_rate_radps,
        "acc_lim_x": robot.max_acceleration_mps2,
        "acc_lim_theta": robot.max_yaw_acceleration_radps2,
        "min_turning_radius": 0.0,
    }


def pure_pursuit(robot: RobotConfig) -> dict[str, Any]:
    """Regulated pure pursuit: of yaw rates it knows only that of turning on the spot, and no acceleration."""
    return {
        "plugin": "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
        "desired_linear_vel": robot.max_speed_mps,
        "rotate_to_heading_angular_vel": 0.5 * robot.max_yaw_rate_radps,
        "max_angular_accel": robot.max_yaw_acceleration_radps2,
        "allow_reversing": robot.min_speed_mps < 0.0,
    }


CONTROLLERS = {"dwb": dwb, "mppi": mppi, "teb": teb, "pure_pursuit": pure_pursuit}


def smoother(robot: RobotConfig) -> dict[str, Any]:
    """The velocity smoother."""
    rise = [robot.max_acceleration_mps2, 0.0, robot.max_yaw_acceleration_radps2]
    return {
        "max_velocity": [robot.max_speed_mps, 0.0, robot.max_yaw_rate_radps],
        "min_velocity": [robot.min_speed_mps, 0.0, -robot.max_yaw_rate_radps],
        "max_accel": rise,
        "max_decel": [-value for value in rise],
    }


def parameters(robot: RobotConfig, controller: str = "dwb") -> dict[str, Any]:
    """All that Nav2 is told of a robot."""
    if robot.radius_m is not None:
        shape: dict[str, Any] = {"robot_radius": robot.radius_m}
    else:
        shape = {"footprint": str([list(corner) for corner in robot.footprint_m or ()])}
    scan = {
        "topic": "/front/scan",
        "data_type": "LaserScan",
        "obstacle_max_range": robot.lidar.max_range_m,
        "raytrace_max_range": robot.lidar.max_range_m + 0.5,
    }
    layer = {"plugin": "nav2_costmap_2d::ObstacleLayer", "observation_sources": "scan", "scan": scan}

    def costmap(frame: str) -> dict[str, Any]:
        own = {"global_frame": frame, "robot_base_frame": "base_footprint", "obstacle_layer": layer, **shape}
        return {"ros__parameters": own}

    return {
        "amcl": {"ros__parameters": {"robot_model_type": "nav2_amcl::DifferentialMotionModel"}},
        "controller_server": {
            "ros__parameters": {
                "controller_frequency": 1.0 / robot.control_period_s,
                "controller_plugins": ["FollowPath"],
                "FollowPath": CONTROLLERS[controller](robot),
            }
        },
        "local_costmap": {"local_costmap": costmap("odom")},
        "global_costmap": {"global_costmap": costmap("map")},
        "velocity_smoother": {"ros__parameters": smoother(robot)},
    }


def write(path: Path, content: dict[str, Any]) -> Path:
    """As YAML."""
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path
