"""Files with random mutations: each reader of ours takes them, or refuses them by a typed error that names the file."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from adrl.errors import AdrlError
from mutations import mutated
from readers import READERS, write_valid

ROUNDS = 40
"""Mutations of each file."""


@pytest.fixture(scope="session")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of each kind, as it is written."""
    top = tmp_path_factory.mktemp("valid")
    write_valid(top)
    return top


@pytest.mark.parametrize("kind", READERS)
def test_mutated_files_are_read_or_refused_by_name(kind: str, valid: Path, tmp_path: Path) -> None:
    folder, file, read = READERS[kind]
    read(valid / folder)
    shutil.copytree(valid / folder, tmp_path / folder)
    content = (valid / folder / file).read_bytes()
    refused = []
    for seed in range(ROUNDS):
        (tmp_path / folder / file).write_bytes(mutated(content, np.random.default_rng(seed)))
        try:
            read(tmp_path / folder)
        except AdrlError as error:
            refused.append(str(error))
    assert refused
    assert max(map(len, refused)) < 1000
    assert not any("\n" in message for message in refused)
