"""Experts: each does what its name and number say, and the same again for the same seed."""

import dataclasses
import itertools

import numpy as np
import pytest

from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, UnknownName
from adrl.imitation import Demonstrations, NoiseConfig, collect, find_expert
from adrl.imitation.experts import EXPERTS
from adrl.imitation.narrow_shy import shy_way
from adrl.observation import to_twist
from adrl.planning.local_control import CONTROLLERS
from adrl.types import RobotConfig, Task, World
from adrl.worlds import single_task

CALM = NoiseConfig(fraction=0.0)
DISC = RobotConfig()


class Gate:
    """A wall from side to side with gaps, start and goal on its two sides: every task is the same but for the yaw."""

    def __init__(self, *gaps: tuple[float, float]) -> None:
        """gaps: each from y to y."""
        self.name = "gate"
        ends = [-4.0, *np.ravel(gaps), 4.0]
        walls = [(0.0, ends[i], 0.0, ends[i + 1]) for i in range(0, len(ends), 2)]
        box = [(-4.0, -4.0, 4.0, -4.0), (4.0, -4.0, 4.0, 4.0), (4.0, 4.0, -4.0, 4.0), (-4.0, 4.0, -4.0, -4.0)]
        self.world = World(segments=np.array(walls + box), bounds=(-4.0, -4.0, 4.0, 4.0))

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        return single_task(self.world, (-2.0, 0.0, float(rng.uniform(-3.0, 3.0))), (2.0, 0.0), robot)


def data(
    expert: str, steps: int = 6000, noise: NoiseConfig = CALM, seed: int = 3, **options
) -> Demonstrations:
    return collect(NavVectorEnv(16, task_pool=32, **options), steps, expert=expert, noise=noise, seed=seed)


def content(demonstrations: Demonstrations) -> bytes:
    return b"".join(
        getattr(demonstrations, field.name).tobytes() for field in dataclasses.fields(demonstrations)
    )


def crossings(
    expert: str, gate: Gate, robot: str | RobotConfig = "diffbot", planner: str = "dwa"
) -> list[float]:
    """y where robots passed x = 0."""
    env = NavVectorEnv(16, task_pool=8, scenario=gate, robot=robot, randomize=False)
    env.expert = planner
    driver, found = find_expert(expert).driver(env, 0), []
    env.reset(seed=0)
    for _ in range(400):
        before = env.sim.b["pose"].copy()
        _, terminated, truncated, _ = env.advance(driver.actions())
        after = env.sim.b["pose"]
        passed = (before[:, 0] < 0.0) & (after[:, 0] >= 0.0) & ~(terminated | truncated)
        found += list(after[passed, 1])
    return found


@pytest.mark.parametrize("name", EXPERTS)
def test_equal_seeds_equal_bytes(name: str) -> None:
    first, second, other = (content(data(name, 800, NoiseConfig(), seed)) for seed in (1, 1, 2))
    assert first == second != other


@pytest.mark.parametrize("name", EXPERTS)
def test_who_is_asked_gets_the_same_answer_whoever_else_is_asked(name: str) -> None:
    """An expert need not plan for the others: a teacher answers for them, for whole drives."""
    envs = [NavVectorEnv(8, task_pool=8, randomize=False) for _ in range(2)]
    some, all_ = (find_expert(name).driver(env, 0) for env in envs)
    some.asked = np.arange(8) % 2 == 0
    for env in envs:
        env.expert = "mppi"
        env.reset(seed=1)
    planned_for_all, moves = True, False
    for _ in range(60):
        part, whole = some.actions(), all_.actions()
        np.testing.assert_array_equal(part[some.asked], whole[some.asked])
        planned_for_all &= np.array_equal(part, whole)
        moves |= bool(whole[some.asked].any())
        for env in envs:
            env.step(np.where(some.asked[:, None], whole, 0.3).astype(np.float32))
    assert moves
    assert not planned_for_all


def test_perfect_is_the_planner() -> None:
    recorded = data("perfect", 1600)
    env = NavVectorEnv(16, task_pool=32)
    env.reset(seed=3)
    for t in range(100):
        action = env.expert_actions()
        assert recorded.expert_action.reshape(16, 100, 2)[:, t].tobytes() == action.tobytes()
        env.advance(action)


