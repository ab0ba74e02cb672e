"""A user's own shaping terms: beside the paper's six, or in the place of one; by object, or by entry point."""

import json
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose

import adrl
from adrl import registry
from adrl.agents.config import Td3Config
from adrl.agents.replay import Replay
from adrl.envs import NavVectorEnv
from adrl.errors import ConfigError, DatasetError, UnknownName
from adrl.evaluation.trace_file import read_traces
from adrl.imitation import Demonstrations, Source, collect, load_minari, save_minari
from adrl.report.document import document
from adrl.report.source import read_source
from adrl.rewards import REWARD_TERMS, RewardConfig, RewardTerm, Step, reward_terms, terms, weights
from reward_steps import a_step
from small_run import run_cli


def still(step: Step, config: RewardConfig) -> np.ndarray:
    """-1 a period for a robot that turns."""
    return -1.0 * (step.yaw_rate_radps != 0.0) * step.periods


STILL = RewardTerm("still", still, lambda t_obs, t_goal, t_stop, s: 0.2 + 0.2 * s)
SEVEN = RewardConfig(extra_terms=(STILL,))
NO_TERM = still


def test_a_term_stands_beside_the_six_and_shares_their_weight() -> None:
    assert list(reward_terms(SEVEN)) == [*REWARD_TERMS, "still"]
    step = a_step(yaw_rate_radps=0.5)
    assert_allclose(terms(step, SEVEN)[:, :6], terms(step, RewardConfig()))
    assert_allclose(terms(step, SEVEN)[:, 6], -1.0)
    near = np.array([0.5, 0.25, 1.0])
    plain, seven = weights(near, 0.5, RewardConfig()), weights(near, 0.5, SEVEN)
    assert_allclose(seven[2:].sum(), 1.0)
    assert_allclose(seven[:2], plain[:2])
    # Before normalisation the four rows are 0.275, 0.2, 0.225 and 0.45 here, the fifth 0.3.
    assert_allclose(seven[6], 0.3 / 1.45)
    assert_allclose(seven[2:6] / plain[2:6], 1.15 / 1.45)


def test_a_term_with_a_shaping_term_s_name_takes_its_place() -> None:
    config = RewardConfig(extra_terms=(RewardTerm("motion", still, STILL.weight),))
    assert list(reward_terms(config)) == list(REWARD_TERMS)
    assert_allclose(terms(a_step(yaw_rate_radps=0.5), config)[:, 2], -1.0)
    assert_allclose(weights(np.array([0.5, 0.25, 1.0]), 0.5, config)[2], 0.3 / (0.3 + 0.2 + 0.225 + 0.45))


def test_no_approach_pays_nothing_for_nearing_the_goal_and_all_else_as_before() -> None:
    config = RewardConfig(extra_terms=("no-approach",))
    step = a_step(previous_distance_m=3.0, distance_m=2.9, yaw_rate_radps=0.5)
    plain, terminal = terms(step, RewardConfig()), terms(step, config)
    approach = list(REWARD_TERMS).index("approach")
    assert (plain[:, approach] > 0.0).all()
    assert_allclose(terminal[:, approach], 0.0)
    assert_allclose(np.delete(terminal, approach, axis=1), np.delete(plain, approach, axis=1))
    near = np.array([0.5, 0.25, 1.0])
    assert_allclose(weights(near, 0.5, config), weights(near, 0.5, RewardConfig()))


def test_a_weight_names_its_features() -> None:
    """The same weight as of four parameters, whose names are its own."""
    by_position = RewardTerm("still", still, lambda a, b, c, s: 0.1 + 0.2 * a + 0.3 * b + 0.4 * c + 0.5 * s)
    by_name = RewardTerm(
        "still",
        still,
        lambda f: 0.1 + 0.2 * f.threat + 0.3 * f.proximity + 0.4 * f.stop + 0.5 * f.maturity,
    )
    states = np.random.default_rng(0).uniform(size=(50, 3))
    given, named = (
        weights(states, 0.3, RewardConfig(extra_terms=(term,))) for term in (by_position, by_name)
    )
    assert_allclose(given, named, rtol=1e-12)


