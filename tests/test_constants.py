"""Options that have become constants: files of before that name them still load, with the value they have."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

import resume_run
from adrl.agents.config import Td3Config, TrainConfig
from adrl.agents.saved_run import identity_of_before
from adrl.comparison.compare import SETTINGS_FILE, claim
from adrl.comparison.config import CompareConfig
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.deploy.setup import setup_of
from adrl.errors import CheckpointError, ConfigError
from adrl.imitation.schedule import ScheduleConfig
from adrl.planning.replanner_config import ReplannerConfig
from adrl.rewards import RewardConfig
from adrl.types import without_constants

CONSTANTS: dict[type, dict[str, Any]] = {
    TrainConfig: {"updates_per_iteration": 4, "static_maturity": 0.5},
    Td3Config: {
        "policy_delay": 2,
        "actor_average": 0.0025,
        "target_noise_std": 0.2,
        "target_noise_clip": 0.5,
        "q_filter": False,
    },
    ScheduleConfig: {"fall_updates": 30000.0},
    RewardConfig: {
        "success_reward": 200.0,
        "failure_penalty": 200.0,
        "stagnation_fraction": 0.15,
        "near_goal_m": 3.0,
        "success_weight": 1.0,
    },
    ReplannerConfig: {
        "environment_gain": 0.5,
        "safe_clearance_m": 0.3,
        "conflict_m": 2.0,
        "arrival_m": 0.4,
        "min_interval_m": 0.3,
        "near_goal_m": 3.0,
        "k_obstacle": 0.6,
        "k_proximity": 0.1,
        "k_turn": 0.3,
        "turn_cost_m": 0.1,
        "forget_s": 1.0,
    },
    CompareConfig: {"task_priority": 1.0},
}
"""As every file of before has them."""


@pytest.mark.parametrize("kind", CONSTANTS)
def test_the_value_of_before_is_the_constant_and_another_is_refused(kind: type) -> None:
    today = {field.name for field in dataclasses.fields(kind)}
    for name, value in CONSTANTS[kind].items():
        assert name not in today
        assert getattr(kind, name) == value
        assert without_constants(kind, {name: value, "kept": 1}) == {"kept": 1}
        with pytest.raises(CheckpointError, match=f"{name} of .* was 7 and is always"):
            without_constants(kind, {name: 7})


CAME_LATER = {"td3": ["row_weights"], "schedule": ["lambda_floor"], "": ["guide"]}
"""Options that some file of before does not know."""


def of_before(document: dict[str, Any]) -> dict[str, Any]:
    """A learner's configuration as earlier versions wrote it."""
    sections = {"td3": Td3Config, "schedule": ScheduleConfig, "reward": RewardConfig}
    return document | CONSTANTS[TrainConfig] | {n: document[n] | CONSTANTS[k] for n, k in sections.items()}


def test_a_checkpoint_of_before_goes_on(tmp_path: Path) -> None:
    resume_run.run(tmp_path / "whole", 240)
    resume_run.run(tmp_path / "run", 120)
    (state,) = (tmp_path / "run" / "checkpoint").glob("*/state.json")
    saved = json.loads(state.read_text())
    config = of_before(saved["config"])
    state.write_text(json.dumps(saved | {"config": config | {"updates_per_iteration": 8}}))
    with pytest.raises(CheckpointError, match="updates_per_iteration of TrainConfig was 8"):
        resume_run.run(tmp_path / "run", 240, resume=True)
    state.write_text(json.dumps(saved | {"config": config}))
    resume_run.run(tmp_path / "run", 240, resume=True)
    policies = [(tmp_path / name / "policy.safetensors").read_bytes() for name in ("run", "whole")]
    assert policies[0] == policies[1]


def without_what_came_later(document: dict[str, Any]) -> dict[str, Any]:
    return {
        name: {key: of for key, of in value.items() if key not in CAME_LATER[name]}
        if name in CAME_LATER
        else value
        for name, value in document.items()
        if name not in CAME_LATER[""]
    }


