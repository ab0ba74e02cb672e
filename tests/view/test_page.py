"""The page in a real browser: it drives, records, survives a reload, and finds its server again."""

import json
import math
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect
from websockets.sync.client import connect

from adrl.imitation import load_minari
from view.served import Served, served
from waiting import wait_until

pytestmark = [pytest.mark.realtime, pytest.mark.slow, pytest.mark.integration]

PHONE, DESK = (360, 780), (1280, 900)
PATIENCE_MS = 300_000
"""A busy machine is no failure."""
SLOW = 0.1
"""Speed of the drives: they are under way for as long as a slow page needs to look at them."""
expect.set_options(timeout=PATIENCE_MS)


@dataclass
class Tab:
    """A page, and what it said and asked for."""

    page: Page
    address: str
    messages: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    @property
    def time_s(self) -> float:
        """Of the first robot."""
        return float(self.page.locator("canvas.world").first.get_attribute("data-time") or 0.0)

    @property
    def drive(self) -> int:
        """Counts up with every new drive that the page shows."""
        return int(self.page.locator("html").get_attribute("data-drive") or -1)

    def moves_on(self) -> None:
        """Waits until time has gone on."""
        before = self.time_s
        wait_until(lambda: self.time_s > before, PATIENCE_MS / 1000)

    def is_quiet(self) -> None:
        """It asks nobody else for anything, and has no error."""
        origin = self.address.split("/")[2]
        assert [
            url for url in self.requests if url.split("/")[2] != origin and not url.startswith("data:")
        ] == []
        assert self.messages == []


def opened(browser: Browser, address: str, size: tuple[int, int] = DESK, **options: Any) -> Tab:
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, **options)
    page.set_default_timeout(PATIENCE_MS)
    tab = Tab(page, address)
    page.on("console", lambda message: tab.messages.append(message.text))
    page.on("pageerror", lambda error: tab.messages.append(str(error)))
    page.on("request", lambda request: tab.requests.append(request.url))
    page.goto(address)
    page.wait_for_selector("html[data-drive]")
    return tab


def ask(server: Served, *messages: dict[str, Any]) -> int:
    """What another page asks for. The number of the drive that the last of them begins."""
    with connect(server.line, open_timeout=PATIENCE_MS / 1000) as line:

        def drive() -> int:
            while "setup" not in (content := json.loads(line.recv(timeout=PATIENCE_MS / 1000))):
                pass
            return int(content["setup"]["version"])

        before = drive()
        for message in messages:
            line.send(json.dumps(message))
        while (now := drive()) == before:
            pass
        return now


def begin(server: Served, **choice: Any) -> int:
    """A new drive, whatever went before: task 0 of clutter with the shipped policy."""
    return ask(
        server,
        {"do": "fault", "name": "none"},
        {"do": "pace", "playing": True, "speed": SLOW},
        {"do": "choose", "policies": ["default"], "place": "clutter"} | choice,
    )


@pytest.fixture(scope="module")
def server() -> Iterator[Served]:
    with served("--scenario", "clutter", "--port", 0) as running:
        yield running


@pytest.fixture
def tab(browser: Browser, server: Served) -> Iterator[Tab]:
    """The page, at the start of task 0 with the shipped policy."""
    begin(server)
    tab = opened(browser, server.address)
    yield tab
    tab.is_quiet()
    tab.page.close()


def choose(tab: Tab, task: str = "0", **names: str) -> None:
    for name, value in names.items():
        tab.page.locator(f"#{name}").select_option(value)
    tab.page.locator("#task").fill(task)
    before = tab.drive
    tab.page.locator("#start").click()
    wait_until(lambda: tab.drive > before, PATIENCE_MS / 1000)


def picture(tab: Tab) -> str:
    return tab.page.locator("canvas.world").first.evaluate("canvas => canvas.toDataURL()")


def status(tab: Tab, name: str) -> None:
    """Waits for the first robot's status."""
    expect(tab.page.locator("canvas.world").first).to_have_attribute("data-status", name)


