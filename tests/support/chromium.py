"""A headless Chromium, spoken to by its DevTools protocol; no test framework of browsers is needed."""

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
EXECUTABLE = next((found for name in NAMES if (found := shutil.which(name))), None)
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run",
         "--remote-allow-origins=*", "--window-size=1100,700")  # fmt: skip


class Page:
    """A page that is open; `errors` are those of its console and its scripts."""

    def __init__(self, address: str) -> None:
        assert EXECUTABLE is not None
        self._open = contextlib.ExitStack()
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        folder = Path(self._folder.name)
        self._process = subprocess.Popen(
            [EXECUTABLE, *FLAGS, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        deadline = time.monotonic() + 60
        while not (port := folder / "DevToolsActivePort").exists() or not port.read_text().strip():
            assert time.monotonic() < deadline and self._process.poll() is None, "Chromium did not start"
            time.sleep(0.05)
        number = port.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{number}/json/list", timeout=20) as answer:
            target = next(t for t in json.load(answer) if t["type"] == "page")
        opened = connect(target["webSocketDebuggerUrl"], max_size=2**26, open_timeout=20)
        self._socket = self._open.enter_context(opened)
        self._numbers, self.errors = itertools.count(1), []
        for domain in ("Runtime", "Log", "Page"):
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=address)

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """A command, and its answer."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv(timeout=30))
            self._note(message)
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]

    def _note(self, message: dict[str, Any]) -> None:
        params = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(params["exceptionDetails"])[:300])
        elif message.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])

    def value(self, expression: str) -> Any:
        """What a script's expression is."""
        return self.ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait(self, expression: str, seconds: float = 30.0) -> Any:
        """The value of an expression once it is true."""
        deadline = time.monotonic() + seconds
        while not (found := self.value(expression)):
            assert time.monotonic() < deadline, f"{expression} is {found!r}; errors: {self.errors}"
            time.sleep(0.02)
        return found

    def mouse(self, kind: str, x: float, y: float) -> None:
        """The left button "Pressed" or "Released", or the mouse "Moved", at a point of the window."""
        button = {"button": "left", "buttons": int(kind != "Released"), "clickCount": int(kind != "Moved")}
        self.ask("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **button)

    def screenshot(self, path: Path) -> None:
        """A PNG of the window."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        """End the browser."""
        self._open.close()
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()
