"""What all tests share: a headless machine, and the data beside the repository."""

import os
import shutil
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

IN_CI = os.environ.get("CI") == "true"

# A busy machine is no failure; in CI the same examples are tried every time.
settings.register_profile("adrl", deadline=None, derandomize=IN_CI)
settings.load_profile("adrl")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder ../shared/data of maps and worlds. Absent: the test is skipped, in CI it fails."""
    path = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not path.is_dir():
        message = "the folder shared/data is not beside the repository"
        if IN_CI:
            pytest.fail(message)
        pytest.skip(message)
    return path


@pytest.fixture(scope="session")
def chromium() -> str:
    """The machine's Chromium. Absent: the test is skipped, in CI it fails."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        message = "no chromium; on Debian: apt-get install chromium"
        if IN_CI:
            pytest.fail(message)
        pytest.skip(message)
    return path