def test_it_drives_pauses_and_begins_anew(tab: Tab, server: Served) -> None:
    before = picture(tab)
    tab.moves_on()
    assert picture(tab) != before
    tab.page.locator("#play").click()
    expect(tab.page.locator("#play")).to_contain_text("Play")
    stood = tab.time_s
    tab.page.wait_for_timeout(500)
    assert tab.time_s == stood
    tab.page.locator("#play").click()
    tab.moves_on()
    for _ in range(3):
        tab.page.locator("#speed").press("ArrowRight")
    wait_until(lambda: truth(server, "frame")["speed"] > 1.25**2.5 * SLOW, PATIENCE_MS / 1000)
    tab.page.locator("#play").click()
    expect(tab.page.locator("#play")).to_contain_text("Play")
    tab.page.locator("#restart").click()
    expect(tab.page.locator("canvas.world")).to_have_attribute("data-time", "0")


def test_a_fault_is_seen_and_the_supervisor_says_why(tab: Tab) -> None:
    status(tab, "driving")
    button = tab.page.get_by_role("button", name="Drop the scan")
    button.click()
    status(tab, "stopped")
    expect(tab.page.locator(".status .why")).to_contain_text("scan_stale: the last scan is too old")
    expect(button).to_have_attribute("aria-pressed", "true")
    button.click()
    status(tab, "driving")


def truth(server: Served, wanted: str) -> dict[str, Any]:
    """The server's own setup or frame, by a line of the test's."""
    with connect(server.line, open_timeout=PATIENCE_MS / 1000) as line:
        while True:
            content = json.loads(line.recv(timeout=PATIENCE_MS / 1000))
            if wanted == "setup" and "setup" in content:
                return content["setup"]
            if wanted == "frame" and "lanes" in content:
                return content


def on_screen(tab: Tab, world: dict[str, Any], x: float, y: float) -> tuple[float, float]:
    """Where a place of the world is in the window."""
    canvas = tab.page.locator("canvas.world").first
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    assert box is not None
    x0, y0, x1, y1 = world["bounds"]
    scale = min(box["width"], box["height"]) / (1.03 * max(x1 - x0, y1 - y0))
    return (
        box["x"] + 0.5 * box["width"] + (x - 0.5 * (x0 + x1)) * scale,
        box["y"] + 0.5 * box["height"] - (y - 0.5 * (y0 + y1)) * scale,
    )


def free_place(world: dict[str, Any]) -> tuple[float, float]:
    """Far from all that stands there."""
    x0, y0, x1, y1 = world["bounds"]
    circles = np.array(world["circles"]).reshape(-1, 3)
    middles = [np.array(flat).reshape(-1, 2).mean(axis=0) for flat in world["polygons"]]
    things = np.array([*circles[:, :2], *middles])
    places = np.random.default_rng(0).uniform((x0 + 1, y0 + 1), (x1 - 1, y1 - 1), (500, 2))
    away = np.linalg.norm(places[:, None] - things[None], axis=2).min(axis=1)
    x, y = places[away.argmax()].tolist()
    return x, y


def wait_for_goal(server: Served, x: float, y: float) -> None:
    wait_until(
        lambda: math.dist(truth(server, "frame")["lanes"][0]["goal"], (x, y)) < 0.1, PATIENCE_MS / 1000
    )


def test_a_click_is_a_goal(tab: Tab, server: Served) -> None:
    world = truth(server, "setup")["world"]
    x, y = free_place(world)
    tab.page.mouse.click(*on_screen(tab, world, x, y))
    wait_for_goal(server, x, y)
    status(tab, "driving")


