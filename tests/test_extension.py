"""One of each kind of thing, from a package that is installed beside ours: nothing of ours changes for it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from adrl.registry import offered

PACKAGE = '''
import contextlib
import dataclasses

import numpy as np

from adrl.imitation import Driver
from adrl.observation import Mirror
from adrl.rewards import RewardTerm
from adrl.types import RobotConfig
from adrl.worlds import SCENARIOS

ROBOT = RobotConfig(name="courier", radius_m=0.25, max_speed_mps=0.8)


class Yard:
    """Clutter by another name."""

    name = "yard"

    def task(self, rng, robot):
        return SCENARIOS["clutter"].task(rng, robot)


YARD = Yard()


def in_haste(config):
    """TD3 that looks less far ahead."""
    return dataclasses.replace(config, td3=dataclasses.replace(config.td3, gamma=0.95))


CALM = RewardTerm(
    "calm",
    lambda step, config: -0.1 * step.quantities["turning"] * step.periods,
    lambda f: 0.1 * f.busy,
    features={"busy": lambda step, config: np.clip(step.quantities["turning"], 0.0, 1.0)},
    quantities={"turning": lambda sim: np.abs(sim.b["twist"][:, 1])},
)


class Hasty(Driver):
    """Full speed ahead."""

    def actions(self):
        return np.tile(np.array([self.speed, 0.0], np.float32), (self.env.num_envs, 1))


@dataclasses.dataclass(frozen=True)
class AtSpeed:
    """Drives straight on, at so much of the greatest speed."""

    speed: float = 1.0

    def __str__(self):
        return f"hasty:{self.speed}"

    def driver(self, env, seed):
        driver = Hasty(env)
        driver.speed = self.speed
        return driver


class Clearest:
    """How far the LiDAR sees in the clearest direction, of its reach."""

    name = "clearest"
    size, limit = 1, 1.0

    def __init__(self, robot, config):
        self.reach_m = robot.lidar.max_range_m

    def write(self, senses, out):
        out[:, 0] = senses.ranges.max(axis=1) / self.reach_m

    def mirror(self):
        return Mirror(np.arange(1), np.ones(1, np.float32))


class Straight:
    """Full speed ahead."""

    name = "straight"

    def act(self, observation):
        return np.tile(np.array([1.0, 0.0], np.float32), (len(observation), 1))


STRAIGHT = Straight()


class Ghosts:
    """Robots that nothing stops and that see nothing."""

    def __init__(self, robot, num_envs=1, *, seed=0):
        self.robot, self.num_envs = robot, num_envs

    def reset(self, indices, tasks, b):
        for i, task in zip(indices, tasks, strict=True):
            b["pose"][i] = b["odometry"][i] = task.start
        b["twist"][indices] = 0.0
        b["ranges"][indices] = self.robot.lidar.max_range_m

    def step(self, b):
        rows, dt_s = np.flatnonzero(b["active"]), self.robot.control_period_s
        v, w = b["command"][rows].T
        heading = b["pose"][rows, 2]
        way = np.stack([v * np.cos(heading), v * np.sin(heading), w], axis=1) * dt_s
        b["pose"][rows] += way
        b["odometry"][rows] += way
        b["twist"][rows] = b["command"][rows]
        b["time"][rows] += dt_s
        b["travelled"][rows] += np.abs(v) * dt_s


@contextlib.contextmanager
def ghosts(robot, num_envs=1, *, seed=0):
    yield Ghosts(robot, num_envs, seed=seed)
'''
OFFERED = {
    "adrl.robots": "courier = outside:ROBOT",
    "adrl.scenarios": "yard = outside:YARD",
    "adrl.methods": "in-haste = outside:in_haste",
    "adrl.experts": "hasty = outside:AtSpeed",
    "adrl.reward_terms": "calm = outside:CALM",
    "adrl.observation_components": "clearest = outside:Clearest",
    "adrl.policies": "straight = outside:STRAIGHT",
    "adrl.simulators": "ghosts = outside:ghosts",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as pip leaves it: a module, and what its metadata offers."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "outside.py").write_text(PACKAGE)
    metadata = folder / "outside-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: outside\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "".join(f"[{group}]\n{line}\n" for group, line in OFFERED.items())
    )
    return folder


def adrl(site: Path, *arguments: str) -> str:
    """What the command prints, in a process that has the package."""
    done = subprocess.run(
        [sys.executable, "-m", "adrl.cli", *arguments],
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_a_package_offers_is_found_by_kind(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    kinds = (
        "robot",
        "scenario",
        "method",
        "expert",
        "reward term",
        "observation component",
        "policy",
        "simulator",
    )
    for kind, line in zip(kinds, OFFERED.values(), strict=True):
        assert line.partition(" ")[0] in offered(kind), kind


@pytest.mark.integration
def test_it_is_listed(site: Path) -> None:
    printed = adrl(site, "list")
    for line in OFFERED.values():
        name = line.partition(" ")[0]
        assert f"{name} " in printed, name
    assert printed.count("plug-in of outside") == len(OFFERED)


@pytest.mark.integration
@pytest.mark.slow
def test_all_of_it_trains_and_drives(site: Path, tmp_path: Path) -> None:
    run, result = tmp_path / "run", tmp_path / "straight.json"
    sizes = ("--steps", "1024", "--num-envs", "16", "--task-pool", "8", "--demonstration-steps", "256")
    named = ("--scenario", "yard", "--robot", "courier", "--method", "in-haste", "--out", str(run))
    extra = ("--reward.extra-terms", "calm", "--encoder.extra-components", "clearest", "--env", "ghosts")
    adrl(site, "train", *named, *extra, *sizes, "--start-steps", "256", "--validation-episodes", "4")
    config = json.loads((run / "config.json").read_text())
    assert config["input_size"] == 36 + 8 + 1
    assert config["encoder"]["extra_components"] == ["clearest"]
    assert (config["method"], config["robot"]["name"]) == ("in-haste", "courier")
    assert config["environment"]["simulator"] == "ghosts"
    row = json.loads((run / "metrics.jsonl").read_text().splitlines()[-1])
    assert row["term/calm"] <= 0.0
    adrl(site, "evaluate", "--policy", str(run), "--scenario", "yard", "--episodes", "4")
    adrl(site, "collect", "--expert", "hasty:0.5", "--steps", "256", "--out", str(tmp_path / "data"))
    assert "expert hasty:0.5" in (tmp_path / "data" / "data" / "metadata.json").read_text()
    drive = ("--scenario", "yard", "--robot", "courier", "--episodes", "4", "--json", str(result))
    adrl(site, "evaluate", "--policy", "straight", *drive)
    summary = json.loads(result.read_text())
    assert (summary["policy"], summary["robot"], summary["scenario"]) == ("straight", "courier", "yard")
