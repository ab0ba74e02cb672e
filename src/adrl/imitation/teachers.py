"""Policies that answer in an expert's place, in tasks like those that they were trained in: policy distillation.

What a planner does with the goal alone follows from what it remembers, which a policy of one observation cannot know; a
policy that reinforcement has made does only what can be told from an observation, so all of it can be learnt.
"""

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from adrl.deploy.policy import MlpPolicy, load_policy, resolve_policy
from adrl.deploy.setup import Setup, setup_of
from adrl.errors import CheckpointError
from adrl.imitation.experts import Driver, Expert
from adrl.registry import listed
from adrl.worlds.place import split_guidance

if TYPE_CHECKING:
    from adrl.envs import NavVectorEnv

F32 = NDArray[np.float32]
UNKNOWN, NOBODY = -2, -1
"""Who teaches a task: not looked up yet, and no policy."""


def tasks_of(places: Sequence[str], guidances: Sequence[str]) -> frozenset[tuple[str, str]]:
    """(scenario, guidance) of the tasks of such a run. guidances: NAME or NAME@PLACE."""
    return frozenset(
        (place, guidance)
        for guidance, own in map(split_guidance, guidances)
        for place in places
        if own in ("", place)
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Teacher:
    """A policy, and what it teaches."""

    policy: MlpPolicy
    setup: Setup
    tasks: frozenset[tuple[str, str]]
    """(scenario, guidance) of the tasks that it was trained in."""

    @classmethod
    def of(cls, policy: str | os.PathLike[str]) -> Self:
        """A run's folder, or a shipped policy. Raises CheckpointError."""
        try:
            loaded = load_policy(resolve_policy(policy))
        except CheckpointError as error:
            raise CheckpointError(f"teachers: {error}") from None
        config = loaded.config
        environment = config.table("environment")
        places = listed(str(environment.get("scenario", "")))
        guidances = environment.get("placed_guidances") or environment.get("guidances") or (config.guidance,)
        return cls(policy=loaded, setup=setup_of(loaded), tasks=tasks_of(places, guidances))

    @property
    def taught(self) -> list[str]:
        """GUIDANCE@SCENARIO of what it teaches."""
        return [f"{guidance}@{place}" for place, guidance in sorted(self.tasks)]

    @property
    def about(self) -> dict[str, Any]:
        """What is told of it beside the policies that it has taught: of what run it is, and how long that took."""
        config = self.policy.config
        return {
            "taught": self.taught,
            "fingerprint": self.policy.fingerprint,
            "train_seconds": config.extra.get("train_seconds"),
            "settings": {name: value for name, value in config.table("settings").items() if name != "out"},
        }

    def __str__(self) -> str:
        return f"{','.join(self.taught)} {self.policy.fingerprint}"


@dataclass(frozen=True)
class Taught:
    """An expert, but for the tasks that one of its teachers was trained in: there it is the first of those."""

    expert: Expert
    teachers: tuple[Teacher, ...]

    def __str__(self) -> str:
        return "; ".join(map(str, (self.expert, *self.teachers)))

    @property
    def tasks(self) -> frozenset[tuple[str, str]]:
        """(scenario, guidance) of what the teachers answer for."""
        return frozenset[tuple[str, str]]().union(*(teacher.tasks for teacher in self.teachers))

    @property
    def planner(self) -> str | None:
        """The expert's."""
        return getattr(self.expert, "planner", None)

    def driver(self, env: "NavVectorEnv", seed: int) -> Driver:
        """Raises ConfigError."""
        return _TaughtDriver(env, self.expert.driver(env, seed), self.teachers)


class _TaughtDriver(Driver):
    def __init__(self, env: "NavVectorEnv", driver: Driver, teachers: Sequence[Teacher]) -> None:
        super().__init__(env)
        self._driver, self._teachers = driver, teachers
        self._teacher = np.full(env.num_tasks, UNKNOWN)

    def advising(self) -> AbstractContextManager[None]:
        return self._driver.advising()

    def within_reach(self, actions: F32) -> F32:
        """The expert's limits are not its teachers'."""
        return np.where(
            self._driver.asked[:, None], self._driver.within_reach(actions), super().within_reach(actions)
        )

    def actions(self) -> F32:
        env, task = self.env, self.env.task_index
        for new in np.unique(task[self._teacher[task] == UNKNOWN]):
            self._teacher[new] = self._whose(int(new))
        teacher = self._teacher[task]
        self._driver.asked = teacher == NOBODY
        actions = self._driver.actions()
        self.given_up = self._driver.given_up & self._driver.asked
        if (teacher != NOBODY).any():
            observation = env.sim.observe()
            for number, one in enumerate(self._teachers):
                rows = teacher == number
                actions[rows] = one.policy.act(observation[rows])
        return actions

    def _whose(self, task: int) -> int:
        """The number of the teacher who was trained in such tasks, or NOBODY."""
        env = self.env
        kind = (env.scenario_of_task(task).name, env.kinds[env.kind_of_task(task)].guidance)
        return next((n for n, one in enumerate(self._teachers) if kind in one.tasks), NOBODY)
