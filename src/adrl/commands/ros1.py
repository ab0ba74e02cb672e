"""adrl ros1."""

from collections.abc import Sequence

from adrl.commands.ros_nodes import run


def _split(arguments: Sequence[str]) -> tuple[Sequence[str], Sequence[str]]:
    """Ours, and with := ROS's."""
    theirs = [argument for argument in arguments if ":=" in argument]
    return [argument for argument in arguments if ":=" not in argument], theirs


def main(arguments: Sequence[str]) -> int:
    """Run a node."""
    return run("ros1", _split, arguments, "_stamped:=true scan:=front/scan __ns:=robot1")
