"""Files at the door: written whole or not at all, read within bounds, every failure one error with the name.

A file that is read may come from anywhere. It is a plain file of at most so many bytes, its JSON and TOML
name every key once, and whatever else goes wrong while it is read and checked (`reading`) is one error of the
caller's kind.
"""

import errno
import json
import os
import re
import stat
import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from ..inputs import checks
from ..inputs.errors import ArgumentError

MOST_TEXT = 16 * 2**20  # bytes of a text file, or of an archive's header
MOST_TOML = 4 * 2**20  # bytes of a TOML file, which is read at a megabyte a second
DEPTH = 32  # nested lists and tables of a JSON text
KEY_PARTS = 16  # of a dotted TOML key
MOST_BYTES = 8 * 2**30  # of an archive, packed and unpacked; SLCP_WARP_MOST_BYTES has another number

_KEY = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_KEY}(?:[ \t]*+\.[ \t]*+{_KEY}){{{KEY_PARTS}}}")
_JSON_TEXT = re.compile(r'"(?:[^"\\]|\\.)*+"')


class FileError(ArgumentError):
    """A file that cannot be read as what it should be; the message names it and says what is wrong."""


def most_bytes() -> int:
    """How many bytes an archive may have, packed and unpacked."""
    text = os.environ.get("SLCP_WARP_MOST_BYTES", "").strip()
    if text and (not text.isdigit() or int(text) < 1):
        raise ValueError(f"SLCP_WARP_MOST_BYTES must be a whole number of at least 1, got {text!r}")
    return int(text) if text else MOST_BYTES


@contextmanager
def reading(path: str | os.PathLike[str], what: str, kind: Callable[[str], ValueError]) -> Iterator[None]:
    """Turn every failure while a file is read and checked into one error `kind` that names the file.

    Args:
        what: what it is read as, "a trajectory". Errors of the block need not name the file.

    A file that is not there stays a FileNotFoundError.
    """
    checks.path("path", path)
    try:
        yield
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: no such file") from error
    except Exception as error:
        raise kind(f"{path} cannot be read as {what}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """What an error says, in one short line."""
    own = {
        MemoryError: "it needs more memory than there is",
        RecursionError: "it is nested too deeply",
        UnicodeDecodeError: "it is no text",
        PermissionError: "it may not be read",
        IsADirectoryError: "it is a directory; a file is needed",
    }
    said = next((text for kind, text in own.items() if isinstance(error, kind)), None)
    text = said or (str(error) if isinstance(error, ValueError | OSError) else f"damaged ({error!r})")
    return " ".join(text.split())[:300] or type(error).__name__


@contextmanager
def opened(path: str | os.PathLike[str], most: int = MOST_TEXT) -> Iterator[IO[bytes]]:
    """Open a plain file of at most `most` bytes. Raises FileError, without the name, and OSError."""
    if not stat.S_ISDIR(os.stat(path).st_mode) and not stat.S_ISREG(os.stat(path).st_mode):
        raise FileError("it is no plain file")
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise FileError(f"it has {size} bytes; at most {most} are read")
        yield file


def read_bytes(path: str | os.PathLike[str], most: int = MOST_TEXT) -> bytes:
    """What is in a plain file of at most `most` bytes."""
    with opened(path, most) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise FileError(f"it has more than {most} bytes")
    return data


def read_text(path: str | os.PathLike[str], most: int = MOST_TEXT) -> str:
    """The text (UTF-8) of a plain file of at most `most` bytes, after a byte order mark or not."""
    return read_bytes(path, most).decode("utf-8-sig")


def parse_json(text: str) -> Any:
    """JSON of bounded depth in which no key comes twice."""
    depth = 0
    for bracket in re.finditer(r"[\[\]{}]", _JSON_TEXT.sub("", text)):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > DEPTH:
            raise FileError(f"lists and tables are nested more than {DEPTH} deep")
    return json.loads(text, object_pairs_hook=_unique)


def parse_toml(text: str) -> Any:
    """TOML, which knows no key twice, with keys of bounded length (longer ones take hours)."""
    if _LONG_KEY.search(text):
        raise FileError(f"a key has more than {KEY_PARTS} parts")
    return tomllib.loads(text)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in pairs:
        if key in out:
            raise FileError(f"the key {key!r:.60} comes twice")
        out[key] = value
    return out


@contextmanager
def replacing(path: str | os.PathLike[str], through: str | os.PathLike[str] | None = None) -> Iterator[Path]:
    """A new file beside `path`, which takes its place once the block has written it whole.

    If the block raises or the process dies, what was at `path` stays. The parent's folder must exist.

    Args:
        through: another folder for the new file until it is whole, on the same disk.

    Raises:
        OSError: the file cannot be written (a full disk, no permission); the message names it.
    """
    path = Path(os.path.realpath(path))  # a link stays one, what it points to is replaced
    part = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{path.suffix}")
    part = part if through is None else Path(through) / part.name
    try:
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "it is no plain file")
        yield part
        if path.exists():
            part.chmod(stat.S_IMODE(path.stat().st_mode))
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        said = error.strerror or str(error)
        raise OSError(
            error.errno, f"cannot be written ({said}); what was there is unchanged", str(path)
        ) from error
    finally:
        with suppress(OSError):
            part.unlink()


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file (UTF-8), whole or not at all."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


def _sync_folder(folder: Path) -> None:
    """Make the new name last through a loss of power, where a folder can be synchronised."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    with suppress(OSError):
        os.fsync(handle)
    os.close(handle)