def test_a_number_is_a_weight_that_nothing_is_divided_by() -> None:
    config = RewardConfig(extra_terms=(RewardTerm("still", still, 0.7),))
    near = np.array([0.5, 0.25, 1.0])
    assert_allclose(weights(near, 0.5, config), [*weights(near, 0.5, RewardConfig()), 0.7])
    instead = RewardConfig(extra_terms=(RewardTerm("motion", still, 0.7),))
    assert_allclose(weights(near, 0.5, instead)[2], 0.7)
    assert_allclose(weights(near, 0.5, instead)[3:].sum(), 1.0)


WINDY = RewardTerm(
    "windy",
    lambda step, config: -step.quantities["wind"],
    lambda f: 0.2 * f.gust,
    features={"gust": lambda step, config: np.clip(step.quantities["wind"], 0.0, 1.0)},
    quantities={"wind": lambda sim: 0.1 + 0.01 * sim.b["time"]},
)
"""A term with a quantity that no Step has and a feature of its own."""


def test_a_term_brings_quantities_and_features_of_its_own() -> None:
    config = RewardConfig(extra_terms=(WINDY,))
    env, data = demonstrations(config)
    assert data.features.shape == (64, 4)
    time_s = np.arange(1, 17) * env.robot.control_period_s  # steps of one robot, from its start
    assert_allclose(data.reward_terms[:16, 6], -0.1 - 0.01 * time_s, rtol=1e-6)
    assert_allclose(data.features[:16, 3], 0.1 + 0.01 * (time_s - 0.1), rtol=1e-6)
    shares = weights(data.features, 0.5, config)
    expected = 0.2 * data.features[:, 3] / (0.15 + 0.15 * data.features[:, 0])
    assert_allclose(shares[:, 6] / shares[:, 4], expected, rtol=1e-6)


def test_a_feature_that_nobody_brings_is_named() -> None:
    with pytest.raises(ConfigError, match=r"asks for 'gust'; there are threat, proximity, stop, maturity"):
        RewardTerm("odd", still, lambda f: f.gust)
    with pytest.raises(ConfigError, match="'threat', which is there"):
        RewardTerm("odd", still, 0.1, features={"threat": lambda step, config: step.clearance_m})
    with pytest.raises(ConfigError, match="is -1; give 0 or more"):
        RewardTerm("odd", still, -1)


@pytest.mark.parametrize("bad", [(STILL, "still"), (RewardTerm("failure", still, STILL.weight),)])
def test_names_must_be_free(bad: Any) -> None:
    with pytest.raises(ConfigError, match="give another name"):
        RewardConfig(extra_terms=bad)


@pytest.mark.parametrize("paid", [1.0, np.ones((2, 1)), np.ones(3), np.array([0.0, np.nan])])
def test_a_term_pays_each_step_one_finite_number(paid: Any) -> None:
    """What is not is told at the first step, before replay has it."""
    odd = RewardConfig(extra_terms=(RewardTerm("odd", lambda step, config: paid, STILL.weight),))
    with pytest.raises(ConfigError, match=r"'odd'.*one finite number a step"):
        terms(a_step(reached=[False, False]), odd)


@pytest.mark.parametrize(
    ("weight", "says"), [(-0.1, "is -0.05; give 0 or more"), (np.nan, "nan"), (np.ones(2), "one a state")]
)
def test_a_weight_is_no_less_than_nothing_in_any_state(weight: Any, says: str) -> None:
    RewardTerm("fixed", still, lambda t_obs, t_goal, t_stop, s: 0.2)
    RewardTerm("at_times", still, lambda t_obs, t_goal, t_stop, s: np.where(s > 0.5, 0.2, 0.0))
    shape = np.shape(weight)
    with pytest.raises(ConfigError, match=f"'odd'.*{says}"):
        RewardTerm("odd", still, lambda t_obs, t_goal, t_stop, s: weight if shape else weight * s)


def offer(monkeypatch: pytest.MonkeyPatch, **objects: str) -> None:
    """An installed package that offers these objects of this file as reward terms."""
    group = "adrl.reward_terms"
    offered = [EntryPoint(name, f"{__name__}:{value}", group) for name, value in objects.items()]
    monkeypatch.setattr(
        registry, "entry_points", lambda *, group: offered if group == offered[0].group else []
    )
    monkeypatch.setattr(EntryPoint, "load", lambda point: globals()[point.value.rpartition(":")[2]])


