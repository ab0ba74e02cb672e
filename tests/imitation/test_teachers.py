"""Policies that answer in an expert's place."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adrl.agents.config import TrainConfig
from adrl.deploy.policy import MlpPolicy
from adrl.deploy.training_worlds import training_worlds
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation import collect, find_expert
from adrl.imitation.demonstrations import NoiseConfig
from adrl.observation import EncoderConfig
from adrl.runs import RunConfig
from adrl.runs.card import card, train_command
from adrl.runs.run import Run

ROWS = 8
ENCODER = EncoderConfig(history_steps=2)
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
        ({"encoder": EncoderConfig()}, {}, "was trained with encoder"),
        ({"scenario": "complex"}, {}, "was trained in goal@complex, and the run has none of these"),
        ({"stop_within_m": 0.5}, {}, r"stop_within_m 0\.5, and is to teach one with 0\.3"),
        ({}, {"method": "td3"}, "learns without an expert; leave out teachers"),
        ({}, {"dataset": Path("drives"), "expert": "perfect"}, "teachers .* would drive, and dataset holds"),
    ],
)
def test_one_that_cannot_teach_is_refused(
    tmp_path: Path, of_teacher: dict[str, object], of_run: dict[str, object], says: str
) -> None:
    folder = teacher(tmp_path, **of_teacher)  # pyright: ignore[reportArgumentType]
    if "method" in of_run:
        of_run = of_run | {"expert": "perfect"}
    with pytest.raises(ConfigError, match=says):
        Run.of(replace(LEARNER, teachers=folder, **of_run))  # pyright: ignore[reportArgumentType]


def test_one_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises((ConfigError, CheckpointError), match="nowhere"):
        Run.of(replace(LEARNER, teachers=str(tmp_path / "nowhere")))


def test_it_is_of_the_rounds_of_a_run(tmp_path: Path) -> None:
    """A clone of rounds learns from its teacher as from any expert."""
    learner = TrainConfig(steps=64)
    run = Run.of(replace(LEARNER, teachers=teacher(tmp_path), learner=learner, demonstration_rounds=1))
    assert run.config.teachers == str(tmp_path)
    about = run.about_policy().extra
    assert about["settings"]["teachers"] == str(tmp_path)
    assert about["settings"]["expert"] == "mapless:4", "as --expert takes it"
    (told,) = about["environment"]["teachers"]
    assert told["taught"] == ["goal@clutter"]
    assert told["fingerprint"] in str(run.expert)
    assert train_command(told["settings"]).startswith("adrl train --scenario clutter --robot any ")


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
