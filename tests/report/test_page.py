"""The report in a real browser: opened, sorted, played, narrowed to a telephone, and held to asking for nothing."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from map_files import write_map
from small_run import finished_run, run_cli

pytestmark = [pytest.mark.slow, pytest.mark.integration]

MOST_BYTES = 8_000_000
PHONE, DESK = (360, 780), (1280, 900)
PATIENCE_MS = 120_000
"""A busy machine is no failure."""
AT_LEAST_THREE = re.compile(r"[3-9]|\d\d+")
"""A frame's number. The page forbids scripts that are strings, so it is no condition for wait_for_function."""


@dataclass
class Opened:
    page: Page
    address: str
    messages: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with evaluations on clutter, made by the report itself, and on a map; its policy hardly drives."""
    folder = tmp_path_factory.mktemp("report") / "run"
    shutil.copytree(finished_run(tmp_path_factory), folder)
    assert run_cli("report", folder, "--episodes", 10, "--figures") == 0
    pixels = np.full((140, 160), 254)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
    pixels[50:90, 70:80] = 0
    place = write_map(folder.parent, pixels, resolution=0.05)
    out = folder / "on-a-map"
    assert run_cli("evaluate", "--policy", folder, "--map", place, "--episodes", 12, "--out", out) == 0
    assert run_cli("report", folder) == 0
    return folder


def opened(browser: Browser, path: Path, size: tuple[int, int] = DESK, **options: Any) -> Opened:
    """The report, ready."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, **options)
    page.set_default_timeout(PATIENCE_MS)
    report = Opened(page, path.as_uri())
    page.on("console", lambda message: report.messages.append(message.text))
    page.on("pageerror", lambda error: report.messages.append(str(error)))
    page.on("request", lambda request: report.requests.append(request.url))
    page.goto(report.address)
    page.wait_for_selector("html[data-ready]")
    return report


def require_quiet(report: Opened) -> None:
    """No error, no message, and no request but for the file itself."""
    assert report.messages == []
    outside = [url for url in report.requests if not url.startswith(("data:", "blob:"))]
    assert outside == [report.address]


@pytest.fixture(scope="module")
def desk(browser: Browser, folder: Path) -> Opened:
    """One page for all tests at a desk: opening costs a second or two."""
    return opened(browser, folder / "report.html")


@pytest.fixture
def page(desk: Opened) -> Iterator[Page]:
    yield desk.page
    require_quiet(desk)


def column(table: Locator, index: int) -> list[str]:
    """The first lines of a column's cells, from top to bottom."""
    cells = table.locator(f"tbody tr > :nth-child({index + 1})").all_inner_texts()
    return [cell.split("\n")[0].strip() for cell in cells]


def picture(canvas: Locator) -> bytes:
    return canvas.screenshot()


def test_the_file_is_small_and_names_no_address_to_load_from(folder: Path) -> None:
    content = (folder / "report.html").read_text(encoding="utf-8")
    assert len(content.encode()) < MOST_BYTES
    own = content[: content.index('<script type="application/json"')]
    assert "http" not in own.replace("http-equiv", "")
    assert content.count("default-src 'none'") == 1


def test_the_browser_itself_refuses_requests(desk: Opened) -> None:
    violated = desk.page.evaluate(
        """async () => {
            const told = [];
            document.addEventListener('securitypolicyviolation', (event) => told.push(event.effectiveDirective));
            const answer = await fetch('http://127.0.0.1:9/').then(() => 'sent', () => 'refused');
            const image = new Image();
            await new Promise((done) => { image.onerror = done; image.src = 'http://127.0.0.1:9/x.png'; });
            return [answer, ...told].sort();
        }"""
    )
    assert violated == ["connect-src", "img-src", "refused"]
    # What the browser says of it is no message of the page's.
    desk.messages.clear()
    desk.requests[:] = [desk.address]


def require_every_section(page: Page) -> None:
    """All are there and in the navigation, and a chart is drawn when it comes into sight, with a line in it."""
    sections = ["Results", "Training", "Replay", "Failures", "Where it fails", "Tasks"]
    assert page.locator("main section:visible h2").all_inner_texts() == sections
    assert page.locator("nav a").all_inner_texts() == sections
    charts = page.locator("#training .chart")
    assert charts.count() >= 4
    for chart in charts.all():
        chart.scroll_into_view_if_needed()
        chart.locator(".scatterlayer path.js-line").first.wait_for(state="attached")