def test_an_obstacle_is_dragged(tab: Tab, server: Served) -> None:
    tab.page.locator("#play").click()
    world = truth(server, "setup")["world"]
    middles = np.array([np.array(flat).reshape(-1, 2).mean(axis=0) for flat in world["polygons"]])
    things = np.concatenate([middles, np.array(world["circles"]).reshape(-1, 3)[:, :2]])
    apart = np.sort(np.linalg.norm(middles[:, None] - things[None], axis=2), axis=1)[:, 1]
    chosen = int(apart.argmax())  # nothing else lies on it
    before = middles[chosen]
    after = np.array(free_place(world))
    mouse = tab.page.mouse
    mouse.move(*on_screen(tab, world, *before))
    mouse.down()
    for part in (0.3, 0.7, 1.0):
        mouse.move(*on_screen(tab, world, *(before + part * (after - before))))
        tab.page.wait_for_timeout(80)
    mouse.up()

    def moved() -> bool:
        corners = np.array(truth(server, "setup")["world"]["polygons"][chosen]).reshape(-1, 2)
        return bool(np.linalg.norm(corners.mean(axis=0) - after) < 0.1)

    wait_until(moved, PATIENCE_MS / 1000)
    tab.page.locator("#play").click()


def test_the_keyboard_alone_sets_a_goal_and_puts_a_pillar(tab: Tab, server: Served) -> None:
    page = tab.page
    page.evaluate("document.getElementById('theme').focus()")
    names = []
    while not names or names[-1] != "world":
        page.keyboard.press("Tab")
        names.append(page.evaluate("document.activeElement.id || document.activeElement.className"))
        assert len(names) < 40, names
    assert {"policy", "robot", "place-choice", "play", "speed"} <= set(names)
    before = truth(server, "frame")["lanes"][0]["goal"]
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    wait_until(lambda: truth(server, "frame")["lanes"][0]["goal"][1] < before[1] - 0.3, PATIENCE_MS / 1000)
    pillars = len(truth(server, "setup")["world"]["circles"])
    page.keyboard.press("p")
    wait_until(lambda: len(truth(server, "setup")["world"]["circles"]) == pillars + 3, PATIENCE_MS / 1000)


def test_a_person_drives_records_and_saves(tab: Tab, server: Served) -> None:
    page = tab.page
    page.get_by_role("button", name="Take the wheel").click()
    expect(page.locator("#take-wheel")).to_have_text("Let the policy drive")
    page.locator("#record").click()
    expect(page.locator("#record")).to_have_attribute("aria-pressed", "true")
    page.keyboard.down("a")
    expect(page.locator("#recorded")).to_contain_text("steps")
    page.keyboard.up("a")
    page.locator("#record").click()
    expect(page.locator("#record")).to_have_attribute("aria-pressed", "false")
    page.locator("#save").click()
    expect(page.locator("#recorded")).to_contain_text("adrl train --dataset")
    folder = server.output.parent / "demonstrations"
    assert len(load_minari(folder)) >= 1
    page.locator("#take-wheel").click()
    expect(page.locator("#take-wheel")).to_have_text("Take the wheel")


def test_a_person_walks_in_on_the_way(tab: Tab, server: Served) -> None:
    tab.page.get_by_role("button", name="Let a person come from the goal").click()
    wait_until(lambda: len(truth(server, "frame")["lanes"][0]["people"]) == 3, PATIENCE_MS / 1000)


def test_a_gamepad_drives(tab: Tab, server: Served) -> None:
    """Stick forwards: the robot drives on; let go: it stands."""
    page = tab.page
    page.evaluate(
        "() => { window.stick = [0, 0, 0, 0]; navigator.getGamepads = () => [null, { axes: window.stick }]; }"
    )
    page.locator("#take-wheel").click()
    expect(page.locator("#take-wheel")).to_have_text("Let the policy drive")

    def twist() -> list[float]:
        return truth(server, "frame")["lanes"][0]["twist"]

    page.evaluate("window.stick = [-1, 0, 0, 0]")
    wait_until(lambda: twist()[1] > 0.1, PATIENCE_MS / 1000)  # to the left
    page.evaluate("window.stick = [0, 0, 1, 0]")  # the right stick turns it, too
    wait_until(lambda: twist()[1] < -0.1, PATIENCE_MS / 1000)
    page.evaluate("window.stick = [0.05, -0.05, 0.05, 0]")  # in the dead zone
    wait_until(lambda: twist() == [0.0, 0.0], PATIENCE_MS / 1000)
    page.locator("#take-wheel").click()
    expect(page.locator("#take-wheel")).to_have_text("Take the wheel")


