"""Policies that answer in an expert's place."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl.comparison.compare import compare
from adrl.comparison.config import CompareConfig
from adrl.deploy.policy import MlpPolicy
from adrl.deploy.training_worlds import training_worlds
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation import collect, find_expert
from adrl.imitation.demonstrations import NoiseConfig
from adrl.observation import EncoderConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.runs import RunConfig
from adrl.runs.card import card, train_command
from adrl.runs.run import REACH_M, Run
from small_run import TRAIN, run_cli

ROWS = 8
ENCODER = EncoderConfig(history_steps=2)
BODY = EncoderConfig(history_steps=2, body=True, reach_m=REACH_M)
LEARNER = RunConfig(
    scenario="clutter,rooms",
    guidance="map,goal@clutter",
    robot="any",
    expert="mapless",
    encoder=ENCODER,
    task_pool=24,
)


def teacher(
    folder: Path, scenario: str = "clutter", guidance: str = "goal", seed: int = 0, **options: object
) -> str:
    """A folder with a policy that does something, as a run of such tasks would leave it."""
    settings = {"robot": "any", "encoder": ENCODER} | options
    run = Run.of(RunConfig(scenario=scenario, guidance=guidance, **settings))  # pyright: ignore[reportArgumentType]
    return saved(run, folder, seed)


def saved(run: Run, folder: Path, seed: int = 0) -> str:
    """The same, of this run."""
    size = run.make_env(1, task_pool=1).single_observation_space.shape
    assert size is not None
    rng = np.random.default_rng(seed)
    sizes = [(size[0], 8), (8, 2)]
    layers = [(rng.normal(0.0, 0.3, s).astype(np.float32), np.zeros(s[1], np.float32)) for s in sizes]
    policy = MlpPolicy(layers, replace(run.about_policy(), input_size=size[0], widths=(8,)))
    policy.save(folder)
    return str(folder)


def test_a_teacher_answers_in_tasks_like_its_own_and_the_expert_in_all_others(tmp_path: Path) -> None:
    names = teacher(tmp_path / "goal"), teacher(tmp_path / "rooms", "rooms", "map", seed=1)
    run = Run.of(replace(LEARNER, teachers=",".join(names)))
    env = run.make_env(ROWS)
    taught, alone = run.expert.driver(env, 0), find_expert("mapless").driver(env, 0)
    observation, _ = env.reset(seed=3)
    policies = [one.policy for one in run.expert.teachers]  # pyright: ignore[reportAttributeAccessIssue]
    told = Counter[str]()
    for _ in range(60):
        actions, own = taught.actions(), alone.actions()
        for row, task in enumerate(env.task_index):
            place = env.scenario_of_task(int(task)).name
            setting = f"{env.kinds[env.kind_of_task(int(task))].guidance}@{place}"
            expected = {
                "goal@clutter": policies[0].act(observation[row : row + 1])[0],
                "map@rooms": policies[1].act(observation[row : row + 1])[0],
                "map@clutter": own[row],
            }[setting]
            np.testing.assert_allclose(actions[row], expected, atol=1e-6)
            told[setting] += 1
        observation, *_ = env.step(actions)
    assert len(told) == 3
    assert min(told.values()) > 20, told


def test_what_a_teacher_shows_can_be_driven_through_whole_drives(tmp_path: Path) -> None:
    """The expert is asked in some rows alone, and those are as if it were asked in all."""
    run = Run.of(replace(LEARNER, teachers=teacher(tmp_path)))
    calm = NoiseConfig(fraction=0.0)
    shown, alone = (
        collect(run.make_env(ROWS), 1600, expert=expert, noise=calm, seed=5)
        for expert in (run.expert, find_expert("mapless"))
    )
    same = np.all(shown.expert_action == alone.expert_action, axis=1).reshape(ROWS, -1)
    first = [int(row.argmin()) if not row.all() else row.size for row in same]
    assert 0 in first, "some rows begin with the goal alone in clutter"
    assert max(first) > 50, "and others with the map"


def test_it_answers_where_a_learner_drives(tmp_path: Path) -> None:
    run = Run.of(replace(LEARNER, guidance="goal", scenario="clutter", teachers=teacher(tmp_path)))
    (policy,) = (one.policy for one in run.expert.teachers)  # pyright: ignore[reportAttributeAccessIssue]
    shown = collect(
        run.make_env(ROWS), 400, expert=run.expert, learner=lambda o: np.zeros((len(o), 2), np.float32)
    )
    np.testing.assert_allclose(shown.expert_action, policy.act(shown.observation), atol=1e-6)


def test_it_says_who_teaches(tmp_path: Path) -> None:
    """So rounds that others have shown are not gone on with."""
    one, other = (
        str(Run.of(replace(LEARNER, teachers=teacher(tmp_path / str(seed), seed=seed))).expert)
        for seed in (0, 1)
    )
    assert one.startswith("mapless:4; goal@clutter ")
    assert other.startswith("mapless:4; goal@clutter ")
    assert one != other
    mixed = teacher(tmp_path / "mixed", "clutter,rooms", "map,goal@clutter")
    assert (
        str(Run.of(replace(LEARNER, teachers=mixed)).expert).split()[1]
        == "goal@clutter,map@clutter,map@rooms"
    )


@pytest.mark.parametrize(
    ("of_teacher", "of_run", "says"),
    [
        (
            {"encoder": EncoderConfig()},
            {},
            "was trained with encoder.history_steps 0, and the run has 2; train both",
        ),
        ({"scenario": "complex"}, {}, "was trained in goal@complex, and the run has none of these"),
        ({"stop_within_m": 0.5}, {}, r"stop_within_m 0\.5, and the run has 0\.3; train both"),
        (
            {"guidance": "replan", "replanner": ReplannerConfig(lookahead_m=5.0)},
            {"guidance": "replan"},
            r"replanner\.lookahead_m 5\.0, and the run has 1\.5",
        ),
        (
            {"robot": "diffbot"},
            {"robot": "jackal", "scenario": "clutter", "guidance": "goal"},
            r"another robot, with radius_m 0.2 instead of none, .*--robot",
        ),
        ({"robot": "docs/policies/any.toml"}, {}, "not trained for all robots of family any; train both"),
        (
            {"robot": "diffbot", "encoder": BODY, "stop_within_m": 0.3},
            {},
            "not trained for all robots of family any",
        ),
        ({}, {"expert": "few:5"}, "few:5 shows no more than its drives, and teachers would"),
        ({}, {"method": "td3", "expert": "perfect"}, "learns without an expert; leave out teachers"),
        ({}, {"dataset": Path("drives"), "expert": "perfect"}, "teachers .* would drive, and dataset holds"),
    ],
)
def test_one_that_cannot_teach_is_refused(
    tmp_path: Path, of_teacher: dict[str, object], of_run: dict[str, object], says: str
) -> None:
    folder = teacher(tmp_path, **of_teacher)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match=says):
        Run.of(replace(LEARNER, teachers=folder, **of_run))  # pyright: ignore[reportArgumentType]


def test_a_teacher_of_many_robots_teaches_one_of_them(tmp_path: Path) -> None:
    one = replace(LEARNER, scenario="clutter", guidance="goal", encoder=BODY, stop_within_m=0.3)
    one = replace(one, robot="jackal", teachers=teacher(tmp_path / "run"))
    assert "goal@clutter" in str(Run.of(one).expert)
    wide = tmp_path / "wide.toml"
    wide.write_text("radius_m = 1.5\n")
    with pytest.raises(ConfigError, match=r"does not know the robot: .*outside: .*--robot"):
        Run.of(replace(one, robot=str(wide)))


def test_one_that_takes_the_robot_for_another_is_refused(tmp_path: Path) -> None:
    """What it asks for is read as shares of that other robot's speeds."""
    start = saved(Run.of(RunConfig(robot="turtlebot3_burger", guidance="goal")), tmp_path / "start")
    begun = {"scenario": "clutter", "robot": "jackal", "guidance": "goal", "method": "adrl"}
    own, other = (
        saved(Run.of(RunConfig(**begun, fine_tune=tune)), tmp_path / name)  # pyright: ignore[reportArgumentType]
        for name, tune in (("own", None), ("other", start))
    )
    assert "goal@clutter" in str(Run.of(RunConfig(**begun, teachers=own)).expert)  # pyright: ignore[reportArgumentType]
    assert "goal@clutter" in str(Run.of(RunConfig(**begun, teachers=other, fine_tune=start)).expert)  # pyright: ignore[reportArgumentType]
    for teachers, tune in ((own, start), (other, None)):
        with pytest.raises(ConfigError, match=r"takes the robot for another .*max_range_m .*--fine-tune"):
            Run.of(RunConfig(**begun, teachers=teachers, fine_tune=tune))  # pyright: ignore[reportArgumentType]