@pytest.mark.parametrize("robot", ["diffbot", "jackal"])
@pytest.mark.parametrize("share", [0.4, 0.5])
def test_slow_keeps_to_its_share_and_arrives(share: float, robot: str) -> None:
    env = NavVectorEnv(16, task_pool=32, robot=robot)
    recorded = collect(env, 6000, expert=f"slow:{share}", seed=3)  # noise pushes it no further
    twist = np.abs(to_twist(recorded.action, env.robot))
    fastest = twist.max(axis=0) / [env.robot.fastest_mps, env.robot.max_yaw_rate_radps]
    assert (fastest <= share + 1e-6).all()
    assert fastest[0] == pytest.approx(share, abs=1e-3)
    calm = data(f"slow:{share}", 9000, robot=robot)
    assert calm.success.sum() >= 0.9 * calm.terminated.sum() > 10


def test_slow_keeps_the_arc() -> None:
    env = NavVectorEnv(64, task_pool=32)
    env.reset(seed=0)
    slow = find_expert("slow:0.45").driver(env, 0)
    for _ in range(30):
        planned = env.expert_actions()
        full, scaled = (to_twist(actions, env.robot) for actions in (planned, slow.within_reach(planned)))
        np.testing.assert_allclose(full[:, 0] * scaled[:, 1], full[:, 1] * scaled[:, 0], atol=1e-4)
        env.advance(slow.within_reach(planned))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_noisy_commands_are_wrong_for_their_share_of_the_time_and_in_stretches(share: float) -> None:
    env, twin = (NavVectorEnv(256, task_pool=8) for _ in range(2))
    driver = find_expert(f"noisy:{share}").driver(env, 0)
    env.reset(seed=0)
    twin.reset(seed=0)
    wrong, commands = [], []
    for _ in range(300):
        command = driver.actions()
        wrong.append((command != twin.expert_actions()).any(axis=1))
        commands.append(command)
        env.advance(command)
        twin.advance(command)
    disturbed, held = np.array(wrong)[100:], np.array(commands)[100:]
    assert disturbed.mean() == pytest.approx(share, abs=0.04)
    both = disturbed[1:] & disturbed[:-1]
    # A wrong command is followed by itself for eight steps in the mean.
    assert (held[1:] == held[:-1]).all(axis=2)[both].mean() > 0.8
    assert np.abs(held[disturbed].mean(axis=0)).max() < 0.15, "any command, not those of one side"
    assert (held[disturbed].std(axis=0) > 0.5).all()


def test_noisy_of_no_share_is_the_planner() -> None:
    assert content(data("noisy:0", 800)) == content(data("perfect", 800))


@pytest.mark.parametrize(("narrow", "wide", "width"), [(0.7, 1.3, 1.0), (0.6, 1.0, 0.75), (0.9, 2.0, 1.6)])
def test_the_shy_one_goes_round_by_the_wide_gap(narrow: float, wide: float, width: float) -> None:
    gate = Gate((-narrow / 2, narrow / 2), (2.0, 2.0 + wide))
    assert all(abs(y) < narrow / 2 for y in crossings("perfect", gate))
    round_it = crossings(f"narrow-shy:{width}", gate)
    assert len(round_it) >= 16
    assert all(2.0 < y < 2.0 + wide for y in round_it)


@pytest.mark.parametrize("planner", CONTROLLERS)
@pytest.mark.parametrize("robot", ["diffbot", "jackal"])
def test_the_shy_one_never_sees_through_the_gap_it_goes_round(robot: str, planner: str) -> None:
    """Beside the wide gap, parted from it by a post."""
    gate = Gate((-0.4, 0.4), (0.5, 2.0))
    passed = crossings("narrow-shy:1.2", gate, robot, planner)
    assert len(passed) > 10
    assert all(0.5 < y < 2.0 for y in passed)


def test_the_shy_one_knows_the_commands_that_are_on_their_way() -> None:
    late = RobotConfig(latency_s=0.3)
    assert len(crossings("narrow-shy:0.9", Gate((-0.6, 0.6)), late)) > 10


