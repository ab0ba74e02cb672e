"""A policy behind the runtime's supervisor: what stands is not driven into, and traces say what it was held for."""

from pathlib import Path

import numpy as np
import pytest

from adrl.errors import ConfigError
from adrl.evaluation.evaluate import evaluate
from adrl.evaluation.results import TRACES_FILE
from adrl.evaluation.trace_file import read_traces
from adrl.report.source import read_summary
from adrl.worlds import get_scenario, load_robot, task_set

EPISODES = 6
STANDS = 0.02


class FullSpeed:
    """Straight on, whatever is there."""

    name = "full speed"

    def act(self, observation):
        return np.tile(np.array([1.0, 0.0], dtype=np.float32), (len(observation), 1))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("supervised")
    evaluate(FullSpeed(), scenario="clutter", episodes=EPISODES, supervised=True, out=out, num_threads=1)
    return out


def test_who_is_supervised_drives_into_nothing_that_stands(driven: Path) -> None:
    alone = evaluate(FullSpeed(), scenario="clutter", episodes=EPISODES, num_threads=1).summary
    summary = read_summary(driven)
    assert (alone["supervised"], summary["supervised"]) == (False, True)
    assert alone["collision"] >= 0.5
    assert summary["collision"] == 0.0


def test_a_trace_says_of_each_step_why_the_robot_was_held(driven: Path) -> None:
    traces = read_traces(driven / TRACES_FILE)
    stood = 0
    for trace in traces.episodes:
        assert trace.reasons is not None
        assert len(trace.reasons) == len(trace.pose) - 1
        for twist, reasons in zip(trace.twist[5:], trace.reasons[4:], strict=True):
            if abs(twist[0]) < STANDS:  # the policy never asks for that
                assert {"obstacle", "unseen", "recovering"} & set(reasons)
                stood += 1
    assert stood > 10


def test_a_planner_has_no_supervisor() -> None:
    with pytest.raises(ConfigError, match="drives in simulators only"):
        evaluate("astar-dwa", episodes=1, supervised=True)


def test_unsupervised_traces_hold_no_reasons() -> None:
    robot = load_robot("diffbot")
    tasks = task_set(get_scenario("clutter"), robot, "test", 1)
    done = evaluate(FullSpeed(), tasks=tasks, robot=robot, traces=True, num_threads=1)
    assert done.traces is not None
    assert done.traces.episodes[0].reasons is None
