"""What the server lets in, what it sends, and how it ends: a real process, without a browser."""

import http.client
import json
import signal
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from adrl.errors import ConfigError
from adrl.view.server import serve
from refusals import Adrl
from view.served import PATIENCE_S, Served, served

pytestmark = [pytest.mark.realtime, pytest.mark.slow, pytest.mark.integration]


@pytest.fixture(scope="module")
def server() -> Iterator[Served]:
    with served("--scenario", "clutter", "--port", 0) as running:
        yield running


def get(server: Served, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    """Status, headers and body."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return (
            answer.status,
            {name.lower(): value for name, value in answer.getheaders()},
            answer.read().decode(),
        )
    finally:
        connection.close()


def message(line: ClientConnection) -> dict[str, Any]:
    return json.loads(line.recv(timeout=PATIENCE_S))


def frame(line: ClientConnection) -> dict[str, Any]:
    """The next frame."""
    while "lanes" not in (found := message(line)):
        pass
    return found


def hear_to_the_end(line: ClientConnection) -> None:
    """Raises ConnectionClosed."""
    while True:
        line.recv(timeout=PATIENCE_S)


def test_whoever_has_the_address_gets_the_page_and_all_it_needs(server: Served) -> None:
    root = f"/{server.token}/"
    assert len(server.token) >= 16
    files = {"": "text/html", "view.css": "text/css"} | dict.fromkeys(
        ("view.js", "plotly.js"), "text/javascript"
    )
    for name, kind in files.items():
        status, headers, body = get(server, root + name)
        assert (status, headers["content-type"].split(";")[0]) == (200, kind)
        assert len(body) > 500
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe-eval" not in policy
        assert "script-src 'self';" in policy
        assert headers["referrer-policy"] == "no-referrer"
    assert "http://" not in get(server, root + "view.css")[2]


@pytest.mark.parametrize(
    "path", ["/", "/live", "/wrong/", "/wrong/view.js", "/wrong/live", "/docs", "/../etc/passwd"]
)
def test_nobody_else_gets_anything(server: Served, path: str) -> None:
    status, _, body = get(server, path)
    assert status == 404
    assert server.token not in body


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1.evil.example:8765"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:1"},
    ],
)
def test_other_sites_pages_are_refused(server: Served, headers: dict[str, str]) -> None:
    assert get(server, f"/{server.token}/", **headers)[0] == 403
    if "Origin" in headers:
        with pytest.raises(InvalidStatus) as refused:
            connect(server.line, additional_headers=headers, open_timeout=PATIENCE_S)
        assert refused.value.response.status_code == 403


def test_without_the_token_there_is_no_line(server: Served) -> None:
    with pytest.raises(InvalidStatus):
        connect(server.line.replace(server.token, "x" * 20), open_timeout=PATIENCE_S)


def test_it_listens_on_loopback_alone(server: Served) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as other:
        # 127.0.0.2 is this machine, too, and not where it listens.
        assert other.connect_ex(("127.0.0.2", server.port)) != 0


def test_two_lines_are_told_the_same_drive_and_what_each_asks(server: Served) -> None:
    with (
        connect(server.line, open_timeout=PATIENCE_S) as one,
        connect(server.line, open_timeout=PATIENCE_S) as two,
    ):
        assert message(one)["setup"]["choice"] == message(two)["setup"]["choice"]
        one.send(json.dumps({"do": "pace", "playing": False, "speed": 3.0}))
        for line in (one, two):
            while (found := frame(line))["playing"]:
                pass
            assert found["speed"] == 3.0
        stood = [frame(line)["lanes"][0]["time_s"] for line in (one, two)]
        assert stood[0] == stood[1]
        two.send(json.dumps({"do": "restart"}))
        two.send(json.dumps({"do": "pace", "playing": True, "speed": 1.0}))
        while frame(one)["lanes"][0]["time_s"] == stood[0]:
            pass


def test_nonsense_is_answered_in_a_line_and_harms_nobody(server: Served) -> None:
    with connect(server.line, open_timeout=PATIENCE_S) as line:
        for text in ("", "[1]", '{"do": "fly"}', b"\x00\xff"):
            line.send(text)
            while "errors" not in (found := message(line)):
                pass
            assert "\n" not in found["errors"][0]
        assert frame(line)["lanes"]
    with connect(server.line, open_timeout=PATIENCE_S) as line:
        line.send("x" * 10**6)
        with pytest.raises(ConnectionClosed):
            hear_to_the_end(line)
    assert get(server, f"/{server.token}/")[0] == 200


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_with_its_command_while_a_page_watches(number: signal.Signals) -> None:
    with served("--port", 0) as server, connect(server.line, open_timeout=PATIENCE_S) as line:
        frame(line)
        assert server.end(number) == 0
        with pytest.raises(ConnectionClosed):
            hear_to_the_end(line)
        assert "Traceback" not in server.output.read_text()
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            assert probe.connect_ex(("127.0.0.1", server.port)) != 0
        assert [path.name for path in server.output.parent.iterdir()] == ["output"]


def test_what_was_recorded_is_saved_at_the_end() -> None:
    with served("--policy", "by hand", "--port", 0) as server:
        with connect(server.line, open_timeout=PATIENCE_S) as line:
            line.send(json.dumps({"do": "record", "on": True}))
            while (found := frame(line))["record"]["steps"] < 5:
                assert "errors" not in found
                line.send(json.dumps({"do": "hand", "speed": 0.0, "turn": 0.5}))
        assert server.end() == 0
        assert server.output.read_text().splitlines()[-1].endswith("demonstrations")
        assert (server.output.parent / "demonstrations" / "data").is_dir()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--policy", "nobody"), "unknown policy"),
        (("--policy", "default", "jackal", "default"), "3 policies"),
        (("--map", "none.yaml"), "none.yaml"),
        (("--task", "-1"), "give 0 or more"),
        (("--token", "short"), "token"),
        (("--port", "1000000"), "port 1000000"),
    ],
)
def test_bad_options_are_refused_in_a_line(adrl: Adrl, arguments: tuple[str, ...], words: str) -> None:
    adrl.refuses("view", *arguments, says=(words,))


def test_a_port_that_is_taken_is_said(server: Served) -> None:
    with pytest.raises(ConfigError, match="cannot be had"):
        serve(None, port=server.port, tell=print)  # pyright: ignore[reportArgumentType]
