"""Pools of tasks, of one robot in one kind of place or of a mixture of both."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from adrl.envs.kinds import Kind
from adrl.errors import ConfigError, TaskError
from adrl.types import RobotConfig, Scenario, Task
from adrl.worlds import task_set
from adrl.worlds.place import split_guidance

LOG = logging.getLogger("adrl.envs")
MOST_TRIES = 32
"""Robots that are tried for one task."""


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """What the tasks of a pool are made of. Raises ConfigError where there is nothing of one thing."""

    robots: Sequence[RobotConfig | Kind]
    """Taken in turn: as many tasks for each. A Kind brings its guidance, a robot alone is given one of guidances."""
    guidances: Sequence[str]
    """NAME, or NAME@PLACE for a guidance that is drawn in one of the scenarios alone."""
    scenarios: Sequence[Scenario]

    def __post_init__(self) -> None:
        for what, things in vars(self).items():
            if not things:
                raise ConfigError(f"there are no {what} to draw tasks of; give one or more")
        places = [scenario.name for scenario in self.scenarios]
        for name, place in map(split_guidance, self.guidances):
            if place and place not in places:
                raise ConfigError(
                    f"guidance {name}@{place} is for a place that is not trained in; give one of {', '.join(places)}"
                )
        for place in places:
            if not any(own in ("", place) for _, own in map(split_guidance, self.guidances)):
                raise ConfigError(f"there is no guidance for {place}; give one without a place, or for it")

    def entry(self, number: int) -> tuple[Kind, Scenario]:
        """Whose task `number` is, and where: the same for ever, whatever the pool's size."""
        robot, guidance, scenario = (
            self.robots[number % len(self.robots)],
            self.guidances[0],
            self.scenarios[0],
        )
        if len(self.guidances) > 1 or len(self.scenarios) > 1:
            rng = np.random.default_rng((number, crc32(b"mixture")))
            guidance = self.guidances[int(rng.integers(len(self.guidances)))]
            scenario = self.scenarios[int(rng.integers(len(self.scenarios)))]
            while split_guidance(guidance)[1] not in ("", scenario.name):
                guidance = self.guidances[int(rng.integers(len(self.guidances)))]
        guidance, _ = split_guidance(guidance)
        return robot if isinstance(robot, Kind) else Kind(robot=robot, guidance=guidance), scenario


@dataclass(eq=False)
class TaskPool:
    """The first `size` tasks of a split, each made when it is first asked for. Copies share what is made.

    Where the robots are several and a task's own has none, as it fits through no gap there, the next robot that has one
    takes its place, which the log says.
    """

    mixture: Mixture
    split: str
    size: int
    kinds: tuple[Kind, ...] = field(init=False)
    """Those that the tasks are of."""
    kind: NDArray[np.intp] = field(init=False)
    """(size,) which of the kinds each task is of, by its number; known for good once the task is made."""

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ConfigError(f"task_pool is {self.size}; give 1 or more")
        numbers: dict[Kind, int] = {}
        entries = [self.mixture.entry(i) for i in range(self.size)]
        self.kind = np.array([numbers.setdefault(kind, len(numbers)) for kind, _ in entries])
        self.kinds = tuple(numbers)
        self._scenarios = [scenario for _, scenario in entries]
        self._tasks: dict[int, tuple[Task, Scenario]] = {}

    def __getitem__(self, index: int) -> Task:
        """Task `index` of the split. Raises TaskError where no robot has one."""
        if index not in self._tasks:
            self.kind[index], self._tasks[index] = self._made(index)
        return self._tasks[index][0]

    def scenario(self, index: int) -> Scenario:
        """Where task `index` is. Raises TaskError where no robot has one."""
        self[index]
        return self._tasks[index][1]

    def _made(self, index: int) -> tuple[int, tuple[Task, Scenario]]:
        """A task, where it is, and the kind that it is of."""
        tries = min(self.size, MOST_TRIES) if len(self.kinds) > 1 else 1
        for number in (np.arange(index, index + tries) % self.size).tolist():
            kind, _ = self.mixture.entry(number)
            try:
                scenario = self._scenarios[number]
                task = task_set(scenario, kind.robot, self.split, 1, first=number)[0]
            except TaskError as error:
                if tries == 1 or number == (index + tries - 1) % self.size:
                    raise
                LOG.warning("robot %s is left out of task %d: %s", kind.robot.name, number, error)
            else:
                return self.kinds.index(kind), (task, scenario)
        raise AssertionError("one try or more was made")

    def __deepcopy__(self, memo: dict[int, Any]) -> "TaskPool":
        return self  # tasks never change

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_tasks": {}}  # a task's number says all of it
