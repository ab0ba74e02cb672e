"""A training on the robots of a family, from the command line to the policy that drives each of them."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl.agents.config import TrainConfig
from adrl.deploy.policies import find_policy
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig
from adrl.runs import RunConfig, rounds
from adrl.runs.run import REACH_M, SEED_ROBOTS, STOP_WITHIN_M, Run
from adrl.worlds import FAMILIES, ROBOTS
from small_run import TRAIN, run_cli

ANY = FAMILIES["any"]


def test_a_run_of_a_family_tells_the_body_and_has_one_scale_of_metres():
    run = Run.of(RunConfig(robot="any"))
    assert run.robot == ANY
    assert run.encoder == EncoderConfig(body=True, reach_m=REACH_M)
    own = RunConfig(robot="any", encoder=EncoderConfig(history_steps=2, reach_m=6.0))
    assert Run.of(own).encoder == EncoderConfig(history_steps=2, reach_m=6.0, body=True)
    assert Run.of(RunConfig()).encoder == EncoderConfig(), "a run of one robot is as before"
    assert run.folder == Path("runs/adrl-clutter-any-goal-s0")
    about = run.about_policy()
    assert about.robot == {}
    assert about.family["name"] == "any"


def test_no_robot_of_a_family_is_driven_faster_than_it_stops_within_a_few_decimetres():
    run = Run.of(RunConfig(robot="any"))
    own = [ANY.draw("train", i) for i in range(40)]
    assert [robot.slowed(STOP_WITHIN_M) for robot in own] == [*run.robots("train", 40)]
    assert sum(robot.stop_distance_m > STOP_WITHIN_M for robot in own) > 5, "some would be faster"
    assert run.about_policy().extra["environment"]["stop_within_m"] == STOP_WITHIN_M
    assert [*Run.of(RunConfig(robot="any", stop_within_m=1000.0)).robots("train", 40)] == own
    assert "stop_within_m" not in Run.of(RunConfig()).about_policy().extra["environment"]


@pytest.mark.parametrize(("guidance", "near"), [("map", True), ("goal", False), ("map,goal", False)])
def test_one_that_learns_by_waypoints_alone_is_shown_no_farther_point_on_its_own_map(
    guidance: str, near: bool
):
    assert Run.of(RunConfig(robot="any", guidance=guidance)).replanner.near == near
    assert not Run.of(RunConfig(guidance=guidance)).replanner.near, "robots of one kind have learnt without"


@pytest.mark.slow
@pytest.mark.integration
def test_a_guidance_for_a_place_is_kept_when_the_run_goes_on(tmp_path: Path):
    places = (
        "--scenario",
        "clutter,complex",
        "--robot",
        "any",
        "--validation-episodes",
        "4",
        "--out",
        tmp_path,
        "--method",
        "td3",
    )
    assert run_cli(*TRAIN, *places, "--guidance", "map,goal@clutter") == 0
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["environment"]["guidances"] == ["map", "goal"]
    assert config["settings"]["guidance"] == "map,goal@clutter"
    longer = [word if word != "4096" else "6144" for word in TRAIN]
    assert run_cli(*longer, *places, "--resume", "--guidance", "map,goal") == 2, "other tasks"
    assert run_cli(*longer, *places, "--resume") == 0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"guidance": "map,goal@"}, "give a place after @"),
        (
            {"guidance": "map,goal@clutter", "robot": "diffbot"},
            "for families of robots, and diffbot is one robot",
        ),
    ],
    ids=str,
)
def test_a_guidance_for_no_place_or_for_one_robot_is_refused(options: dict[str, Any], told: str):
    given: dict[str, Any] = {"robot": "any", "scenario": "clutter,complex"} | options
    with pytest.raises(ConfigError, match=told):
        Run.of(RunConfig(**given))


def test_each_task_has_a_robot_of_its_own_of_the_training_split():
    env = Run.of(RunConfig(robot="any")).make_env(6, task_pool=6, seed=0)
    assert [kind.robot.name for kind in env.kinds] == [f"any:train:{i}" for i in range(6)]
    observation, _ = env.reset()
    assert env.single_observation_space.shape == (env.sim.encoder.size,)
    assert env.observation_space.contains(observation)
    for _ in range(5):
        observation = env.step(env.action_space.sample())[0]
        assert env.observation_space.contains(observation)
    assert env.sim.encoder.mirror is not None, "robots that are not symmetric mirror into each other"


def test_each_seed_trains_with_robots_of_its_own_and_all_are_validated_with_the_same():
    runs = [Run.of(RunConfig(robot="any", learner=TrainConfig(seed=seed))) for seed in (0, 1, 7)]
    trained = [{kind.robot.name for kind in run.make_env(4, task_pool=4).kinds} for run in runs]
    assert trained[0] == {f"any:train:{i}" for i in range(4)}
    assert trained[2] == {f"any:train:{7_000_000 + i}" for i in range(4)}
    validated = [[robot.name for robot in run.robots("validation", 4)] for run in runs]
    assert validated == [[f"any:validation:{i}" for i in range(4)]] * 3
    assert RunConfig(task_pool=SEED_ROBOTS).task_pool == SEED_ROBOTS
    with pytest.raises(ConfigError, match="task_pool"):
        RunConfig(task_pool=SEED_ROBOTS + 1)  # robots of the next seed


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (
            {"fine_tune": Path("diffbot")},
            "policy of fine_tune is not told of the body: it was trained for robot diffbot",
        ),
        ({"env": "gazebo"}, "robot any is several, and gazebo drives one; give one"),
    ],
    ids=["fine_tune", "env"],
)
def test_what_a_family_cannot_do_is_one_line(options: dict, told: str):
    with pytest.raises(ConfigError, match=told) as caught:
        Run.of(RunConfig(robot="any", **options))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "options",
    [{"expert": "few:3"}, {"dataset": Path("drives")}, {"fine_tune": Path("diffbot")}, {"method": "td3"}],
    ids=str,
)
def test_rounds_of_demonstrations_need_somebody_to_ask(options: dict):
    options = {"method": "adrl"} | options
    with pytest.raises(ConfigError, match="demonstration_rounds asks an expert"):
        RunConfig(demonstration_rounds=2, **options)


@pytest.mark.slow
@pytest.mark.integration
def test_rounds_that_were_stopped_go_on_with_the_next_to_the_same_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """And begin with the clone: the best is kept, and validated first."""
    given = (*TRAIN, "--demonstration-rounds", "2", "--guidance", "map", "--validation-episodes", "4")
    through, stopped = tmp_path / "through", tmp_path / "stopped"
    assert run_cli(*given, "--out", through) == 0
    assert "to begin with" in capsys.readouterr().err

    real = rounds.collect

    def killed_in_the_second(*arguments, **options):
        if options.get("seed") == 2 * rounds.TASKS_APART:
            os.kill(os.getpid(), signal.SIGTERM)
        return real(*arguments, **options)

    monkeypatch.setattr(rounds, "collect", killed_in_the_second)
    assert run_cli(*given, "--out", stopped) != 0
    assert (
        "stopped with 2 rounds of demonstrations; the same command with --resume" in capsys.readouterr().err
    )
    monkeypatch.setattr(rounds, "collect", real)
    assert run_cli(*given, "--out", stopped) != 0
    assert "unfinished run; give --resume" in capsys.readouterr().err
    for other, told in (
        (("--seed", "1"), "run.seed = 0, this run has 1"),
        (("--method", "td3bc"), "run.method = 'adrl', this run has 'td3bc'"),
        (("--demonstration-rounds", "0"), "holds a run with demonstration_rounds"),
    ):
        assert run_cli(*given, "--out", stopped, "--resume", *other) != 0
        assert told in capsys.readouterr().err
    second = stopped / "checkpoint" / "rounds" / "01.safetensors"
    whole = second.read_bytes()
    second.write_bytes(whole[:-100])
    assert run_cli(*given, "--out", stopped, "--resume") != 0
    assert "01.safetensors: truncated" in capsys.readouterr().err
    second.write_bytes(whole)
    assert run_cli(*given, "--out", stopped, "--resume") == 0
    assert find_policy(stopped).fingerprint == find_policy(through).fingerprint


@pytest.mark.slow
@pytest.mark.integration
def test_one_command_trains_for_any_robot_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "run"
    few = ("--robot", "any", "--eval-interval-steps", "4096", "--validation-episodes", "6")
    assert run_cli(*TRAIN, *few, "--out", out) == 0
    config = json.loads((out / "config.json").read_text())
    assert config["settings"]["robot"] == config["family"]["name"] == "any"
    policy = find_policy(out)
    assert policy.family == ANY
    assert policy.robot is None
    assert policy.strange(ROBOTS["jackal"]) is None
    assert policy.taken_as(ROBOTS["jackal"]) == ROBOTS["jackal"].slowed(STOP_WITHIN_M)
    assert policy.taken_as(ROBOTS["diffbot"]) == ROBOTS["diffbot"], "it stops in less"
    drives = (
        "--scenario",
        "clutter",
        "--robot",
        "any",
        "--robots",
        "4",
        "--episodes",
        "1",
        "--json",
        tmp_path / "s.json",
    )
    assert run_cli("evaluate", "--policy", out, *drives) == 0
    summary = json.loads((tmp_path / "s.json").read_text())
    assert (summary["trained_for"], summary["warnings"]) == ("any", [])
    assert (
        run_cli(
            "evaluate", "--policy", out, "--robot", "any:test:3", "--scenario", "clutter", "--episodes", "2"
        )
        == 0
    )
    longer = [word if word != "4096" else "6144" for word in TRAIN]
    assert run_cli(*longer, *few, "--out", out, "--resume") == 0
    assert json.loads((out / "config.json").read_text())["env_steps"] == 6144
    other = np.array([run_cli(*longer, "--robot", "jackal", "--out", out, "--resume")])
    assert other[0] == 2, "another robot is another run"
