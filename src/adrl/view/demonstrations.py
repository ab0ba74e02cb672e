"""Demonstrations of a person who drives on the page, as adrl train --dataset takes them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl.envs.nav_sim import NavSim
from adrl.envs.steps import Outcome
from adrl.errors import ConfigError
from adrl.imitation import require_minari
from adrl.observation import EncoderConfig
from adrl.types import RobotConfig, Scenario

F32 = NDArray[np.float32]


class Recorder:
    """Steps of one robot's drives in its simulator, which shows goals as guidance `goal` does."""

    def __init__(self, robot: RobotConfig, scenario: Scenario) -> None:
        """Raises MissingExtra without Minari: nobody drives for nothing."""
        require_minari()
        self.robot, self.scenario = robot, scenario
        self._steps: list[dict[str, Any]] = []
        self._under_way = False
        self.arrivals = self.episodes = 0

    def __len__(self) -> int:
        return len(self._steps)

    def add(self, sim: NavSim, seen: F32, action: F32, outcome: Outcome) -> None:
        """A step of robot 0: seen (1, D) before it, action (1, 2) executed. Nothing is learnt from waiting to begin."""
        if not self._under_way and not np.abs(sim.b["command"][0]).max() > 0.0:
            return
        self._under_way = True
        terminated = bool(outcome.reached[0] or outcome.collided[0])
        self._steps.append(
            {
                "observation": seen[0],
                "action": action[0],
                "expert_action": action[0],
                "next_observation": sim.observe()[0],
                "reward_terms": outcome.reward_terms[0],
                "features": outcome.features[0],
                "terminated": terminated,
                "truncated": False,
            }
        )
        if terminated:
            self.arrivals += int(outcome.reached[0])
            self._end()

    def cut(self) -> None:
        """The drive ends here: another goal, another start, or nobody records any more."""
        if self._under_way:
            self._steps[-1]["truncated"] = True
            self._end()

    def _end(self) -> None:
        self.episodes += 1
        self._under_way = False

    def save(self, out: Path) -> Path:
        """Write what there is to a new folder, out or out-2, out-3 ..., and begin anew. Raises ConfigError for nothing,
        DatasetError, OSError."""
        from adrl.imitation import Demonstrations, Source, save_minari
        from adrl.worlds.given import training_fingerprints

        self.cut()
        if not self._steps:
            raise ConfigError("nothing is recorded yet; choose the policy 'by hand', record, and drive")
        columns = {name: np.array([step[name] for step in self._steps]) for name in self._steps[0]}
        source = Source(
            robot=self.robot,
            encoder=EncoderConfig(),
            guidance="goal",
            scenario=self.scenario.name,
            demonstrator="a person, in adrl view",
            worlds=tuple(sorted(training_fingerprints(self.scenario))),
        )
        path = next(place for place in _places(out) if not place.exists())
        save_minari(Demonstrations(**columns), path, source)
        self._steps, self.arrivals, self.episodes = [], 0, 0
        return path


def _places(out: Path) -> Iterator[Path]:
    yield out
    number = 2
    while True:
        yield out.with_name(f"{out.name}-{number}")
        number += 1