def test_two_policies_drive_side_by_side(tab: Tab) -> None:
    choose(tab, policy="default", second="jackal", robot="diffbot")
    tab.moves_on()
    times = tab.page.locator("canvas.world").evaluate_all("all => all.map(canvas => canvas.dataset.time)")
    assert times[0] == times[1]
    boxes = [canvas.bounding_box() for canvas in tab.page.locator("canvas.world").all()]
    assert boxes[0] is not None
    assert boxes[1] is not None
    assert abs(boxes[0]["y"] - boxes[1]["y"]) < 5


def test_a_bad_choice_is_said_on_the_page(tab: Tab) -> None:
    tab.page.locator("#place-choice").select_option("\u2026")
    tab.page.get_by_label("map, world or folder").last.fill("nowhere.yaml")
    tab.page.locator("#start").click()
    expect(tab.page.locator("#banner")).to_contain_text("nowhere.yaml")
    tab.moves_on()
    tab.page.reload()
    tab.page.wait_for_selector("html[data-drive]")
    expect(tab.page.locator("#place-choice")).to_have_value("clutter")


def chosen(tab: Tab) -> dict[str, str]:
    """What the form shows, and what the fault is."""
    names = ("policy", "second", "robot", "place-choice", "guidance", "people", "task", "fault")
    return {name: tab.page.locator(f"#{name}").input_value() for name in names}


def test_what_a_person_chooses_survives_the_server_and_a_press_of_start_takes_what_is_shown(
    tab: Tab, server: Served
) -> None:
    page = tab.page
    own = page.get_by_label("map, world or folder").last
    page.locator("#fault").select_option("scan dropped")
    page.locator("#robot").select_option("jackal")
    page.locator("#guidance").select_option("goal")
    page.locator("#people").fill("3")
    page.locator("#task").fill("7")
    page.locator("#place-choice").select_option("\u2026")
    own.fill("nowhere.yaml")
    page.locator("#fault").focus()
    before = chosen(tab)
    for news in ({"do": "restart"}, {"do": "choose", "policies": ["jackal"], "place": "hall", "task": 2}):
        there = ask(server, news)
        wait_until(lambda there=there: tab.drive >= there, PATIENCE_MS / 1000)
        followed = {"policy": "jackal"} if news["do"] == "choose" else {}
        assert chosen(tab) == before | followed
        assert own.input_value() == "nowhere.yaml"
    page.locator("#start").click()
    expect(page.locator("#banner")).to_contain_text("nowhere.yaml")
    assert chosen(tab) == before | {"policy": "jackal"}
    choose(tab, task="8", **{"place-choice": "complex"})
    choice = truth(server, "setup")["choice"]
    assert choice == {
        "policies": ["jackal"],
        "place": "complex",
        "robot": "jackal",
        "guidance": "goal",
        "people": 3,
        "task": 8,
    }
    begin(server, task=4)
    expect(page.locator("#task")).to_have_value("4")  # nothing else is chosen: the page shows what drives


def test_a_list_that_is_open_stays_as_it_is(tab: Tab, server: Served) -> None:
    policy = tab.page.locator("#policy")
    policy.focus()
    option = policy.locator("option").first.element_handle()
    there = ask(server, {"do": "choose", "policies": ["jackal"], "place": "clutter"})
    wait_until(lambda: tab.drive >= there, PATIENCE_MS / 1000)
    assert option.evaluate("option => option.isConnected")
    assert policy.input_value() == "default"
    choose(tab)
    assert truth(server, "setup")["choice"]["policies"] == ["default"]


@pytest.mark.parametrize(
    "news",
    [{"do": "restart"}, {"do": "choose", "policies": ["jackal", "default"], "place": "clutter"}],
    ids=["restart", "choose"],
)
def test_the_crosshair_survives_the_server(tab: Tab, server: Served, news: dict[str, Any]) -> None:
    canvas = tab.page.locator("canvas.world").first
    x, y = truth(server, "frame")["lanes"][0]["goal"]
    canvas.focus()
    for _ in range(6):
        tab.page.keyboard.press("ArrowDown")
    there = ask(server, news)
    wait_until(lambda: tab.drive >= there, PATIENCE_MS / 1000)
    tab.page.keyboard.press("Enter")
    wait_until(lambda: truth(server, "frame")["lanes"][0]["goal"] != [x, y], PATIENCE_MS / 1000)
    now = truth(server, "frame")["lanes"][0]["goal"]
    assert now[0] == pytest.approx(x, abs=0.1)
    assert now[1] < y - 0.5