def test_another_world_of_the_same_name_is_refused(tmp_path: Path) -> None:
    box = "<link name='l'><collision name='c'><geometry><box><size>{0} {0} 1</size></box></geometry></collision></link>"
    for name, side_m in (("here", 0.5), ("there", 0.7)):
        (tmp_path / name).mkdir()
        walls = "".join(
            f"<model name='{k}'><static>1</static><pose>{x} {y} 0.5 0 0 0</pose>{box.format(side_m)}</model>"
            for k, (x, y) in enumerate(((0, 0), (6, 0), (0, 6), (6, 6), (3, 3)))
        )
        (tmp_path / name / "w.world").write_text(f"<sdf version='1.6'><world name='w'>{walls}</world></sdf>")
    one, other = (tmp_path / name / "w.world" for name in ("here", "there"))
    settings = {"robot": "diffbot", "encoder": ENCODER, "guidance": "goal"}
    run = Run.of(RunConfig(world=one, **settings))  # pyright: ignore[reportArgumentType]
    folder = saved(run, tmp_path / "run")
    assert "goal@sdf:w" in str(Run.of(replace(run.config, teachers=folder)).expert)
    with pytest.raises(ConfigError, match="another world that is called sdf:w"):
        Run.of(replace(run.config, world=other, teachers=folder))


