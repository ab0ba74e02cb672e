"""Checkpoints: a folder each under checkpoint/, complete from the moment it has its name.

  checkpoint/.new-*         being written; ignored and removed
  checkpoint/000000012800/  state.json and one .safetensors file a part; the name counts environment steps
  checkpoint/.old-*         being deleted; ignored and removed

A kill between any two system calls leaves the newest complete folder or the one before it.
"""

import shutil
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NotRequired, TypedDict

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from adrl.errors import CheckpointError, FileError, brief
from adrl.files import require_ordinary, sync, write_json
from adrl.json_files import checked, read_json

Arrays = dict[str, NDArray[Any]]

FOLDER = "checkpoint"
STATE_FILE = "state.json"
SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """What save() was given."""

    path: Path
    state: dict[str, Any]
    parts: dict[str, Arrays]

    def part(self, name: str) -> Arrays:
        """One part's arrays. Raises CheckpointError naming the file if it was not saved."""
        if name not in self.parts:
            raise CheckpointError(
                f"{self.path / name}.safetensors: no such file; the checkpoint is incomplete"
            )
        return self.parts[name]


def save(run: Path, env_steps: int, state: Mapping[str, Any], parts: Mapping[str, Arrays]) -> Path:
    """Write a checkpoint and delete the older ones; one of as many env_steps stays as it is.

    Raises OSError; what was there before then still loads.
    """
    folder = run / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)
    final = folder / f"{env_steps:012d}"
    if final.exists():
        return final
    new = folder / f".new-{final.name}"
    new.mkdir()
    for part, arrays in parts.items():
        path = new / f"{part}.safetensors"
        save_file({key: np.asarray(array, order="C") for key, array in arrays.items()}, path)
        sync(path)
    write_json(new / STATE_FILE, {"schema_version": SCHEMA_VERSION, "parts": sorted(parts)} | dict(state))
    sync(new)
    new.rename(final)
    sync(folder)
    for older in _complete(folder):
        if older != final:
            _retire(older)
    _clear(folder)
    return final


def load(run: Path, parts: Collection[str] | None = None) -> Checkpoint | None:
    """The newest checkpoint of a run folder, or None. parts: those that are read, all when None.

    Raises CheckpointError naming the bad file.
    """
    folders = _complete(run / FOLDER)
    if not folders:
        return None
    path = folders[-1]
    state = _read_state(path / STATE_FILE)
    wanted = [part for part in state["parts"] if parts is None or part in parts]
    return Checkpoint(path, state, {part: _read_arrays(path / f"{part}.safetensors") for part in wanted})


def settings(run: Path) -> dict[str, Any]:
    """What the newest checkpoint of a run folder says its run was, without its arrays; {} where there is none."""
    folders = _complete(run / FOLDER)
    return _read_state(folders[-1] / STATE_FILE).get("config", {}) if folders else {}


def exists(run: Path) -> bool:
    """Whether a run folder holds a checkpoint to resume from."""
    return bool(_complete(run / FOLDER))


def require_same(path: Path, saved: Any, given: Any, name: str = "config") -> None:
    """Raises CheckpointError naming the first value in which a resumed run differs from its checkpoint."""
    if isinstance(given, dict) and isinstance(saved, dict):
        for key in sorted(given.keys() | saved.keys()):
            require_same(path, saved.get(key), given.get(key), f"{name}.{key}")
        return
    plain = list(given) if isinstance(given, tuple) else given
    if saved != plain:
        told, ours = _shown(saved), _shown(plain)
        raise CheckpointError(f"{path}: was written with {name} = {told}, this run has {ours}")


def _shown(value: Any) -> str:
    """A value in an error; of a long list its beginning and its length."""
    if isinstance(value, list) and len(value) > 6:
        return f"{[*value[:3]]!r} and {len(value) - 3} more"
    return repr(value)


class _State(TypedDict):
    """What is the same in the state of every kind of run."""

    schema_version: int
    parts: list[Annotated[str, Meta(pattern=r"^\w+$")]]
    config: NotRequired[dict[str, Any]]


def _read_state(path: Path) -> dict[str, Any]:
    try:
        state = read_json(path, dict[str, Any])
        if state.get("schema_version") != SCHEMA_VERSION:
            raise CheckpointError(f"{path}: not a checkpoint of this version of ADRL")
        checked(state, _State)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; the checkpoint is damaged, delete its folder") from None
    return state


def _read_arrays(path: Path) -> Arrays:
    try:
        require_ordinary(path)
        return load_file(path)
    except FileError as error:
        raise CheckpointError(f"{path} {error}; the checkpoint is damaged, delete its folder") from None
    except (OSError, SafetensorError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{path}: truncated, or not a safetensors file ({brief(error)})") from None


def _complete(folder: Path) -> list[Path]:
    """Complete checkpoints, oldest first."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_dir() and path.name.isdigit())


def _retire(path: Path) -> None:
    """Take a checkpoint's name away before its files go: no half-deleted one passes for a whole one."""
    path.rename(path.with_name(f".old-{path.name}"))


def _clear(folder: Path) -> None:
    for path in folder.iterdir():
        if path.name.startswith((".new-", ".old-")):
            shutil.rmtree(path)