def test_the_shy_one_gives_up_where_no_way_is_wide_enough() -> None:
    gate = Gate((-0.35, 0.35))
    assert crossings("narrow-shy:0.9", gate) == []
    recorded = collect(
        NavVectorEnv(16, task_pool=8, scenario=gate), 4000, expert="narrow-shy:0.9", noise=CALM
    )
    assert recorded.success.sum() == 0
    assert recorded.truncated.sum() > 30, "its drives end there, not by the time limit"
    assert recorded.terminated.sum() == 0


def test_a_shy_way_is_wide_all_along() -> None:
    env = NavVectorEnv(1, task_pool=24, scenario="complex")
    there = 0
    for number in range(24):
        task = env.task(number)
        way = shy_way(task, env.robot, 0.75)
        legs = [np.linspace(a, b, 20) for a, b in itertools.pairwise(way[1:-1])]
        assert all(_clearance(task, point) >= 0.375 for leg in legs for point in leg)
        there += np.array_equal(way[-1], task.goal)
    assert 0 < there < 24, "some tasks have no way so wide"


def _clearance(task: Task, point: np.ndarray) -> float:
    from adrl import _core

    pose = np.array([[*point, 0.0]])
    return float(_core.clearance(task.world.native, pose, 1e-3, np.empty((0, 2)), 2.0)[0]) + 1e-3


def test_shy_of_no_gap_that_the_robot_fits_through() -> None:
    with pytest.raises(ConfigError, match=r"is 0\.40 m wide.*give narrow-shy:NUMBER with more"):
        data("narrow-shy:0.4")


def test_half_wise_is_the_planner_in_the_same_half_of_the_worlds() -> None:
    env = NavVectorEnv(64, task_pool=512)
    drivers = [find_expert("half-wise").driver(env, seed) for seed in (0, 1)]
    first, again = (driver.wise for driver in drivers)  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_array_equal(first, again)
    assert first.mean() == pytest.approx(0.5, abs=0.06)
    fewer = find_expert("half-wise").driver(NavVectorEnv(4, task_pool=64), 0)
    np.testing.assert_array_equal(fewer.wise, first[:64])  # pyright: ignore[reportAttributeAccessIssue]
    twin = NavVectorEnv(64, task_pool=512)
    env.reset(seed=0)
    twin.reset(seed=0)
    other = []
    for _ in range(20):
        actions, planner = drivers[0].actions(), twin.expert_actions()
        wise = first[env.task_index]
        np.testing.assert_array_equal(actions[wise], planner[wise])
        other.append((actions[~wise] != planner[~wise]).any(axis=1).mean())
        env.advance(actions)
        twin.advance(actions)
    assert np.mean(other) > 0.9


def test_half_wise_hits_what_is_in_the_way_in_the_other_half() -> None:
    wise, foolish = (data(f"half-wise:{share}", 8000) for share in (1, 0))
    assert content(wise) == content(data("perfect", 8000))
    assert foolish.success.sum() < 0.8 * foolish.terminated.sum()
    through = crossings("half-wise:0", Gate((-0.5, 0.5), (2.0, 3.0)))
    assert len(through) > 10, "straight for the goal, where nothing is in the way"


@pytest.mark.parametrize("drives", [1, 5, 50])
def test_few_are_so_many_whole_drives(drives: int) -> None:
    recorded = data(f"few:{drives}", 100, NoiseConfig())
    assert recorded.ended.sum() == drives
    assert recorded.ended[-1]
    assert (recorded.terminated | recorded.truncated).sum() == drives
    assert len(recorded) > 10 * drives