@pytest.mark.parametrize("expert", ["slow:0.5", "narrow-shy:1.2", "noisy", "half-wise"])
def test_what_an_expert_does_wrong_its_teacher_does_not(tmp_path: Path, expert: str) -> None:
    """It is neither slowed nor given up."""
    learner = replace(LEARNER, robot="diffbot", scenario="complex", guidance="map", expert=expert)
    folder = teacher(tmp_path, "complex", "map", robot="diffbot")
    run = Run.of(replace(learner, teachers=folder))
    (policy,) = (one.policy for one in run.expert.teachers)  # pyright: ignore[reportAttributeAccessIssue]
    shown = collect(run.make_env(ROWS), 2400, expert=run.expert, noise=NoiseConfig(fraction=0.0))
    np.testing.assert_allclose(shown.expert_action, policy.act(shown.observation), atol=1e-6)
    np.testing.assert_array_equal(shown.action, shown.expert_action)
    driven = run.expert.driver(env := run.make_env(ROWS), 0)
    env.reset(seed=0)
    for _ in range(200):
        env.step(driven.actions())
        assert not driven.given_up.any()


def test_one_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises((ConfigError, CheckpointError), match="nowhere"):
        Run.of(replace(LEARNER, teachers=str(tmp_path / "nowhere")))


def test_a_run_tells_who_taught_it(tmp_path: Path) -> None:
    run = Run.of(replace(LEARNER, teachers=teacher(tmp_path)))
    about = run.about_policy().extra
    assert about["settings"]["teachers"] == str(tmp_path)
    assert about["settings"]["expert"] == "mapless:4", "as --expert takes it"
    (told,) = about["teachers"]
    assert told["taught"] == ["goal@clutter"]
    assert about["environment"]["teachers"] == [f"goal@clutter {told['fingerprint']}"]
    assert told["fingerprint"] in str(run.expert)
    assert train_command(told["settings"]).startswith("adrl train --scenario clutter --robot any ")


@pytest.mark.slow
@pytest.mark.integration
def test_rounds_are_gone_on_with_by_their_own_teacher_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = (
        saved(Run.of(RunConfig(robot="diffbot", guidance="map")), tmp_path / str(seed), seed)
        for seed in (0, 1)
    )
    folder = tmp_path / "run"
    given = (*TRAIN, "--demonstration-rounds", "1", "--validation-episodes", "4", "--out", folder)
    assert run_cli(*given, "--guidance", "map", "--teachers", one) == 0
    assert "demonstrated by" not in capsys.readouterr().err, "the planner was asked in no task"
    assert "planner" not in json.loads((folder / "config.json").read_text())["environment"]
    for words in (("--teachers", other), ()):
        assert run_cli(*given, *words, "--resume") != 0
        said = capsys.readouterr().err
        assert "environment.teachers = ['map@clutter" in said
        assert len(said.splitlines()[-1]) < 400
    assert run_cli(*given, "--teachers", one, "--resume", "--steps", "6144") == 0
    assert "6144 environment steps" in capsys.readouterr().err, "with the guidance of its checkpoint"


def test_methods_without_an_expert_are_compared_without_teachers(tmp_path: Path) -> None:
    folder = teacher(tmp_path, robot="diffbot")
    shared = {"robot": "diffbot", "guidance": "goal", "encoder": ENCODER, "teachers": folder}
    comparison = CompareConfig(methods="adrl,td3", **shared)  # pyright: ignore[reportArgumentType]
    assert set(comparison.method_settings()) >= {"adrl", "td3"}
    assert [comparison.run(name, 0, tmp_path).teachers for name in ("adrl", "td3")] == [folder, ""]
    settings = comparison.settings()
    teacher(tmp_path, robot="diffbot", seed=1)
    assert comparison.settings() != settings, "trained anew"


def test_a_comparison_with_an_unfit_teacher_is_refused_before_any_work(tmp_path: Path) -> None:
    folder = teacher(tmp_path / "teacher", robot="diffbot")
    comparison = CompareConfig(
        methods="td3,adrl", robot="diffbot", guidance="goal", teachers=folder, out=tmp_path / "out"
    )
    with pytest.raises(ConfigError, match=r"encoder\.history_steps 2"):
        compare(replace(comparison, learner=replace(comparison.learner, steps=2048)))
    assert not (tmp_path / "out").exists()


def test_who_was_taught_has_learned_from_the_worlds_of_its_teacher(tmp_path: Path) -> None:
    folder = Path(teacher(tmp_path))
    config = json.loads((folder / "config.json").read_text())
    config["environment"]["worlds"] = ["0123456789abcdef"]
    (folder / "config.json").write_text(json.dumps(config))
    about = Run.of(replace(LEARNER, teachers=str(folder))).about_policy()
    assert training_worlds(about) == {"0123456789abcdef"}


def test_a_card_tells_of_the_teacher(tmp_path: Path) -> None:
    run = Run.of(replace(LEARNER, teachers=teacher(tmp_path)))
    page = "\n".join(card(run.about_policy(), "0", []))
    assert "| teacher of `goal@clutter` |" in page
    assert "| its command | `adrl train --scenario clutter --robot any " in page