def test_a_checkpoint_that_knows_fewer_options_goes_on_with_what_was_done_then(tmp_path: Path) -> None:
    """It cloned less late in training, which today's options say; the others do by default what was done."""
    resume_run.run(tmp_path / "run", 120)
    (state,) = (tmp_path / "run" / "checkpoint").glob("*/state.json")
    saved = json.loads(state.read_text())
    config = without_what_came_later(saved["config"])
    state.write_text(json.dumps(saved | {"config": config}))
    with pytest.raises(CheckpointError, match=r"schedule\.lambda_floor = 0\.0, this run has 0\.1"):
        resume_run.run(tmp_path / "run", 240, resume=True)
    config["schedule"]["lambda_floor"] = 0.1
    del saved["explorer"]
    state.write_text(json.dumps(saved | {"config": config}))
    resume_run.run(tmp_path / "run", 240, resume=True)


def test_a_comparison_that_knows_fewer_options_goes_on(tmp_path: Path) -> None:
    schedule = ScheduleConfig(lambda_floor=0.0)
    config = CompareConfig(methods="adrl,td3", learner=TrainConfig(steps=1000, schedule=schedule))
    claim(config, tmp_path)
    path = tmp_path / SETTINGS_FILE
    content = json.loads(path.read_text())
    content["settings"]["learner"] = without_what_came_later(content["settings"]["learner"])
    methods = {name: without_what_came_later(learner) for name, learner in content["methods"].items()}
    path.write_text(json.dumps(content | {"methods": methods}))
    claim(dataclasses.replace(config, methods="adrl,td3,bc"), tmp_path)
    with pytest.raises(ConfigError, match="lambda_floor"):
        claim(CompareConfig(methods="adrl", learner=TrainConfig(steps=1000)), tmp_path)


def test_a_comparison_of_before_that_has_the_q_filter_goes_on(tmp_path: Path) -> None:
    config = CompareConfig(methods="q-filter,td3", learner=TrainConfig(steps=1000))
    claim(config, tmp_path)
    path = tmp_path / SETTINGS_FILE
    content = json.loads(path.read_text())
    for name, learner in content["methods"].items():
        assert (learner["td3"].pop("row_weights") == "q-filter") is (name == "q-filter")
        learner["td3"]["q_filter"] = name == "q-filter"
    path.write_text(json.dumps(content))
    claim(config, tmp_path)
    content["methods"]["td3"]["td3"]["q_filter"] = True
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match='row_weights: "q-filter" there'):
        claim(config, tmp_path)


def test_a_comparison_of_before_goes_on(tmp_path: Path) -> None:
    config = CompareConfig(methods="adrl,td3", learner=TrainConfig(steps=1000))
    claim(config, tmp_path)
    path = tmp_path / SETTINGS_FILE
    content = json.loads(path.read_text())
    settings = content["settings"] | CONSTANTS[CompareConfig]
    settings["replanner"] |= CONSTANTS[ReplannerConfig]
    settings["learner"] = of_before(settings["learner"])
    for section, name in (("replanner", "near"), ("encoder", "num_tracks")):
        del settings[section][name]
    for name in ("demonstration_rounds", "stop_within_m", "expert"):
        del settings[name]
    methods = {name: of_before(learner) for name, learner in content["methods"].items()}
    path.write_text(json.dumps(content | {"settings": settings, "methods": methods}))
    claim(dataclasses.replace(config, methods="adrl,td3,bc"), tmp_path)
    assert json.loads(path.read_text())["methods"].keys() == {"adrl", "td3", "bc"}


def test_a_checkpoint_of_before_may_know_fewer_constants_of_the_replanner() -> None:
    today = {"environment": {"replanner": dataclasses.asdict(ReplannerConfig())}}
    before = {
        "environment": {
            "replanner": {k: v for k, v in today["environment"]["replanner"].items() if k != "near"}
        }
    }
    assert identity_of_before(before)["environment"] == today["environment"]


@pytest.mark.parametrize("name", ["diffbot", "jackal"])
def test_shipped_policies_keep_their_replanner(name: str) -> None:
    policy = load_policy(resolve_policy(name))
    saved = policy.config.extra["environment"]["replanner"]
    assert CONSTANTS[ReplannerConfig].items() <= saved.items(), "it was written before"
    replanner = setup_of(policy).replanner
    assert {key: getattr(replanner, key) for key in saved} == saved
