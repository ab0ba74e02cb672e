"""The classical planners: what they know, and what they may not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import adrl
from adrl.baselines.planners import PLANNERS
from adrl.envs import NavSim
from adrl.errors import ConfigError
from adrl.planning.local_control import pursuit_config
from adrl.types import Array, RobotConfig, Task, World
from adrl.worlds import get_scenario, task_set
from adrl.worlds.robots import load_robot

FORESEEING = sorted(name for name in PLANNERS if f"{name}-static" in PLANNERS)
each_planner = pytest.mark.parametrize("name", FORESEEING)
ROBOT = RobotConfig()
MEASURED = ("kind", "ranges", "odometry", "twist", "active")
"""What a robot knows of itself without a map: what it is, too; and whether it drives."""
DOCS = Path(__file__).parents[2] / "docs"


def course(name: str, task: Task, steps: int, guidance: str = "replan", threads: int = 1) -> Array:
    """(steps, 2) actions of a robot that does as the planner says."""
    sim = NavSim(1, ROBOT, guidance=guidance, plans_itself=True, num_threads=threads)
    sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
    policy = PLANNERS[name]()
    actions = []
    for _ in range(steps):
        actions.append(policy.act_in(sim)[0].copy())
        sim.step(actions[-1][None])
    return np.array(actions)


def behind_a_wall(hidden: Array) -> Task:
    """A wall in front of the robot with a way about it, and circles (N, 3) that it hides."""
    world = World(bounds=(-5.0, -8.0, 8.0, 8.0), circles=hidden, segments=np.array([[2.0, -2.5, 2.0, 2.5]]))
    path = np.array([[0.0, 0.0], [2.0, 3.0], [5.0, 0.0]])
    return Task(
        world=world, start=(0.0, 0.0, 0.0), goal=(5.0, 0.0), path=path, shortest_m=6.0, time_limit_s=60.0
    )


@each_planner
def test_a_planner_without_a_map_never_reads_the_true_one(name: str):
    """What a wall hides, and the path of the task, change no command until they can be seen."""
    nothing = behind_a_wall(np.empty((0, 3)))
    hidden = behind_a_wall(np.array([[3.0, 0.0, 0.4], [3.0, 1.0, 0.3], [2.6, -1.0, 0.3]]))
    elsewhere = replace(hidden, path=np.array([[0.0, 0.0], [2.0, -3.0], [5.0, 0.0]]))
    courses = [course(name, task, 15) for task in (nothing, hidden, elsewhere)]
    assert_array_equal(courses[0], courses[1])
    assert_array_equal(courses[0], courses[2])
    # With the map the path counts.
    assert np.any(course(name, hidden, 15, "map") != course(name, elsewhere, 15, "map"))


@each_planner
def test_a_planner_without_a_map_has_no_true_pose(name: str):
    """All but ranges, odometry and twist is garbled while it decides: not a command of the drive is another one."""
    task = behind_a_wall(np.empty((0, 3)))
    drifting = replace(ROBOT, odometry_drift=0.1)
    courses = []
    for garbled in (False, True):
        sim = NavSim(1, drifting, guidance="replan", plans_itself=True)
        sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
        policy = PLANNERS[name]()
        actions = []
        for _ in range(15):
            truth = {key: array.copy() for key, array in sim.b.items() if key not in MEASURED}
            for key, array in truth.items():
                sim.b[key][:] = array + 3 if garbled else array
            actions.append(policy.act_in(sim).copy())
            for key, array in truth.items():
                sim.b[key][:] = array
            sim.step(actions[-1])
        assert not np.allclose(sim.b["pose"], sim.b["odometry"], atol=0.01)
        courses.append(actions)
    assert_array_equal(courses[0], courses[1])


@each_planner
def test_it_goes_about_a_wall_that_it_finds(name: str):
    summary = adrl.evaluate(
        name, tasks=[behind_a_wall(np.empty((0, 3)))], guidance="replan", num_threads=1
    ).summary
    assert summary["success"] == 1.0
    assert summary["guidance"] == "replan"


@each_planner
@pytest.mark.parametrize("guidance", ["map", "replan"])
def test_threads_and_neighbours_change_nothing(name: str, guidance: str):
    robot = load_robot("jackal")
    tasks = task_set(get_scenario("clutter"), robot, "validation", 4)

    def drive(some: list[Task], threads: int) -> Array:
        sim = NavSim(len(some), robot, guidance=guidance, plans_itself=True, num_threads=threads)
        rows = np.arange(len(some))
        seeds = np.array([tasks.index(task) for task in some], np.uint64)
        sim.reset(rows, some, seeds, [np.random.default_rng(0) for _ in some])
        policy = PLANNERS[name]()
        poses = []
        for _ in range(12):
            sim.step(policy.act_in(sim))
            poses.append(sim.b["pose"].copy())
        return np.stack(poses)

    tasks = list(tasks)
    together = drive(tasks, 1)
    assert_array_equal(together, drive(tasks, 3))
    for i, task in enumerate(tasks):
        assert_array_equal(together[:, i : i + 1], drive([task], 1))


@each_planner
def test_an_episode_begins_without_the_memory_of_the_one_before(name: str):
    task = behind_a_wall(np.empty((0, 3)))
    sim = NavSim(1, ROBOT, guidance="replan", plans_itself=True)
    policy = PLANNERS[name]()
    courses = []
    for _ in range(2):
        sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
        policy.reset(np.arange(1))
        actions = []
        for _ in range(8):
            actions.append(policy.act_in(sim).copy())
            sim.step(actions[-1])
        courses.append(np.stack(actions))
    assert_allclose(courses[0], courses[1], atol=0.0)


@pytest.mark.slow
@each_planner
@pytest.mark.parametrize(("robot", "guidance"), [("jackal", "map"), ("jackal", "replan"), ("diffbot", "map")])
def test_planners_arrive(name: str, robot: str, guidance: str):
    summary = adrl.evaluate(
        name,
        robot=robot,
        scenario="clutter",
        guidance=guidance,
        split="validation",
        episodes=40,
        num_threads=1,
    ).summary
    assert summary["success"] >= 0.9


def test_pursuit_has_the_constants_of_its_best_trial():
    trials = json.loads((DOCS / "results" / "classical.json").read_text())["astar-pursuit"]["trials"]
    best = max(trials, key=lambda trial: trial["value"])["constants"]
    config = pursuit_config(ROBOT)
    for name, value in best.items():
        assert getattr(config, name) == pytest.approx(value, rel=0.02)


def crossing(speed_mps: float) -> Task:
    """A disc beside the straight way that is about to cross it, or with speed 0 stands there."""
    disc = np.array([[0.9, -0.6, 0.9, 0.6, 0.3, speed_mps, 0.0, np.inf]])
    path = np.array([[0.0, 0.0], [4.0, 0.0]])
    world = World(bounds=(-3.0, -3.0, 6.0, 3.0), discs=disc)
    return Task(
        world=world, start=(0.0, 0.0, 0.0), goal=(4.0, 0.0), path=path, shortest_m=4.0, time_limit_s=60.0
    )


@each_planner
def test_only_a_disc_that_moves_is_foreseen(name: str):
    moving, standing = (
        np.abs(
            course(name, crossing(speed), 15, "map") - course(f"{name}-static", crossing(speed), 15, "map")
        )
        for speed in (0.5, 0.0)
    )
    assert moving.max() > 0.5
    # MPPI looks distances up on a lattice, but for those to what it foresees.
    assert standing.max() <= (0.02 if name == "astar-mppi" else 0.0)


@each_planner
def test_on_its_own_map_none_foresees_so_the_name_of_one_that_does_not_is_refused(name: str):
    with pytest.raises(ConfigError, match=f"{name}-static does not drive with guidance replan.*give map"):
        adrl.evaluate(f"{name}-static", tasks=[crossing(0.5)], guidance="replan", num_threads=1)


@each_planner
@pytest.mark.parametrize("guidance", ["map", "replan"])
def test_a_robot_begins_when_it_has_a_task(name: str, guidance: str):
    """Beside one without a task a robot drives as if alone; the other one then does as well."""
    task = behind_a_wall(np.empty((0, 3)))
    alone = course(name, task, 6, guidance)
    sim = NavSim(2, ROBOT, guidance=guidance, plans_itself=True)
    policy = PLANNERS[name]()
    for row in (1, 0):
        sim.reset(np.array([row]), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
        for action in alone:
            actions = policy.act_in(sim)
            assert_array_equal(actions[row], action)
            sim.step(actions)
