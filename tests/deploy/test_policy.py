"""The policy a robot runs: the JAX actor's twin, whole or refused, and without JAX."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adrl.deploy.policy import MlpPolicy, PolicyConfig, load_policy
from adrl.errors import CheckpointError
from adrl.types import Policy
from damage import DAMAGES, damage_file

CONFIG = PolicyConfig(
    input_size=7,
    widths=(16, 8),
    robot={"name": "diffbot", "radius_m": 0.2},
    encoder={"num_sectors": 36},
    guidance="map",
    maturity=0.25,
    extra={"scenario": "clutter", "train_seconds": 12.5},
)


@pytest.fixture
def policy() -> MlpPolicy:
    rng = np.random.default_rng(0)
    sizes = CONFIG.sizes
    layers = [
        (rng.normal(size=(i, o)).astype(np.float32), rng.normal(size=o).astype(np.float32))
        for i, o in pairwise(sizes)
    ]
    return MlpPolicy(layers, CONFIG)


def test_what_is_saved_is_loaded(policy: MlpPolicy, tmp_path: Path):
    policy.save(tmp_path / "run")
    loaded = load_policy(tmp_path / "run")
    assert loaded.config == CONFIG
    observation = np.random.default_rng(1).normal(size=(5, 7)).astype(np.float32)
    assert_array_equal(loaded.act(observation), policy.act(observation))
    assert isinstance(loaded, Policy)


def test_actions_are_in_range_and_leave_the_observation_alone(policy: MlpPolicy):
    observation = 100.0 * np.random.default_rng(1).normal(size=(50, 7)).astype(np.float32)
    before = observation.copy()
    actions = policy.act(observation)
    assert actions.shape == (50, 2)
    assert actions.dtype == np.float32
    assert np.abs(actions).max() <= 1.0
    assert_array_equal(observation, before)


def test_it_agrees_with_the_actor_that_was_trained():
    from adrl.agents.config import TrainConfig
    from adrl.agents.learner import Learner
    from adrl.agents.methods import method_config
    from adrl.agents.networks import actor, actor_sizes

    config = method_config("td3", TrainConfig(steps=1))
    learner = Learner(config, 4, 48, None, None, np.random.default_rng(0))
    learner.state = learner.state._replace(actor=learner.state.actor * 5.0)
    learner._actor = learner.state.actor
    config_of_policy = PolicyConfig(input_size=48, widths=config.td3.widths)
    observation = np.random.default_rng(1).normal(size=(200, 48)).astype(np.float32)
    trained = actor(learner.state.actor, observation, actor_sizes(48, config.td3.widths))  # pyright: ignore
    deployed = learner.policy(config_of_policy, averaged=False).act(observation)
    assert np.abs(deployed).max() > 0.1
    assert_allclose(deployed, trained, atol=1e-5)


def test_deployment_needs_no_jax():
    code = "import adrl.deploy.policy, sys; sys.exit('jax' in sys.modules or 'gymnasium' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", ["policy.safetensors", "config.json"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_names_the_file(policy: MlpPolicy, tmp_path: Path, name: str, damage: str):
    policy.save(tmp_path)
    path = tmp_path / name
    damage_file(path, damage)
    with pytest.raises(CheckpointError, match=name):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"input_size": 8},
        {"input_size": "7"},
        {"input_size": 0},
        {"input_size": True},
        {"widths": [16]},
        {"widths": [16, 8, 4]},
        {"widths": 16},
        {"widths": []},
        {"schema_version": 99},
        {"robot": "diffbot"},
        {"maturity": None},
        {"maturity": float("nan")},
    ],
)
def test_a_config_that_does_not_fit_is_refused(policy: MlpPolicy, tmp_path: Path, change: dict[str, object]):
    policy.save(tmp_path)
    path = tmp_path / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(CheckpointError, match=str(tmp_path)):
        load_policy(tmp_path)


def test_weights_that_are_not_numbers_are_refused(policy: MlpPolicy, tmp_path: Path):
    policy.layers[1][0][3, 3] = np.nan
    policy.save(tmp_path)
    with pytest.raises(CheckpointError, match=r"layers\.1\.weight holds NaN"):
        load_policy(tmp_path)
