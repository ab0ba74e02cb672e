"""Which given worlds a policy has learned from: told by what stands in them, through every way they come in."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adrl.agents.checkpoint import require_same
from adrl.deploy.policy import MlpPolicy, PolicyConfig
from adrl.deploy.training_worlds import training_worlds
from adrl.errors import CheckpointError
from adrl.runs import Run, RunConfig
from adrl.types import World
from adrl.worlds import ROBOTS, BarnScenario
from adrl.worlds.barn import field_world
from adrl.worlds.given import fingerprint
from small_run import run_cli

JACKAL = ROBOTS["jackal"]


@given(seed=st.integers(0, 100))
def test_equal_things_in_any_order_are_one_world_and_a_moved_one_makes_another(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = field_world(rng.random((30, 30)) < 0.2)
    circles = world.circles[rng.permutation(len(world.circles))]
    noise = rng.uniform(-1e-6, 1e-6, circles.shape)
    assert fingerprint(World(bounds=(0.0, 0.0, 1.0, 1.0), circles=circles + noise)) == fingerprint(world)
    circles[rng.integers(len(circles)), rng.integers(3)] += 0.01
    assert fingerprint(dataclasses.replace(world, circles=circles)) != fingerprint(world)
    square = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]])
    boxes = tuple(square + rng.uniform(0.0, 1.0, 2) for _ in range(3))
    listed, otherwise = (World(bounds=(0.0, 0.0, 2.0, 2.0), polygons=b) for b in (boxes, boxes[::-1]))
    assert (
        fingerprint(listed)
        == fingerprint(otherwise)
        != fingerprint(dataclasses.replace(listed, polygons=boxes[:2]))
    )


@pytest.fixture
def folder(barn: Path, tmp_path: Path) -> Path:
    for number in (18, 67, 105):
        shutil.copy(barn / "worlds" / f"world_{number}.world", tmp_path)
        shutil.copy(barn / "paths" / f"path_{number}.npy", tmp_path)
    return tmp_path


def config_of(run: RunConfig) -> PolicyConfig:
    return Run.of(dataclasses.replace(run, robot=JACKAL)).about_policy()


def test_a_run_knows_its_training_worlds_and_not_those_held_out(folder: Path) -> None:
    scenario = BarnScenario(folder, 1)
    known = training_worlds(config_of(RunConfig(barn=folder, barn_held_out=1)))
    assert known == {fingerprint(world.world) for world in scenario.split("train")}
    assert known is not None
    assert not known & {fingerprint(world.world) for world in scenario.split("test")}
    one = training_worlds(config_of(RunConfig(world=folder / "world_18.world")))
    assert one is not None
    assert one < training_worlds(config_of(RunConfig(barn=folder)))  # type: ignore[operator]
    assert training_worlds(config_of(RunConfig(scenario="cellular"))) == set()


def test_a_run_resumed_with_other_worlds_is_another_run(folder: Path) -> None:
    """Or a run would have had worlds that its config.json does not name."""
    first, second = (config_of(RunConfig(barn=folder, barn_held_out=n)).extra["environment"] for n in (1, 2))
    with pytest.raises(CheckpointError, match="worlds"):
        require_same(Path("checkpoint"), first, second)


def test_fine_tuning_inherits_them(folder: Path, tmp_path: Path) -> None:
    first = config_of(RunConfig(barn=folder, barn_held_out=1))
    sizes = (44, 1), (1, 2)
    layers = [(np.zeros(size, np.float32), np.zeros(size[1], np.float32)) for size in sizes]
    MlpPolicy(layers, dataclasses.replace(first, input_size=44, widths=(1,))).save(tmp_path / "first")
    tuned = training_worlds(config_of(RunConfig(scenario="cellular", fine_tune=tmp_path / "first")))
    assert tuned == training_worlds(first) != set()
    assert training_worlds(config_of(RunConfig(scenario="cellular", fine_tune=Path("diffbot")))) == set()


@pytest.mark.integration
def test_demonstrations_bring_theirs(folder: Path, tmp_path: Path) -> None:
    small = ("--robot", "jackal", "--steps", 64, "--num-envs", 4)
    for name, place in (("given", ("--barn", folder)), ("drawn", ("--scenario", "clutter"))):
        assert run_cli("collect", *place, *small, "--out", tmp_path / name) == 0
    taught = training_worlds(config_of(RunConfig(scenario="cellular", dataset=tmp_path / "given")))
    assert taught == training_worlds(config_of(RunConfig(barn=folder)))
    assert training_worlds(config_of(RunConfig(scenario="cellular", dataset=tmp_path / "drawn"))) == set()


def test_what_a_run_does_not_say_is_not_known(folder: Path) -> None:
    said = config_of(RunConfig(barn=folder))
    environment = {k: v for k, v in said.extra["environment"].items() if k != "worlds"}
    silent = dataclasses.replace(said, extra={**said.extra, "environment": environment})
    assert training_worlds(silent) is None
    assert training_worlds(PolicyConfig(input_size=1, widths=())) is None
    for odd in ({**environment, "worlds": [1]}, "worlds"):
        with pytest.raises(CheckpointError, match="environment"):
            training_worlds(dataclasses.replace(said, extra={**said.extra, "environment": odd}))
