"""DynaBARN's kind of world: what is as published, curves, and what can be solved at all."""

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from adrl.envs import NavSim
from adrl.types import NOBODY, People, RobotConfig
from adrl.worlds import ROBOTS, SCENARIOS, task_set

ROBOT = ROBOTS["jackal_dynabarn"]
SEARCH = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "dynabarn_solvable.py"))


def test_start_goal_and_walls_are_the_published_ones() -> None:
    for task in task_set(SCENARIOS["dynabarn"], ROBOT, "test", 5):
        assert task.start == (12.0, 0.0, np.pi)
        assert task.goal == (-9.0, 0.0)
        assert task.goal_tolerance_m == 0.3
        assert ROBOT.max_speed_mps == 0.5
        assert (task.world.segments[:, [0, 2]].max(axis=1) < 10.5).all()
        assert not ((task.world.segments[:, [0, 2]] == 10.0).all(axis=1)).any(), "open towards +x"


def test_cylinders_stay_on_their_curves_in_the_square_whatever_is_in_the_way() -> None:
    (task,) = task_set(SCENARIOS["dynabarn"], ROBOT, "test", 1)
    alone = [replace(task.people, **one(task.people, k)) for k in range(len(task.people))]
    sims = []
    for people in (task.people, *alone):
        sim = NavSim(1, RobotConfig())
        sim.reset(
            np.array([0]), [replace(task, people=people)], np.zeros(1, np.uint64), np.random.default_rng(0)
        )
        for _ in range(150):
            sim.native.step()
            assert (np.abs(sim.people(0)[:, :2]) <= 10.0).all()
        sims.append(sim.people(0))
    np.testing.assert_allclose(sims[0], np.concatenate(sims[1:]), atol=1e-9)


def one(people: People, k: int) -> dict[str, Any]:
    """What makes person k alone of them."""
    rows = {
        name: getattr(people, name)[[k]]
        for name in ("radius_m", "speed_mps", "share", "reaction_s", "group", "blind")
    }
    return rows | {"routes": people.routes[k : k + 1]}


def test_the_search_solves_an_empty_square_and_no_wall_of_cylinders() -> None:
    (task,) = task_set(SCENARIOS["dynabarn"], ROBOT, "test", 1)
    assert SEARCH["solvable"](replace(task, people=NOBODY), ROBOT)
    y = np.arange(-9.5, 10.0, 1.0)
    count = len(y)
    wall = replace(
        task.people,
        routes=tuple(np.array([(0.0, at)]) for at in y),
        radius_m=np.full(count, 0.5),
        speed_mps=np.zeros(count),
        share=np.zeros(count),
        reaction_s=np.zeros(count),
        group=np.full(count, -1),
        blind=np.ones(count, dtype=bool),
    )
    assert not SEARCH["solvable"](replace(task, people=wall), ROBOT)
    assert not SEARCH["solvable"](replace(task, people=NOBODY, time_limit_s=40.0), ROBOT), (
        "21 m at 0.5 m/s take 42 s"
    )
