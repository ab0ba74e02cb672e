"""Drives a policy on many robots of a family, some tasks each, and sums up over the robots: adrl.evaluate_family."""

import logging
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adrl import files
from adrl.baselines.planners import PLANNERS
from adrl.deploy.policies import ResolvedPolicy, find_policy
from adrl.errors import ConfigError, TaskError
from adrl.evaluation.evaluate import setting_of, trace_recorder
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.over_robots import Columns, by_robot, summarise_robots
from adrl.evaluation.results import (
    EPISODES_FILE,
    ROBOTS_FILE,
    SUMMARY_FILE,
    TRACES_FILE,
    RunMeta,
    Summary,
    require_results_folder,
    write_table,
)
from adrl.evaluation.rollout import CHUNK, PrivilegedPolicy, rollout
from adrl.evaluation.trace_file import write_traces
from adrl.evaluation.traces import Traces
from adrl.observation import EncoderConfig
from adrl.processes import usable_cores
from adrl.types import Policy, RobotConfig, Scenario, Task
from adrl.worlds import RobotFamily, get_scenario, load_robots, task_set

LOG = logging.getLogger("adrl.evaluation")
ROBOTS, TASKS = 100, 20
"""Robots of an evaluation, and tasks of each, where none are asked for."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FamilyEvaluation:
    """How a policy did on robots of a family."""

    summary: Summary
    robots: Columns
    """A row a robot; see by_robot."""
    episodes: Episodes
    """(E,) robot after robot."""
    whose: NDArray[np.int64]
    """(E,) number of the robot that drove each episode."""
    traces: Traces | None = None
    """The course of some episodes, where it was kept."""

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write summary.json, robots.parquet, episodes.parquet with a column robot, and traces. Raises OSError."""
        import pyarrow as pa

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        write_table(
            folder / EPISODES_FILE, self.episodes.to_table().append_column("robot", pa.array(self.whose))
        )
        write_table(
            folder / ROBOTS_FILE, pa.table({name: pa.array(column) for name, column in self.robots.items()})
        )
        if self.traces is not None:
            write_traces(folder / TRACES_FILE, self.traces)
        files.write_json(folder / SUMMARY_FILE, self.summary)


