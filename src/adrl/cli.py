"""The command line. Only the command that runs is imported, so help comes at once."""

import sys
import time
from collections.abc import Sequence
from importlib import import_module

from adrl.errors import AdrlError, MissingExtra

STARTED_S = time.monotonic()
"""When the program began: training's wall clock counts from here."""

COMMANDS = {
    "demo": "the main job in one go: drive, train for a minute, evaluate, draw",
    "robot": "write a robot file from Nav2 parameters, a URDF or a bag; draw a robot with its LiDAR",
    "train": "train a policy",
    "evaluate": "drive a policy on fixed tasks and report success, time and distance with intervals",
    "compare": "train and evaluate many methods with many seeds, and compare them in one table",
    "barn": "drive a policy in worlds of the BARN benchmark and score it",
    "gazebo": "drive policies in Gazebo, measure the gap to our simulator, export worlds",
    "ros1": "drive a robot with ROS 1, or be one: drive, sim",
    "ros2": "drive a robot with ROS 2, be one, or be Nav2's controller: drive, sim, controller",
    "calibrate": "fit the simulator's base to recorded drives",
    "view": "watch and steer drives live, in a browser on this machine",
    "report": "write one HTML file of a run or a comparison: curves, tables, replays, failures",
    "regret": "compare methods by how far each is behind the best, over experts, rewards, places and robots",
    "reproduce": "run the paper's experiments again: figures, tables and what does not reproduce",
    "collect": "record demonstrations as a Minari dataset",
    "export": "write a policy as an ONNX model, or for the C++ example",
    "bench": "measure one of: sim, plan, act, faults, learn, gazebo, ros2, nav2",
    "list": "list robots, scenarios, methods and policies",
}


BAD_PATHS = (FileNotFoundError, FileExistsError, PermissionError, NotADirectoryError, IsADirectoryError)
"""Errors of the system that an option caused; others, such as a full disk, are failures."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Exit codes: 0 good, 1 failed, 2 bad input."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        _print_help()
        return 0 if arguments else 2
    if arguments[0] == "--version":
        from importlib.metadata import version

        print(version("adrl"))
        return 0
    name, rest = arguments[0], arguments[1:]
    try:
        if name not in COMMANDS:
            from adrl.errors import UnknownName

            raise UnknownName("command", name, COMMANDS)
        return import_module(f"adrl.commands.{name}").main(rest)
    except AdrlError as error:
        print(f"adrl: error: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith(("adrl", "_adrl")):
            raise
        print(f"adrl: error: {MissingExtra.of(error)}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"adrl: error: {error.strerror or error}: {error.filename or ''}".rstrip(": "), file=sys.stderr)
        return 2 if isinstance(error, BAD_PATHS) else 1
    except KeyboardInterrupt as stop:  # training says how to go on
        print(f"adrl: {str(stop) or 'stopped'}", file=sys.stderr)
        return 1


def _print_help() -> None:
    width = max(map(len, COMMANDS))
    print("usage: adrl COMMAND [OPTIONS]\n\nTrain and evaluate LiDAR navigation policies.\n\ncommands:")
    for name, text in COMMANDS.items():
        print(f"  {name:<{width}}  {text}")
    print("\nadrl COMMAND --help explains the options of a command; adrl --version tells the version.")


if __name__ == "__main__":
    sys.exit(main())
