"""Given worlds as files."""

import os
from dataclasses import fields
from pathlib import Path

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...storage.archive import open_archive, write_archive
from ...storage.files import FileError, reading
from .arrays import Worlds

FORMAT, VERSION = "slcp-warp-worlds", 1
NAMES = tuple(each.name for each in fields(Worlds))


def save_worlds(worlds: Worlds, path: str | os.PathLike[str]) -> Path:
    """Write worlds to an .npz file, whole or not at all.

    Raises:
        ArgumentError: a path with another ending.
    """
    path = checks.path("path", path)
    own = checks.instance("worlds", worlds, Worlds, "slcp_warp.Worlds").numpy()
    if path.suffix != ".npz":
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .npz is needed")
    given = {name: getattr(own, name) for name in NAMES if getattr(own, name) is not None}
    write_archive(path, {"format": FORMAT, "version": VERSION}, given)
    return path


def load_worlds(path: str | os.PathLike[str]) -> Worlds:
    """The worlds of a file that `save_worlds` wrote.

    Raises:
        FileNotFoundError: no such file.
        FileError: truncated, or no worlds.
    """
    with reading(path, "worlds", FileError), open_archive(path) as archive:
        archive.check_format(FORMAT, VERSION)
        if unknown := sorted(set(archive.names) - set(NAMES)):
            raise FileError(f"it holds {unknown[0]!r:.60}; there are {', '.join(NAMES)}")
        return Worlds(**archive.read_all(("x0", *(name for name in archive.names if name != "x0"))))
