"""An environment whose tasks are of several robots, guidances and scenarios."""

import copy
import pickle
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from adrl.envs import Kind, Mixture, NavEnv, NavVectorEnv
from adrl.errors import ConfigError, TaskError, UnknownName
from adrl.imitation.best_planner import best_planner
from adrl.imitation.demonstrations import collect
from adrl.imitation.experts import find_expert
from adrl.rewards.step import reference_period_s
from adrl.types import GUIDANCE, RobotConfig, Task
from adrl.worlds import FAMILIES, ROBOTS, get_scenario, task_set

MIXED: dict[str, Any] = {
    "robot": ["diffbot", "jackal", ROBOTS["turtlebot3_burger"]],
    "guidance": GUIDANCE,
    "scenario": ["clutter", "dynamic"],
    "task_pool": 24,
    "replanner": None,
}


def mixed(num_envs: int = 6, **options: Any) -> NavVectorEnv:
    return NavVectorEnv(num_envs, **MIXED | options)


def course(env: NavVectorEnv, steps: int) -> list[Any]:
    rng = np.random.default_rng(0)
    told = []
    for t in range(steps):
        actions = rng.uniform(-1.0, 1.0, (env.num_envs, 2)).astype(np.float32)
        told.append(env.step(env.expert_actions() if t % 2 else actions))
        told.append((env.task_index, env.sim.b["kind"].copy(), env.periods))
    return told


@pytest.mark.slow
def test_a_task_is_the_same_for_ever() -> None:
    """Whatever the pool's size: its robot, its guidance and its scenario go by its number."""
    small, large = mixed(task_pool=5), mixed(task_pool=30)
    seen = set()
    for i in range(30):
        kind = large.kinds[large.kind_of_task(i)]
        assert kind.robot == [ROBOTS["diffbot"], ROBOTS["jackal"], ROBOTS["turtlebot3_burger"]][i % 3]
        if i < 5:
            assert small.kinds[small.kind_of_task(i)] == kind
            assert small.task(i).start == large.task(i).start
        candidates = [task_set(scenario, kind.robot, "train", 1, first=i)[0] for scenario in large.scenarios]
        matching = [k for k, task in enumerate(candidates) if task.start == large.task(i).start]
        assert len(matching) == 1
        assert large.scenario_of_task(i) is large.scenarios[matching[0]]
        seen.add((kind.guidance, matching[0]))
    assert seen == {(guidance, k) for guidance in GUIDANCE for k in range(2)}


def test_a_row_drives_its_task_as_its_own_environment_does() -> None:
    """Each task's first observation is that of an environment of its kind alone."""
    env = mixed(8, seed=3)
    observation, _ = env.reset()
    for row, number in enumerate(env.task_index.tolist()):
        kind = env.kinds[env.kind_of_task(number)]
        assert env.kinds[env.sim.b["kind"][row]] == kind
        period = kind.robot.control_period_s / reference_period_s(kind.robot.max_speed_mps)
        assert env.periods[row] == period
        np.testing.assert_array_equal(env.sim.b["pose"][row], env.task(number).start)
        twist = observation[row, env.sim.encoder.places["twist"]]
        np.testing.assert_array_equal(twist, 0.0)


@pytest.mark.parametrize("priority", [None, 2.0])
def test_equal_seeds_equal_bytes_and_a_copy_goes_on_alike(priority: float | None) -> None:
    first, other = (mixed(seed=4, task_priority=priority, num_threads=n) for n in (1, 3))
    for env in (first, other):
        env.reset()
    assert data_equivalence(course(first, 25), course(other, 25))
    assert len(np.unique(first.sim.b["kind"])) > 1
    pickled, copied = pickle.loads(pickle.dumps(first)), copy.deepcopy(first)
    resumed = mixed(seed=99, task_priority=priority)
    resumed.set_state(first.state())
    expected = course(first, 60)
    for env in (pickled, copied, resumed):
        assert data_equivalence(expected, course(env, 60))


def test_rows_become_other_kinds_and_are_cut_after_as_many_steps() -> None:
    env = mixed(4, max_episode_steps=7, seed=0)
    env.reset()
    age, seen = np.zeros(4, int), [env.sim.b["kind"].copy()]
    for _ in range(40):
        _, terminated, truncated, _ = env.advance(np.zeros((4, 2), np.float32))
        age += 1
        np.testing.assert_array_equal(truncated, (age == 7) & ~terminated)
        age[terminated | truncated] = 0
        seen.append(env.sim.b["kind"].copy())
    assert (np.ptp(seen, axis=0) > 0).all()


def test_a_family_gives_each_task_a_robot_of_its_own() -> None:
    family = FAMILIES["any"]
    train, validation = (
        NavVectorEnv(2, robot="any", split=split, task_pool=4) for split in ("train", "validation")
    )
    assert [kind.robot for kind in train.kinds] == [family.draw("train", i) for i in range(4)]
    assert not {kind.robot for kind in train.kinds} & {kind.robot for kind in validation.kinds}


def test_one_of_each_is_an_environment_as_ever() -> None:
    plain, listed = (
        NavVectorEnv(3, seed=1, task_pool=4),
        NavVectorEnv(3, robot=["diffbot"], scenario=["clutter"], guidance=["goal"], seed=1, task_pool=4),
    )
    plain.reset()
    listed.reset()
    assert data_equivalence(course(plain, 20), course(listed, 20))
    assert (listed.robot, listed.scenario.name) == (ROBOTS["diffbot"], "clutter")
    single = NavEnv(**MIXED)
    single.reset(seed=5)
    assert single.observation_space.contains(single.step(single.action_space.sample())[0])


