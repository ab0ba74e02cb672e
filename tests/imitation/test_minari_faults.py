"""Datasets that are damaged, foreign or of something else: the error names the folder and what is wrong."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
import pytest
from minari.serialization import serialize_space

from adrl.envs import NavVectorEnv
from adrl.errors import DatasetError
from adrl.imitation import Demonstrations, Source, load_minari
from adrl.observation import EncoderConfig
from adrl.types import LidarConfig
from adrl.worlds import ROBOTS


def other(env: NavVectorEnv, **changes: Any) -> Source:
    return dataclasses.replace(Source.of(env), **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": ROBOTS["diffbot"]}, r"robot\.radius_m = 0\.105, 0\.2 is wanted"),
        (
            {"robot": dataclasses.replace(ROBOTS["turtlebot3_burger"], lidar=LidarConfig())},
            r"robot\.lidar\.num_beams",
        ),
        ({"encoder": EncoderConfig(num_sectors=24)}, r"encoder\.num_sectors = 36, 24 is wanted"),
        ({"encoder": EncoderConfig(near_m=0.5)}, r"encoder\.near_m = 0\.3"),
        ({"guidance": "goal"}, "guidance = map, goal is wanted"),
    ],
)
def test_data_of_something_else(
    env: NavVectorEnv, dataset: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(DatasetError, match=message) as error:
        load_minari(dataset, other(env, **changes))
    assert str(dataset) in str(error.value)


def edit_metadata(path: Path, **changes: Any) -> None:
    file = path / "data" / "metadata.json"
    content = json.loads(file.read_text()) | changes
    file.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))


def edit_episode(path: Path, name: str, change: Callable[[Any], Any]) -> None:
    with h5py.File(path / "data" / "main_data.hdf5", "a") as file:
        group: Any = file["episode_1"]
        value = change(group[name][()])
        del group[name]
        if value is not None:
            group[name] = value


def with_nan(array: Any) -> Any:
    array[3, 1] = np.nan
    return array


def cut(path: Path, share: float) -> None:
    file = path / "data" / "main_data.hdf5"
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])


FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no data file": (
        lambda p: (p / "data" / "main_data.hdf5").unlink(),
        "truncated, or not a Minari dataset",
    ),
    "no metadata": (lambda p: (p / "data" / "metadata.json").unlink(), "holds no metadata.json"),
    "cut in half": (lambda p: cut(p, 0.5), "truncated"),
    "cut at the end": (lambda p: cut(p, 0.99), "truncated"),
    "empty file": (lambda p: cut(p, 0.0), "truncated"),
    "foreign metadata": (lambda p: (p / "data" / "metadata.json").write_text("{}"), "metadata.json lacks"),
    "torn metadata": (
        lambda p: (p / "data" / "metadata.json").write_text('{"total'),
        "metadata.json is not valid JSON",
    ),
    "list metadata": (
        lambda p: (p / "data" / "metadata.json").write_text("[]"),
        "metadata.json is of another form",
    ),
    "no spaces": (
        lambda p: edit_metadata(p, observation_space=None),
        "metadata.json lacks observation_space",
    ),
    "unknown format": (lambda p: edit_metadata(p, data_format="pickle"), "not a Minari dataset"),
    "more episodes": (lambda p: edit_metadata(p, total_episodes=10_000), "truncated"),
    "no episodes": (lambda p: edit_metadata(p, total_episodes=0), "no step"),
    "image": (
        lambda p: edit_metadata(p, observation_space=serialize_space(IMAGE)),
        "observation space",
    ),
    "discrete": (
        lambda p: edit_metadata(p, action_space=serialize_space(gymnasium.spaces.Discrete(4))),
        "action space",
    ),
    "NaN": (lambda p: edit_episode(p, "observations", with_nan), "holds NaN"),
    "NaN action": (lambda p: edit_episode(p, "actions", with_nan), r"outside \[-1, 1\]"),
    "metric actions": (
        lambda p: edit_episode(p, "actions", lambda a: 3.0 * np.ones_like(a)),
        r"outside \[-1, 1\]",
    ),
    "narrow": (lambda p: edit_episode(p, "observations", lambda a: a[:, :20]), "observations of 20 numbers"),
    "short": (lambda p: edit_episode(p, "actions", lambda a: a[:-1]), "rows of action"),
    "narrow terms": (
        lambda p: edit_episode(p, "infos/reward_terms", lambda a: a[:, :5]),
        "truncated, or not",
    ),
    "no terms": (
        lambda p: edit_episode(p, "infos/reward_terms", lambda a: None),
        "no reward_terms in its infos",
    ),
    "early end": (
        lambda p: edit_episode(p, "terminations", lambda a: np.ones_like(a)),
        "episode 1 goes on after its end",
    ),
    "no group": (lambda p: edit_episode(p, "rewards", lambda a: None), "truncated, or not a Minari dataset"),
}
IMAGE = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)


@pytest.mark.parametrize("fault", FAULTS)
def test_damaged_datasets_are_named(fault: str, env: NavVectorEnv, dataset: Path) -> None:
    damage, message = FAULTS[fault]
    damage(dataset)
    with pytest.raises(DatasetError, match=message) as error:
        load_minari(dataset, Source.of(env))
    assert str(dataset) in str(error.value)


def test_missing_and_foreign_folders(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"nowhere: no such folder"):
        load_minari(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=r"holds no metadata\.json"):
        load_minari(tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(DatasetError, match="no such folder"):
        load_minari(tmp_path / "file")


@pytest.mark.parametrize(
    "kwargs",
    [{"robot": "nobodys"}, {"robot": {"radius_m": -1}}, {"encoder": {"x": 1}}, {"encoder": 5}, [1, 2]],
)
def test_an_env_spec_that_makes_no_environment_is_named(
    env: NavVectorEnv, dataset: Path, kwargs: Any
) -> None:
    spec = {
        "id": "adrl/Nav-v0",
        "entry_point": "adrl.envs:NavEnv",
        "kwargs": kwargs,
        "additional_wrappers": [],
    }
    edit_metadata(dataset, adrl=None, env_spec=json.dumps(spec))
    with pytest.raises(DatasetError, match="env_spec"):
        load_minari(dataset, Source.of(env))
    assert len(load_minari(dataset)) > 0


def test_loading_runs_no_code(dataset: Path) -> None:
    """No environment is made: a spec that names a hostile entry point is never looked at."""
    hostile = json.dumps({"id": "x-v0", "entry_point": "os:abort", "additional_wrappers": []})
    edit_metadata(dataset, env_spec=hostile)
    load_minari(dataset)
    edit_metadata(dataset, observation_space=None)
    with pytest.raises(DatasetError, match="lacks observation_space"):
        load_minari(dataset)


def test_an_episode_that_breaks_off_is_truncated(recorded: Demonstrations, dataset: Path) -> None:
    edit_episode(dataset, "terminations", np.zeros_like)
    edit_episode(dataset, "truncations", np.zeros_like)
    ends = np.flatnonzero(recorded.ended)
    again = load_minari(dataset)
    np.testing.assert_array_equal(again.ended, recorded.ended)
    assert again.truncated[ends[1]]
