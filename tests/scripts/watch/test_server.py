"""The page's server, spoken to without a browser: who is let in, what a lost page leaves behind."""

import asyncio
import contextlib
import json
import socket
import threading
import time

import pytest

websockets = pytest.importorskip("websockets", reason="the extra 'watch' is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from slcp_warp.scripts.commands.watch import watched  # noqa: E402
from slcp_warp.scripts.watch.engine import Engine  # noqa: E402
from slcp_warp.scripts.watch.server import CLIENTS, PageServer  # noqa: E402


class Running:
    """A server in a thread of its own."""

    def __init__(self, port=0):
        self.engine = Engine(watched("flicking_finger", 1, 0))
        self.server, started = PageServer(self.engine, port), threading.Event()
        self.loop = asyncio.new_event_loop()
        self.task = self.loop.create_task(self.server.run(started))
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()
        assert started.wait(30)
        self.port = self.server.port

    def _run(self):
        try:
            self.loop.run_until_complete(self.task)
        except asyncio.CancelledError:
            pass

    def close(self):
        self.loop.call_soon_threadsafe(self.task.cancel)
        self.thread.join(30)
        assert not self.thread.is_alive()

    def connect(self, **more):
        origin = more.pop("origin", f"http://127.0.0.1:{self.port}")
        token = more.pop("token", self.server.token)
        return connect(f"ws://127.0.0.1:{self.port}/{token}/socket", origin=origin, open_timeout=20, **more)

    def raw(self, request):
        """The status line and body that a request of plain text brings back."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=20) as s:
            s.sendall(request.encode())
            answer = b""
            while part := s.recv(65536):
                answer += part
        return answer.decode()

    def get(self, path, *hosts):
        lines = [f"GET {path} HTTP/1.1", *(f"Host: {h}" for h in hosts or [f"127.0.0.1:{self.port}"])]
        return self.raw("\r\n".join([*lines, "", ""]))


@pytest.fixture(scope="module")
def running():
    server = Running()
    yield server
    server.close()


def test_the_page_is_served_to_who_has_its_token(running):
    base = f"/{running.server.token}/"
    page = running.get(base)
    assert page.startswith("HTTP/1.1 200") and "<canvas" in page
    assert "default-src 'none'" in page and "frame-ancestors 'none'" in page
    assert running.get(base + "page.js").startswith("HTTP/1.1 200")
    for path in ("/", "/socket", "/wrong/", base[:-2] + "/", base + "../engine.py", base + "/etc/passwd",
                 base + "%2e%2e/engine.py", base + "engine.py"):  # fmt: skip
        assert running.get(path).startswith("HTTP/1.1 404"), path


def test_another_host_is_refused(running):
    base, own = f"/{running.server.token}/", f"127.0.0.1:{running.port}"
    for hosts in (["evil.example"], [f"evil.example:{running.port}"], [own, "evil.example"], [own, own]):
        assert " 421 " in running.get(base, *hosts).partition("\r\n")[0], hosts
    assert running.get(base, f"localhost:{running.port}").startswith("HTTP/1.1 200")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", None, "https://127.0.0.1", "http://127.0.0.1"]
)
def test_another_origin_is_refused(running, origin):
    with pytest.raises(InvalidStatus) as refused:
        running.connect(origin=origin)
    assert refused.value.response.status_code == 403


def test_a_socket_without_the_token_is_refused(running):
    with pytest.raises(InvalidStatus) as refused:
        running.connect(token="x" * 22)
    assert refused.value.response.status_code == 404


def test_pictures_come_as_fast_as_they_are_taken_and_no_faster(running):
    with running.connect() as page:
        assert json.loads(page.recv(timeout=20))["hello"] == "flicking_finger"
        frames = [json.loads(page.recv(timeout=20))["frame"] for _ in range(3)]
        assert frames == sorted(set(frames))
        with pytest.raises(TimeoutError):
            page.recv(timeout=0.3)  # three are on their way; none was acknowledged
        page.send(json.dumps({"do": "got", "value": frames[0]}))
        assert json.loads(page.recv(timeout=20))["frame"] > frames[-1]


@pytest.mark.parametrize(
    "text", ["{", '{"do": "quit"}', "x" * 5000, b"\x00\x01", '{"do": "' + 80 * "\U0001f600" + '"}']
)
def test_a_message_that_is_not_the_pages_ends_the_connection_and_no_other(running, text):
    with running.connect() as page, running.connect() as other:
        page.send(text)
        with pytest.raises(ConnectionClosed) as ended:
            for _ in range(100):
                page.recv(timeout=20)
        assert ended.value.rcvd.code in (1008, 1009)  # 1009: longer than a frame may be
        assert json.loads(other.recv(timeout=20))["hello"]
        assert "frame" in json.loads(other.recv(timeout=20))


def until(condition, seconds=20.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_lost_page_lets_go(running):
    with running.connect() as page:
        page.send(json.dumps({"do": "grab", "at": [0.2, -3.05], "world": 0}))
        until(lambda: running.engine.pull is not None)
    until(lambda: running.engine.pull is None)


def test_pages_are_counted(running):
    with contextlib.ExitStack() as pages:
        for _ in range(CLIENTS):
            pages.enter_context(running.connect())
        with pytest.raises(InvalidStatus) as refused:
            running.connect()
        assert refused.value.response.status_code == 503
    until(lambda: not running.server._clients)
    with running.connect() as page:
        assert json.loads(page.recv(timeout=20))["hello"]


def test_a_port_that_is_taken_is_an_error(running):
    with pytest.raises(OSError):
        asyncio.run(PageServer(running.engine, running.port).run())


def test_a_command_that_fails_is_said_on_the_page(running):
    engine = running.engine
    engine.send(1, {"do": "set", "name": "sigma", "value": "no number"})
    with running.connect() as page:
        json.loads(page.recv(timeout=20))
        until(lambda: "sigma" in engine.latest()["said"])
        engine.send(1, {"do": "reset"})
        until(lambda: engine.latest()["said"] == "")