def test_a_kind_brings_its_guidance() -> None:
    kinds = [Kind(robot=ROBOTS["diffbot"], guidance="map"), Kind(robot=ROBOTS["jackal"], guidance="replan")]
    assert NavVectorEnv(1, robot=kinds, task_pool=4).kinds == tuple(kinds)


def test_a_guidance_for_a_place_is_drawn_there_alone() -> None:
    places = [get_scenario(name) for name in ("clutter", "complex")]
    robots = (ROBOTS["diffbot"],)
    mixture = Mixture(robots=robots, guidances=("map", "goal@clutter"), scenarios=places)
    drawn = Counter((kind.guidance, scenario.name) for kind, scenario in map(mixture.entry, range(400)))
    assert set(drawn) == {("map", "clutter"), ("goal", "clutter"), ("map", "complex")}
    assert 150 < drawn["map", "complex"] < 250, "places are drawn as often as without"
    for guidances, message in (
        (("map", "goal@rooms"), "goal@rooms is for a place that is not trained in; give one of clutter"),
        (("map@complex",), "no guidance for clutter"),
    ):
        with pytest.raises(ConfigError, match=message):
            Mixture(robots=robots, guidances=guidances, scenarios=places)


@pytest.mark.slow
@pytest.mark.integration
def test_experts_drive_every_row() -> None:
    env = mixed(6, task_pool=12)
    demonstrations = collect(env, 2400, seed=1)
    assert np.isfinite(demonstrations.action).all()
    assert demonstrations.success.any()
    for name in ("slow", "noisy", "half-wise"):
        assert np.isfinite(find_expert(name).driver(env, 0).actions()).all()
    cautious, mapless = (find_expert(name).driver(env, 0).actions() for name in ("cautious", "mapless"))
    on_map = env.sim.rows.on_map
    assert 0 < on_map.sum() < len(on_map)
    np.testing.assert_array_equal(cautious[on_map], mapless[on_map])
    assert np.any(cautious[~on_map] != mapless[~on_map])
    with pytest.raises(ConfigError, match="narrow-shy drives one robot"):
        find_expert("narrow-shy").driver(env, 0)
    assert best_planner(env).success > 0.5


def test_what_is_missing_or_of_several_is_said() -> None:
    nothing: dict[str, Any]
    for nothing in ({"robot": []}, {"guidance": []}, {"scenario": []}):
        with pytest.raises(ConfigError, match=f"no {next(iter(nothing))}"):
            mixed(**nothing)
    with pytest.raises(UnknownName, match="guidance"):
        mixed(guidance=["goal", "stars"])
    env = mixed()
    for attribute, message in (("robot", "3 robots"), ("scenario", "2 scenarios")):
        with pytest.raises(ConfigError, match=message):
            getattr(env, attribute)
    with pytest.raises(ConfigError, match="no robots"):
        Mixture(robots=(), guidances=("goal",), scenarios=(get_scenario("clutter"),))


class Narrow:
    """Large robots have no task in it."""

    name = "narrow"

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        if robot.circumscribed_radius_m > 0.35:
            raise TaskError(
                f"no place has the clearance that robot {robot.name!r} needs; take a smaller robot"
            )
        return get_scenario("clutter").task(rng, robot)


def test_a_robot_that_fits_nowhere_gives_its_task_to_the_next_and_is_named(caplog: pytest.LogCaptureFixture):
    env = NavVectorEnv(8, scenario=Narrow(), robot="any", task_pool=8, seed=0)
    env.reset()
    kept = [env.kinds[env.kind_of_task(i)].robot for i in range(8)]
    drawn = [FAMILIES["any"].draw("train", i) for i in range(8)]
    large = [robot for robot in drawn if robot.circumscribed_radius_m > 0.35]
    assert 0 < len(large) < 8
    for i, robot in enumerate(drawn):
        expected = next(r for r in drawn[i:] + drawn[:i] if r not in large)
        assert kept[i] == expected, robot.name
    for robot in large:
        assert f"robot {robot.name} is left out of task" in caplog.text
    for row, index in enumerate(env.task_index):
        assert env.sim.kinds[env.sim.b["kind"][row]].robot == kept[index]
    with pytest.raises(TaskError, match="'jackal' needs"):
        NavVectorEnv(
            2, scenario=Narrow(), robot=replace(ROBOTS["jackal"], radius_m=0.5, footprint_m=None), seed=0
        ).reset()


def test_a_task_that_another_robot_takes_is_where_that_one_has_it() -> None:
    count = 40
    robots = [FAMILIES["any"].draw("train", i) for i in range(count)]
    env = NavVectorEnv(2, scenario=[Narrow(), "clutter"], robot=robots, task_pool=count, seed=0)
    mixture = Mixture(robots=robots, guidances=("goal",), scenarios=env.scenarios)
    places = [mixture.entry(i)[1] for i in range(count)]

    def fits(number: int) -> bool:
        return places[number].name == "clutter" or robots[number].circumscribed_radius_m <= 0.35

    moved = 0
    for i in range(count):
        number = next(n % count for n in range(i, i + count) if fits(n % count))
        assert env.scenario_of_task(i) is places[number]
        moved += places[number] is not places[i]
    assert moved > 0, "no task was taken elsewhere"


def test_every_row_is_drawn_as_its_own_robot() -> None:
    env = mixed(3, render_mode="rgb_array", seed=2)
    env.reset()
    pictures = env.render()
    assert pictures is not None
    for row, picture in enumerate(pictures):
        alone = mixed(1, render_mode="rgb_array", seed=2 + row)
        alone.reset()
        assert alone.sim.b["kind"][0] == env.sim.b["kind"][row]
        own = alone.render()
        assert own is not None
        np.testing.assert_array_equal(picture, own[0])