def brightness(page: Page) -> int:
    """Red of the page's ground, 0 to 255."""
    return int(page.evaluate("getComputedStyle(document.body).backgroundColor").split("(")[1].split(",")[0])


def test_it_opens_with_every_section(page: Page) -> None:
    require_every_section(page)
    assert brightness(page) > 200


def test_dark_it_opens_too_and_turns_light(browser: Browser, folder: Path) -> None:
    report = opened(browser, folder / "report.html", color_scheme="dark")
    require_every_section(report.page)
    assert brightness(report.page) < 50
    line = report.page.locator("#training .js-line").first
    before = line.get_attribute("style")
    report.page.locator("#theme").click()
    assert brightness(report.page) > 200
    assert line.get_attribute("style") != before
    require_quiet(report)
    report.page.close()


def test_what_is_drawn_when_it_is_seen_moves_nothing(browser: Browser, folder: Path) -> None:
    """Else a press lands beside what was aimed at."""
    report = opened(browser, folder / "report.html")
    places = "[...document.querySelectorAll('main section')].map((one) => one.offsetTop)"
    before = report.page.evaluate(places)
    require_every_section(report.page)
    report.page.locator("#failure-map").scroll_into_view_if_needed()
    report.page.locator("#failure-map .heatmaplayer").first.wait_for(state="attached")
    assert report.page.evaluate(places) == before
    report.page.close()


def test_columns_sort_both_ways_and_say_so(page: Page) -> None:
    table = page.locator("#tasks-table")
    assert [cell.removeprefix("▶ ") for cell in column(table, 0)] == [str(i) for i in range(10)]
    head = table.locator("thead th").nth(3)
    before = column(table, 3)
    head.locator("button").click()
    expect(head).to_have_attribute("aria-sort", "descending")
    assert [float(cell) for cell in column(table, 3)] == sorted(map(float, before), reverse=True)
    head.locator("button").press("Enter")
    expect(head).to_have_attribute("aria-sort", "ascending")
    assert [float(cell) for cell in column(table, 3)] == sorted(map(float, before))
    assert table.locator("thead th[aria-sort=none]").count() == table.locator("thead th").count() - 1
    results = page.locator("#results-table")
    labels = column(results, 0)
    results.locator("thead button").first.click()
    assert column(results, 0) == sorted(labels)


def test_tasks_are_filtered_by_their_ending(page: Page) -> None:
    table, choice = page.locator("#tasks-table"), page.locator("#tasks select").last
    every = column(table, 1)
    for ending in ("collision", "timeout", "success"):
        choice.select_option(ending)
        assert column(table, 1) == [ending] * every.count(ending)
    choice.select_option("failures")
    assert len(column(table, 1)) == len(every) - every.count("success") > 0


def test_a_replay_plays_stops_and_is_scrubbed(page: Page) -> None:
    canvas, play, scrub = page.locator("#replay canvas.world"), page.locator("#play"), page.locator("#scrub")
    # The longest, so that a slow machine does not come to its end.
    lengths = [float(text.split()[-2]) for text in page.locator("#episode option").all_inner_texts()]
    page.locator("#episode").select_option(index=lengths.index(max(lengths)))
    page.get_by_label("Speed").select_option("1")
    start = picture(canvas)
    assert canvas.get_attribute("data-frame") == "0"
    play.click()
    assert "Pause" in play.inner_text()
    expect(canvas).to_have_attribute("data-frame", AT_LEAST_THREE, timeout=PATIENCE_MS)
    play.click()
    assert "Play" in play.inner_text()
    stopped = float(scrub.input_value())
    assert stopped > 0.0
    assert picture(canvas) != start
    page.wait_for_timeout(200)
    assert float(scrub.input_value()) == stopped
    end = scrub.get_attribute("max")
    scrub.fill(str(end))
    strips = page.locator("#replay canvas.strip")
    assert strips.count() == 3
    assert f"of {float(end or 0):.1f} s" in page.locator("#replay output").inner_text()
    last = picture(canvas)
    # The cursor of a strip is dragged back to the start.
    box = strips.first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 35, box["y"] + 40)
    assert float(scrub.input_value()) < 0.1 * float(end or 0)
    assert picture(canvas) != last


