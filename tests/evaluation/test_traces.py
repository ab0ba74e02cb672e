"""Laws of the traces: they are the episodes that were evaluated, and survive their file."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adrl import _core
from adrl.baselines.astar_dwa import AStarDwaPolicy
from adrl.envs import Setting
from adrl.errors import CheckpointError
from adrl.evaluation.metrics import RATES, Episodes
from adrl.evaluation.rollout import rollout
from adrl.evaluation.trace_file import read_traces, write_traces
from adrl.evaluation.traces import TraceRecorder, Traces
from adrl.rewards import REWARD_TERMS, RewardConfig
from adrl.types import OccupancyGrid, RobotConfig, Task, World
from adrl.worlds import get_scenario, single_task, task_set
from adrl.worlds.shapes import enclosure

ROBOT = RobotConfig(max_speed_mps=1.2)
ROOM = (0.0, 0.0, 8.0, 8.0)


class Ahead:
    """Drives to the goal when it lies ahead, and into whatever is in between."""

    def act(self, observation):
        return np.tile(np.array([1.0, 0.0], dtype=np.float32), (len(observation), 1))


def record(
    tasks: list[Task], policy: object, robot: RobotConfig = ROBOT, **options
) -> tuple[Episodes, Traces]:
    recorder = TraceRecorder(**options)
    result = rollout(policy, tasks, Setting(robot=robot, guidance="map"), recorders=[recorder], num_threads=1)  # pyright: ignore
    return result.episodes, recorder.traces()


@pytest.fixture(scope="module")
def driven() -> tuple[list[Task], Episodes, Traces]:
    tasks = task_set(get_scenario("dynamic"), ROBOT, "validation", 12)
    return tasks, *record(tasks, Ahead(), failures=4, arrivals=2)


def test_a_trace_is_the_episode_that_was_measured(driven) -> None:
    tasks, episodes, traces = driven
    assert len(traces.episodes) >= 4
    for trace in traces.episodes:
        i = trace.task
        assert getattr(episodes, trace.ending)[i]
        assert_array_equal(trace.pose[0], tasks[i].start)
        assert_array_equal(trace.pose[-1], episodes.final_pose[i])
        steps = math.ceil(episodes.time_s[i] / ROBOT.control_period_s - 1e-6)
        assert trace.time_s[-1] == episodes.time_s[i]
        for name in ("time_s", "pose", "twist", "waypoint", "clearance", "ranges"):
            assert len(getattr(trace, name)) == steps + 1
        assert trace.paid.shape == trace.weights.shape == (steps, len(REWARD_TERMS))


def test_the_first_failures_and_arrivals_are_kept(driven) -> None:
    _, episodes, traces = driven
    kept = {trace.task for trace in traces.episodes}
    expected = {*np.flatnonzero(~episodes.success)[:4], *np.flatnonzero(episodes.success)[:2]}
    assert kept == expected


def test_scans_are_those_of_the_world_at_that_time(driven) -> None:
    lidar = ROBOT.lidar
    for trace in driven[2].episodes:
        for step in range(0, len(trace.pose), 7):
            now = float(trace.time_s[step])
            seen = _core.raycast(
                trace.world.native, trace.pose[step : step + 1], lidar.angles_rad, lidar.max_range_m, now
            )
            error = trace.ranges[step].astype(float) - seen[0]
            # Noise, and the rounding of a half float below 8 m.
            assert np.abs(error).max() < 6.0 * lidar.noise_std_m + 0.004


def test_an_end_is_paid_for_once_and_the_shaping_weights_sum_to_1(driven) -> None:
    config = RewardConfig()
    pays = {"success": config.scale * 200.0, "failure": -config.scale * 200.0}
    for trace in driven[2].episodes:
        for name, ending in (("success", "success"), ("failure", "collision")):
            column = trace.paid[:, list(REWARD_TERMS).index(name)]
            assert_allclose(column[-1], pays[name] if trace.ending == ending else 0.0, rtol=1e-6)
            assert (column[:-1] == 0.0).all()
        assert_allclose(trace.weights[:, 2:].sum(axis=1), 1.0, atol=1e-5)


def test_routes_of_all_episodes_begin_and_end_where_the_robots_did(driven) -> None:
    _, episodes, traces = driven
    assert_array_equal(traces.tasks, episodes.task)
    for i, route in enumerate(traces.routes):
        assert_array_equal(route[0], episodes.start_xy_m[i])
        assert_array_equal(route[-1], episodes.final_pose[i, :2])
        assert np.hypot(*np.diff(route, axis=0).T).max(initial=0.0) <= 0.5 * ROBOT.max_speed_mps + 1e-6


def test_recording_and_chunks_change_nothing(driven, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks, episodes, traces = driven
    plain = rollout(Ahead(), tasks, Setting(robot=ROBOT, guidance="map"), num_threads=1).episodes
    assert plain.to_table().equals(episodes.to_table())
    monkeypatch.setattr("adrl.evaluation.rollout.CHUNK", 5)
    _, parts = record(tasks, Ahead(), failures=4, arrivals=2)
    for ours, theirs in zip(parts.episodes, traces.episodes, strict=True):
        assert (ours.task, ours.ending) == (theirs.task, theirs.ending)
        assert_array_equal(ours.ranges, theirs.ranges)
        assert_array_equal(ours.paid, theirs.paid)


def same_world(ours: World, theirs: World) -> None:
    for name in ("circles", "segments", "discs"):
        assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for first, second in zip(ours.polygons, theirs.polygons, strict=True):
        assert_array_equal(first, second)
    assert ours.bounds == theirs.bounds
    assert (ours.grid is None) == (theirs.grid is None)
    if ours.grid is not None and theirs.grid is not None:
        assert_array_equal(ours.grid.solid, theirs.grid.solid)
        assert (ours.grid.resolution_m, ours.grid.origin) == (theirs.grid.resolution_m, theirs.grid.origin)


def assert_same(ours: Traces, theirs: Traces) -> None:
    assert (ours.robot, ours.guidance, ours.maturity) == (theirs.robot, theirs.guidance, theirs.maturity)
    assert_array_equal(ours.tasks, theirs.tasks)
    for first, second in zip(ours.routes, theirs.routes, strict=True):
        assert_allclose(first, second, atol=1e-5)
    for first, second in zip(ours.episodes, theirs.episodes, strict=True):
        assert (first.task, first.ending, first.goal) == (second.task, second.ending, second.goal)
        assert_array_equal(first.ranges, second.ranges)
        for name in ("time_s", "path", "pose", "twist", "waypoint", "clearance", "weights", "paid"):
            assert_allclose(getattr(first, name), getattr(second, name), atol=1e-5)
        same_world(first.world, second.world)


def test_a_file_gives_back_what_was_written(driven, tmp_path: Path) -> None:
    path = tmp_path / "traces.safetensors"
    write_traces(path, driven[2])
    assert_same(read_traces(path), driven[2])


def test_tasks_of_one_world_share_it_also_in_the_file(tmp_path: Path) -> None:
    solid = np.zeros((80, 90), np.uint8)
    solid[60:64, 20:50] = 1
    grid = OccupancyGrid(solid=solid, resolution_m=0.1, origin=(0.0, 0.0, 0.0))
    room = World(bounds=ROOM, segments=enclosure(ROOM), circles=np.array([[4.0, 2.0, 0.4]]), grid=grid)
    box = replace(
        ROBOT, name="box", radius_m=None, footprint_m=((-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1))
    )
    starts = [(1.0, y, 0.0) for y in (2.0, 4.0)]
    tasks = [single_task(room, start, (7.0, start[1]), box) for start in starts]
    episodes, traces = record(tasks, Ahead(), box)
    assert [trace.ending for trace in traces.episodes] == ["collision", "success"]
    assert episodes.collision.tolist() == [True, False]
    assert traces.world is room
    write_traces(tmp_path / "t", traces)
    again = read_traces(tmp_path / "t")
    assert again.world is again.episodes[0].world is again.episodes[1].world
    assert_same(again, traces)


def test_a_start_at_the_goal_has_no_step(tmp_path: Path) -> None:
    room = World(bounds=ROOM, segments=enclosure(ROOM))
    task = replace(single_task(room, (4.0, 4.0, 0.0), (7.0, 4.0), ROBOT), goal=(4.1, 4.0))
    _, traces = record([task], AStarDwaPolicy())
    write_traces(tmp_path / "t", traces)
    (trace,) = read_traces(tmp_path / "t").episodes
    assert (trace.ending, trace.pose.shape, trace.paid.shape) == (RATES[0], (1, 3), (0, 6))


def test_what_is_no_trace_is_refused(driven, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="does not exist"):
        read_traces(tmp_path / "absent")
    path = tmp_path / "traces.safetensors"
    write_traces(path, driven[2])
    whole = path.read_bytes()
    for broken in (b"", whole[: len(whole) // 2], whole[:100], b"{}" * 50):
        path.write_bytes(broken)
        with pytest.raises(CheckpointError, match="traces"):
            read_traces(path)
