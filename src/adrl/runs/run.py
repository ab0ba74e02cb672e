"""A training run, resolved: objects, nothing left to look up. Made once, at the door, and handed on."""

import functools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from adrl.agents.config import TrainConfig
from adrl.agents.interface import Validation
from adrl.agents.methods import method_name
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.envs import Kind, Mixture, NavVectorEnv, Setting
from adrl.envs.mixture import TaskPool
from adrl.errors import ConfigError
from adrl.evaluation.rollout import Rewards, rollout
from adrl.imitation import Expert
from adrl.imitation.best_planner import Trial
from adrl.imitation.teachers import tasks_of
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.runs.config import RunConfig
from adrl.runs.expert import expert_of
from adrl.runs.fine_tuning import Start, beginning_with_a_policy
from adrl.runs.record import about_policy
from adrl.simulators import NATIVE, Simulator, find_simulator
from adrl.types import RobotConfig, Scenario, Task
from adrl.worlds import RobotFamily, load_robots


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """What a run is made of."""

    config: RunConfig
    """As it was asked for: sizes, budgets and files."""
    scenarios: tuple[Scenario, ...]
    robot: RobotConfig | RobotFamily
    learner: TrainConfig
    """As the method has it."""
    guidances: tuple[str, ...]
    replanner: ReplannerConfig
    encoder: EncoderConfig
    taken_as: RobotConfig | None
    """The robot as the policy takes it: another one where it began as another robot's; None for a family, whose robots
    are taken as they are."""
    expert: Expert
    simulator: Simulator | None
    """None for ours."""
    start: Start | None
    """The policy that fine-tuning begins with."""
    folder: Path

    @classmethod
    def of(cls, config: RunConfig) -> Self:
        """Look up all that the configuration names. Raises AdrlError."""
        start = None if config.fine_tune is None else Start.of(config.fine_tune)
        config = config if start is None else start.begun(config)
        if config.demonstration_rounds > 0:
            config = beginning_with_a_policy(config)
        scenarios, robot = config.load_all(), load_robots(config.robot)
        _require_native(config, robot)
        if isinstance(robot, RobotFamily):
            config = _of_family(config, robot, start)
        taken_as = _taken_as(config, robot, start)
        return cls(
            config=config,
            scenarios=scenarios,
            robot=robot,
            learner=config.resolved(),
            guidances=config.guidances,
            replanner=config.resolved_replanner(),
            encoder=config.encoder,
            taken_as=taken_as,
            expert=expert_of(config, scenarios, robot, taken_as),
            simulator=find_simulator(config.env),
            start=start,
            folder=config.out or _default_folder(config, scenarios, robot),
        )

    @property
    def tasks(self) -> frozenset[tuple[str, str]]:
        """(scenario, guidance) of what it trains in."""
        return tasks_of([scenario.name for scenario in self.scenarios], self.config.placed_guidances)

    @property
    def stop_within_m(self) -> float:
        """See RobotConfig.slowed: the policy asks for no greater speed; infinite for any."""
        given = self.config.stop_within_m
        return math.inf if given is None else given

    @property
    def num_threads(self) -> int:
        """0, one a core, for fine-tuning, which is waited for; 1 for others, of which several run side by side."""
        return 1 if self.start is None else 0

    @property
    def demonstration_steps(self) -> int:
        """Steps to collect where none are said: few for fine-tuning, as a slow planner's would take half of it."""
        given = self.config.demonstration_steps
        return given if given is not None else (10_000 if self.start is None else 3_000)

    def make_env(self, num_envs: int, **options: Any) -> NavVectorEnv:
        """The environment of training, with the learner's reward and first S. options: of NavVectorEnv."""
        learner, task_pool = self.learner, options.get("task_pool", self.config.task_pool)
        given = {
            "scenario": self.scenarios,
            "robot": self.robots("train", task_pool),
            "guidance": self.config.placed_guidances,
            "replanner": self.replanner,
            "task_pool": task_pool,
            "task_priority": 0.0,
            "encoder": self.encoder,
            "taken_as": self.taken_as,
            "reward_config": learner.reward,
            "maturity": 0.0 if learner.measures_maturity else learner.static_maturity,
            "num_threads": self.num_threads,
        }
        return NavVectorEnv(num_envs, **given | options)

    def about_policy(self, planner: Trial | None = None, **setup_seconds: float) -> PolicyConfig:
        """What is saved with the policy; see about_policy."""
        return about_policy(self, planner, setup_seconds)

    def validation(self) -> Callable[[MlpPolicy, float], Validation]:
        """Drives the first validation tasks, drawn when first asked for, all side by side."""
        learner = self.learner

        @functools.cache
        def pool() -> tuple[TaskPool, list[Task]]:
            count = self.config.validation_episodes
            pool = TaskPool(self.mixture("validation", count), "validation", count)
            return pool, [pool[i] for i in range(count)]

        def evaluate(policy: MlpPolicy, maturity: float) -> Validation:
            drawn, driven = pool()
            settings = [
                Setting(
                    robot=kind.robot,
                    guidance=kind.guidance,
                    encoder=self.encoder,
                    replanner=self.replanner,
                    maturity=policy.config.maturity,
                    taken_as=kind.taken_as,
                )
                for kind in drawn.kinds
            ]
            result = rollout(
                policy,
                driven,
                settings,
                kinds=drawn.kind.tolist(),
                num_threads=self.num_threads,
                rewards=Rewards(config=learner.reward, gamma=learner.td3.gamma, maturity=maturity),
            )
            solved = result.episodes.success
            limits_s = [task.time_limit_s for task in driven]
            return Validation(
                success=float(solved.mean()),
                seconds=float(np.where(solved, result.episodes.time_s, limits_s).mean()),
                start=result.start,
                discounted_return=float(result.discounted_return.mean()),
            )

        return evaluate

    def robots(self, split: str, count: int) -> Sequence[RobotConfig]:
        """The robot, or of a family one for each of `count` tasks of a split.

        Each seed trains with robots of its own: those of seed s are s * SEED_ROBOTS and on. All are validated with the
        same ones.
        """
        if isinstance(self.robot, RobotConfig):
            return (self.robot,)
        first = self.learner.seed * SEED_ROBOTS if split == "train" else 0
        return [self.robot.draw(split, first + i).slowed(self.stop_within_m) for i in range(count)]

    def mixture(self, split: str, count: int) -> Mixture:
        """What `count` tasks of a split are made of."""
        robots: Sequence[RobotConfig | Kind] = self.robots(split, count)
        if isinstance(self.robot, RobotConfig):
            robots = [Kind(robot=self.robot, guidance=g, taken_as=self.taken_as) for g in self.guidances]
        return Mixture(robots=robots, guidances=self.config.placed_guidances, scenarios=self.scenarios)