def test_a_replay_shows_the_path_that_holds_at_its_time(
    browser: Browser, folder: Path, tmp_path: Path
) -> None:
    """A car that stood is given others on its way. Pictures of the start and of the end."""
    head, begin, rest = (folder / "report.html").read_text(encoding="utf-8").partition('id="data">')
    text, close, tail = rest.partition("</script>")

    def shown(*later: tuple[float, float]) -> tuple[bytes, bytes]:
        """later: from which share of the time on there is a path round a corner, and how far off that is."""
        data = json.loads(text)
        replay = data["evaluations"][0]["replays"][0]
        (x, y), end_s = replay["path"][:2], replay["time_s"][-1]
        replay["later_paths"] = [
            [share * end_s, [x, y, x + off, y + off, *replay["goal"]]] for share, off in later
        ]
        path = tmp_path / "report.html"
        path.write_text(f"{head}{begin}{json.dumps(data)}{close}{tail}", encoding="utf-8")
        page = opened(browser, path).page
        page.locator("#episode").select_option(index=0)
        canvas, scrub = page.locator("#replay canvas.world"), page.locator("#scrub")
        start = picture(canvas)
        scrub.fill(str(scrub.get_attribute("max")))
        pictures = start, picture(canvas)
        page.close()
        return pictures

    own, first, second = shown(), shown((0.0, 0.4)), shown((0.0, 0.8))
    assert len({own[0], first[0], second[0]}) == len({own[1], first[1], second[1]}) == 3
    assert shown((0.5, 0.4)) == (own[0], first[1])
    assert shown((0.0, 0.4), (0.5, 0.8)) == (first[0], second[1])
    assert shown((2.0, 0.4)) == own


def test_another_episode_is_another_picture(page: Page) -> None:
    canvas, choice = page.locator("#replay canvas.world"), page.locator("#episode")
    seen = set()
    for index in range(3):
        choice.select_option(index=index)
        label = canvas.get_attribute("aria-label") or ""
        assert choice.locator("option:checked").inner_text() in label
        seen.add((label, picture(canvas)))
    assert len(seen) == 3
    page.get_by_label("Next episode").click()
    assert choice.evaluate("select => select.selectedIndex") == 3


def test_a_failure_opens_its_replay(page: Page) -> None:
    shots = page.locator("#failures .shot")
    assert shots.count() >= 1
    shot = shots.last
    title = shot.locator("strong").inner_text().lower()
    shot.click()
    assert title in (page.locator("#replay canvas.world").get_attribute("aria-label") or "")
    assert page.locator("#replay h2").evaluate("h => Math.abs(h.getBoundingClientRect().top)") < 200
    assert page.locator("#replay .ending").inner_text() in ("collision", "timeout")


def test_the_map_shows_counts_that_are_the_episodes(page: Page) -> None:
    plot = page.locator("#failure-map")
    plot.scroll_into_view_if_needed()
    plot.locator(".heatmaplayer image").first.wait_for(state="attached")
    assert plot.locator(".heatmaplayer image").count() == 1
    assert plot.locator(".layer-below image, .imagelayer image").count() >= 1
    ends = plot.evaluate("p => p.data.filter(t => t.customdata).flatMap(t => t.customdata).length")
    page.locator("#tasks select").first.select_option(label="on-a-map")
    page.locator("#tasks select").last.select_option("failures")
    assert ends == len(column(page.locator("#tasks-table"), 0)) >= 1
    page.locator("#map select").last.select_option("passed")
    assert plot.evaluate("p => Math.max(...p.data[0].z.flat().filter(v => v !== null))") <= 12
    lines = page.get_by_role("button", name="Start → goal")
    traces = plot.evaluate("p => p.data.length")
    lines.click()
    assert plot.evaluate("p => p.data.length") == traces + 2


def test_curves_against_steps_or_time(page: Page) -> None:
    chart = page.locator("#training .chart").first
    chart.scroll_into_view_if_needed()
    chart.locator(".xtitle").wait_for(state="attached")
    assert "wall clock" in (chart.locator(".xtitle").text_content() or "")
    page.get_by_role("button", name="environment steps").click()
    assert "environment steps" in (chart.locator(".xtitle").text_content() or "")
    assert chart.evaluate("c => Math.max(...c.data[0].x)") == 4096


