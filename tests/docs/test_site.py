"""The documentation in a real browser: every page asks its own site for all it needs and fits a telephone."""

import functools
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, Request, Response

pytestmark = [pytest.mark.slow, pytest.mark.integration]

ROOT = Path(__file__).resolve().parents[2]
PHONE, DESK = (390, 844), (1280, 900)
PATIENCE_MS = 120_000


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as make docs does."""
    out = tmp_path_factory.mktemp("site")
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)]
    subprocess.run(command, cwd=ROOT, env=quiet, check=True, timeout=300)
    return out


@pytest.fixture(scope="module")
def with_bars(browser: Browser, chromium: str) -> Iterator[Browser]:
    """A browser that draws scroll bars, as a reader's does."""
    shown = browser.browser_type.launch(
        executable_path=chromium,
        args=["--no-sandbox"],
        ignore_default_args=["--hide-scrollbars"],
        timeout=PATIENCE_MS,
    )
    yield shown
    shown.close()


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(QuietHandler, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()


def settle(page: Page) -> None:
    """Wait for what changes the sizes on a loaded page. An idle network, which Playwright can wait for, was never seen
    once on a busy machine."""
    page.evaluate("document.fonts.ready.then(() => true)")


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["telephone", "desk"])
def test_every_page_is_complete_in_itself(
    browser: Browser, site: Path, address: str, size: tuple[int, int]
) -> None:
    """No request leaves the site, none fails, no script stumbles, nothing is wider than the screen."""
    pages = sorted(path.relative_to(site).as_posix() for path in site.rglob("*.html"))
    assert {"index.html", "quickstart.html", "method.html", "results/index.html"} <= set(pages)
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(PATIENCE_MS)
    faults: list[str] = []

    def asked(request: Request) -> None:
        if not request.url.startswith((address, "data:")):
            faults.append(request.url)

    def answered(response: Response) -> None:
        if response.status >= 400:
            faults.append(f"{response.status} {response.url}")

    page.on("request", asked)
    page.on("response", answered)
    page.on("pageerror", lambda error: faults.append(str(error)))
    found = {}
    for name in pages:
        page.goto(address + name)
        settle(page)
        if (width := page.evaluate("document.documentElement.scrollWidth")) > size[0]:
            faults.append(f"{width} px wide")
        found[name] = list(faults)
        faults.clear()
    page.close()
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_from_the_disk_it_opens_and_searches_too(browser: Browser, site: Path) -> None:
    requests: list[str] = []
    page = browser.new_page(viewport={"width": DESK[0], "height": DESK[1]})
    page.set_default_timeout(PATIENCE_MS)
    page.on("request", lambda request: requests.append(request.url))
    page.goto((site / "quickstart.html").as_uri())
    assert page.locator("h1").first.inner_text()
    page.locator(".md-search__input").press_sequentially("watchdog")
    found = page.locator(".md-search-result__link").first
    found.wait_for()
    assert "robot.html" in (found.get_attribute("href") or "")
    page.close()
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []


@pytest.mark.parametrize("size", [PHONE, DESK], ids=["telephone", "desk"])
def test_every_equation_fits(browser: Browser, site: Path, size: tuple[int, int]) -> None:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(PATIENCE_MS)
    page.goto((site / "method.html").as_uri())
    settle(page)
    boxes = page.evaluate(
        """[...document.querySelectorAll(".equation > div")].map(e => [e.innerText, e.clientWidth, e.scrollWidth])"""
    )
    page.close()
    assert len(boxes) > 20
    assert [box for box in boxes if box[2] > box[1]] == []


def test_a_table_wider_than_a_telephone_scrolls_by_a_bar_that_is_seen(with_bars: Browser, site: Path) -> None:
    page = with_bars.new_page(viewport={"width": PHONE[0], "height": PHONE[1]})
    page.set_default_timeout(PATIENCE_MS)
    page.goto((site / "results" / "index.html").as_uri())
    page.locator(".md-typeset__scrollwrap").first.wait_for()
    settle(page)
    sizes = page.evaluate(
        """[...document.querySelectorAll(".md-typeset__scrollwrap")].map(
            e => [e.scrollWidth > e.clientWidth, e.offsetHeight > e.clientHeight])"""
    )
    page.close()
    assert [True, True] in sizes
    assert [wide for wide, has_bar in sizes if wide != has_bar] == []