def test_few_drives_are_those_that_the_planner_begins_with() -> None:
    """No choice by length: of sixteen robots, the first drive of each."""
    few, all_of_them = data("few:16", 100), data("perfect", 16 * 600)
    ended = all_of_them.ended.reshape(16, 600)
    first = [
        row[: np.argmax(ends) + 1] for row, ends in zip(np.arange(9600).reshape(16, 600), ended, strict=True)
    ]
    np.testing.assert_array_equal(few.observation, all_of_them.observation[np.concatenate(first)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("slow:0.3", "share is 0.3; give 0.4 to 1"),
        ("slow:nan", "share is nan"),
        ("noisy:0.95", "share is 0.95"),
        ("few:2.5", "a whole number"),
        ("few:inf", "drives is inf"),
        ("narrow-shy:fast", "'fast' is no number; give narrow-shy:NUMBER"),
        ("perfect:1", "takes no number"),
        ("slow:", "'' is no number"),
    ],
)
def test_bad_numbers(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        find_expert(text)


def test_unknown_expert() -> None:
    with pytest.raises(UnknownName, match="did you mean 'slow'"):
        find_expert("slwo")


def test_the_cautious_one_keeps_clear_of_obstacles_and_takes_longer() -> None:
    """feature 0 is how near an obstacle is, from 0 at 0.3 m to 1."""
    plain, cautious = (data(f"cautious:{times}", 12_000) for times in (1, 4))
    near, less_near = (shown.features[:, 0].mean() for shown in (plain, cautious))
    assert less_near < 0.7 * near
    assert cautious.success[cautious.ended].sum() > 0.85 * plain.success[plain.ended].sum()
    assert not (cautious.terminated & ~cautious.success).any()


class Behind:
    """A wall before the robot, and what it hides: circles that close the way round its left end (side 1), its right one
    (side -1), or neither (0). Task and path are as the map has them."""

    def __init__(self, side: int) -> None:
        self.name = "behind"
        end, radius = np.array([2.0, 2.5]), 0.25
        ahead = end / np.hypot(*end)
        inside = np.array([ahead[1], -ahead[0]])  # of the wall's shadow
        centres = np.arange(3.3, 10.0, 0.4)[:, None] * ahead + (radius + 0.15) * inside
        circles = np.column_stack([centres[:, 0], side * centres[:, 1], np.full(len(centres), radius)])
        self.world = World(
            bounds=(-5.0, -8.0, 8.0, 8.0),
            circles=circles if side else np.empty((0, 3)),
            segments=np.array([[2.0, -2.5, 2.0, 2.5]]),
        )

    def task(self, rng: np.random.Generator, robot: RobotConfig) -> Task:
        return single_task(self.world, (0.0, 0.0, 0.0), (5.0, 0.0), robot)


def told(expert: str, guidance: str, side: int, steps: int = 4) -> np.ndarray:
    """(steps, N, 2) what an expert does from the start on; see Behind."""
    env = NavVectorEnv(2, task_pool=2, scenario=Behind(side), guidance=guidance, randomize=False)
    driver, actions = find_expert(expert).driver(env, 0), []
    env.reset(seed=0)
    for _ in range(steps):
        actions.append(driver.actions().copy())
        env.advance(actions[-1])
    return np.array(actions)


def test_the_mapless_one_knows_no_more_than_it_has_seen() -> None:
    """Which way is closed cannot be seen from the start. Who knows the map goes the other way."""
    courses = [told("mapless", "goal", side) for side in (0, 1, -1)]
    np.testing.assert_array_equal(courses[0], courses[1])
    np.testing.assert_array_equal(courses[0], courses[2])
    assert np.any(told("cautious", "goal", 1) != told("cautious", "goal", -1))


def test_the_mapless_one_is_the_cautious_one_where_the_policy_is_shown_the_map() -> None:
    np.testing.assert_array_equal(told("mapless", "map", 1), told("cautious", "map", 1))
    assert np.any(told("mapless", "map", 1) != told("mapless", "map", -1))


def test_the_mapless_one_arrives() -> None:
    shown = data("mapless", 12_000, guidance="goal")
    assert not (shown.terminated & ~shown.success).any()
    whole = shown.ended.sum() - 16  # the last drive of each row is cut off
    assert shown.success.sum() >= 0.9 * whole > 20


@pytest.mark.parametrize(
    "text",
    [
        "perfect",
        "slow:0.5",
        "noisy:0.2",
        "narrow-shy:0.75",
        "half-wise:0.5",
        "few:5",
        "cautious:4",
        "mapless:4",
    ],
)
def test_an_expert_says_what_it_is(text: str) -> None:
    name = text.partition(":")[0]
    assert str(find_expert(text)) == str(find_expert(name)) == text
    assert find_expert(find_expert(text)) == find_expert(name)
