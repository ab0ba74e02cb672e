"""A training run that is watched, and a bag that is replayed, without a browser."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from adrl.agents import checkpoint
from adrl.deploy import load_policy
from adrl.errors import CheckpointError, DatasetError
from adrl.imitation import BagTopics
from adrl.runs.newest import newest_policy
from adrl.types import RobotConfig
from adrl.view.choices import Offer
from adrl.view.messages import Choose, decode
from adrl.view.recording import Replay
from adrl.view.training import Training
from adrl.worlds import load_robot
from bag_drives import drive_by_hand
from refusals import Adrl
from small_run import finished_run

pytestmark = [pytest.mark.slow, pytest.mark.integration]
CHOICE = Choose(policies=("default",), place="clutter")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory)


def test_the_newest_checkpoints_policy_is_that_of_the_run(run: Path) -> None:
    found = newest_policy(run)
    assert found is not None
    steps, policy = found
    saved = load_policy(run)
    assert steps == saved.config.extra["env_steps"]
    assert policy.config.sizes == saved.config.sizes
    assert policy.config.maturity == saved.config.maturity
    for ours, theirs in zip(policy.layers, saved.layers, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1], theirs[1])


def test_curves_grow_and_the_newest_policy_drives(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "going-on"
    folder.mkdir()
    log = (run / "metrics.jsonl").read_text().splitlines(keepends=True)
    (folder / "metrics.jsonl").write_text("".join(log[:2]))
    show = Training(folder, Offer(), CHOICE, tmp_path / "demonstrations")
    first = show.turn([], 1.0)
    assert first["lanes"] == []
    points = len(first["charts"][0]["series"][0]["wall_s"]["x"])
    json.dumps(show.setup(), allow_nan=False)
    assert "charts" not in show.turn([], 2.5)  # nothing new
    (folder / "metrics.jsonl").write_text("".join(log))
    shutil.copytree(run / checkpoint.FOLDER, folder / checkpoint.FOLDER)
    version = show.version
    second = show.turn([], 4.0)
    assert len(second["charts"][0]["series"][0]["wall_s"]["x"]) > points
    assert len(second["lanes"]) == 1
    assert show.version > version
    setup = show.setup()
    assert setup["choice"]["policies"][0].startswith("going-on after")
    show.turn([decode('{"do": "pace", "playing": true, "speed": 20.0}')], 4.1)
    assert show.turn([], 4.2)["lanes"][0]["time_s"] > 0.0


def test_a_folder_without_a_run_is_refused(adrl: Adrl) -> None:
    adrl.refuses("view", "nowhere", "--follow", says=("nowhere", "give the folder"))
    adrl.refuses("view", "--follow", says=("adrl view RUN --follow",))
    adrl.refuses("view", "--bag", "none.bag", says=("none.bag",))
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl"):
        Training(adrl.folder, Offer(), CHOICE, adrl.folder)


@pytest.fixture
def robot() -> RobotConfig:
    return load_robot("diffbot")


def test_a_bag_is_replayed_as_it_was_driven(tmp_path: Path, robot: RobotConfig) -> None:
    path = tmp_path / "drive"
    drive_by_hand(path, [(2.0, 0.4, 0.0), (2.0, 0.2, 0.5)], robot)
    show = Replay(path, robot, BagTopics())
    json.dumps(show.setup(), allow_nan=False)
    end_s = show.turn([], 0.0)["duration_s"]
    assert end_s > 3.0
    seen = show.turn([decode('{"do": "seek", "time_s": 1.0}')], 0.05)["lanes"][0]
    assert abs(seen["time_s"] - 1.0) < 0.11
    assert abs(seen["twist"][0] - 0.4) < 0.05
    rows = show.setup()["lanes"][0]["rows"]
    assert rows[-1][0] == seen["time_s"]
    assert rows[-1][1] > rows[0][1] + 0.2  # it drove forwards
    before = show.version
    frame = show.turn([decode('{"do": "seek", "time_s": 1e6}'), decode('{"do": "restart"}')], 0.1)
    assert frame["lanes"][0]["time_s"] == end_s
    assert "cannot be changed" in frame["errors"][0]
    assert show.version > before
    assert not show.turn([], 0.4)["playing"]  # at the end it stops
    again = show.turn([decode('{"do": "pace", "playing": true, "speed": 1.0}')], 0.5)
    assert again["lanes"][0]["time_s"] < 1.0


def test_a_bag_without_the_topic_is_refused(tmp_path: Path, robot: RobotConfig) -> None:
    path = tmp_path / "drive"
    drive_by_hand(path, [(2.0, 0.4, 0.0)], robot)
    with pytest.raises(DatasetError, match="/laser"):
        Replay(path, robot, BagTopics(scan="/laser"))