def test_the_drive_survives_a_reload_and_two_tabs_show_the_same(
    tab: Tab, browser: Browser, server: Served
) -> None:
    choose(tab, policy="jackal", task="5", **{"place-choice": "complex"})
    tab.moves_on()
    tab.page.locator("#play").click()
    expect(tab.page.locator("#play")).to_contain_text("Play")
    time_s = tab.time_s
    tab.page.reload()
    tab.page.wait_for_selector("html[data-drive]")
    assert tab.time_s >= time_s > 0.0
    assert tab.page.locator("#policy").input_value() == "jackal"
    assert tab.page.locator("#task").input_value() == "5"
    other = opened(browser, server.address)
    assert other.time_s == tab.time_s
    other.page.locator("#play").click()
    expect(tab.page.locator("#play")).to_contain_text("Pause")
    tab.moves_on()
    other.is_quiet()
    other.page.close()


def test_a_killed_server_is_said_and_found_again(browser: Browser) -> None:
    with served("--port", 0, "--token", "testing-again") as first:
        begin(first)
        tab = opened(browser, first.address)
        tab.moves_on()
        port = first.port
        first.end(signal.SIGKILL)
        expect(tab.page.locator("#banner")).to_contain_text("does not answer")
        expect(tab.page.locator("#link")).to_have_attribute("data-state", "gone")
        stood = tab.time_s
    with served("--port", port, "--token", "testing-again") as second:
        assert second.address == tab.address
        expect(tab.page.locator("#link")).to_have_attribute("data-state", "live")
        expect(tab.page.locator("#banner")).to_be_hidden()
        wait_until(lambda: tab.time_s != stood, PATIENCE_MS / 1000)
        tab.page.close()


def brightness(page: Page) -> int:
    """Red of the page's ground, 0 to 255."""
    return int(page.evaluate("getComputedStyle(document.body).backgroundColor").split("(")[1].split(",")[0])


def test_light_and_dark(browser: Browser, server: Served) -> None:
    tab = opened(browser, server.address, color_scheme="dark")
    assert brightness(tab.page) < 50
    tab.page.locator("#theme").click()
    assert brightness(tab.page) > 200
    tab.is_quiet()
    tab.page.close()


def test_a_telephone_shows_all_of_it_and_steers(browser: Browser, server: Served) -> None:
    begin(server)
    tab = opened(browser, server.address, PHONE, has_touch=True, is_mobile=True, device_scale_factor=2)
    page = tab.page
    page.locator("#take-wheel").tap()
    expect(page.locator("#pad")).to_be_visible()
    width = page.evaluate(
        "[document.documentElement.scrollWidth, document.body.scrollWidth, window.innerWidth]"
    )
    assert width == [PHONE[0]] * 3
    small = page.evaluate(
        """() => [...document.querySelectorAll('body *')].filter((node) => node.checkVisibility()
            && [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim())
            && parseFloat(getComputedStyle(node).fontSize) < 11).map((node) => node.outerHTML.slice(0, 100))"""
    )
    assert small == []
    targets = page.locator("main button, main select, main input").evaluate_all(
        "all => all.filter(n => n.checkVisibility()).map(n => n.getBoundingClientRect().height)"
    )
    assert min(targets) >= 36
    pad = page.locator("#pad")
    pad.scroll_into_view_if_needed()
    box = pad.bounding_box()
    assert box is not None
    heading = truth(server, "frame")["lanes"][0]["pose"][2]
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.05 * box["width"], box["y"] + 0.5 * box["height"])
    wait_until(lambda: truth(server, "frame")["lanes"][0]["pose"][2] != heading, PATIENCE_MS / 1000)
    page.mouse.up()
    page.locator("#take-wheel").tap()
    tab.is_quiet()
    page.close()
