"""What people had of a robot: distances, fault, time near them and time at rest; in tables, files and the report."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl import _core
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.results import RunMeta, compare_paired, comparison_table, summarise
from adrl.evaluation.rollout import rollout
from adrl.evaluation.social import _to_footprint
from adrl.evaluation.trace_file import read_traces, write_traces
from adrl.evaluation.traces import TraceRecorder
from adrl.types import People, RobotConfig, Task, World
from adrl.worlds import ROBOTS

ROBOT = RobotConfig(max_acceleration_mps2=1000.0)
META = RunMeta(policy="p", method="m", robot="r", scenario="s", guidance="goal", split="test")


class Drive:
    """A constant action."""

    def __init__(self, speed: float) -> None:
        self.speed = speed

    def act(self, observation):
        return np.tile(np.array([self.speed, 0.0], dtype=np.float32), (len(observation), 1))


def walker(a: tuple[float, float], b: tuple[float, float], share: float = 0.0) -> People:
    """One of 1 m/s and 0.3 m."""
    one = np.ones(1)
    return People(
        routes=(np.array([a, b]),),
        radius_m=0.3 * one,
        speed_mps=one,
        share=share * one,
        reaction_s=0.1 * one,
        group=np.array([-1]),
    )


def a_task(people: People, goal: tuple[float, float] = (4.0, 0.0), limit_s: float = 12.0) -> Task:
    return Task(
        world=World(bounds=(-9.0, -9.0, 9.0, 9.0)),
        start=(0.0, 0.0, 0.0),
        goal=goal,
        path=np.array([(0.0, 0.0), goal]),
        shortest_m=math.hypot(*goal),
        time_limit_s=limit_s,
        people=people,
    )


def drive(task: Task, speed: float) -> Episodes:
    """speed: the action's, from -1 at rest to 1 at full speed."""
    return rollout(Drive(speed), [task], ROBOT, num_threads=1).episodes


@pytest.mark.parametrize("name", ["diffbot", "jackal"])
def test_distances_are_those_of_the_collision(name: str) -> None:
    robot, rng = ROBOTS[name], np.random.default_rng(0)
    points = rng.uniform(-2.0, 2.0, (200, 2))
    for point, ours in zip(points, _to_footprint(robot, points), strict=True):
        world = World(bounds=(-3.0, -3.0, 3.0, 3.0), circles=np.array([[*point, 1e-9]]))
        theirs = _core.clearance(world.native, np.zeros((1, 3)), robot.radius_m or 0.0, robot.polygon, 9.0)[0]
        assert max(ours, 0.0) == pytest.approx(max(theirs, 0.0), abs=1e-6)


def test_whoever_walks_into_a_standing_robot_is_no_fault_of_it() -> None:
    blind = walker((3.0, 0.0), (-5.0, 0.0))
    stands, drives = drive(a_task(blind), -1.0), drive(a_task(blind), 1.0)
    for episodes in (stands, drives):
        assert episodes.collision.all()
        assert episodes.person_distance_m is not None
        assert episodes.person_distance_m[0] == pytest.approx(0.0, abs=2e-3)
    assert stands.at_fault is not None
    assert not stands.at_fault[0]
    assert drives.at_fault is not None
    assert drives.at_fault[0]
    assert stands.frozen_s is not None
    assert stands.frozen_s[0] == pytest.approx(stands.time_s[0], abs=0.11)
    assert drives.frozen_s is not None
    assert drives.frozen_s[0] == 0.0
    # From 0.5 m on, at 1 m/s.
    assert stands.near_person_s is not None
    assert stands.near_person_s[0] == pytest.approx(0.5, abs=0.11)


def test_time_is_lost_to_the_clear_path() -> None:
    passes = a_task(walker((2.0, 1.2), (-8.0, 1.2)), limit_s=20.0)
    (fast,), (slow,) = (drive(passes, speed).lost_s for speed in (1.0, 0.0))  # pyright: ignore
    assert fast == pytest.approx(0.0, abs=0.2)
    assert slow == pytest.approx(3.7 / 0.6, abs=0.3), "at half the speed it takes twice the time"
    nearest = drive(passes, 1.0).person_distance_m
    assert nearest is not None
    assert nearest[0] == pytest.approx(1.2 - 0.3 - 0.2, abs=0.01)