def evaluate_family(
    policy: str | os.PathLike[str] | Policy | PrivilegedPolicy | ResolvedPolicy,
    *,
    family: str | os.PathLike[str] | RobotFamily = "any",
    scenario: str | Scenario = "clutter",
    guidance: str | None = None,
    split: str = "test",
    robots: int = ROBOTS,
    episodes: int = TASKS,
    seed: int = 0,
    num_threads: int = 0,
    traces: bool = False,
    out: str | os.PathLike[str] | None = None,
    on_step: Callable[[int, int], None] | None = None,
) -> FamilyEvaluation:
    """Drive the first `robots` robots of a family's split, `episodes` tasks of the scenario's each.

    No two robots share a task: robot i drives tasks i * episodes and on, so that robots are independent of each other.
    A robot for which the scenario has no task, as one that fits through none of its gaps, is left out: a line in the
    log and in the summary names it, and it counts neither for nor against the policy. The other arguments are those of
    evaluate(). Raises AdrlError, TaskError where no robot is left.
    """
    for name, value, least in (
        ("robots", robots, 1),
        ("episodes", episodes, 1),
        ("seed", seed, 0),
        ("num_threads", num_threads, 0),
    ):
        if value < least:
            raise ConfigError(f"{name} is {value}; give {least} or more")
    require_results_folder("out", out)
    place, drawn = get_scenario(scenario), load_robots(family)
    if not isinstance(drawn, RobotFamily):
        raise ConfigError(f"robot {drawn.name!r} is one robot, and robots are drawn from a family; give any")
    driver = find_policy(policy, PLANNERS)
    guidance = driver.require_guidance(guidance)
    recorder = trace_recorder(driver.policy, ()) if traces or out is not None else None
    left_out: dict[str, str] = {}

    def tell(ended: int) -> None:
        if on_step is not None:
            on_step(ended, (robots - len(left_out)) * episodes)

    driven, parts = dict[int, RobotConfig](), list[Episodes]()
    own = None if isinstance(driver.encoder, EncoderConfig) else driver.encoder
    side_by_side = (
        max(1, CHUNK // episodes) if own is None else 1
    )  # an encoder of a policy's own sees one robot
    having_tasks = _with_tasks(
        drawn, place, split, robots, episodes, left_out, ahead=side_by_side, num_threads=num_threads
    )
    while group := [*islice(having_tasks, side_by_side)]:
        ended = sum(map(len, parts))
        part = rollout(
            driver.policy,
            [task for _, _, tasks in group for task in tasks],
            [setting_of(driver, robot, guidance, driver.replanner) for _, robot, _ in group],
            kinds=[k for k in range(len(group)) for _ in range(episodes)],
            encoder=own,
            seed=seed,
            num_threads=num_threads,
            numbers=[number * episodes + i for number, _, _ in group for i in range(episodes)],
            recorders=[] if recorder is None else [recorder],
            on_step=lambda more, _, ended=ended: tell(ended + more),
        )
        driven |= {number: robot for number, robot, _ in group}
        parts.append(part.episodes)
    if not parts:
        raise TaskError(f"none of {robots} robots has a task: {next(iter(left_out.values()))}")
    warnings = [*_strange(driver, [*driven.values()], drawn.name), *_told(left_out, robots, place.name)]
    for line in warnings:
        LOG.warning(line)
    numbers, together = np.array([*driven]), Episodes.concatenated(parts)
    whose = np.repeat(numbers, episodes)
    columns = by_robot([*driven.values()], numbers, together, whose)
    meta = RunMeta.of(
        driver,
        robot=drawn.name,
        scenario=place.name,
        guidance=guidance,
        split=split,
        warnings=warnings,
    )
    done = FamilyEvaluation(
        summary=summarise_robots(columns, meta, left_out),
        robots=columns,
        episodes=together,
        whose=whose,
        traces=None if recorder is None else recorder.traces(),
    )
    if out is not None:
        done.save(out)
    return done


def _with_tasks(
    family: RobotFamily,
    place: Scenario,
    split: str,
    robots: int,
    episodes: int,
    left_out: dict[str, str],
    *,
    ahead: int,
    num_threads: int,
) -> Iterator[tuple[int, RobotConfig, list[Task]]]:
    """Number, robot and tasks of each, in order; those that have none go to left_out, with why.

    Tasks take as long to draw as to drive: those of `ahead` robots are drawn on threads of their own meanwhile.
    """

    def drawn(number: int) -> tuple[int, RobotConfig, list[Task] | TaskError]:
        robot = family.draw(split, number)
        try:
            return number, robot, task_set(place, robot, split, episodes, first=number * episodes)
        except TaskError as error:
            return number, robot, error

    numbers = iter(range(robots))
    with ThreadPoolExecutor(num_threads or len(usable_cores())) as pool:
        waiting = deque(pool.submit(drawn, number) for number in islice(numbers, ahead))
        try:
            while waiting:
                number, robot, tasks = waiting.popleft().result()
                waiting.extend(pool.submit(drawn, following) for following in islice(numbers, 1))
                if isinstance(tasks, TaskError):
                    left_out[robot.name] = str(tasks)
                else:
                    yield number, robot, tasks
        finally:
            for drawing in waiting:
                drawing.cancel()


def _strange(driver: ResolvedPolicy, robots: Sequence[RobotConfig], family: str) -> list[str]:
    """A line where the policy was not made for some of the robots."""
    strange = [(robot, line) for robot in robots if (line := driver.strange(robot)) is not None]
    if not strange:
        return []
    if driver.family is None:
        return [
            f"policy {driver.name} was trained for robot {driver.made_for} and drives robots of family {family}"
        ]
    return [
        f"{len(strange)} of {len(robots)} robots are not such as it was trained for; the first: {strange[0][1]}"
    ]


def _told(left_out: Mapping[str, str], robots: int, place: str) -> list[str]:
    if not left_out:
        return []
    name, why = next(iter(left_out.items()))
    names = ", ".join(left_out)
    return [
        f"{len(left_out)} of {robots} robots have no task in {place} and are left out: {names} ({name}: {why})"
    ]
