"""The paths that a car which stood was given: what is drawn, recorded and replayed is what it followed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.highlevel import AnyReader

from adrl.bags import BagWriter
from adrl.envs import NavSim, Setting
from adrl.envs.render import Renderer
from adrl.errors import CheckpointError
from adrl.evaluation.bag_recorder import START_S, BagRecorder
from adrl.evaluation.rollout import rollout
from adrl.evaluation.trace_file import read_traces, write_traces
from adrl.evaluation.traces import Trace, TraceRecorder
from adrl.planning.standstill import WAIT_S
from adrl.report.document import _replay, _Worlds
from adrl.types import RobotConfig
from adrl.worlds import single_task
from env_tasks import room

CAR = RobotConfig(name="car", max_speed_mps=0.6, min_speed_mps=-0.3, min_turning_radius_m=0.6)
TASK = replace(single_task(room(10.0), (-3.0, 0.0, 0.0), (3.0, 1.0), CAR), time_limit_s=3.0 * WAIT_S)
PERIOD_S = CAR.control_period_s
STOPS = round(2.0 / PERIOD_S)
"""Steps after which it stands."""


class Stops:
    """Turns off its path, and stands then."""

    def __init__(self) -> None:
        self.step = 0

    def act(self, observation: np.ndarray) -> np.ndarray:
        self.step += 1
        action = (1.0, 1.0) if self.step <= STOPS else (-1.0 / 3.0, 0.0)
        return np.tile(np.array(action, np.float32), (len(observation), 1))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trace, Path]:
    bag, recorder = tmp_path_factory.mktemp("later") / "car.bag", TraceRecorder()
    with BagWriter(bag, CAR) as writer:
        recorders = [recorder, BagRecorder(writer)]
        rollout(Stops(), [TASK], Setting(robot=CAR, guidance="map"), recorders=recorders, num_threads=1)
    write_traces(bag.with_name("traces"), recorder.traces())
    return recorder.traces().episodes[0], bag


def test_each_begins_where_the_car_stood_when_it_was_given(driven: tuple[Trace, Path]) -> None:
    trace, _ = driven
    assert_array_equal(trace.path, TASK.path)
    since = np.unique(trace.later_paths[:, 0])
    assert len(since) == 2, "once each WAIT_S"
    for state in since:
        path = trace.later_paths[trace.later_paths[:, 0] == state, 1:]
        assert state * PERIOD_S >= WAIT_S
        assert_allclose(path[0], trace.pose[int(state), :2], atol=0.1)
        assert_allclose(path[-1], TASK.goal, atol=0.1)


def test_a_file_gives_them_back_and_what_is_none_is_refused(
    driven: tuple[Trace, Path], tmp_path: Path
) -> None:
    trace, bag = driven
    traces = read_traces(bag.with_name("traces"))
    assert_allclose(traces.episodes[0].later_paths, trace.later_paths, atol=1e-5)
    good, state = trace.later_paths, np.array([1.0, 0.0, 0.0])
    for bad in (good[:, :2], good[::-1], good + 0.5 * state, good + 1e4 * state, good * np.nan):
        traces.episodes[0] = replace(trace, later_paths=bad)
        write_traces(tmp_path / "bad", traces)
        with pytest.raises(CheckpointError, match="later_paths"):
            read_traces(tmp_path / "bad")


def test_a_bag_has_a_plan_for_each_at_its_time(driven: tuple[Trace, Path]) -> None:
    trace, bag = driven
    with AnyReader([bag]) as reader:
        plans: list[tuple[float, Any]] = [
            (time_ns * 1e-9 - START_S, reader.deserialize(raw, line.msgtype))
            for line, time_ns, raw in reader.messages()
            if line.topic == "/plan"
        ]
    since = np.unique(trace.later_paths[:, 0])
    assert_allclose([at for at, _ in plans], [0.0, *since * PERIOD_S], atol=1e-6)
    told = np.array([(p.pose.position.x, p.pose.position.y) for _, plan in plans[1:] for p in plan.poses])
    assert_array_equal(told, trace.later_paths[:, 1:])


def test_a_replay_has_each_from_its_time_on(driven: tuple[Trace, Path]) -> None:
    trace, _ = driven
    shown = _replay(trace, CAR, _Worlds())["later_paths"]
    since = np.unique(trace.later_paths[:, 0])
    assert_allclose([at for at, _ in shown], since * PERIOD_S, atol=1e-6)
    assert_allclose(np.concatenate([path for _, path in shown]), trace.later_paths[:, 1:].ravel(), atol=2e-3)


def test_a_picture_shows_the_path_that_is_followed() -> None:
    sim = NavSim(1, CAR, guidance="map")
    sim.reset(np.array([0]), [TASK], np.zeros(1, np.uint64), np.random.default_rng(0))
    policy = Stops()
    for _ in range(round((WAIT_S + 1.5) / PERIOD_S)):
        sim.step(policy.act(np.empty((1, 0))))
    assert sim.paths[0] is not TASK.path
    picture = Renderer().draw(sim, 0)
    sim.tasks[0] = replace(TASK, path=np.empty((0, 2)))
    assert_array_equal(Renderer().draw(sim, 0), picture)
    sim.paths[0] = TASK.path
    assert (Renderer().draw(sim, 0) != picture).any()


def test_the_state_of_a_simulator_has_it() -> None:
    first, second = (NavSim(1, CAR, guidance="map") for _ in range(2))
    first.reset(np.array([0]), [TASK], np.zeros(1, np.uint64), np.random.default_rng(0))
    policy = Stops()
    for _ in range(round((WAIT_S + 1.5) / PERIOD_S)):
        first.step(policy.act(np.empty((1, 0))))
    second.set_state(first.state(), first.tasks)
    assert_array_equal(second.paths[0], first.paths[0])
