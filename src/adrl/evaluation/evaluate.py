"""Drives a policy on a split's tasks, and sums up how good it was: adrl.evaluate."""

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.bags import BagWriter, require_new_bag
from adrl.baselines.planner import AStarDwaPolicy
from adrl.deploy.policy import MlpPolicy, load_policy, resolve_policy
from adrl.deploy.setup import Setup, setup_of
from adrl.envs import Body, NavSim
from adrl.errors import CheckpointError, ConfigError
from adrl.evaluation.bag_recorder import BagRecorder
from adrl.evaluation.results import RunMeta, Summary, summarise, write_episodes
from adrl.evaluation.rollout import PrivilegedPolicy, Recorder, Rollout, rollout
from adrl.evaluation.traces import TRACES_FILE, TraceRecorder, write_traces
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig, RewardTerm
from adrl.types import Policy, RobotConfig, Scenario, Task
from adrl.worlds import get_scenario, load_robot, task_set

PLANNER = "astar-dwa"
OWN_TASKS = "own"
"""The split that a summary names when the tasks were the user's."""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """An evaluation's results: the JSON document of design section 9, and what it was made from."""

    summary: Summary
    rollout: Rollout
    tasks: Sequence[Task]


def evaluate(
    policy: str | Path | MlpPolicy | Policy | PrivilegedPolicy,
    *,
    scenario: str | Scenario = "clutter",
    robot: str | RobotConfig | None = None,
    guidance: str | None = None,
    split: str = "test",
    episodes: int = 500,
    seed: int = 0,
    num_threads: int = 0,
    record: int = 0,
    replanner: ReplannerConfig | None = None,
    paper_literal: bool = False,
    tasks: Sequence[Task] | None = None,
    make_body: Callable[[RobotConfig], AbstractContextManager[Body]] | None = None,
    on_drive: Callable[[NavSim, NDArray[np.int64], NDArray[np.bool_]], None] | None = None,
    out: Path | None = None,
    bag: Path | None = None,
    bag_tasks: Collection[int] | None = None,
    reward_terms: Sequence[RewardTerm] = (),
    on_step: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Drive the first `episodes` tasks of a split.

    policy: "astar-dwa", "default", a run folder, or an object with act(observation). robot, guidance: of the policy's
    training when None. seed: changes the noise only. record: tasks whose routes are kept. replanner: constants of
    guidance `replan`, those of the training when None. paper_literal: with these, its equations as printed. tasks:
    instead of those of the split. make_body: makes what moves the robots instead of our simulator, for as long as it is
    needed: adrl.integrations.gazebo.Gazebo. on_drive: see rollout. out: folder for episodes.parquet, summary.json and
    traces.safetensors, the course of some episodes and of the first failures, for adrl report. bag: file of a ROS 1
    bag, or folder of a ROS 2 bag, for the episodes of bag_tasks, or of all tasks when None. reward_terms: your own that
    the policy was trained with, for the traces; those that an installed package offers are found. Raises AdrlError.
    """
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}; give 1 or more")
    for name, value in (("seed", seed), ("num_threads", num_threads)):
        if value < 0:
            raise ConfigError(f"{name} is {value}; give 0 or more")
    if isinstance(policy, (str, Path)) and str(policy) != PLANNER:
        policy = load_policy(resolve_policy(policy))
    if bag is None and bag_tasks is not None:
        raise ConfigError("bag_tasks chooses what a bag holds; give bag too")
    if bag is not None:
        require_new_bag("bag", bag)
    place = get_scenario(scenario)
    driver, about, setup, config = _driver(policy, robot, guidance)
    if paper_literal and about["guidance"] != "replan":
        raise ConfigError(
            f"paper_literal sets the equations of guidance replan, and guidance is {about['guidance']}; give replan"
        )
    constants = replanner or (setup.replanner if setup else ReplannerConfig())
    constants = constants.literal() if paper_literal else constants
    if tasks is None:
        tasks = task_set(place, config, split, episodes)
    else:
        split = OWN_TASKS
    absent = sorted(set(bag_tasks or ()) - set(range(len(tasks))))
    if absent:
        raise ConfigError(f"bag_tasks has {absent[0]}; the tasks are 0 to {len(tasks) - 1}")
    traces = None if out is None else _trace_recorder(driver, reward_terms)
    with ExitStack() as stack:
        body = stack.enter_context(make_body(config)) if make_body is not None else None
        recorders: list[Recorder] = [] if traces is None else [traces]
        if bag is not None:
            recorders.append(BagRecorder(stack.enter_context(BagWriter(bag, config)), bag_tasks))
        result = rollout(
            driver,
            tasks,
            config,
            guidance=about["guidance"],
            encoder=setup.encoder if setup else None,
            replanner=constants,
            maturity=driver.config.maturity if isinstance(driver, MlpPolicy) else 0.0,
            seed=seed,
            num_threads=num_threads,
            record=record,
            recorders=recorders,
            on_step=on_step,
            body=body,
            on_drive=on_drive,
        )
    simulator = "native" if body is None else type(body).__name__.lower()
    meta = RunMeta(
        **about,
        robot=config.name,
        scenario=place.name,
        split=split,
        simulator=simulator,
        paper_literal=about["guidance"] == "replan" and constants == constants.literal(),
    )
    summary = summarise(result.episodes, meta)
    if out is not None and traces is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_episodes(out / "episodes.parquet", result.episodes)
        write_traces(out / TRACES_FILE, traces.traces())
        files.write_json(out / "summary.json", summary)
    return Evaluation(summary=summary, rollout=result, tasks=tasks)


def _trace_recorder(driver: Policy | PrivilegedPolicy, reward_terms: Sequence[RewardTerm]) -> TraceRecorder:
    """A recorder with the reward that the policy was trained with, if it says so. Raises CheckpointError."""
    if not isinstance(driver, MlpPolicy):
        return TraceRecorder()
    saved = driver.config.extra.get("reward", {})
    try:
        maturity = saved.get("maturity")
        maturity = driver.config.maturity if maturity is None else float(maturity)
        constants = saved.get("constants", {})
        given = {term.name: term for term in reward_terms}
        extra = [given.get(name, name) for name in constants.get("extra_terms", ())]
        return TraceRecorder(RewardConfig(**constants | {"extra_terms": extra}), maturity)
    except (AttributeError, TypeError, ValueError) as error:
        raise CheckpointError(f"bad reward in the policy's config.json ({error}); restore the file") from None


def _driver(
    policy: Any, robot: str | RobotConfig | None, guidance: str | None
) -> tuple[Policy | PrivilegedPolicy, dict[str, Any], Setup | None, RobotConfig]:
    """The policy itself, what the summary says of it, what it was trained with and the robot it drives."""
    named = load_robot(robot) if isinstance(robot, str) else robot
    if policy == PLANNER:
        about = {"policy": PLANNER, "method": PLANNER, "guidance": guidance or "map"}
        return AStarDwaPolicy(), about, None, named or load_robot("diffbot")
    if not isinstance(policy, MlpPolicy):
        if not (hasattr(policy, "act") or hasattr(policy, "act_in")):
            raise ConfigError(
                f"policy {policy!r} is no run folder and has no act(observation); give one of them"
            )
        about = {"policy": type(policy).__name__, "method": "external", "guidance": guidance or "goal"}
        return policy, about, None, named or load_robot("diffbot")
    config = policy.config
    setup = setup_of(policy)
    extra = config.extra
    about = {
        "policy": str(extra.get("run", "policy")),
        "method": config.method,
        "guidance": guidance or config.guidance,
        "train_seconds": extra.get("train_seconds"),
        "env_steps": extra.get("env_steps"),
        "gradient_updates": extra.get("gradient_updates"),
        "trained_paper_literal": extra.get("paper_literal"),
    }
    return policy, about, setup, named or setup.robot


def robot_of(policy: str | Path) -> str | RobotConfig:
    """The robot a policy drives when none is named. Raises CheckpointError."""
    if str(policy) == PLANNER:
        return "diffbot"
    return setup_of(load_policy(resolve_policy(policy))).robot
