"""adrl ros2 drive: a navigator without Nav2, which drives the robot to the goals that it gets."""

from adrl_bringup.node import launch_node
from launch import LaunchDescription

TASK = ["policy", "robot", "map", "guidance", "localisation", "goal_yaw"]
BASE = ["odom_frame", "map_frame", "base_frame", "stamped"]
TOPICS = ["scan", "cloud", "odom", "amcl_pose", "goal_pose", "cmd_vel", "plan"]


def generate_launch_description() -> LaunchDescription:
    return launch_node(
        "drive", name="adrl", settings=[*TASK, *BASE], topics={topic: topic for topic in TOPICS}
    )
