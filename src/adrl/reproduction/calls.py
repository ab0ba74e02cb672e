"""How long the calls of `adrl reproduce` worked on a results folder, and on what: its record survives a kill."""

import platform
import subprocess
import time
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import adrl
from adrl.runs import versions

INTERVAL_S = 30.0
"""A killed call's record lacks at most this much of it."""
EXTRAS = ("stable_baselines3", "torch")
"""What the baselines run on, beside what versions() names."""


class Call:
    """One call, from its construction on. It is written when jobs run, and again and again while they do."""

    def __init__(self, write: Callable[[dict[str, Any]], None], cores: int | None) -> None:
        """Write: puts the record into the results. cores: how many work here, None for those of a Ray cluster."""
        self._write = write
        self._started_s = self._written_s = time.monotonic()
        self._jobs: int | None = None
        self._facts = {"began": datetime.now(UTC).isoformat(timespec="seconds"), "cores": cores} | {
            "machine": machine(),
            "versions": versions() | _extras(),
            "commit": commit(),
            "measured_by": "adrl reproduce",
        }

    def tell(self, ended: int, running: int) -> None:
        """Hears how many jobs have ended in this call, and how many run. One in which none ran leaves no record."""
        first = self._jobs is None
        if first and not running and not ended:
            return
        if first or ended != self._jobs or time.monotonic() - self._written_s >= INTERVAL_S:
            self._jobs = ended
            self.close()

    def close(self) -> None:
        """Write it as it is now."""
        if self._jobs is None:
            return
        self._written_s = time.monotonic()
        wall_s = round(self._written_s - self._started_s, 1)
        self._write({"wall_s": wall_s, "jobs": self._jobs} | self._facts)


def machine() -> str:
    """Processor and system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{models[0] if models else platform.processor() or platform.machine()}, {platform.system()}"


def commit() -> str | None:
    """Of the checkout that the package is in, with -dirty after it where files differ; None for an installed one."""
    folder = Path(adrl.__file__).parent
    try:
        # A package that was installed below some other repository is no part of it.
        _git(folder, "ls-files", "--error-unmatch", "__init__.py")
        return _git(folder, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def _extras() -> dict[str, str]:
    found = {}
    for name in EXTRAS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
