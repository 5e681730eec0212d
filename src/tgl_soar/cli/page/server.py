"""The page, its files and its socket, beside the link to the module; all in one event loop.

    GET /            the page; its files below /static, nothing from anywhere else
    GET /scene       the place and what numbers mean
    GET /recording   a log in the place of a flight
    WS  /live        frames out (`broadcast`), requests in (`browser_requests`)

The page itself is public; the three others want the token.  A browser's page from another origin is
refused, whatever token it has, and so is a name for this computer that is not its own: a stranger's
name that leads here would make a stranger's page ours.
"""

from __future__ import annotations

import asyncio
import ipaddress
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from starlette.applications import Starlette
from starlette.requests import HTTPConnection
from starlette.requests import Request as HttpRequest
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from tgl_soar.cli.page.browser_requests import ClientAllowance, Hello, Refused, is_token, request_of
from tgl_soar.cli.page.desk import Desk

STATIC: Final = Path(__file__).parent / "static"
HELLO_S: Final = 5.0  # for the first request of a connection
CLOSED_REFUSED: Final = 1008  # WebSocket: policy violation
MOST_VIEWERS: Final = 32
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self';"
    " img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none';"
    " frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


class Access(NamedTuple):
    """Who may open the page."""

    token: str
    host: str  # that it is served at, as it was named


def is_own_name(header: str, host: str) -> bool:
    """Whether a Host header names this computer: by an address, or by the name it is served at."""
    name = header.rsplit(":", 1)[0] if not header.endswith("]") else header
    name = name.removeprefix("[").removesuffix("]").lower()
    if name in ("localhost", host.lower()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_own_page(connection: HTTPConnection) -> bool:
    """Whether a request comes from our own page; a program that is no browser names no origin."""
    origin = connection.headers.get("origin")
    return origin is None or origin == f"http://{connection.headers.get('host', '')}"


class _Guarded:
    """Refuses strangers' names and pages before anything is served, and adds `HEADERS`."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        known = is_own_name(connection.headers.get("host", ""), self._access.host)
        if not (known and is_own_page(connection)):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": CLOSED_REFUSED})
                return
            await PlainTextResponse("not from here\n", 403)(scope, receive, send)
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                own = [(k.lower().encode(), v.encode()) for k, v in HEADERS.items()]
                message["headers"] = [*message["headers"], *own]
            await send(message)

        await self._app(scope, receive, with_headers)


def app_of(desk: Desk, access: Access) -> ASGIApp:
    """The application; it works the desk as long as it runs."""

    def allowed(request: HttpRequest) -> bool:
        given = request.headers.get("authorization", "").removeprefix("Bearer ")
        return is_token(given, access.token)

    async def page(_request: HttpRequest) -> Response:
        return FileResponse(STATIC / "index.html")

    async def scene(request: HttpRequest) -> Response:
        if not allowed(request):
            return PlainTextResponse("wrong token: open the address that was printed\n", 403)
        return Response(desk.scene, media_type="application/json")

    async def recording(request: HttpRequest) -> Response:
        if not allowed(request):
            return PlainTextResponse("wrong token: open the address that was printed\n", 403)
        if desk.recording is None:
            return PlainTextResponse("there is no recording: this is a flight\n", 404)
        return Response(desk.recording, media_type="application/json")

    async def live(socket: WebSocket) -> None:
        await _live(socket, desk, access)

    @asynccontextmanager
    async def working(_app: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(desk.work())
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
            desk.close()

    routes = [
        Route("/", page),
        Route("/scene", scene),
        Route("/recording", recording),
        WebSocketRoute("/live", live),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    return _Guarded(Starlette(routes=routes, lifespan=working), access)


async def _live(socket: WebSocket, desk: Desk, access: Access) -> None:
    """One page, from its hello to its end."""
    await socket.accept()
    viewer = None
    allowance = ClientAllowance()
    try:
        first = await asyncio.wait_for(_text(socket), HELLO_S)
        hello = request_of(first, access.token)
        if not isinstance(hello, Hello):
            raise Refused("the first request is hello")
        if len(desk.pages.viewers) >= MOST_VIEWERS:
            raise Refused(f"{MOST_VIEWERS} pages are open already: close one")
        viewer = desk.pages.add(hello.name, socket.send_text)
        await socket.send_json({"you": viewer.number})
        while True:
            text = await _text(socket)
            now_s = time.monotonic()
            if not allowance.spend(now_s):
                raise Refused("too many requests: open the page again")
            desk.take(viewer, request_of(text, access.token), now_s)
    except Refused as refused:
        with suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(CLOSED_REFUSED, str(refused)[:120])
    except TimeoutError:
        with suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(CLOSED_REFUSED, "no hello came")
    except (WebSocketDisconnect, RuntimeError):
        pass
    finally:
        if viewer is not None:
            desk.leave(viewer)


async def _text(socket: WebSocket) -> str:
    """The next request.  Errors: `Refused` for bytes, WebSocketDisconnect."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1000))
    text = message.get("text")
    if not isinstance(text, str):
        raise Refused("this is no request")
    return text
