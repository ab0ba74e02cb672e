"""adrl ros1 and adrl ros2: the same nodes and options, of two generations."""

from collections.abc import Callable, Sequence
from importlib import import_module

from adrl.commands.options import load_place, parse, subcommand
from adrl.integrations.ros.config import NUMBERS, ControllerConfig, DriveConfig, SimConfig

Split = Callable[[Sequence[str]], tuple[Sequence[str], Sequence[str]]]
"""Arguments -> ours, and those of ROS."""


def run(command: str, split: Split, arguments: Sequence[str], example: str) -> int:
    """Run a node of ros1 or ros2, which is imported when it is known that it runs."""

    def drive(arguments: Sequence[str]) -> int:
        ours, theirs = split(_apart(arguments))
        config = parse(DriveConfig, ours, f"{command} drive", "Drive a robot to the goals it gets.")
        import_module(f"adrl.integrations.{command}.drive").drive(config, theirs)
        return 0

    def sim(arguments: Sequence[str]) -> int:
        ours, theirs = split(_apart(arguments))
        config = parse(SimConfig, ours, f"{command} sim", "A simulated robot on the topics of one.")
        load_place(config)
        import_module(f"adrl.integrations.{command}.sim").sim(config, theirs)
        return 0

    def controller(arguments: Sequence[str]) -> int:
        ours, theirs = split(_apart(arguments))
        about = "Follow the paths of Nav2's planners, in the place of its controller_server."
        config = parse(ControllerConfig, ours, f"{command} controller", about)
        import_module(f"adrl.integrations.{command}.controller").controller(config, theirs)
        return 0

    kinds = {
        "drive": ("drive a robot to the goals it gets", drive),
        "sim": ("a simulated robot on the topics of one", sim),
    }
    if command == "ros2":
        kinds["controller"] = ("follow paths in the place of Nav2's controller_server", controller)
    return subcommand(command, "node", kinds, arguments, f"\nROS's own arguments go with them: {example}")


def _apart(arguments: Sequence[str]) -> list[str]:
    """Numbers that are given as 1,2,0.5 one by one."""
    out: list[str] = []
    for argument in arguments:
        of_numbers = bool(out) and out[-1].removeprefix("--") in NUMBERS
        out += argument.split(",") if of_numbers else [argument]
    return out
