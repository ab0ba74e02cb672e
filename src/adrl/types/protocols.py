"""What scenarios and policies have to have, and the words that they share."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from adrl.types.robots import RobotConfig
from adrl.types.worlds import Task

ACTION_SIZE = 2
"""Numbers of an action: speed, yaw rate."""
GUIDANCE = ("goal", "replan", "map")
SPLITS = ("train", "validation", "test")


@runtime_checkable
class Scenario(Protocol):
    """A family of worlds. Register in adrl.worlds.SCENARIOS or pass the object itself."""

    @property
    def name(self) -> str:
        """What it is called; its tasks are seeded by it."""
        ...

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        """Draw a world and a solvable start and goal for this robot."""
        ...


@runtime_checkable
class Policy(Protocol):
    """Maps observations to normalised actions. What it may have besides act, all of it optional:

    name: in tables and files; that of its class by default. guidance: "goal" by default. robot: a RobotConfig, or the
    name of one: the robot it is made for, and drives where none is asked for; or a family of robots. encoder: an
    EncoderConfig, or an adrl.observation.Encoder of its own; EncoderConfig() by default. reset(rows): episodes of
    robots rows (M,) begin, for a policy with memory. training_worlds: fingerprints of the given worlds that it has
    learned from, () for one that learns nothing; unknown by default. See docs/guide/policy.md.
    """

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, D) observations -> (N, 2) actions in [-1, 1]: speed, yaw rate."""
        ...
