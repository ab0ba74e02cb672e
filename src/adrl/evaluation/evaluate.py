"""Drives a policy on a split's tasks, and sums up how good it was: adrl.evaluate."""

import logging
import os
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.bags import BagWriter, require_new_bag
from adrl.baselines.planners import PLANNERS
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.deploy.policy import MlpPolicy
from adrl.envs import Body, NavSim, Setting
from adrl.errors import CheckpointError, ConfigError
from adrl.evaluation.bag_recorder import BagRecorder
from adrl.evaluation.results import (
    EPISODES_FILE,
    SUMMARY_FILE,
    TRACES_FILE,
    RunMeta,
    Summary,
    require_results_folder,
    summarise,
    write_episodes,
)
from adrl.evaluation.rollout import PrivilegedPolicy, Recorder, Rollout, rollout
from adrl.evaluation.supervised import Supervised
from adrl.evaluation.trace_file import write_traces
from adrl.evaluation.traces import TraceRecorder, Traces
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig, RewardTerm
from adrl.types import Policy, RobotConfig, Scenario, Task, without_constants
from adrl.worlds import get_scenario, task_set

LOG = logging.getLogger("adrl.evaluation")
EPISODES = 500
"""Tasks that are driven where no number is asked for."""
OWN_TASKS = "own"
"""The split that a summary names when the tasks were the user's."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """An evaluation's results: the JSON document of design section 9, and what it was made from."""

    summary: Summary
    rollout: Rollout
    tasks: Sequence[Task]
    traces: Traces | None = None
    """The course of some episodes, where it was kept."""

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write summary.json, episodes.parquet and traces.safetensors, for adrl report. Raises OSError."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_episodes(folder / EPISODES_FILE, self.rollout.episodes)
        if self.traces is not None:
            write_traces(folder / TRACES_FILE, self.traces)
        files.write_json(folder / SUMMARY_FILE, self.summary)


