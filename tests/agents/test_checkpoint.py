"""A checkpoint is there whole or not at all, whatever call the process dies in."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adrl.agents import checkpoint
from adrl.errors import CheckpointError
from damage import DAMAGES, damage_file


class Killed(BaseException):
    """Stands for the death of the process: nothing handles it."""


def content(value: float) -> tuple[dict[str, Any], dict[str, checkpoint.Arrays]]:
    parts = {
        "a": {
            "x": np.full((3, 2), value, np.float32),
            "flag": np.array([True, False]),
            "scalar": np.array(value),
        },
        "b": {"seed": np.array([2**63 + 1], np.uint64), "none": np.zeros((0, 4))},
    }
    return {"number": value, "big": 2**100}, parts


def test_what_is_saved_is_loaded(tmp_path: Path):
    assert checkpoint.load(tmp_path) is None
    checkpoint.save(tmp_path, 10, *content(1.5))
    saved = checkpoint.load(tmp_path)
    assert saved is not None
    assert saved.state["number"] == 1.5
    assert saved.state["big"] == 2**100
    for name, arrays in content(1.5)[1].items():
        for key, array in arrays.items():
            assert_array_equal(saved.part(name)[key], array)
            assert saved.part(name)[key].dtype == array.dtype


def test_only_the_newest_is_kept(tmp_path: Path):
    for step in (10, 200, 3000):
        checkpoint.save(tmp_path, step, *content(step))
    assert [path.name for path in (tmp_path / "checkpoint").iterdir()] == ["000000003000"]


CALLS = [
    (os, "fsync"),
    (os, "open"),
    (os, "replace"),
    (Path, "mkdir"),
    (Path, "rename"),
    (shutil, "rmtree"),
    (checkpoint, "save_file"),
]


def count_calls(patch: pytest.MonkeyPatch, die_at: int | None) -> list[str]:
    """Record the calls that touch the disk; die before the one numbered die_at."""
    calls: list[str] = []

    def wrap(name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def called(*args: Any, **kwargs: Any) -> Any:
            calls.append(name)
            if len(calls) - 1 == die_at:
                raise Killed
            return original(*args, **kwargs)

        return called

    for owner, name in CALLS:
        patch.setattr(owner, name, wrap(name, getattr(owner, name)))
    return calls


def test_dying_before_any_call_leaves_the_old_one_or_the_new_one(tmp_path: Path):
    def prepared(name: str) -> Path:
        run = tmp_path / name
        checkpoint.save(run, 10, *content(1.0))
        return run

    whole = prepared("whole")
    with pytest.MonkeyPatch.context() as patch:
        calls = count_calls(patch, None)
        checkpoint.save(whole, 20, *content(2.0))
    assert {"fsync", "rename", "rmtree"} <= set(calls)
    found = set()
    for die_at in range(len(calls)):
        run = prepared(str(die_at))
        with pytest.MonkeyPatch.context() as patch:
            count_calls(patch, die_at)
            with pytest.raises(Killed):
                checkpoint.save(run, 20, *content(2.0))
        saved = checkpoint.load(run)
        assert saved is not None
        found.add(saved.state["number"])
        assert (saved.part("a")["x"] == saved.state["number"]).all()
        # And the next save clears up.
        checkpoint.save(run, 30, *content(3.0))
        assert [path.name for path in (run / "checkpoint").iterdir()] == ["000000000030"]
    assert found == {1.0, 2.0}


def test_a_half_deleted_old_one_is_not_mistaken_for_the_newest(tmp_path: Path):
    checkpoint.save(tmp_path, 10, *content(1.0))
    folder = tmp_path / "checkpoint"
    (folder / ".new-000000000020").mkdir()
    (folder / ".old-000000000005").mkdir()
    saved = checkpoint.load(tmp_path)
    assert saved is not None
    assert saved.state["number"] == 1.0


@pytest.mark.parametrize("name", ["a.safetensors", "b.safetensors", "state.json"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_names_the_file(tmp_path: Path, name: str, damage: str):
    path = checkpoint.save(tmp_path, 10, *content(1.0)) / name
    damage_file(path, damage)
    with pytest.raises(CheckpointError, match=name):
        checkpoint.load(tmp_path)


def test_another_configuration_is_named():
    saved = {"td3": {"gamma": 0.99, "widths": [128, 128]}, "seed": 0}
    given = {"td3": {"gamma": 0.9, "widths": (128, 128)}, "seed": 0}
    with pytest.raises(CheckpointError, match=r"config\.td3\.gamma = 0\.99, this run has 0\.9"):
        checkpoint.require_same(Path("x"), saved, given)
    checkpoint.require_same(Path("x"), saved, given | {"td3": {"gamma": 0.99, "widths": (128, 128)}})


def test_a_long_list_of_another_configuration_is_told_in_a_line():
    worlds = [f"{number:016x}" for number in range(50)]
    with pytest.raises(
        CheckpointError, match=r"config\.worlds = .* and 47 more, this run has .* and 32 more"
    ) as told:
        checkpoint.require_same(Path("x"), {"worlds": worlds}, {"worlds": worlds[10:45]})
    assert len(str(told.value)) < 300
