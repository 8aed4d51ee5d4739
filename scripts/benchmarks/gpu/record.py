"""What a check finds: checks, rows and notes by section; the file is whole after every one of them."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.runs.origin import program, surroundings
from slcp_warp.storage.files import FileError, parse_json, read_text, reading, write_text

FORMAT, VERSION = "slcp-gpu-check", 1
WAITING, RUNNING, DONE, FAILED, LEFT_OUT = "waiting", "running", "done", "failed", "left out"
Event = dict[str, Any]


class Found:
    """What a section says of what it finds.

    Attributes:
        send: takes an event.
    """

    def __init__(self, send: Callable[[Event], None]) -> None:
        self.send = send

    def check(self, what: str, right: bool, **figures: Any) -> None:
        """Something that must hold, with the figures that say whether it does."""
        self.send({"kind": "checks", "what": what, "right": bool(right), **plain(figures)})

    def at_most(self, what: str, found: float, most: float, **figures: Any) -> None:
        """A number that must not be larger (NaN is)."""
        self.check(what, float(found) <= most, found=float(found), at_most=most, **figures)

    def row(self, case: str, **figures: Any) -> None:
        """Figures of a case; a name that ends in `rate` is one that another run is compared by."""
        self.send({"kind": "rows", "case": case, **plain(figures)})

    def note(self, text: str) -> None:
        """A sentence."""
        self.send({"kind": "notes", "text": text})


class Record:
    """The file of a check, whole at any time.

    Attributes:
        content: as it is written.
    """

    def __init__(self, path: Path, device: str, sections: list[str]) -> None:
        self.path = path
        self.content: dict[str, Any] = {
            "format": FORMAT, "version": VERSION, "device": device, "program": program(),
            "surroundings": surroundings(), "sections": {name: _empty() for name in sections},
        }  # fmt: skip
        self.write()

    def section(self, name: str) -> dict[str, Any]:
        """What is known of a section."""
        found: dict[str, Any] = self.content["sections"][name]
        return found

    def add(self, name: str, event: Event) -> None:
        """An event of a section: a check, a row, a note, or its end."""
        event = dict(event)
        kind, section = event.pop("kind"), self.section(name)
        if kind == "notes":
            section["notes"].append(event["text"])
        elif kind == "end":
            section.update(event)
        else:
            section[kind].append(event)
        self.write()

    def write(self) -> None:
        """Replace the file."""
        write_text(self.path, json.dumps(self.content, indent=1, allow_nan=False) + "\n")


def _empty() -> dict[str, Any]:
    return {"status": WAITING, "seconds": 0.0, "checks": [], "rows": [], "notes": []}


def wrong(content: dict[str, Any]) -> list[str]:
    """What is not right: checks that failed, and sections that did."""
    out = []
    for name, section in content["sections"].items():
        out += [f"{name}: {check['what']}" for check in section["checks"] if not check["right"]]
        if section["status"] == FAILED:
            out.append(f"{name}: {section.get('error', 'it failed')}")
    return out


def read(path: Path) -> dict[str, Any]:
    """The content of an earlier run's file.

    Raises:
        FileError: no such file of a check.
        FileNotFoundError: no file.
    """
    with reading(path, "a file of `slcp gpu-check`", FileError):
        content = parse_json(read_text(path))
        if (content["format"], content["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format {FORMAT!r}, version {VERSION} are needed")
        for section in content["sections"].values():
            for part in ("checks", "rows", "notes"):
                section[part]
        found: dict[str, Any] = content
        return found


def plain(value: Any) -> Any:
    """Numbers and texts that JSON has; what is not finite as a text."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else str(float(value))
    return value if value is None or isinstance(value, str) else str(value)
