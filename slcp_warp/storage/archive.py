"""Archives: NumPy files (.npz) of plain arrays and a JSON header; nothing is pickled.

All files of results have this form: trajectories, plans, surfaces, libraries, sweeps. What is in the zip is
judged by its directory before anything is unpacked, every array by its own header before memory is set
aside, and only the arrays that are asked for are read.
"""

import io
import json
import math
import os
import re
import struct
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import IO, Any

import numpy as np

from .files import MOST_TEXT, FileError, most_bytes, opened, parse_json, replacing

DIRECTORY = 2**20  # bytes of the list of an archive's arrays: about 10,000 of them
AXES = 8
RATIO = 1032  # the most that deflate can do
CHUNK = 2**20
_END = struct.Struct("<4s4H2LH")
_LOCAL = struct.Struct("<26xH2x")  # what stands before an array's name, and how long that is
_UTF8 = 0x800
# A header as NumPy writes it. NumPy reads it by Python's own parser, which in CPython 3.11 (gh-106905) may
# raise a SystemError of a sound file where another thread parses, too.
PLAIN = re.compile(
    rb"\{'descr': '([<>|=][a-zA-Z]\d+)', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,18}, ?)*\d{0,18})\), \} *\n?"
)


def write_archive(
    path: str | os.PathLike[str], header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write a header of JSON values and arrays, whole or not at all.

    Raises:
        FileError: a header that is no JSON.
        OSError: the file cannot be written; both name the file.
    """
    try:
        text = np.array(json.dumps(dict(header)))
    except (TypeError, ValueError, RecursionError) as error:
        raise FileError(f"{path}: its header holds what JSON cannot: {error}") from error
    with replacing(path) as part, open(part, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=text, **arrays)


@contextmanager
def open_archive(path: str | os.PathLike[str]) -> Iterator["Archive"]:
    """Open an archive and read its header; errors do not name the file (`files.reading` does).

    Raises:
        FileError: no archive, too large, or a header that is none; much else of a damaged file's.
    """
    with opened(path, most_bytes()) as file:
        _check_directory(file)
        with zipfile.ZipFile(file) as packed:
            yield Archive(packed)


class Archive:
    """An archive that is open.

    Attributes:
        header: its JSON values.
        names: of the arrays.
    """

    def __init__(self, packed: zipfile.ZipFile) -> None:
        self._packed = packed
        self._left = most_bytes()
        self._members: dict[str, zipfile.ZipInfo] = {}
        for info in packed.infolist():
            if info.filename in self._members:
                raise FileError(f"it holds {info.filename!r:.60} twice")
            _check_name(packed, info)
            self._members[info.filename] = info
        if "header.npy" not in self._members:
            raise FileError("it has no header")
        self.names = tuple(n.removesuffix(".npy") for n in self._members if n != "header.npy")
        text = self._read("header", "U", MOST_TEXT)
        if text.ndim:
            raise FileError("its header is no text")
        header = parse_json(str(text))
        if not isinstance(header, dict):
            raise FileError("its header is no table of values")
        self.header: dict[str, Any] = header

    def check_format(self, form: str, *versions: int) -> int:
        """Raise FileError unless the header names this format and one of the versions; the version."""
        if self.header.get("format") != form:
            raise FileError(f"its format is {self.header.get('format')!r:.60}; {form!r} is needed")
        version = self.header.get("version")
        if isinstance(version, bool) or version not in versions:
            known = " or ".join(map(str, versions))
            raise FileError(f"it has version {version!r:.20}; this program reads {known}")
        return int(version)

    def read(self, name: str, kinds: str = "iuf") -> np.ndarray:
        """One array. Raises FileError: missing, or of another kind (`dtype.kind`) than the given ones."""
        return self._read(name, kinds, self._left)

    def read_all(self, names: Iterator[str] | tuple[str, ...], kinds: str = "iuf") -> dict[str, np.ndarray]:
        """Several arrays, by name."""
        wanted = tuple(names)
        missing = [name for name in wanted if f"{name}.npy" not in self._members]
        if missing:
            raise FileError(f"it lacks the arrays {missing}")
        return {name: self.read(name, kinds) for name in wanted}

    def _read(self, name: str, kinds: str, most: int) -> np.ndarray:
        info = self._members.get(f"{name}.npy")
        if info is None:
            raise FileError(f"it lacks the array {name!r}")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & 1:
            raise FileError(f"array {name!r} is packed in a way that is not read")
        if info.file_size > most or info.file_size > RATIO * info.compress_size + CHUNK:
            raise FileError(f"array {name!r} unpacks to {info.file_size} bytes; {most} are left for it")
        with self._packed.open(info) as member:
            shape, fortran, dtype = _array_header(member)
            size = math.prod(shape) * dtype.itemsize
            if dtype.kind not in kinds:
                need = "a text" if kinds == "U" else "numbers"
                raise FileError(f"array {name!r} is of type {dtype}; {need} needed")
            if len(shape) > AXES or min((0, *shape)) < 0 or size != info.file_size - member.tell():
                raise FileError(f"array {name!r} has shape {shape} in {info.file_size} bytes")
            array = np.empty(math.prod(shape), dtype)
            _fill(array.view(np.uint8).data if size else memoryview(b""), member, name)
        self._left -= size
        array = array.astype(dtype.newbyteorder("="), copy=False)
        return array.reshape(shape, order="F" if fortran else "C")


def _check_name(packed: zipfile.ZipFile, info: zipfile.ZipInfo) -> None:
    """Raise FileError unless the array itself has the name that the directory gives it: one that may be
    missing would be lost by a damaged letter.
    """
    file: Any = packed.fp
    file.seek(max(info.header_offset, 0))
    local = file.read(_LOCAL.size)
    length = _LOCAL.unpack(local)[0] if len(local) == _LOCAL.size else 0
    encoding = "utf-8" if info.flag_bits & _UTF8 else "cp437"
    if file.read(length) != info.orig_filename.encode(encoding, "replace"):
        raise FileError(f"its list of arrays names {info.filename!r:.60} what has another name")


def _array_header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether columns come first, and type of a .npy file."""
    version = np.lib.format.read_magic(member)
    if version != (1, 0):  # others are for headers of more than 64 kB
        raise FileError(f"an array is of NumPy's format {version}")
    start = member.read(2)
    text = member.read(int.from_bytes(start, "little"))
    found = PLAIN.fullmatch(text)
    if found is None:  # whatever else there is, NumPy says
        return np.lib.format.read_array_header_1_0(io.BytesIO(start + text))
    descr, fortran, shape = (part.decode("latin1") for part in found.groups())
    return tuple(int(n) for n in shape.split(",") if n.strip()), fortran == "True", np.dtype(descr)


def _fill(view: memoryview, member: IO[bytes], name: str) -> None:
    """Read exactly the array's bytes; the zip's own checksum is compared at its end."""
    done = 0
    while done < len(view):
        part = member.read(min(CHUNK, len(view) - done))
        if not part:
            raise FileError(f"array {name!r} ends after {done} of {len(view)} bytes")
        view[done : done + len(part)] = part
        done += len(part)
    if member.read(1):
        raise FileError(f"array {name!r} goes on after its {len(view)} bytes")


def _check_directory(file: IO[bytes]) -> None:
    """Bound the zip's directory, which is read as a whole, by what its last record says."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - 2**16 - _END.size))
    tail = file.read()
    at = tail.rfind(b"PK\5\6")
    if at < 0 or len(tail) - at < _END.size:
        raise FileError("it is no archive, or cut off")
    length = _END.unpack_from(tail, at)[5]
    if (
        tail[at - 20 : at - 16] == b"PK\6\7"
    ):  # a file of gigabytes (zip64) has a wider record before its locator
        if at < 76 or tail[at - 76 : at - 72] != b"PK\6\6":
            raise FileError("it is no archive, or cut off")
        (length,) = struct.unpack_from("<Q", tail, at - 76 + 40)
    if length > DIRECTORY:
        raise FileError(f"it lists its arrays in {length} bytes; at most {DIRECTORY} are read")
