"""Bounds on MJCF, judged on its text: MuJoCo writes out what repeats before anyone can count it."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

from ...storage.files import FileError, opened, read_bytes

ELEMENTS = 10_000  # with what <replicate> repeats and <include> and <attach> bring
DEPTH = 100  # nested elements
FILES = 100  # included
MOST_ASSET = 256 * 2**20  # bytes of a file that a mesh, texture or height field names
CELLS = 2**24  # of a texture or a height field
USER = 1000  # numbers of a user's per element, and keyframes
SIZES = ("nrow", "ncol", "width", "height")
GRIDS = ("texture", "hfield")  # elements that have them; of others a width is a length
FOLDERS = ("meshdir", "texturedir", "assetdir")


def check_bounds(path: Path) -> None:
    """Raise FileError, without the file's name, for a model whose text is damaged or would grow too large."""
    scan = _Scan(path)
    scan.file(path, 1)
    scan.finish()


class _Scan:
    """What a model grows to: elements counted with how often each comes."""

    def __init__(self, path: Path) -> None:
        self.path, self.folders = path, {path.parent}
        self.total = 0
        self.seen: set[Path] = set()
        self.assets: list[str] = []
        self.attached = 0
        self.brought = 0  # elements of the largest model that can be attached

    def file(self, path: Path, times: int) -> None:
        """Count one file's elements, each of which comes so many times."""
        real = path.resolve()
        if real in self.seen:  # MuJoCo refuses a file that is included twice
            return
        self.seen.add(real)
        if len(self.seen) > FILES:
            raise FileError(f"it includes more than {FILES} files")
        _Parser(self, path, times).parse(read_bytes(path))

    def add(self, times: int) -> None:
        """Count an element."""
        self.total += times
        if self.total > ELEMENTS:
            raise FileError(f"it grows to more than {ELEMENTS} elements, with what is repeated and included")

    def places(self, name: str, beside: Path) -> Iterator[Path]:
        """Files that a name may stand for."""
        name = os.fsdecode(name.encode("iso-8859-1"))
        for folder in (*sorted(self.folders), beside.parent):
            for place in (folder / name, folder / Path(name).name):
                if place.exists():
                    yield place

    def model(self, name: str, beside: Path) -> None:
        """A model to attach: its elements come once for every <attach>."""
        before = self.total
        for place in self.places(name, beside):
            self.file(place, 1)
        self.brought = max(self.brought, self.total - before)

    def finish(self) -> None:
        """Count what is attached, and look at the files that the assets name."""
        self.add(self.attached * self.brought)
        for name in self.assets:
            for place in self.places(name, self.path):
                with opened(place, MOST_ASSET):
                    pass


class _Parser:
    """One file's elements, without building a tree."""

    def __init__(self, scan: _Scan, path: Path, times: int) -> None:
        self.scan, self.path, self.times = scan, path, [times]

    def parse(self, text: bytes) -> None:
        parser = expat.ParserCreate("iso-8859-1")  # byte by byte, as MuJoCo reads, whatever the file declares
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.StartDoctypeDeclHandler = self.doctype
        try:
            parser.Parse(text.removeprefix(b"\xef\xbb\xbf"), True)
        except expat.ExpatError as error:
            raise FileError(f"{self.path.name} is no well-formed XML: {error}") from error

    def doctype(self, name: str, system: str | None, public: str | None, own: bool) -> None:
        if own or system or public:
            raise FileError(f"{self.path.name} declares entities or a document type of its own")

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self.times) > DEPTH:
            raise FileError(f"its elements are nested more than {DEPTH} deep")
        times = count = self.times[-1]
        for part in attributes.get("count", "1").split():
            count = min(count * max(_whole(name, "count", part), 1), ELEMENTS + 1)
        self.scan.add(max(count, times))  # what repeats nothing is counted, too: it takes its time
        if name == "replicate":
            times = max(count, times)
        self.times.append(times)
        self.look(name, attributes, times)

    def end(self, name: str) -> None:
        self.times.pop()

    def look(self, name: str, attributes: dict[str, str], times: int) -> None:
        """Bound what the attributes of an element ask for."""
        scan = self.scan
        if name == "attach":
            scan.attached += times
        if name == "compiler":
            scan.folders |= {self.path.parent / attributes[key] for key in FOLDERS if key in attributes}
        cells = 1
        for key in SIZES:
            if name in GRIDS and key in attributes:
                cells *= max(_whole(name, key, attributes[key]), 1)
        if cells > CELLS:
            raise FileError(f"<{name}> has {cells} cells; at most {CELLS} are read")
        for key, value in attributes.items():
            if (
                name == "size"
                and (key.startswith("nuser") or key == "nkey")
                and _whole(name, key, value) > USER
            ):
                raise FileError(f"<{name}> has {key} {value:.20}; at most {USER} are read")
        for key, value in attributes.items():
            if not key.startswith("file") or not value:
                continue
            if name == "model":
                scan.model(value, self.path)
            elif name == "include":
                for place in scan.places(value, self.path):
                    scan.file(place, times)
            else:
                scan.assets.append(value)


def _whole(element: str, key: str, text: Any) -> int:
    try:
        return int(text[:20])
    except ValueError:
        raise FileError(f"<{element}> has {key} {text!r:.40}; a whole number is needed") from None