SEED_ROBOTS = 1_000_000
"""Training robots that belong to one seed: as many as a pool may have tasks."""
STOP_WITHIN_M = 0.3
"""Of a family, if nothing else is said: see RunConfig.stop_within_m, and docs/decisions.md for what more costs."""
REACH_M = 10.0
"""Where the scale of the scan's distances ends for a policy of a family, if nothing else is said: farther is free."""


def _require_native(config: RunConfig, robot: RobotConfig | RobotFamily) -> None:
    """Raises ConfigError for several robots, places or guidances where one of each is wanted."""
    if isinstance(robot, RobotConfig) and config.placed_guidances != config.guidances:
        raise ConfigError(
            f"guidance {config.guidance}: @PLACE is for families of robots, and {robot.name} is one robot; "
            "leave out @PLACE"
        )
    given = {"robot": robot.name, "scenario": config.scenario, "guidance": config.guidance}
    several = {
        "robot": isinstance(robot, RobotFamily),
        "scenario": len(config.load_all()) > 1,
        "guidance": len(config.guidances) > 1,
    }
    for name in (name for name, is_so in several.items() if is_so):
        if config.env != NATIVE:
            raise ConfigError(
                f"{name} {given[name]} is several, and {config.env} drives one; give one, or leave out env"
            )
        if config.dataset is not None:
            raise ConfigError(
                f"{name} {given[name]} is several, and a dataset is of one; give one, or leave out dataset"
            )


def _of_family(config: RunConfig, family: RobotFamily, start: Start | None) -> RunConfig:
    """The run of a family: the policy is told of the body, metres read the same for all of its robots, none drives
    faster than it stops within a few of them, and one that learns by waypoints alone is shown no other point later.

    Raises ConfigError for a policy to begin with that is not.
    """
    if start is not None and not start.setup.encoder.body:
        raise ConfigError(
            f"robot {family.name} is a family, and the policy of fine_tune is not told of the body: it was trained for "
            f"robot {start.setup.robot and start.setup.robot.name}; leave out fine_tune, or give one robot"
        )
    encoder = config.encoder
    if start is None:
        encoder = replace(encoder, body=True, reach_m=REACH_M if encoder.reach_m is None else encoder.reach_m)
    replanner = config.replanner
    if start is None and replanner.near is None:
        replanner = replace(replanner, near=config.guidances == ("map",))
    stop_within_m = STOP_WITHIN_M if config.stop_within_m is None else config.stop_within_m
    return replace(config, encoder=encoder, replanner=replanner, stop_within_m=stop_within_m)


def _taken_as(config: RunConfig, robot: RobotConfig | RobotFamily, start: Start | None) -> RobotConfig | None:
    if isinstance(robot, RobotFamily):
        return None
    taken_as = robot if start is None else start.setup.taken_as(robot)
    return taken_as if config.stop_within_m is None else taken_as.slowed(config.stop_within_m)


def _default_folder(
    config: RunConfig, scenarios: Sequence[Scenario], robot: RobotConfig | RobotFamily
) -> Path:
    """Its name tells what the run is."""
    places = "-".join(scenario.name for scenario in scenarios)
    parts = (method_name(config.chosen_method), places, robot.name, "-".join(config.placed_guidances))
    name = "-".join(re.sub(r"[^\w.-]+", "-", part) for part in parts)
    return Path("runs") / f"{name}-s{config.learner.seed}"
