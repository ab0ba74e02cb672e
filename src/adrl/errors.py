"""Every error ADRL raises on purpose. Each says what is wrong and what to do; the CLI prints it and exits with 2."""

from collections.abc import Iterable
from difflib import get_close_matches


def brief(text: object) -> str:
    """On one line and not long: what a message quotes of a file, or of another library's error."""
    return " ".join(str(text).split())[:200]


class AdrlError(Exception):
    """Base of all errors caused by the input, not by a fault in ADRL."""


class ConfigError(AdrlError):
    """A configuration value is outside its domain."""


class UnknownName(AdrlError):
    """A robot, scenario, method or policy that no registry lists."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        nearest = get_close_matches(name, known, n=1, cutoff=0.4)
        hint = f"did you mean {nearest[0]!r}? " if nearest else ""
        super().__init__(f"unknown {kind} {name!r}: {hint}known: {', '.join(known)}")


class FileError(AdrlError):
    """A file is missing, no ordinary file, too large or malformed. The text goes on from the file's name."""


class MapError(AdrlError):
    """A map file is missing, malformed or has no free cell."""


class WorldError(AdrlError):
    """A Gazebo world cannot be read or holds no usable geometry."""


class PlanningError(AdrlError):
    """Base of the planners' errors."""


class StartOccupied(PlanningError):
    """The start pose is in collision."""


class GoalOccupied(PlanningError):
    """The goal lies inside an obstacle or too near one for the robot."""


class NoPath(PlanningError):
    """Start and goal are free but not connected for this robot."""


class NoRoomToTurn(PlanningError):
    """A robot at its goal cannot turn to the heading asked for."""


class GoalRefused(AdrlError):
    """Base of the reasons for which a robot does not take a goal; what it was doing before goes on."""


class BadGoal(GoalRefused):
    """The goal is not finite."""


class UnknownFrame(GoalRefused):
    """The goal is in a frame that is neither that of the odometry nor that of the map."""


class NotLocalised(GoalRefused):
    """The goal needs the robot's place on the map, which nothing has told."""


class TransformError(AdrlError):
    """A transform between two frames is missing, stale or of the future."""


class TaskError(AdrlError):
    """No task that meets the request could be drawn from a world."""


class CheckpointError(AdrlError):
    """A run folder, policy or checkpoint is truncated, foreign or of another shape."""


class DatasetError(AdrlError):
    """A demonstration dataset is missing, malformed or of another shape."""


class MissingExtra(AdrlError):
    """An optional dependency is needed and not installed."""

    @classmethod
    def of(cls, error: ModuleNotFoundError) -> "MissingExtra":
        """Of a package's own module that was not found, where adrl was installed without its dependencies."""
        module = str(error.name).partition(".")[0]
        package = {"yaml": "pyyaml", "PIL": "pillow"}.get(module, module)
        return cls(f"the module {module} is not installed; run: pip install {package}")

    @classmethod
    def named(cls, extra: str, what: str, otherwise: str = "") -> "MissingExtra":
        """Of an extra of this package. what: what needs it. otherwise: what else can be done."""
        return cls(f"{what} needs the extra {extra}; run: pip install 'adrl[{extra}]'{otherwise}")
