"""The cells of `adrl regret`: expert, reward, place, robot and budget, fixed beforehand.

All levels make 6 x 2 x 2 x 2 = 48 cells. These twelve are a fraction of them in which every expert stands twice, the
second time with the other reward, place and robot (a foldover pair): each level of the three appears six times, each
expert meets all of them, and no two of the three go together (of twelve cells the pairs of levels hold 3 each for
reward and place, 3 each for reward and robot, 4 or 2 for place and robot). Twelve cells cannot balance the last, too.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from adrl.agents.config import TrainConfig
from adrl.comparison.config import CompareConfig
from adrl.rewards import RewardConfig

EPISODES = 200
"""Test tasks of each policy."""
DEMONSTRATION_STEPS = 10_000
VALIDATION_EPISODES = 20
"""Of the one validation, at the end: nothing is chosen by it."""

Reward = Literal["dense", "terminal"]
REWARDS: dict[Reward, RewardConfig] = {
    "dense": RewardConfig(),
    "terminal": RewardConfig(extra_terms=("no-approach",)),
}
GUIDANCE = {"clutter": "goal", "complex": "map"}
"""Of a place. Without the map dead ends decide in complex, not the methods: docs/reproduce.md."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One setting in which all methods are compared."""

    expert: str
    """As --expert takes it."""
    reward: Reward
    place: Literal["clutter", "complex"]
    robot: Literal["diffbot", "jackal"]
    steps: int
    """Budget of every method in environment steps, the demonstrations not counted."""

    @property
    def name(self) -> str:
        """Of the cell and of its folder; the expert's number is left out."""
        return "-".join((self.expert.partition(":")[0], self.reward, self.place, self.robot))

    def comparison(self, methods: str, seeds: int, out: Path) -> CompareConfig:
        """The comparison that fills the cell. Every method has the same one configuration, in every cell."""
        return CompareConfig(
            scenario=self.place,
            robot=self.robot,
            guidance=GUIDANCE[self.place],
            expert=self.expert,
            methods=methods,
            seeds=seeds,
            episodes=EPISODES,
            validation_episodes=VALIDATION_EPISODES,
            demonstration_steps=DEMONSTRATION_STEPS,
            keep_checkpoints=False,
            shares_compiled=True,
            out=out / self.name,
            learner=TrainConfig(
                steps=self.steps, eval_interval_steps=self.steps, reward=REWARDS[self.reward]
            ),
        )


def _cell(
    expert: str,
    reward: Reward,
    place: Literal["clutter", "complex"],
    robot: Literal["diffbot", "jackal"],
    steps: int,
) -> Cell:
    return Cell(expert=expert, reward=reward, place=place, robot=robot, steps=steps)


CELLS: dict[str, Cell] = {
    cell.name: cell
    for cell in (
        _cell("perfect", "terminal", "clutter", "diffbot", 65_536),
        _cell("perfect", "dense", "complex", "jackal", 65_536),
        _cell("slow:0.5", "dense", "clutter", "diffbot", 65_536),
        _cell("slow:0.5", "terminal", "complex", "jackal", 65_536),
        _cell("noisy:0.3", "dense", "clutter", "jackal", 20_480),
        _cell("noisy:0.3", "terminal", "complex", "diffbot", 65_536),
        _cell("narrow-shy:0.75", "terminal", "clutter", "jackal", 65_536),
        _cell("narrow-shy:0.75", "dense", "complex", "diffbot", 65_536),
        _cell("half-wise:0.5", "terminal", "clutter", "diffbot", 20_480),
        _cell("half-wise:0.5", "dense", "complex", "jackal", 65_536),
        _cell("few:5", "dense", "clutter", "diffbot", 20_480),
        _cell("few:5", "terminal", "complex", "jackal", 65_536),
    )
}
"""Name -> cell."""
