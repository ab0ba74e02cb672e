"""A training run of seconds through the real command line, for the tests that need a finished one."""

import hashlib
from pathlib import Path

import pytest

from adrl.cli import main

SIZES = (
    *("--steps", "4096", "--demonstration-steps", "2048", "--task-pool", "8", "--num-envs", "32"),
    *("--pretrain-updates", "8", "--critic-warmup-updates", "8", "--start-steps", "512"),
    *("--td3.widths", "16", "16", "--log-interval-steps", "1024", "--checkpoint-interval-steps", "1024"),
)
TRAIN = ("train", "--scenario", "clutter", *SIZES)


def run_cli(*arguments: object) -> int:
    """Exit code of adrl with these arguments, in this process."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as stop:  # how the option parser ends
        return stop.code if isinstance(stop.code, int) else 1


def finished_run(factory: pytest.TempPathFactory) -> Path:
    """A run folder; the same in all tests, which leave it as it is."""
    out = factory.getbasetemp() / "small-run"
    if not out.exists():
        assert run_cli(*TRAIN, "--out", out) == 0
    return out


def contents(folder: Path) -> dict[str, tuple[int, str]]:
    """Everything below a folder: of files the time of the last change and a digest of the content.

    A folder's own time tells nothing: it changes with a lock that came and went.
    """
    return {
        str(path.relative_to(folder)): (
            (path.stat().st_mtime_ns, hashlib.sha256(path.read_bytes()).hexdigest())
            if path.is_file()
            else (0, "folder")
        )
        for path in sorted(folder.rglob("*"))
    }
