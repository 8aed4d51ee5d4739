"""The page's server: on the loopback only, for one origin, behind a token; no path comes from outside."""

import asyncio
import importlib.resources
import itertools
import json
import secrets
import threading
from http import HTTPStatus
from typing import Any

from .engine import Engine
from .messages import MOST_BYTES, parsed

try:
    from websockets.asyncio.server import Server, ServerConnection, serve
    from websockets.datastructures import Headers
    from websockets.exceptions import ConnectionClosed
    from websockets.http11 import Request, Response
except ImportError as error:
    raise ImportError("slcp watch needs the package 'websockets': pip install 'slcp-warp[watch]'") from error

HOST = "127.0.0.1"
CREDITS = 3  # pictures on their way to a page
MOST_REASON = 120  # bytes that tell a page why its socket closes
CLIENTS = 8
FILES = {
    "": ("index.html", "text/html"),
    "page.js": ("page.js", "text/javascript"),
    "page.css": ("page.css", "text/css"),
}
POLICY = (
    "default-src 'none'; img-src data:; script-src 'self'; style-src 'self'; connect-src 'self' {socket}; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class PageServer:
    """Serves an engine's page; `address` once it is `started`.

    Args:
        engine: what is shown.
        port: on the loopback; 0: any that is free.
    """

    def __init__(self, engine: Engine, port: int = 0) -> None:
        self.engine, self.port = engine, port
        self.token = secrets.token_urlsafe(16)
        self.files = {name: (_page_file(file), kind) for name, (file, kind) in FILES.items()}
        self._clients: dict[int, tuple[ServerConnection, asyncio.Event]] = {}
        self._numbers = itertools.count(1)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = threading.Event()

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    async def run(self, started: threading.Event | None = None) -> None:
        """Serve until cancelled, with the engine in a thread of its own.

        Raises:
            OSError: the port is taken.
        """
        self._loop = asyncio.get_running_loop()
        server: Server
        async with serve(
            self._client, HOST, self.port, process_request=self._answer, max_size=MOST_BYTES, compression=None
        ) as server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            thread = threading.Thread(target=self.engine.run, args=(self._stop, self._wake), daemon=True)
            thread.start()
            if started is not None:
                started.set()
            try:
                await server.serve_forever()
            finally:
                self._stop.set()
                await asyncio.get_running_loop().run_in_executor(None, thread.join)

    def _wake(self) -> None:
        """From the engine's thread: there is a new picture."""
        if self._loop is not None and not self._loop.is_closed():
            try:
                self._loop.call_soon_threadsafe(self._ring)
            except RuntimeError:  # the loop ended in between
                self._stop.set()

    def _ring(self) -> None:
        for _, bell in self._clients.values():
            bell.set()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file of the page; None lets the socket's handshake go on."""
        hosts = request.headers.get_all("Host")
        if hosts not in ([f"{HOST}:{self.port}"], [f"localhost:{self.port}"]):
            return _response(HTTPStatus.MISDIRECTED_REQUEST, "another host")
        token, slash, name = request.path.lstrip("/").partition("/")
        if not slash or not secrets.compare_digest(token.encode(), self.token.encode()):
            return _response(HTTPStatus.NOT_FOUND, "not found")
        if name == "socket":
            origins = request.headers.get_all("Origin")
            if origins not in ([f"http://{HOST}:{self.port}"], [f"http://localhost:{self.port}"]):
                return _response(HTTPStatus.FORBIDDEN, "another origin")
            if len(self._clients) >= CLIENTS:
                return _response(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages")
            return None
        if name not in self.files:
            return _response(HTTPStatus.NOT_FOUND, "not found")
        body, kind = self.files[name]
        return _response(HTTPStatus.OK, body, kind, f"ws://{hosts[0]}")

    async def _client(self, connection: ServerConnection) -> None:
        """One page, until it goes."""
        number, bell = next(self._numbers), asyncio.Event()
        self._clients[number] = connection, bell
        credit = asyncio.Semaphore(CREDITS)
        try:
            await connection.send(json.dumps(self.engine.hello()))
            sending = asyncio.create_task(self._send(connection, bell, credit))
            try:
                async for text in connection:
                    await self._receive(connection, number, text, credit)
            finally:
                sending.cancel()
        except ConnectionClosed:
            pass
        finally:
            del self._clients[number]
            self.engine.send(number, {"do": "release"})  # a lost page holds nothing

    async def _receive(
        self, connection: ServerConnection, number: int, text: str | bytes, credit: asyncio.Semaphore
    ) -> None:
        try:
            message = parsed(text)
        except ValueError as error:
            reason = str(error).encode(errors="replace")[:MOST_REASON].decode(errors="ignore")
            await connection.close(1008, reason)
            return
        if message["do"] == "got":
            if credit._value < CREDITS:
                credit.release()
        else:
            self.engine.send(number, message)

    async def _send(
        self, connection: ServerConnection, bell: asyncio.Event, credit: asyncio.Semaphore
    ) -> None:
        """The newest picture, as often as the page takes one."""
        shown = -1
        while True:
            await bell.wait()
            bell.clear()
            await credit.acquire()
            picture: dict[str, Any] = self.engine.latest()
            if picture["frame"] == shown:
                credit.release()
                continue
            shown = picture["frame"]
            try:
                await connection.send(json.dumps(picture, separators=(",", ":")))
            except ConnectionClosed:
                return


def _page_file(name: str) -> bytes:
    return importlib.resources.files(__package__).joinpath("page", name).read_bytes()


def _response(status: HTTPStatus, body: bytes | str, kind: str = "text/plain", socket: str = "") -> Response:
    content = body.encode() if isinstance(body, str) else body
    headers = Headers(
        {
            "Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content)),
            "Connection": "close",
            "Content-Security-Policy": POLICY.format(socket=socket), "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
        }
    )  # fmt: skip
    return Response(status.value, status.phrase, headers, content)
