"""Laws of the rollout: what an evaluation measures, and what its seed may change."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adrl.baselines.astar_dwa import AStarDwaPolicy
from adrl.envs import Setting
from adrl.errors import ConfigError, TaskError
from adrl.evaluation.metrics import Episodes, success_rate
from adrl.evaluation.rollout import Rewards, rollout
from adrl.evaluation.traces import TraceRecorder
from adrl.observation import EncoderConfig, Measurements
from adrl.rewards import RewardConfig
from adrl.types import RobotConfig, Task, World
from adrl.worlds import ROBOTS, get_scenario, single_task, task_set
from adrl.worlds.shapes import enclosure

ROBOT = RobotConfig()
ROOM = (0.0, 0.0, 8.0, 8.0)


class Forward:
    """Full speed ahead."""

    def act(self, observation):
        return np.tile(np.array([1.0, 0.0], dtype=np.float32), (len(observation), 1))


class ScanReader:
    """Drives as the nearest sector says, so that every bit of noise shows in the route."""

    def act(self, observation):
        nearest = observation[:, :36].min(axis=1)
        return np.stack([2.0 * nearest - 1.0, observation[:, 37]], axis=1).astype(np.float32)


class Still:
    """Stands."""

    def act(self, observation):
        return np.tile(np.array([-1.0, 0.0], dtype=np.float32), (len(observation), 1))


@pytest.fixture(scope="module")
def tasks() -> list[Task]:
    return task_set(get_scenario("clutter"), ROBOT, "validation", 24)


def straight(goal_x: float, **world) -> Task:
    room = World(bounds=ROOM, segments=enclosure(ROOM), **world)
    return single_task(room, (1.0, 4.0, 0.0), (goal_x, 4.0), ROBOT)


def test_a_straight_drive_is_measured_by_hand():
    episodes = rollout(Forward(), [straight(5.0)], ROBOT).episodes
    assert episodes.success[0]
    # From 1.0 to the rim of the disc of 0.3 m about 5.0; a step of 0.06 m may end inside it.
    assert 3.7 <= episodes.distance_m[0] <= 3.76
    # The path runs through the centres of the cells of start and goal: up to a cell longer at each end.
    assert episodes.shortest_m[0] == pytest.approx(3.7, abs=0.1)
    assert episodes.time_s[0] == pytest.approx(episodes.distance_m[0] / 0.6, abs=0.3)
    assert episodes.mean_speed_mps[0] == pytest.approx(episodes.distance_m[0] / episodes.time_s[0])
    assert episodes.smoothness[0] == 0.0
    assert episodes.least_clearance_m[0] == pytest.approx(1.0 - 0.2)  # at the start, to the wall behind


def test_driving_into_a_wall_and_standing_end_as_they_should():
    behind = straight(7.0, circles=np.array([[4.0, 3.7, 0.5]]))
    hit = rollout(Forward(), [behind], ROBOT).episodes
    assert hit.collision[0]
    assert hit.least_clearance_m[0] <= 0.0
    assert hit.distance_m[0] == pytest.approx(4.0 - 1.0 - math.sqrt(0.7**2 - 0.3**2), abs=2e-3)
    stood = rollout(Still(), [straight(5.0)], ROBOT).episodes
    assert stood.timeout[0]
    assert stood.distance_m[0] == 0.0
    assert stood.time_s[0] == pytest.approx(straight(5.0).time_limit_s, abs=0.1)


def test_the_planner_reaches_its_goals(tasks):
    result = rollout(AStarDwaPolicy(), tasks, Setting(robot=ROBOT, guidance="map"), record=5)
    assert success_rate(result.episodes) == 1.0
    assert [len(route) for route in result.routes] == [
        round(time_s / 0.1) + 1 for time_s in result.episodes.time_s[:5]
    ]
    for task, route in zip(tasks, result.routes, strict=False):
        np.testing.assert_allclose(route[0], task.start[:2])
        assert math.dist(route[-1], task.goal) < task.goal_tolerance_m


DRIFTING = replace(ROBOT, odometry_drift=0.1)


def drive(tasks: list[Task], *, seed: int = 0, threads: int = 1, first: int = 0) -> Episodes:
    driven = rollout(ScanReader(), tasks, DRIFTING, seed=seed, num_threads=threads, first_task=first)
    return driven.episodes


def test_an_evaluation_repeats_and_its_seed_changes_noise_only(tasks):
    first, again, other = drive(tasks), drive(tasks, threads=3), drive(tasks, seed=1)
    assert first.to_table().equals(again.to_table())
    assert_array_equal(first.start_xy_m, other.start_xy_m)
    assert_array_equal(first.goal_xy_m, other.goal_xy_m)
    assert (first.final_pose != other.final_pose).any()


def test_a_task_is_driven_the_same_alone_and_among_others(tasks):
    alone = drive(tasks[7:8], first=7)
    assert alone.to_table().equals(drive(tasks).to_table().slice(7, 1))


def test_chunks_change_nothing(tasks, monkeypatch):
    whole = rollout(ScanReader(), tasks, DRIFTING, record=7, num_threads=1)
    monkeypatch.setattr("adrl.evaluation.rollout.CHUNK", 5)
    told = []
    parts = rollout(
        ScanReader(), tasks, DRIFTING, record=7, num_threads=1, on_step=lambda *now: told.append(now)
    )
    assert parts.episodes.to_table().equals(whole.episodes.to_table())
    for ours, theirs in zip(parts.routes, whole.routes, strict=True):
        assert_array_equal(ours, theirs)
    assert told[-1] == (24, 24)
    assert [ended for ended, _ in told] == sorted(ended for ended, _ in told)


def test_no_tasks_is_an_error():
    with pytest.raises(TaskError, match="no tasks"):
        rollout(Still(), [], ROBOT)


def mixed_settings() -> list[Setting]:
    encoder = EncoderConfig(history_steps=2)
    return [
        Setting(robot=ROBOTS["jackal"], guidance="replan", encoder=encoder, taken_as=ROBOTS["jackal"]),
        Setting(robot=ROBOT, guidance="replan", encoder=encoder),
        Setting(robot=ROBOTS["turtlebot3_burger"], guidance="replan", encoder=encoder),
    ]


def test_robots_side_by_side_drive_as_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one chunk and in several, whatever the order: episodes, starts, returns and replays."""
    settings, numbers = mixed_settings(), [7, 3, 12, 0, 5, 9, 1]
    kinds = [2, 0, 1, 1, 0, 2, 0]
    clutter, rewards = get_scenario("clutter"), Rewards(config=RewardConfig(), gamma=0.98, maturity=0.3)
    tasks = [
        task_set(clutter, settings[k].robot, "validation", 1, first=n)[0]
        for n, k in zip(numbers, kinds, strict=True)
    ]
    parts, traces = [], {}
    for task, number, k in zip(tasks, numbers, kinds, strict=True):
        recorder = TraceRecorder(arrivals=1, failures=1)
        options = {"first_task": number, "rewards": rewards, "recorders": [recorder], "record": 1}
        parts.append(rollout(ScanReader(), [task], settings[k], num_threads=1, **options))
        traces[number] = recorder.traces()
    for chunk in (1000, 3):
        monkeypatch.setattr("adrl.evaluation.rollout.CHUNK", chunk)
        recorder = TraceRecorder(arrivals=9, failures=9)
        told = {"numbers": numbers, "rewards": rewards, "recorders": [recorder], "record": len(tasks)}
        whole = rollout(ScanReader(), tasks, settings, kinds=kinds, num_threads=2, **told)
        expected = Episodes.concatenated([part.episodes for part in parts])
        for name, column in vars(whole.episodes).items():
            assert_array_equal(column, getattr(expected, name), name)
        assert_array_equal(whole.start, np.concatenate([part.start for part in parts]))
        assert_array_equal(whole.replans, np.concatenate([part.replans for part in parts]))
        assert_array_equal(
            whole.discounted_return, np.concatenate([part.discounted_return for part in parts])
        )
        for route, part in zip(whole.routes, parts, strict=True):
            assert_array_equal(route, part.routes[0])
        for trace in recorder.traces().episodes:
            (alone,) = traces[trace.task].episodes
            assert trace.robot == alone.robot == settings[kinds[numbers.index(trace.task)]].robot
            for name in ("ranges", "pose", "waypoint", "weights", "paid"):
                assert_array_equal(getattr(trace, name), getattr(alone, name), name)
        for route, number in zip(recorder.traces().routes, numbers, strict=True):
            assert_array_equal(route, traces[number].routes[0])


def test_what_cannot_be_driven_side_by_side_is_said(tasks: list[Task]) -> None:
    settings = mixed_settings()
    for kinds in (None, [0], [0, 3], [0, -1]):
        with pytest.raises(ConfigError, match="its kind"):
            rollout(Still(), tasks[:2], settings, kinds=kinds)
    with pytest.raises(ConfigError, match="its number"):
        rollout(Still(), tasks[:2], ROBOT, numbers=[1])
    with pytest.raises(ConfigError, match="no settings"):
        rollout(Still(), tasks[:2], [], kinds=[0, 0])
    with pytest.raises(ConfigError, match="differ in more than robot"):
        rollout(Still(), tasks[:2], [settings[0], replace(settings[1], maturity=1.0)], kinds=[0, 1])
    with pytest.raises(ConfigError, match="encoder of its own"):
        rollout(Still(), tasks[:2], settings, kinds=[0, 1], encoder=Measurements())
