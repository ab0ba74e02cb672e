"""Texts and paths are the same to every function that takes a place."""

import dataclasses
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import adrl
from adrl.api import RunConfig
from adrl.comparison.config import CompareConfig
from adrl.worlds.place import Place


@pytest.mark.parametrize("config", [Place, RunConfig, CompareConfig])
def test_paths_of_a_configuration_may_be_texts(config: type) -> None:
    hints = get_type_hints(config)
    names = [f.name for f in dataclasses.fields(config) if Path in (hints[f.name], *get_args(hints[f.name]))]
    assert names
    for name in set(names) - {"models"}:
        assert getattr(config(**{name: "some/place"}), name) == Path("some/place"), name


def test_an_evaluation_is_saved_where_a_text_says(tmp_path: Path) -> None:
    result = adrl.evaluate(
        "astar-dwa", episodes=1, out=str(tmp_path / "out"), bag=str(tmp_path / "drives.bag"), num_threads=1
    )
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "summary.json",
        "episodes.parquet",
        "traces.safetensors",
    }
    assert (tmp_path / "drives.bag").is_file()
    result.save(str(tmp_path / "again"))
    for path in (tmp_path / "out").iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()
