"""`slcp bench watch`: pictures a second, load, memory and delay, seen by a page's socket."""

import contextlib
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...support.screen import show_rows

GRAB = {"do": "grab", "world": 0}
EVERY = 1.0 / 60.0  # s between two moves of the mouse


@contextlib.contextmanager
def served(task: str, policy: str | None) -> Iterator[tuple[str, Any]]:
    """The address of a page that a process of its own serves, and that process."""
    import psutil

    command = [sys.executable, "-m", "slcp_warp.scripts.main", "watch", task, "--no-browser"]
    command += [] if policy is None else ["--policy", policy]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        said = (re.search(r"http://\S+/", line) for line in process.stdout)
        found = next((match[0] for match in said if match), None)
        if found is None:
            raise ValueError(f"slcp watch {task} ended with {process.wait()}")
        yield found, psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait()


class Page:
    """A page's socket that takes every picture."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.hello = json.loads(socket.recv())
        self.picture = self.next()

    def next(self) -> dict[str, Any]:
        """The next picture, acknowledged."""
        self.picture = json.loads(self.socket.recv())
        self.send({"do": "got", "value": self.picture["frame"]})
        return self.picture

    def send(self, message: dict[str, Any]) -> None:
        """A message."""
        self.socket.send(json.dumps(message))


def phase(page: Page, process: Any, name: str, seconds: float, at: np.ndarray | None) -> dict[str, Any]:
    """What the server does for that long; `at`: a body there is dragged in circles."""
    cpu, began, count = sum(process.cpu_times()[:2]), time.perf_counter(), 0
    delays, sent, wanted = [], began, None
    if at is not None:
        page.send(GRAB | {"at": at.tolist()})
    while (now := time.perf_counter()) - began < seconds:
        if at is not None and wanted is None and now - sent >= EVERY:
            angle = 2.0 * np.pi * (now - began)
            wanted = (at + 0.3 * np.array([np.cos(angle), np.sin(angle)])).round(4)
            page.send({"do": "drag", "at": wanted.tolist()})
            sent = now
        picture = page.next()
        count += 1
        if wanted is not None and picture["pull"] and np.allclose(picture["pull"][3:5], wanted, atol=1e-4):
            delays.append(time.perf_counter() - sent)
            wanted = None
    if at is not None:
        page.send({"do": "release"})
    taken = time.perf_counter() - began
    load = (sum(process.cpu_times()[:2]) - cpu) / taken
    row = {"phase": name, "pictures a second": count / taken, "share of a core": load}
    row |= {"memory MB": process.memory_info().rss / 1e6}
    late = np.array(delays or [np.nan]) * 1e3
    return row | {"move to picture ms": float(np.median(late)), "95 %": float(np.quantile(late, 0.95))}


def growth(process: Any, page: Page, minutes: float, every: float) -> list[dict[str, Any]]:
    """Left alone for that long [min], a row each `every` minutes."""
    spans = np.minimum(every, minutes - every * np.arange(int(np.ceil(minutes / every - 1e-9))))
    return [
        phase(page, process, f"after {after:g} min", 60.0 * float(span), None)
        for span, after in zip(spans, np.cumsum(spans), strict=True)
    ]


def bench_watch(
    task: str, policy: str | None, seconds: float, minutes: float, every: float
) -> list[dict[str, Any]]:
    """Left alone, dragged, and left alone for long, beside each other."""
    from websockets.sync.client import connect
    from websockets.typing import Origin

    with served(task, policy) as (address, process):
        socket = address.replace("http", "ws") + "socket"
        with connect(socket, origin=Origin(address.rsplit("/", 2)[0])) as opened:
            page = Page(opened)
            at = np.array(page.picture["poses"][0])
            free = [k for k, shape in enumerate(page.hello["shapes"]) if shape["body"] >= 0]
            point = at[free[-1], :2]
            rows = [
                phase(page, process, "left alone", seconds, None),
                phase(page, process, "dragged", seconds, point),
                *growth(process, page, minutes, every),
            ]
    show_rows(f"slcp watch {task}", rows)
    return rows
