"""Model cards: made of a policy's config.json and of measured results, and of no other policy's."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from adrl.commands.run_options import parse_run
from adrl.commands.train import COMMON
from adrl.deploy.policy import SHIPPED, load_policy, resolve_policy
from adrl.errors import ConfigError
from adrl.observation import EncoderConfig
from adrl.runs import RunConfig
from adrl.runs.card import card, train_command
from adrl.runs.run import Run
from deploy.recorded import a_policy_of_a_family

ROOT = Path(__file__).resolve().parents[1]
METRICS = ("success", "collision", "time_s", "optimality")


def measured(**changes: Any) -> dict[str, Any]:
    summary = {name + end: 0.99 for name in METRICS for end in ("", "_low", "_high")}
    about = {
        "command": "adrl evaluate --policy p --scenario complex",
        "policy": "p",
        "policy_fingerprint": "f",
    }
    return {**about, "episodes": 500, **summary, **changes}


def test_the_command_of_a_card_trains_with_the_settings_of_its_policy():
    asked = RunConfig(
        robot="any",
        scenario="clutter,rooms",
        guidance="map,replan",
        randomize=False,
        encoder=EncoderConfig(history_steps=2),
        demonstration_steps=3000,
    )
    asked = replace(
        asked, learner=replace(asked.learner, max_seconds=60.0, seed=3, exploration_std=(0.1, 0.3))
    )
    settings = Run.of(asked).about_policy().extra["settings"]
    words = shlex.split(train_command(settings))
    assert words[:2] == ["adrl", "train"]
    again = parse_run(RunConfig, words[2:], "train", "", COMMON)
    assert Run.of(again).about_policy().extra["settings"] == settings


def test_a_card_of_a_family_tells_its_ranges_and_one_of_a_robot_its_name():
    of_family = "\n".join(
        card(
            a_policy_of_a_family().config,
            "f",
            [measured(worst_decile=0.9, worst_decile_low=0.8, worst_decile_high=1.0)],
        )
    )
    assert "0.2 to 2 m/s" in of_family
    assert "Robots outside of its family" in of_family
    assert "90.0 [80.0, 100.0]" in of_family
    of_robot = "\n".join(card(load_policy(resolve_policy("jackal")).config, "f", []))
    assert "`jackal`, 2 m/s" in of_robot
    assert "Not measured yet." in of_robot


def test_where_a_policy_fails_its_card_says_so():
    config = load_policy(resolve_policy("diffbot")).config
    text = "\n".join(
        card(config, "f", [measured(), measured(success=0.5, command="adrl evaluate --policy p --robot r")])
    )
    assert "`--robot r`: it arrives in 50.0 % only" in text
    assert "`--scenario complex`: it arrives" not in text
    assert "Guidance `goal`: it was not trained with it" in text
    assert "nothing moved where it was trained" in text


def test_results_of_other_weights_are_refused():
    config = load_policy(resolve_policy("diffbot")).config
    with pytest.raises(ConfigError, match=r"was measured with other weights .*run python docs/measure.py p"):
        card(config, "other", [measured()])


def test_each_shipped_policy_has_a_card():
    for name in SHIPPED:
        assert (
            f"<!-- table: policy policies/{name} -->"
            in (ROOT / "docs" / "policies" / f"{name}.md").read_text()
        )
