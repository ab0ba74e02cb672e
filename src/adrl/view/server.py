"""The page and its live line, on loopback, for whoever has the address; nothing else is served.

A browser is held to it by its Content-Security-Policy; what another site's page could send is refused by Host, Origin
and the token in the address.
"""

import asyncio
import contextlib
import json
import secrets
import signal
import socket
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from adrl.errors import ConfigError
from adrl.report.html import SHARED, asset, plotly_script
from adrl.view.messages import Message, decode
from adrl.view.show import Show

HOST = "127.0.0.1"
PORT = 8765
TURN_S = 0.05
"""From one frame of the page to the next."""
QUEUED = 40
"""Frames that wait for a slow page; then it is told all anew."""
CLOSING_S = 1
"""Pages have so long to say good-bye."""
SCRIPTS = ("link.js", "lanes.js", "pointer.js", "hand.js", "controls.js", "training.js", "main.js")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self' {lines}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Inline styles are Plotly's."""


def serve(
    show: Show, *, port: int | None = None, token: str | None = None, tell: Callable[[str], None]
) -> None:
    """Show it until SIGINT, SIGTERM or SIGHUP. tell: is given the address.

    port: None takes PORT, or a free one where that is taken. token: None draws one. Raises ConfigError.
    """
    with _listening(port) as listener:
        taken: int = listener.getsockname()[1]
        token = secrets.token_urlsafe(16) if token is None else _checked(token)
        stage = Stage(show)
        app = _Guarded(_application(stage, token), taken)
        config = uvicorn.Config(
            app, log_level="error", lifespan="off", timeout_graceful_shutdown=CLOSING_S, ws_max_size=2**16
        )
        tell(f"http://{HOST}:{taken}/{token}/")
        asyncio.run(_run(_Server(config), listener, stage))


async def _run(server: "_Server", listener: socket.socket, stage: "Stage") -> None:
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, server.end)
    turns = asyncio.create_task(stage.run())
    turns.add_done_callback(lambda _: server.end())
    await server.serve(sockets=[listener])
    turns.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await turns  # what went wrong in it is raised here


class _Server(uvicorn.Server):
    """Ends when it is told, and leaves the signals to this program."""

    def end(self) -> None:
        self.force_exit = self.should_exit  # told twice, it waits for nobody
        self.should_exit = True

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class Stage:
    """A show and the pages that watch it."""

    def __init__(self, show: Show) -> None:
        self._show = show
        self._asked: list[Message] = []
        self._pages: set[_Page] = set()

    async def run(self) -> None:
        """Turn by turn, for as long as anybody watches; a turn runs beside the event loop."""
        while True:
            began_s = time.monotonic()
            if self._pages:
                asked, self._asked = self._asked, []
                frame = await asyncio.to_thread(self._show.turn, asked, began_s)
                self._tell(frame)
            await asyncio.sleep(max(TURN_S - (time.monotonic() - began_s), 0.005))

    def _tell(self, frame: dict[str, Any]) -> None:
        text = _json(frame)
        setup: str | None = None
        for page in self._pages:
            if page.version != self._show.version or page.frames.full():
                about = {"version": self._show.version}
                setup = setup or _json({"setup": self._show.setup() | about})
                page.begin(setup, self._show.version)
            page.frames.put_nowait(text)

    async def watch(self, socket: WebSocket) -> None:
        """A page, from its beginning to its end."""
        await socket.accept()
        page = _Page()
        self._pages.add(page)
        sending = asyncio.create_task(page.send(socket))
        try:
            while True:
                try:
                    message = decode(await socket.receive_text())
                    self._asked.append(
                        message
                    )  # to the list of now: while this waited, another took its place
                except (ConfigError, KeyError) as error:  # KeyError: bytes instead of text
                    page.say(_json({"errors": [str(error)]}))
        except WebSocketDisconnect:
            pass
        finally:
            self._pages.discard(page)
            sending.cancel()


class _Page:
    """What waits to be sent to one page."""

    def __init__(self) -> None:
        self.version = -1
        """Of the setup that it has."""
        self.frames: asyncio.Queue[str] = asyncio.Queue(QUEUED)

    def begin(self, setup: str, version: int) -> None:
        while not self.frames.empty():
            self.frames.get_nowait()
        self.frames.put_nowait(setup)
        self.version = version

    def say(self, text: str) -> None:
        if not self.frames.full():
            self.frames.put_nowait(text)

    async def send(self, socket: WebSocket) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it has gone
            while True:
                await socket.send_text(await self.frames.get())


class _Guarded:
    """Refuses what does not come from a page of this address: another Host is how a foreign site reaches loopback."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        self._policy = POLICY.format(lines=" ".join(f"ws://{host}" for host in sorted(self._hosts)))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = HTTPConnection(scope).headers
        origin = headers.get("origin")
        if headers.get("host") not in self._hosts or (
            origin is not None and origin.removeprefix("http://") not in self._hosts
        ):
            await _refuse(scope, receive, send)
            return

        async def send_guarded(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] += [(name, value.encode()) for name, value in self._headers()]
            await send(message)

        await self._app(scope, receive, send_guarded)

    def _headers(self) -> Iterator[tuple[bytes, str]]:
        yield b"content-security-policy", self._policy
        yield b"referrer-policy", "no-referrer"
        yield b"x-content-type-options", "nosniff"
        yield b"cache-control", "no-store"
        yield b"cross-origin-resource-policy", "same-origin"


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).close(1008)
    else:
        await PlainTextResponse("this page is for this machine alone\n", 403)(scope, receive, send)


