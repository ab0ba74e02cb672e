"""The planner of a robot: what is measured is what happens, and the best one is chosen."""

import math

import numpy as np
import pytest

from adrl.envs import NavSim, NavVectorEnv
from adrl.imitation import best_planner as module
from adrl.imitation.best_planner import Trial, best_planner, trial
from adrl.planning.local_control import CONTROLLERS
from adrl.types import RobotConfig


def a_trial(controller: str, success: float = 1.0, pace: float = 1.0, backward: float = 0.0) -> Trial:
    return Trial(controller=controller, success=success, pace=pace, backward=backward)


@pytest.mark.parametrize(
    ("trials", "chosen"),
    [
        ([a_trial("a", pace=1.1), a_trial("b", pace=1.0)], "a"),
        ([a_trial("a", pace=1.4), a_trial("b", pace=1.1)], "b"),
        ([a_trial("a", pace=1.3), a_trial("b", pace=1.2)], "b"),
        ([a_trial("a", success=0.9), a_trial("b", pace=1.5)], "b"),
        ([a_trial("a", success=0.9), a_trial("b", success=0.6)], "a"),
        ([a_trial("a", backward=0.5), a_trial("b", pace=2.0)], "b"),
        ([a_trial("a", success=0.0, pace=math.inf), a_trial("b", success=0.0, pace=math.inf)], "a"),
    ],
    ids=["good is enough", "a better pace", "the fastest", "arriving first", "the most", "forward", "none"],
)
def test_of_several_the_best(trials: list[Trial], chosen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {one.controller: one for one in trials}
    monkeypatch.setattr(module, "CONTROLLERS", made)
    monkeypatch.setattr(module, "trial", lambda name, *_: made[name])
    assert best_planner(NavVectorEnv(1, task_pool=1)).controller == chosen


def test_a_trial_counts_what_happens() -> None:
    env = NavVectorEnv(1, task_pool=12, robot=RobotConfig(min_speed_mps=-0.3))
    tasks = [env.task(i) for i in range(12)]
    measured = trial("dwa", [env.robot] * 12, tasks)
    arrived, ways_m, times_s, backed, steps = 0, 0.0, 0.0, 0, 0
    for task in tasks:  # one by one
        sim = NavSim(1, env.robot)
        sim.reset(np.arange(1), [task], np.zeros(1, np.uint64), np.random.default_rng(0))
        while True:
            outcome = sim.step(sim.expert_actions())
            steps += 1
            backed += sim.b["twist"][0, 0] < 0.0
            if outcome.reached[0]:
                arrived += 1
                ways_m += task.shortest_m
                times_s += float(sim.b["time"][0])
            if outcome.reached[0] or outcome.collided[0] or outcome.timed_out[0]:
                break
    assert arrived > 0
    assert measured.success == arrived / 12
    assert measured.pace == pytest.approx(times_s * 0.6 / ways_m)
    assert measured.backward == pytest.approx(backed / steps)


def test_the_same_planner_for_every_seed_and_number_of_robots() -> None:
    first, second = NavVectorEnv(3, task_pool=16), NavVectorEnv(8, task_pool=16, seed=5)
    second.reset()
    assert best_planner(first) == best_planner(second)


def test_diffbot_keeps_the_cheapest() -> None:
    assert best_planner(NavVectorEnv(2, task_pool=50)).controller == next(iter(CONTROLLERS))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_an_environment_drives_by_the_planner_it_is_given(name: str) -> None:
    env = NavVectorEnv(8, task_pool=8)
    env.expert = name
    env.reset(seed=0)
    twin = NavSim(8, env.robot, expert=name)
    twin.reset(
        np.arange(8),
        [env.task(int(i)) for i in env.task_index],
        np.arange(8, dtype=np.uint64),
        np.random.default_rng(0),
    )
    twin.b["params"][:] = env.sim.b["params"]
    for _ in range(60):
        actions = env.expert_actions()
        live = twin.b["active"].astype(bool)
        np.testing.assert_array_equal(actions[live], twin.expert_actions()[live])
        ended = np.logical_or(*env.advance(actions)[1:3])
        twin.step(actions)
        twin.b["active"][ended] = 0


@pytest.mark.parametrize("name", CONTROLLERS)
def test_what_a_planner_remembers_is_in_the_state(name: str) -> None:
    """Put back amid an episode, or copied, it goes on to the same bytes."""
    env = NavVectorEnv(8, task_pool=8, scenario="clutter")
    env.expert = name
    env.reset(seed=1)
    for _ in range(30):
        env.advance(env.expert_actions())
    state = env.state()
    ways = []
    for _ in range(2):
        env.set_state(state)
        ways.append([env.advance(env.expert_actions())[0].tobytes() for _ in range(20)])
    assert ways[0] == ways[1]
