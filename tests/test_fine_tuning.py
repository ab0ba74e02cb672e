"""A run that begins with a policy: what it takes over, what it refuses, and that it ends no worse."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl.agents.config import Td3Config, TrainConfig
from adrl.deploy.another_robot import as_trained
from adrl.deploy.policies import find_policy
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig, ObservationEncoder
from adrl.planning.replanner_config import ReplannerConfig
from adrl.runs import RunConfig
from adrl.runs.run import Run
from adrl.types import LidarConfig
from adrl.worlds import ROBOTS
from deploy.recorded import a_policy_of_a_family
from small_run import finished_run, run_cli

DIFFBOT = Path("diffbot")
SHORT = replace(ROBOTS["diffbot"], name="short", lidar=LidarConfig(max_range_m=3.0), min_speed_mps=-0.2)


@pytest.mark.parametrize("robot", [ROBOTS["jackal"], SHORT], ids=lambda robot: robot.name)
def test_the_policy_sees_the_robot_as_it_will_when_it_is_evaluated(tmp_path: Path, robot):
    """Scans and commands have the scales that it knows, before, during and after the run."""
    run = Run.of(RunConfig(robot=robot, fine_tune=DIFFBOT))
    start = load_policy(resolve_policy("diffbot"))
    seen_as = as_trained(robot, ROBOTS["diffbot"])
    assert run.taken_as == find_policy(start).taken_as(robot) == seen_as
    about = replace(run.about_policy(), input_size=44)
    replace_config = type(start)(start.layers, about)
    replace_config.save(tmp_path)
    tuned = find_policy(tmp_path)
    assert tuned.robot == robot, "it drives its own robot where none is named"
    assert tuned.taken_as(robot) == run.taken_as
    env = run.make_env(4, task_pool=2, seed=0)
    env.reset()
    ranges, goal, twist, last_action, history = env.sim.measured()[:5]
    expected = ObservationEncoder(seen_as, run.encoder).encode(ranges, goal, twist, last_action, history)
    np.testing.assert_array_equal(env.sim.observe(), expected)
    assert ranges.max() <= np.float32(6.0)


def test_encoder_layers_and_replanner_are_the_policys():
    jackal = load_policy(resolve_policy("jackal"))
    run = Run.of(RunConfig(robot="jackal", scenario="cellular", fine_tune=Path("jackal")))
    assert run.encoder.fields() == jackal.config.encoder
    assert run.learner.td3.widths == jackal.config.widths
    assert run.replanner == find_policy("jackal").replanner != ReplannerConfig()
    own = ReplannerConfig(lookahead_m=1.0)
    assert Run.of(RunConfig(fine_tune=Path("jackal"), replanner=own)).replanner == own


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"encoder": EncoderConfig(num_sectors=24)}, r"encoder is .*24.*leave encoder out"),
        ({"learner": TrainConfig(td3=Td3Config(widths=(64, 64)))}, r"td3.widths is \(64, 64\).*\(128, 128\)"),
        ({"method": "bc"}, "'bc' clones alone"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_what_does_not_fit_the_policy_is_one_line(changes: dict, told: str):
    with pytest.raises(ConfigError, match=told) as caught:
        Run.of(RunConfig(fine_tune=DIFFBOT, **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.integration
def test_a_run_ends_no_worse_than_it_began_and_says_so(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    start, out = finished_run(tmp_path_factory), tmp_path / "tuned"
    arguments = ("train", "--fine-tune", start, "--robot", "turtlebot3_burger", "--scenario", "clutter")
    sizes = (
        *("--steps", 1024, "--num-envs", 32, "--task-pool", 8, "--start-steps", 128),
        *("--validation-episodes", 8, "--eval-interval-steps", 512, "--demonstration-steps", 256),
    )
    assert run_cli(*arguments, *sizes, "--out", out) == 0
    told = json.loads((out / "config.json").read_text())
    scores = told["validated"]
    assert scores["kept"]["success"] >= scores["start"]["success"]
    rows = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    validated = {row["env_steps"]: row["success"] for row in rows if row["success"] is not None}
    assert set(validated) == {0, 512, 1024}
    assert validated[scores["kept"]["env_steps"]] == max(validated.values())
    assert told["robot"]["name"] == "turtlebot3_burger"
    assert "to begin with" in capsys.readouterr().err
    # Weights of the start are left as they were where nothing was better.
    same = (out / "policy.safetensors").read_bytes() == (start / "policy.safetensors").read_bytes()
    assert same == (scores["kept"]["env_steps"] == 0)


@pytest.mark.slow
@pytest.mark.integration
def test_a_policy_of_a_family_goes_on_with_one_robot_and_what_it_does_not_know_of_it_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    a_policy_of_a_family().save(tmp_path / "family")
    (tmp_path / "own.toml").write_text("max_speed_mps = 0.6\n[lidar]\nnum_beams = 45\n")
    few = ("--steps", "2048", "--demonstration-steps", "1024", "--task-pool", "8", "--num-envs", "16")
    few += ("--critic-warmup-updates", "8", "--start-steps", "256", "--eval-interval-steps", "2048")
    given = ("--scenario", "clutter", "--robot", tmp_path / "own.toml", "--fine-tune", tmp_path / "family")
    out = ("--validation-episodes", "4", "--out", tmp_path / "run")
    assert run_cli("train", *given, *few, *out) == 0
    assert "own is outside: lidar.num_beams 45; the family has 60 to 1440" in caplog.text
    tuned = find_policy(tmp_path / "run")
    assert tuned.robot is not None
    assert tuned.robot.lidar.num_beams == 45
    assert tuned.told_of_body
    assert tuned.taken_as(ROBOTS["jackal"]) == ROBOTS["jackal"], "it is told what the body is"