def test_the_keyboard_does_it_all(page: Page) -> None:
    page.evaluate("document.getElementById('theme').focus()")
    names = ["theme"]
    for _ in range(80):
        page.keyboard.press("Tab")
        names.append(page.evaluate("document.activeElement.id || document.activeElement.className"))
        if names[-1] == "play":
            break
    assert {"episode", "play"} <= set(names)
    page.keyboard.press("Space")
    canvas = page.locator("#replay canvas.world")
    expect(canvas).to_have_attribute("data-frame", AT_LEAST_THREE, timeout=PATIENCE_MS)
    page.keyboard.press("Space")
    page.keyboard.press("Tab")
    before = float(page.locator("#scrub").input_value())
    page.keyboard.press("ArrowRight")
    assert float(page.locator("#scrub").input_value()) > before


def test_a_telephone_shows_all_of_it(browser: Browser, folder: Path) -> None:
    touch = {"has_touch": True, "is_mobile": True, "device_scale_factor": 2}
    report = opened(browser, folder / "report.html", PHONE, **touch)
    page = report.page
    page.locator("#episode").select_option(index=2)
    page.locator("#scrub").fill("1")
    width = page.evaluate(
        "[document.documentElement.scrollWidth, document.body.scrollWidth, window.innerWidth]"
    )
    assert width == [PHONE[0]] * 3
    # What is wider scrolls within itself; nothing else sticks out.
    out = page.evaluate(
        """() => [...document.querySelectorAll('main *, header *')].filter((node) => {
            if (node.closest('.scroll, nav, svg')) return false;
            const { left, right, width } = node.getBoundingClientRect();
            return width > 0 && (right > innerWidth + 1 || left < -1);
        }).map((node) => node.outerHTML.slice(0, 100))"""
    )
    assert out == []
    small = page.evaluate(
        """() => [...document.querySelectorAll('body *')].filter((node) => node.checkVisibility()
            && [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim())
            && parseFloat(getComputedStyle(node).fontSize) < 11).map((node) => node.outerHTML.slice(0, 100))"""
    )
    assert small == []
    assert page.locator("#replay canvas.world").evaluate("c => c.clientWidth") >= 300
    targets = page.locator("#replay button, #replay select").evaluate_all(
        "all => all.filter(n => n.checkVisibility()).map(n => n.getBoundingClientRect().height)"
    )
    assert min(targets) >= 36
    require_quiet(report)
    page.close()


def test_figures_for_papers_are_beside_it(folder: Path) -> None:
    names = {path.name for path in (folder / "figures").iterdir()}
    assert {
        f"{name}.{kind}" for name in ("training", "routes-evaluation") for kind in ("png", "pdf")
    } <= names
    for path in (folder / "figures").glob("*.pdf"):
        content = path.read_bytes()
        assert content.startswith(b"%PDF")
        assert b"/Type3" not in content


def test_a_comparison_with_its_intervals_and_solved_tasks(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    out = tmp_path_factory.mktemp("comparison") / "out"
    sizes = (
        *(
            "--steps",
            1024,
            "--demonstration-steps",
            512,
            "--task-pool",
            4,
            "--num-envs",
            16,
            "--start-steps",
            256,
        ),
        *(
            "--pretrain-updates",
            8,
            "--td3.widths",
            8,
            8,
            "--log-interval-steps",
            512,
            "--eval-interval-steps",
            512,
        ),
        *("--validation-episodes", 2, "--episodes", 4),
    )
    assert run_cli("compare", "--methods", "bc", "--seeds", 1, *sizes, "--workers", 1, "--out", out) == 0
    assert run_cli("report", out, "--figures") == 0
    assert {path.stem for path in (out / "figures").iterdir()} >= {"training", "success"}
    report = opened(browser, out / "report.html")
    page = report.page
    assert column(page.locator("#results-table"), 0) == ["bc", "astar-dwa"]
    page.locator("#intervals").scroll_into_view_if_needed()
    page.locator("#intervals .point").nth(1).wait_for(state="attached")
    assert page.locator("#intervals .point").count() == 2
    table = page.locator("#tasks-table")
    assert table.locator("thead th").all_inner_texts() == ["Task", "All", "astar-dwa, map", "bc, goal"]
    assert len(column(table, 0)) == 4
    assert page.locator("#episode optgroup").count() == 2
    require_quiet(report)
    page.close()
