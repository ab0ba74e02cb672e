"""adrl ros2 controller in the place of Nav2's controller_server, its commands where Nav2's launch files have them."""

from adrl_bringup.node import launch_node
from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return launch_node(
        "controller",
        name="controller_server",
        settings=["policy", "robot", "odom_frame", "map_frame", "base_frame", "enable_stamped_cmd_vel"],
        topics={"scan": "scan", "cloud": "cloud", "odom": "odom", "cmd_vel": "cmd_vel_nav"},
    )