def test_nobody_no_columns_and_tables_go_there_and_back() -> None:
    alone = drive(a_task(People()), 1.0)
    among = drive(a_task(walker((2.0, 1.2), (-8.0, 1.2))), 1.0)
    assert alone.at_fault is None
    assert "at_fault" not in alone.to_table().column_names
    assert "at_fault" not in summarise(alone, META)
    back = Episodes.from_table(among.to_table())
    for name in ("at_fault", "person_distance_m", "near_person_s", "frozen_s", "lost_s"):
        np.testing.assert_array_equal(getattr(back, name), getattr(among, name))
        summary = summarise(among, META)
        assert summary[name] == pytest.approx(float(getattr(among, name)[0]))
    assert Episodes.from_table(alone.to_table()).at_fault is None
    assert back.select(np.array([0])).among_people
    assert "at_fault" in compare_paired(among, among)
    assert "at_fault" not in compare_paired(among, alone)


def test_tables_show_them_where_people_walked(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    both = [summarise(drive(a_task(who), 1.0), META) for who in (People(), walker((2.0, 1.2), (-8.0, 1.2)))]
    for summaries, social in ((both[:1], False), (both, True)):
        Console(width=80).print(comparison_table(summaries))
        assert ("fault" in capsys.readouterr().out) is social


def test_part_of_the_columns_is_a_broken_record() -> None:
    among = drive(a_task(walker((2.0, 1.2), (-8.0, 1.2))), 1.0)
    with pytest.raises(ValueError, match="have all of"):
        replace(among, frozen_s=None)
    with pytest.raises(ValueError, match="at fault without a collision"):
        replace(among, at_fault=np.ones(1, dtype=bool))


def test_replays_hold_the_people(tmp_path: Path) -> None:
    """Each with its own number of them; the file gives them back."""
    two = walker((2.0, 1.2), (-8.0, 1.2))
    two = replace(
        two,
        routes=two.routes * 2,
        **{
            name: np.tile(getattr(two, name), 2)
            for name in ("radius_m", "speed_mps", "share", "reaction_s", "group")
        },
    )
    tasks = [
        a_task(who)
        for who in (
            walker((3.0, 2.0), (-5.0, 2.0)),
            People(),
            replace(two, routes=(two.routes[0], two.routes[0] - 3.0)),
        )
    ]
    recorder = TraceRecorder()
    episodes = rollout(Drive(1.0), tasks, ROBOT, recorders=[recorder], num_threads=1).episodes
    write_traces(tmp_path / "t.safetensors", recorder.traces())
    traces = sorted(read_traces(tmp_path / "t.safetensors").episodes, key=lambda trace: trace.task)
    assert [trace.people.shape[1] for trace in traces] == [1, 0, 2]
    first = traces[0]
    assert all(trace.legs.size == 0 for trace in traces)
    assert first.people.shape == (len(first.pose), 1, 3)
    np.testing.assert_allclose(first.people[0, 0], [3.0, 2.0, 0.3], atol=1e-6)
    gaps = np.hypot(*(first.people[:, 0, :2] - first.pose[:, :2]).T) - 0.3 - 0.2
    assert episodes.person_distance_m is not None
    assert gaps.min() == pytest.approx(episodes.person_distance_m[0], abs=1e-4)


def test_replays_hold_the_legs_that_the_lidar_sees(tmp_path: Path) -> None:
    """Two within each body; every beam that ends at a person ends at a leg."""
    robot = replace(ROBOT, lidar=replace(ROBOT.lidar, noise_std_m=0.0))
    people = replace(walker((2.0, 0.4), (-8.0, 0.4)), legs=True)
    recorder = TraceRecorder()
    rollout(Drive(0.3), [a_task(people)], robot, recorders=[recorder], num_threads=1)
    write_traces(tmp_path / "t.safetensors", recorder.traces())
    (trace,) = read_traces(tmp_path / "t.safetensors").episodes
    assert trace.legs.shape == (len(trace.pose), 2, 3)
    assert (trace.legs[:, :, 2] == np.float32(0.1)).all()
    beside = np.linalg.norm(trace.legs[:, :, :2] - trace.people[:, :, :2], axis=2)
    assert (beside + 0.1 <= 0.3 + 1e-6).all()
    seen = 0
    for pose, ranges, legs, bodies in zip(trace.pose, trace.ranges, trace.legs, trace.people, strict=True):
        angles = pose[2] + robot.lidar.angles_rad
        ends = pose[:2] + ranges.astype(float)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        at_body = np.linalg.norm(ends - bodies[0, :2], axis=1) < 0.3
        to_legs = np.linalg.norm(ends[:, None] - legs[None, :, :2], axis=2) - 0.1
        assert (np.abs(to_legs[at_body].min(axis=1)) < 0.01).all()
        seen += int(at_body.sum())
    assert seen > 20
