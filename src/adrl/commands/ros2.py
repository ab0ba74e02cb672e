"""adrl ros2."""

from collections.abc import Sequence

from adrl.commands.ros_nodes import run

ROS_ARGUMENTS = "--ros-args"


def split(arguments: Sequence[str]) -> tuple[Sequence[str], Sequence[str]]:
    """Ours, and from --ros-args on ROS's."""
    at = list(arguments).index(ROS_ARGUMENTS) if ROS_ARGUMENTS in arguments else len(arguments)
    return arguments[:at], arguments[at:]


def main(arguments: Sequence[str]) -> int:
    """Run a node."""
    return run("ros2", split, arguments, "--ros-args -p use_sim_time:=true -r scan:=front/scan")
