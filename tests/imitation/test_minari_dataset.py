"""Minari datasets: a round trip keeps every byte, Minari itself reads ours, and bad ones are named."""

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
import pytest

import adrl
from adrl.envs import NavEnv, NavVectorEnv
from adrl.errors import DatasetError
from adrl.imitation import Demonstrations, Source, collect, load_minari, save_minari
from adrl.observation import EncoderConfig
from adrl.types import LidarConfig, RobotConfig
from adrl.worlds import ROBOTS


def assert_same_bytes(one: Demonstrations, other: Demonstrations) -> None:
    for field in dataclasses.fields(Demonstrations):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name


@pytest.mark.parametrize("below", ["", "data"])
def test_round_trip_keeps_every_byte(
    recorded: Demonstrations, env: NavVectorEnv, dataset: Path, below: str
) -> None:
    assert_same_bytes(load_minari(dataset / below, Source.of(env)), recorded)
    assert_same_bytes(load_minari(dataset), recorded)


def test_minari_reads_it(recorded: Demonstrations, dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a dataset of its own, and by name; an episode a group; observations one more than actions."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(dataset.parent))
    data = minari.load_dataset("burger-v3")
    assert data.id == "burger-v3"
    assert data.total_steps == len(recorded)
    assert data.total_episodes == recorded.ended.sum()
    assert data.action_space == gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    first = 0
    for episode in data:
        end = first + len(episode)
        assert recorded.ended[end - 1]
        assert len(episode.observations) == len(episode) + 1
        np.testing.assert_array_equal(episode.observations[:-1], recorded.observation[first:end])
        np.testing.assert_array_equal(episode.infos["expert_action"], recorded.expert_action[first:end])
        assert all(observation in data.observation_space for observation in episode.observations)
        assert np.isfinite(episode.rewards).all()
        first = end


def test_minari_recovers_the_environment(dataset: Path) -> None:
    env = minari.MinariDataset(dataset / "data").recover_environment().unwrapped
    assert isinstance(env, NavEnv)
    assert env._env.robot == ROBOTS["turtlebot3_burger"]
    assert env._env.sim.guidance == "map"
    assert env._env.scenario.name == "clutter"


def test_gymnasiums_own_environment_stays_as_it_was(dataset: Path) -> None:
    assert dataset.exists()
    assert not gymnasium.spec("adrl/Nav-v0").kwargs


def test_any_robot_and_encoder_are_recovered(tmp_path: Path) -> None:
    corners = ((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2))
    robot = RobotConfig(name="mine", radius_m=None, footprint_m=corners, lidar=LidarConfig(num_beams=31))
    encoder = EncoderConfig(num_sectors=12)
    env = NavVectorEnv(2, robot=robot, encoder=encoder, task_pool=2)
    save_minari(collect(env, 20), tmp_path / "mine", Source.of(env))
    again = minari.MinariDataset(tmp_path / "mine" / "data").recover_environment().unwrapped
    assert again._env.robot == robot  # pyright: ignore
    assert again._env.sim.encoder.config == encoder  # pyright: ignore


def test_metadata_tells_where_it_is_from(dataset: Path) -> None:
    about = json.loads(json.loads((dataset / "data" / "metadata.json").read_text())["adrl"])
    assert about["version"] == adrl.__version__
    assert (about["scenario"], about["guidance"]) == ("clutter", "map")
    assert about["robot"]["name"] == "turtlebot3_burger"
    assert about["encoder"]["num_sectors"] == 36
    assert about["extra"] == {"expert": "perfect", "seed": 1}
    assert about["demonstrator"] == "A*+DWA, expert perfect, with noise"


def test_another_name_is_no_other_robot(recorded: Demonstrations, env: NavVectorEnv, dataset: Path) -> None:
    renamed = dataclasses.replace(Source.of(env), robot=dataclasses.replace(env.robot, name="burger"))
    assert_same_bytes(load_minari(dataset, renamed), recorded)


def test_what_exists_is_not_overwritten(recorded: Demonstrations, env: NavVectorEnv, dataset: Path) -> None:
    before = (dataset / "data" / "main_data.hdf5").read_bytes()
    with pytest.raises(DatasetError, match="exists already"):
        save_minari(recorded, dataset, Source.of(env))
    assert (dataset / "data" / "main_data.hdf5").read_bytes() == before
    empty = dataset.parent / "empty"
    empty.mkdir()
    save_minari(recorded, empty, Source.of(env))
    assert_same_bytes(load_minari(empty), recorded)


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_failed_save_leaves_nothing(
    call: str, recorded: Demonstrations, env: NavVectorEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(OSError, match="disk full"):
        save_minari(recorded, tmp_path / "new", Source.of(env))
    assert list(tmp_path.iterdir()) == []


def test_steps_that_do_not_chain_are_refused(
    recorded: Demonstrations, env: NavVectorEnv, tmp_path: Path
) -> None:
    torn = recorded.next_observation.copy()
    torn[5] += 1.0
    with pytest.raises(DatasetError, match="no episode"):
        save_minari(dataclasses.replace(recorded, next_observation=torn), tmp_path / "torn", Source.of(env))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_combined_datasets_are_what_their_parts_are(
    recorded: Demonstrations, env: NavVectorEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """minari.combine_datasets keeps nothing of ours but env_spec: that says of what robot, guidance and encoder."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    for name in ("a-v0", "b-v0"):
        save_minari(recorded, tmp_path / name, Source.of(env))
    minari.combine_datasets([minari.load_dataset(name) for name in ("a-v0", "b-v0")], "both-v0")
    source = Source.of(env)
    both = load_minari(tmp_path / "both-v0", source)
    np.testing.assert_array_equal(both.observation, np.concatenate([recorded.observation] * 2))
    wrong = {
        r"robot\.radius_m = 0\.105, 0\.2 is wanted": {"robot": ROBOTS["diffbot"]},
        "guidance = map, goal is wanted": {"guidance": "goal"},
        r"encoder\.near_m = 0\.3": {"encoder": EncoderConfig(near_m=0.5)},
    }
    for message, changes in wrong.items():
        with pytest.raises(DatasetError, match=message):
            load_minari(tmp_path / "both-v0", dataclasses.replace(source, **changes))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_minari_recorded_is_of_the_robot_that_it_was_made_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    path = record_elsewhere(tmp_path, infos=True, episodes=1)
    with pytest.raises(DatasetError, match=r"robot\.radius_m = 0\.2, 0\.105 is wanted"):
        load_minari(path, Source.of(NavVectorEnv(1, task_pool=1, robot="turtlebot3_burger")))


def record_elsewhere(folder: Path, infos: bool, episodes: int = 2) -> Path:
    """A dataset made with Minari's own recorder, in MINARI_DATASETS_PATH; the last episode breaks off."""
    env = minari.DataCollector(gymnasium.make(adrl.ENV_ID, task_pool=2, randomize=False), record_infos=infos)
    single: Any = env.unwrapped
    env.reset(seed=0)
    while episodes > 0:
        _, _, terminated, truncated, _ = env.step(single.expert_action())
        if terminated or truncated:
            env.reset(seed=episodes)
            episodes -= 1
    for _ in range(4):
        env.step(single.expert_action())
    env.create_dataset("ours/elsewhere-v0")
    env.close()
    return folder / "ours" / "elsewhere-v0"


def test_a_relative_path_is_of_the_working_folder(
    recorded: Demonstrations, env: NavVectorEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_minari(recorded, "demos", Source.of(env))
    assert [path.name for path in tmp_path.iterdir()] == ["demos"]
    np.testing.assert_array_equal(load_minari("demos").action, recorded.action)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_minaris_own_recorder_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It records no expert: what was done is the label. Infos of reset() come first and are left out."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    path = record_elsewhere(tmp_path, infos=True)
    source = Source.of(NavVectorEnv(1, task_pool=1))
    data = load_minari(path, source)
    np.testing.assert_array_equal(data.expert_action, data.action)
    np.testing.assert_array_equal(np.flatnonzero(data.success), np.flatnonzero(data.terminated))
    assert data.ended.sum() == 3
    assert data.truncated[-1]
    assert data.reward_terms[:, 3].any()
    assert (data.observation[1:] == data.next_observation[:-1]).all(axis=1).sum() == len(data) - 3
    with pytest.raises(DatasetError, match="observations of 44 numbers, 20 are wanted"):
        load_minari(path, dataclasses.replace(source, encoder=EncoderConfig(num_sectors=12)))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_without_reward_terms_it_says_what_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    path = record_elsewhere(tmp_path, infos=False)
    with pytest.raises(
        DatasetError, match=r"no reward_terms and no features in its infos.*record_infos=True"
    ):
        load_minari(path)
