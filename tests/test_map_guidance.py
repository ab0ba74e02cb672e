"""With a map that is given, the map shows the way unless something else is asked for."""

import json
from pathlib import Path

import numpy as np
import pytest

from adrl.comparison.config import CompareConfig
from adrl.runs import RunConfig
from adrl.types import World
from adrl.worlds.fixed import FixedWorld
from map_files import write_map
from small_run import SIZES, run_cli

GIVEN = {"map": Path("hall.yaml"), "world": Path("hall.sdf")}
HALL = FixedWorld("hall", World(bounds=(0.0, 0.0, 8.0, 4.0)))


@pytest.mark.parametrize("kind", [RunConfig, CompareConfig])
def test_the_default_is_the_places(kind: type[RunConfig]) -> None:
    for name, path in GIVEN.items():
        assert kind(**{name: path}).resolved_guidance() == "map"  # pyright: ignore[reportArgumentType]
        for guidance in ("goal", "replan", "map"):
            given = kind(guidance=guidance, **{name: path})  # pyright: ignore[reportArgumentType]
            assert given.resolved_guidance() == guidance
    assert kind(scenario=HALL).resolved_guidance() == "map"  # pyright: ignore[reportArgumentType]
    assert kind(scenario="complex").resolved_guidance() == kind().resolved_guidance() == "goal"


def test_what_depends_on_guidance_follows_it() -> None:
    shown, mapless = RunConfig(map=GIVEN["map"]), RunConfig(map=GIVEN["map"], guidance="goal")
    assert shown.resolved() == RunConfig(map=GIVEN["map"], guidance="map").resolved() != mapless.resolved()
    assert CompareConfig(map=GIVEN["map"]).guidance_names == ("map",)


@pytest.mark.slow
@pytest.mark.integration
def test_a_run_on_a_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It says so, keeps it, and a run that was begun with another guidance goes on with that one."""
    pixels = np.full((80, 120), 254, np.uint8)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    hall = write_map(tmp_path, pixels)
    for asked in (None, "goal"):
        out = tmp_path / f"run-{asked}"
        guidance = () if asked is None else ("--guidance", asked)
        assert run_cli("train", "--map", hall, *SIZES, *guidance, "--out", out) == 0
        assert ("guidance map:" in " ".join(capsys.readouterr().err.split())) == (asked is None)
        longer = ("--steps", 5120, "--resume", "--out", out)
        assert run_cli("train", "--map", hall, *SIZES, *longer) == 0
        config = json.loads((out / "config.json").read_text())
        assert config["guidance"] == config["settings"]["guidance"] == (asked or "map")
        assert config["env_steps"] == 5120