def test_installed_packages_offer_terms_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, calmly="STILL", odd="NO_TERM")
    assert RewardConfig(extra_terms=("calmly",)).extra() == (STILL,)
    with pytest.raises(ConfigError, match="not a RewardTerm"):
        RewardConfig(extra_terms=("odd",)).extra()
    with pytest.raises(UnknownName, match="did you mean 'calmly'"):
        RewardConfig(extra_terms=("calmy",)).extra()


def test_the_environment_pays_all_seven() -> None:
    env = gymnasium.make("adrl/Nav-v0", scenario="clutter", reward_config=SEVEN)
    _, info = env.reset(seed=0)
    assert info["reward_terms"].shape == (7,)
    *_, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["reward_terms"][6] == -1.0


def demonstrations(config: RewardConfig) -> tuple[NavVectorEnv, Demonstrations]:
    env = NavVectorEnv(4, scenario="clutter", task_pool=4, reward_config=config)
    return env, collect(env, 64)


def test_a_dataset_holds_the_six_only(tmp_path: Path) -> None:
    env, data = demonstrations(SEVEN)
    assert data.reward_terms.shape == (64, 7)
    with pytest.raises(DatasetError, match="has 7 reward terms"):
        save_minari(data, tmp_path / "seven", Source.of(env))
    plain, six = demonstrations(RewardConfig())
    save_minari(six, tmp_path / "six", Source.of(plain))
    with pytest.raises(DatasetError, match="has 6 reward terms, the run's reward 7"):
        Replay(8, 4, six.observation.shape[1], 1, 0.9, load_minari(tmp_path / "six"), reward=SEVEN)


SMALL: dict[str, Any] = {"num_envs": 16, "task_pool": 8, "demonstration_steps": 512, "validation_episodes": 2}


def test_a_run_learns_from_seven_terms_and_its_replays_show_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By object, then from the command line by name: the same bytes, and another policy than with six terms."""

    def learner(config: RewardConfig) -> adrl.TrainConfig:
        td3 = Td3Config(widths=(16, 16))
        return adrl.TrainConfig(steps=1024, start_steps=256, pretrain_updates=8, td3=td3, reward=config)

    def policy(name: str) -> bytes:
        return (tmp_path / name / "policy.safetensors").read_bytes()

    for name, config in (("object", SEVEN), ("six", RewardConfig())):
        adrl.train(adrl.RunConfig(scenario="clutter", out=tmp_path / name, learner=learner(config), **SMALL))
    with pytest.raises(UnknownName, match="still"):
        adrl.evaluate(tmp_path / "object", scenario="clutter", episodes=1, out=tmp_path / "refused")
    shown = tmp_path / "shown"
    adrl.evaluate(tmp_path / "object", scenario="clutter", episodes=1, out=shown, reward_terms=(STILL,))
    assert read_traces(shown / "traces.safetensors").terms == (*REWARD_TERMS, "still")
    offer(monkeypatch, still="STILL")
    sizes = [text for key, value in SMALL.items() for text in (f"--{key.replace('_', '-')}", str(value))]
    run = ("--steps", 1024, "--start-steps", 256, "--pretrain-updates", 8, "--td3.widths", 16, 16)
    named = tmp_path / "named"
    assert (
        run_cli(
            "train", "--scenario", "clutter", "--out", named, *run, *sizes, "--reward.extra-terms", "still"
        )
        == 0
    )
    assert policy("object") == policy("named") != policy("six")
    row = json.loads((named / "metrics.jsonl").read_text().splitlines()[-1])
    assert row["term/still"] < 0.0 < row["weight/still"]

    adrl.evaluate(named, scenario="clutter", episodes=2, out=tmp_path / "evaluation")
    traces = read_traces(tmp_path / "evaluation" / "traces.safetensors")
    assert traces.terms == (*REWARD_TERMS, "still")
    assert all(
        trace.paid.shape == trace.weights.shape == (len(trace.pose) - 1, 7) for trace in traces.episodes
    )
    page = document(read_source(named))
    (chart,) = (chart for chart in page["charts"] if chart["title"] == "Reward terms")
    assert [series["name"] for series in chart["series"]] == [*list(REWARD_TERMS)[2:], "still"]