def _application(stage: Stage, token: str) -> ASGIApp:
    texts = {
        "": (_page("index.html"), "text/html"),
        "view.css": (asset("style.css") + _page("view.css"), "text/css"),
        "view.js": (_program(), "text/javascript"),
    }

    async def text(request: HTTPConnection) -> Response:
        if not secrets.compare_digest(request.path_params["token"].encode(), token.encode()):
            return PlainTextResponse("no such page; open the address that adrl view printed\n", 404)
        name = request.path_params.get("name", "")
        if name == "plotly.js":
            return Response(plotly_script(), media_type="text/javascript")
        if name not in texts:
            return PlainTextResponse("no such page\n", 404)
        content, kind = texts[name]
        return Response(content, media_type=kind)

    async def live(socket: WebSocket) -> None:
        if not secrets.compare_digest(socket.path_params["token"].encode(), token.encode()):
            await socket.close(1008)
            return
        await stage.watch(socket)

    app = Starlette(
        routes=[
            Route("/{token}/", text),
            WebSocketRoute("/{token}/live", live),
            Route("/{token}/{name}", text),
        ]
    )
    app.router.redirect_slashes = False  # a wrong address is told nothing of the right one
    return app


def _program() -> str:
    parts = [*map(asset, SHARED), *map(_page, SCRIPTS)]
    return "(() => {\n'use strict';\n" + "\n".join(parts) + "\n})();\n"


def _page(name: str) -> str:
    return Path(str(resources.files("adrl.view") / "page" / name)).read_text(encoding="utf-8")


def _json(content: dict[str, Any]) -> str:
    return json.dumps(content, allow_nan=False, separators=(",", ":"))


def _checked(token: str) -> str:
    """Raises ConfigError."""
    if not (8 <= len(token) <= 100 and token.replace("-", "").replace("_", "").isalnum() and token.isascii()):
        raise ConfigError("token has 8 to 100 letters, digits, - and _; leave it out, and one is drawn")
    return token


@contextlib.contextmanager
def _listening(port: int | None) -> Iterator[socket.socket]:
    """A socket on loopback. Raises ConfigError where the port is taken."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for number in (PORT, 0) if port is None else (port,):
            try:
                listener.bind((HOST, number))
                break
            except (OSError, OverflowError) as error:
                if number == PORT and port is None:
                    continue
                raise ConfigError(f"port {number} of {HOST} cannot be had ({error}); give --port 0") from None
        listener.listen()  # whoever reads the address may come before the server is up
        yield listener
