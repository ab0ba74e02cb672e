"""Episodes kept part by part while they are driven, so that a stopped evaluation goes on."""

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from adrl import files
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.evaluation.metrics import Episodes
from adrl.evaluation.results import read_episodes, write_episodes
from adrl.json_files import read_json
from adrl.outputs import locked, require_folder

ASKED_FILE, PARTS_FOLDER = "asked.json", "parts"


class KeptEpisodes:
    """Parts of an evaluation by name, in a folder, or in memory where that is None.

    A context, which locks it. Entering raises ConfigError for a folder of other settings, CheckpointError for one that
    is damaged.
    """

    def __init__(self, folder: str | os.PathLike[str] | None, asked: Mapping[str, Any]) -> None:
        """asked: what the parts depend on; parts of other settings are not gone on with. Raises ConfigError."""
        require_folder("--out", folder, ASKED_FILE)
        self._folder = None if folder is None else Path(folder)
        self._asked = asked
        self._parts: dict[str, Episodes] = {}
        self._stack = ExitStack()

    def __enter__(self) -> "KeptEpisodes":
        if self._folder is not None:
            self._stack.enter_context(locked(self._folder))
            try:
                self._require_same(self._folder / ASKED_FILE)
            except BaseException:
                self._stack.close()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _require_same(self, file: Path) -> None:
        if not file.exists():
            files.write_json(file, self._asked)
            return
        try:
            before = read_json(file, dict[str, Any])
        except FileError as error:
            raise CheckpointError(
                f"{file} {error}; these are not the settings of an evaluation: give another folder"
            ) from None
        other = sorted(name for name in {*before, *self._asked} if before.get(name) != self._asked.get(name))
        if other:
            raise ConfigError(
                f"--out {file.parent} holds runs with other settings ({', '.join(other)}); give another folder, or go "
                "on as it was begun"
            )

    def has(self, name: str) -> bool:
        """Whether the part was driven, now or before. Raises CheckpointError for a file that is malformed."""
        if name not in self._parts and self._folder is not None and self._file(name).exists():
            self._parts[name] = read_episodes(self._file(name))
        return name in self._parts

    def keep(self, name: str, episodes: Episodes) -> None:
        """The part was driven. Raises OSError."""
        self._parts[name] = episodes
        if self._folder is not None:
            write_episodes(self._file(name), episodes)

    def by_trial(self, names: Sequence[str]) -> Episodes:
        """The first trial of every part, then the second of every part, ...; the parts have equally many."""
        parts = [self._parts[name] for name in names]
        count = len(parts[0])
        order = np.arange(count * len(parts)).reshape(len(parts), count).T.ravel()
        return Episodes.concatenated(parts).select(order)

    def _file(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / PARTS_FOLDER / f"{name}.parquet"