def evaluate(
    policy: str | os.PathLike[str] | Policy | PrivilegedPolicy | ResolvedPolicy,
    *,
    scenario: str | Scenario = "clutter",
    robot: str | RobotConfig | None = None,
    guidance: str | None = None,
    split: str = "test",
    episodes: int = EPISODES,
    seed: int = 0,
    num_threads: int = 0,
    record: int = 0,
    replanner: ReplannerConfig | None = None,
    paper_literal: bool = False,
    tasks: Sequence[Task] | None = None,
    make_body: Callable[[RobotConfig], AbstractContextManager[Body]] | None = None,
    on_drive: Callable[[NavSim, NDArray[np.int64], NDArray[np.bool_]], None] | None = None,
    traces: bool = False,
    out: str | os.PathLike[str] | None = None,
    bag: str | os.PathLike[str] | None = None,
    bag_tasks: Collection[int] | None = None,
    supervised: bool = False,
    reward_terms: Sequence[RewardTerm] = (),
    on_step: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Drive the first `episodes` tasks of a split.

    policy: a planner's or shipped policy's name, a run folder, or one of your own in any form of find_policy. robot,
    guidance: of the policy's training when None; what is other on another robot is told in the summary and the log.
    seed: changes the noise only. record: tasks whose routes are kept. replanner: constants of guidance `replan`, those
    of the training when None. paper_literal: with these, its equations as printed. tasks: instead of the split's.
    make_body: makes what moves the robots instead of our simulator, for as long as it is needed:
    adrl.integrations.gazebo.Gazebo. on_drive: see rollout. traces: keep the course of some episodes and of the first
    failures, for Evaluation.save. out: folder to save all of it in, checked before the drive. bag: file of a ROS 1 bag,
    or folder of a ROS 2 bag, for the episodes of bag_tasks, or of all tasks when None. supervised: as on a robot, the
    runtime with its supervisor between policy and base; traces keep what it held the robot for. reward_terms: your own
    that the policy was trained with, for the traces; those that an installed package offers are found. Raises
    AdrlError.
    """
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}; give 1 or more")
    for name, value in (("seed", seed), ("num_threads", num_threads)):
        if value < 0:
            raise ConfigError(f"{name} is {value}; give 0 or more")
    require_results_folder("out", out)
    if bag is None and bag_tasks is not None:
        raise ConfigError("bag_tasks chooses what a bag holds; give bag too")
    if bag is not None:
        require_new_bag("bag", bag)
    place = get_scenario(scenario)
    driver = find_policy(policy, PLANNERS)
    guidance, config = driver.require_guidance(guidance), driver.driven(robot)
    as_given = replanner is None and not paper_literal
    driving = _supervised(driver, config, guidance, as_given) if supervised else driver
    if paper_literal:
        _require_replanner(driver, guidance)
    constants = replanner or driver.replanner
    constants = constants.literal() if paper_literal else constants
    setting = setting_of(driving, config, guidance, constants)
    warning = driver.strange(config)
    if warning is not None:
        LOG.warning(warning)
    if tasks is None:
        tasks = task_set(place, config, split, episodes)
    else:
        split = OWN_TASKS
    absent = sorted(set(bag_tasks or ()) - set(range(len(tasks))))
    if absent:
        raise ConfigError(f"bag_tasks has {absent[0]}; the tasks are 0 to {len(tasks) - 1}")
    drives = driving.policy
    recorder = trace_recorder(driver.policy, reward_terms, drives) if traces or out is not None else None
    with ExitStack() as stack:
        body = stack.enter_context(make_body(config)) if make_body is not None else None
        recorders: list[Recorder] = [] if recorder is None else [recorder]
        if bag is not None:
            recorders.append(BagRecorder(stack.enter_context(BagWriter(bag, config)), bag_tasks))
        result = rollout(
            drives,
            tasks,
            setting,
            encoder=None if isinstance(driving.encoder, EncoderConfig) else driving.encoder,
            seed=seed,
            num_threads=num_threads,
            record=record,
            recorders=recorders,
            on_step=on_step,
            body=body,
            on_drive=on_drive,
        )
    meta = RunMeta.of(
        driver,
        robot=config.name,
        scenario=place.name,
        guidance=guidance,
        split=split,
        simulator="native" if body is None else type(body).__name__.lower(),
        paper_literal=guidance == "replan" and constants == constants.literal(),
        supervised=supervised,
        warnings=() if warning is None else (warning,),
    )
    done = Evaluation(
        summary=summarise(result.episodes, meta),
        rollout=result,
        tasks=tasks,
        traces=None if recorder is None else recorder.traces(),
    )
    if out is not None:
        done.save(out)
    return done


def _supervised(driver: ResolvedPolicy, robot: RobotConfig, guidance: str, as_given: bool) -> ResolvedPolicy:
    """The policy behind the runtime, which encodes and plans by itself. Raises ConfigError."""
    if not as_given:
        raise ConfigError(
            "supervised drives with the policy's own replanner; leave paper_literal and replanner out"
        )
    return replace(
        driver,
        policy=Supervised(driver, robot, guidance),
        encoder=EncoderConfig(),
        encoder_inside=False,
        plans_itself=True,
    )


def _require_replanner(driver: ResolvedPolicy, guidance: str) -> None:
    """Raises ConfigError where no equation of the replanner is at work."""
    if guidance != "replan":
        raise ConfigError(
            f"paper_literal sets the equations of guidance replan, and guidance is {guidance}; give replan"
        )
    if driver.plans_itself:
        raise ConfigError(
            f"paper_literal sets equations of the replanner, and {driver.name} makes its own routes; leave it out"
        )


def setting_of(
    driver: ResolvedPolicy, robot: RobotConfig, guidance: str, replanner: ReplannerConfig
) -> Setting:
    """What a robot sees and follows when this policy drives it. An encoder of the policy's own is not in it."""
    return Setting(
        robot=robot,
        guidance=guidance,
        encoder=driver.encoder if isinstance(driver.encoder, EncoderConfig) else None,
        replanner=replanner,
        maturity=driver.maturity,
        taken_as=driver.taken_as(robot),
        plans_itself=driver.plans_itself,
    )


def trace_recorder(
    driver: Policy | PrivilegedPolicy,
    reward_terms: Sequence[RewardTerm],
    drives: Policy | PrivilegedPolicy | None = None,
) -> TraceRecorder:
    """A recorder with the reward that the policy was trained with, if it says so. drives: what drives in its place,
    whose reasons are kept where it is supervised. Raises CheckpointError."""
    supervised = drives if isinstance(drives, Supervised) else None
    if not isinstance(driver, MlpPolicy):
        return TraceRecorder(supervised=supervised)
    saved = driver.config.extra.get("reward", {})
    try:
        maturity = saved.get("maturity")
        maturity = driver.config.maturity if maturity is None else float(maturity)
        constants = without_constants(RewardConfig, saved.get("constants", {}))
        given = {term.name: term for term in reward_terms}
        constants["extra_terms"] = [given.get(name, name) for name in constants.get("extra_terms", ())]
        return TraceRecorder(RewardConfig(**constants), maturity, supervised=supervised)
    except (AttributeError, TypeError, ValueError) as error:
        raise CheckpointError(f"bad reward in the policy's config.json ({error}); restore the file") from None


def robot_of(policy: Any) -> RobotConfig:
    """The robot a policy drives when none is named. Raises AdrlError."""
    return find_policy(policy, PLANNERS).driven(None)
