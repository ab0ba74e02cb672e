"""What all tests share: a headless machine, data, a browser."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from realtime_last import pytest_collection_finish, pytest_xdist_make_scheduler  # noqa: F401 - pytest calls them
from refusals import Adrl
from small_data import DATA, write_barn, write_cities

if TYPE_CHECKING:
    from playwright.sync_api import Browser

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

IN_CI = os.environ.get("CI") == "true"
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
BOTH = ["small", "shared"] if SHARED.is_dir() or IN_CI else ["small"]
"""Where data come from: small ones of the tests' own and, where it is beside the repository, ../shared/data."""

# A busy machine is no failure; in CI the same examples are tried every time.
settings.register_profile("adrl", deadline=None, derandomize=IN_CI)
settings.load_profile("adrl")


@pytest.fixture(scope="session")
def maps() -> Path:
    """The folder of published maps: turtlebot3_world/map.yaml, depot/depot.yaml, willow/willow-full.yaml."""
    return DATA / "maps"


@pytest.fixture(scope="session", params=BOTH)
def barn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """50 worlds of the BARN benchmark, worlds/ and paths/: drawn from tests/data, and its own files."""
    if request.param == "shared":
        return shared("barn")
    folder = tmp_path_factory.mktemp("barn")
    write_barn(folder)
    return folder


@pytest.fixture(scope="session", params=BOTH)
def cities(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two grids and scenarios with known optima in Moving AI's format: drawn ones, and the published."""
    if request.param == "shared":
        return shared("movingai")
    folder = tmp_path_factory.mktemp("cities")
    write_cities(folder)
    return folder


def shared(name: str) -> Path:
    """A folder of ../shared/data, which CI must have."""
    if not (SHARED / name).is_dir():
        pytest.fail(f"the folder shared/data/{name} is not beside the repository")
    return SHARED / name


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
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=120_000)  # the pages' own patience; what is fulfilled waits for nothing
    with sync_playwright() as playwright:
        # A container's root has no sandbox; the pages are our own. Without a GPU Chromium would emulate one.
        arguments = ["--no-sandbox", "--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments, timeout=120_000)
        yield browser
        browser.close()


@pytest.fixture
def hasty_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that the test starts compile without optimising, in half the time: where the law is not in numbers."""
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0")


@pytest.fixture
def adrl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Adrl:
    """adrl in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return Adrl(tmp_path, capsys)
