"""What all tests share: a headless machine, and the data beside the repository."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from refusals import Adrl

if TYPE_CHECKING:
    from playwright.sync_api import Browser

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


@pytest.fixture(scope="module")
def browser(chromium: str) -> "Iterator[Browser]":
    """A headless browser. Its start may take minutes on a busy machine."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # A container's root has no sandbox; the pages are our own.
        arguments = ["--no-sandbox"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments, timeout=120_000)
        yield browser
        browser.close()


@pytest.fixture
def adrl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Adrl:
    """adrl in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return Adrl(tmp_path, capsys)
