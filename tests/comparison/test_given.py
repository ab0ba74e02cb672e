"""A comparison does not go on when what it was given has changed under the same name."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adrl.agents.config import TrainConfig
from adrl.comparison.compare import claim
from adrl.comparison.config import CompareConfig
from adrl.deploy.policy import load_policy, resolve_policy
from adrl.errors import ConfigError

BUDGET = TrainConfig(steps=1000)


def write_map(path: Path, wall: int) -> Path:
    """A room of 12 m with a wall from its left side to a cell."""
    cells = np.full((60, 60), 254, np.uint8)
    cells[30, :wall] = 0
    path.with_suffix(".pgm").write_bytes(b"P5 60 60 255\n" + cells.tobytes())
    path.write_text(
        f"image: {path.stem}.pgm\nresolution: 0.2\norigin: [0, 0, 0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


def config_of(tmp_path: Path, given: str) -> CompareConfig:
    if given == "worlds":
        files: dict[str, Any] = {"map": write_map(tmp_path / "hall.yaml", 30)}
    elif given == "dataset":
        files = {"dataset": tmp_path / "drives"}
        (tmp_path / "drives" / "data").mkdir(parents=True)
        (tmp_path / "drives" / "data" / "main_data.hdf5").write_bytes(b"one")
    else:
        files = {"fine_tune": tmp_path / "start"}
        shutil.copytree(resolve_policy("diffbot"), tmp_path / "start")
    methods = "adrl" if given == "dataset" else "td3"
    return CompareConfig(methods=methods, learner=BUDGET, out=tmp_path / "out", **files)


def change(tmp_path: Path, given: str) -> None:
    if given == "worlds":
        write_map(tmp_path / "hall.yaml", 31)
    elif given == "dataset":
        (tmp_path / "drives" / "data" / "main_data.hdf5").write_bytes(b"two")
    else:
        policy = load_policy(tmp_path / "start")
        policy.layers[0][0][...] += 0.001
        policy.save(tmp_path / "start")


@pytest.mark.parametrize("given", ["worlds", "dataset", "fine_tune"])
def test_what_changed_is_told(tmp_path: Path, given: str) -> None:
    config = config_of(tmp_path, given)
    (tmp_path / "out").mkdir()
    claim(config, config.out)
    claim(replace(config), config.out)
    change(tmp_path, given)
    with pytest.raises(ConfigError, match=f"given.{given}: "):
        claim(replace(config), config.out)


@pytest.mark.parametrize("given", ["worlds", "dataset", "fine_tune"])
def test_a_folder_of_before_goes_on(tmp_path: Path, given: str) -> None:
    config = config_of(tmp_path, given)
    (tmp_path / "out").mkdir()
    claim(config, config.out)
    path = config.out / "settings.json"
    content = json.loads(path.read_text())
    del content["settings"]["given"]
    path.write_text(json.dumps(content))
    change(tmp_path, given)
    claim(replace(config), config.out)
    assert json.loads(path.read_text()) == content


def test_nothing_given_says_nothing() -> None:
    assert "given" not in CompareConfig(methods="td3", learner=BUDGET).settings()
