"""Options of the commands that drive a policy on fixed tasks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from adrl import api
from adrl.types import RobotConfig
from adrl.worlds import load_robot
from adrl.worlds.place import Place


@dataclass(frozen=True, kw_only=True)
class PolicyOptions(Place):
    """Which policy drives where."""

    policy: str = api.DEFAULT
    """astar-mppi or another planner, a shipped policy (adrl list), a run folder, or one of your own: module:object, the
    model.onnx of adrl export, a model.zip of Stable-Baselines3, or a name that an installed package offers."""
    robot: str | None = None
    """A robot's name (adrl list) or a TOML file; the one the policy was trained on when left out."""
    guidance: Literal["goal", "replan", "map"] | None = None
    """goal: the policy sees the final goal; replan: the same, and waypoints on a map of its own scans when blocked;
    map: a waypoint on the A* path of the known map. As trained when left out."""
    split: Literal["train", "validation", "test"] = "test"
    """Which tasks: task i of a split is the same for ever."""

    def driven_robot(self) -> RobotConfig:
        """The robot that drives. Raises AdrlError."""
        return load_robot(self.robot) if self.robot else api.robot_of(self.policy)


@dataclass(frozen=True, kw_only=True)
class DrivesOptions(PolicyOptions):
    """What noise there is, and where the results go."""

    seed: int = 0
    """Of the sensors' noise; the tasks stay the same."""
    json: Path | None = None
    """File for the results; - prints them."""


@dataclass(frozen=True, kw_only=True)
class TasksOptions(DrivesOptions):
    """On how many tasks."""

    episodes: int = api.EPISODES
    """Tasks to drive, one episode each."""
