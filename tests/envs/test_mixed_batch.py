"""Robots of several kinds in one batch: each drives, sees and is paid as it is alone, to the byte."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from adrl.baselines.planners import PLANNERS
from adrl.deploy.another_robot import as_trained
from adrl.envs import MILD, Kind, NavSim
from adrl.errors import ConfigError, UnknownName
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.types import GUIDANCE, RobotConfig, Task
from adrl.worlds import ROBOTS, get_scenario, task_set
from random_robots import random_robot

OPTIONS: dict[str, Any] = {
    "randomization": MILD,
    "encoder": EncoderConfig(history_steps=2),
    "replanner": ReplannerConfig(cells=120, resolution_m=0.1),
    "maturity": 0.4,
}
STEPS = 40


def random_kinds(rng: np.random.Generator, count: int) -> list[Kind]:
    kinds = [
        Kind(robot=random_robot(rng), guidance=GUIDANCE[rng.integers(len(GUIDANCE))]) for _ in range(count)
    ]
    # One of them is driven by a policy of another robot.
    kinds[0] = replace(kinds[0], taken_as=as_trained(kinds[0].robot, ROBOTS["diffbot"]))
    return kinds


def task_of(kind: Kind, number: int) -> Task:
    return task_set(get_scenario("clutter"), kind.robot, "train", 1, first=number)[0]


def told(sim: NavSim) -> dict[str, np.ndarray]:
    return {
        "observation": sim.observe(),
        "expert": sim.expert_actions(),
        "waypoint": sim.b["waypoint"].copy(),
    }


def drive(sim: NavSim, actions: np.ndarray) -> list[dict[str, np.ndarray]]:
    """What STEPS steps bring, rows first; every third action is the expert's."""
    course = [told(sim)]
    for t, given_actions in enumerate(actions):
        outcome = sim.step(course[-1]["expert"] if t % 3 == 0 else given_actions)
        arrays = {name: value.copy() for name, value in vars(outcome).items()}
        course.append(
            arrays | told(sim) | {name: sim.b[name].copy() for name in ("pose", "odometry", "twist")}
        )
        sim.b["active"][outcome.reached | outcome.collided | outcome.timed_out] = 0
        if sim.replanner is not None:
            course[-1]["replans"] = sim.replanner.replans.copy()
    return course


def begin(sim: NavSim, rows: ArrayLike, tasks: Sequence[Task], numbers: ArrayLike, **more: Any) -> None:
    seeds = np.array(numbers, np.uint64)
    drawers = [np.random.default_rng(n) for n in seeds.tolist()]
    sim.reset(np.array(rows), tasks, seeds, drawers, **more)


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_a_row_is_what_it_is_alone(seed: int, threads: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = random_kinds(rng, 4)
    kind = rng.integers(len(kinds), size=6)
    tasks = [task_of(kinds[k], number) for number, k in enumerate(kind)]
    actions = rng.uniform(-1.0, 1.0, (STEPS, len(kind), 2)).astype(np.float32)
    actions[..., 0] = np.abs(actions[..., 0])
    together = NavSim(len(kind), kinds, num_threads=threads, **OPTIONS)
    numbers = range(len(kind))
    begin(together, numbers, tasks, numbers, kinds=kind)
    course = drive(together, actions)
    for i, k in enumerate(kind):
        own = kinds[k]
        alone = NavSim(1, own.robot, guidance=own.guidance, taken_as=own.taken_as, **OPTIONS)
        begin(alone, [0], [tasks[i]], [i])
        for ours, theirs in zip(course, drive(alone, actions[:, i : i + 1]), strict=True):
            for name, value in theirs.items():
                assert ours[name][i].tobytes() == value[0].tobytes(), (name, own)


def test_of_what_a_row_was_before_nothing_is_left() -> None:
    """Rows that change their kinds in the middle drive as those of a new simulator."""
    rng = np.random.default_rng(5)
    kinds = random_kinds(rng, 4)
    kinds = [
        replace(kind, guidance=guidance) for kind, guidance in zip(kinds, [*GUIDANCE, "replan"], strict=True)
    ]
    numbers = np.arange(8)
    used, new = (NavSim(8, kinds, **OPTIONS) for _ in range(2))
    before, after = numbers % 4, np.roll(numbers, 3) % 4
    begin(used, numbers, [task_of(kinds[k], n) for n, k in enumerate(before)], numbers, kinds=before)
    actions = rng.uniform(-1.0, 1.0, (STEPS, 8, 2)).astype(np.float32)
    drive(used, actions)
    for sim in (used, new):
        tasks = [task_of(kinds[k], 20 + n) for n, k in enumerate(after)]
        begin(sim, numbers, tasks, 20 + numbers, kinds=after)
    for ours, theirs in zip(drive(used, actions), drive(new, actions), strict=True):
        for name, value in theirs.items():
            assert ours[name].tobytes() == value.tobytes(), name


def test_the_state_tells_the_kinds() -> None:
    rng = np.random.default_rng(7)
    kinds = random_kinds(rng, 3)
    kind = np.array([2, 0, 1, 1, 2])
    tasks = [task_of(kinds[k], n) for n, k in enumerate(kind)]
    first, second = (NavSim(5, kinds, **OPTIONS) for _ in range(2))
    begin(first, range(5), tasks, range(5), kinds=kind)
    actions = rng.uniform(-1.0, 1.0, (STEPS, 5, 2)).astype(np.float32)
    drive(first, actions[:10])
    second.set_state(first.state(), first.tasks)
    for ours, theirs in zip(drive(first, actions), drive(second, actions), strict=True):
        for name, value in theirs.items():
            assert ours[name].tobytes() == value.tobytes(), name


@pytest.mark.parametrize("guidance", ["map", "replan"])
@pytest.mark.parametrize("name", ["astar-dwa", "astar-pursuit", "astar-mppi"])
def test_each_row_is_driven_by_the_planner_of_its_own_kind(name: str, guidance: str) -> None:
    kinds = [Kind(robot=robot, guidance=guidance) for robot in (ROBOTS["diffbot"], ROBOTS["jackal"])]
    kind = np.array([1, 0, 1, 0])
    tasks = [task_of(kinds[k], n) for n, k in enumerate(kind)]
    policy = PLANNERS[name]()
    together = NavSim(4, kinds, plans_itself=True)
    begin(together, range(4), tasks, range(4), kinds=kind)
    poses = []
    for _ in range(15):
        together.step(policy.act_in(together))
        poses.append(together.b["pose"].copy())
    for k, own in enumerate(kinds):
        rows = np.flatnonzero(kind == k)
        alone, policy = NavSim(2, own.robot, guidance=guidance, plans_itself=True), PLANNERS[name]()
        begin(alone, [0, 1], [tasks[i] for i in rows], rows.tolist())
        for pose in poses:
            alone.step(policy.act_in(alone))
            assert alone.b["pose"].tobytes() == pose[rows].tobytes()


def test_kinds_are_what_they_should_be() -> None:
    robot = RobotConfig()
    with pytest.raises(UnknownName, match="guidance"):
        Kind(robot=robot, guidance="stars")
    with pytest.raises(ConfigError, match="no kinds"):
        NavSim(1, [])
    several = NavSim(1, [Kind(robot=robot), Kind(robot=ROBOTS["jackal"], guidance="map")])
    for attribute in ("robot", "guidance"):
        with pytest.raises(ConfigError, match="2 "):
            getattr(several, attribute)
    with pytest.raises((ValueError, IndexError)):
        begin(several, [0], [task_of(several.kinds[0], 0)], [0], kinds=np.array([2]))
