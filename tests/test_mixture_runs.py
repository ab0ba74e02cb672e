"""One policy for robots of a family, several places and guidances: trained, gone on with, validated, evaluated."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl.agents.config import TrainConfig
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy
from adrl.errors import AdrlError
from adrl.evaluation.evaluate import evaluate
from adrl.runs import RunConfig, train
from adrl.runs.run import Run
from adrl.worlds import FAMILIES, load_robots

MIXED: dict[str, Any] = {"robot": "any", "scenario": "clutter,rooms", "guidance": "replan,goal,map"}


def config(steps: int, out: Path, resume: bool = False) -> RunConfig:
    """td3: no planner has to drive, which is most of a short run."""
    learner = TrainConfig(
        steps=steps, start_steps=128, checkpoint_interval_steps=None, eval_interval_steps=512
    )
    sizes: dict[str, Any] = {"num_envs": 16, "task_pool": 12, "validation_episodes": 6}
    return RunConfig(**MIXED, **sizes, method="td3", learner=learner, out=out, resume=resume)


@pytest.mark.slow
@pytest.mark.integration
def test_a_run_that_goes_on_is_the_run_and_evaluate_drives_its_policy(tmp_path: Path):
    train(config(256, tmp_path / "parts"))
    train(config(512, tmp_path / "parts", resume=True))
    whole = train(config(512, tmp_path / "whole"))
    parts = load_policy(tmp_path / "parts")
    for (a, b), (c, d) in zip(parts.layers, whole.policy.layers, strict=True):
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(b, d)
    found = find_policy(tmp_path / "whole")
    assert found.family == load_robots("any") == FAMILIES["any"]
    assert found.robot is None
    assert found.guidance == "replan", "the first is its own"
    extra = whole.policy.config.extra
    assert extra["scenario"] == "clutter,rooms"
    assert extra["environment"]["guidances"] == ["replan", "goal", "map"]
    for guidance in ("replan", "goal", "map"):
        done = evaluate(tmp_path / "whole", robot="jackal", scenario="rooms", guidance=guidance, episodes=1)
        assert done.summary["guidance"] == guidance


def test_training_and_validation_have_robots_places_and_guidances_of_their_splits():
    run = Run.of(RunConfig(**MIXED))
    env = run.make_env(2, task_pool=40)
    train_robots = {kind.robot.name for kind in env.kinds}
    assert train_robots == {f"any:train:{i}" for i in range(40)}
    assert {kind.guidance for kind in env.kinds} == {"replan", "goal", "map"}
    assert [place.name for place in env.scenarios] == ["clutter", "rooms"]
    assert all(kind.known_as == kind.robot for kind in env.kinds)
    mixture = run.mixture("validation", 40)
    assert {mixture.entry(i)[0].robot.name for i in range(40)} == {f"any:validation:{i}" for i in range(40)}
    assert {mixture.entry(i)[1].name for i in range(40)} == {"clutter", "rooms"}
    again = Run.of(dataclasses.replace(run.config)).mixture("validation", 40)
    assert [mixture.entry(i)[0] for i in range(40)] == [again.entry(i)[0] for i in range(40)]


def test_a_familys_policy_is_told_of_the_body():
    assert Run.of(RunConfig(robot="any")).encoder.body
    assert not Run.of(RunConfig(robot="jackal", scenario="clutter,rooms")).encoder.body


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"dataset": Path("somewhere"), "method": "adrl"}, "robot any is several, and a dataset is of one"),
        ({"fine_tune": Path("jackal")}, "not told of the body"),
        ({"guidance": "goal,maps"}, "maps"),
        ({"scenario": "clutter,roms"}, "rooms"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_what_is_no_mixture_is_one_line(changes: dict, told: str):
    with pytest.raises(AdrlError, match=told) as caught:
        Run.of(RunConfig(**MIXED | changes)).make_env(1)
    assert "\n" not in str(caught.value)
