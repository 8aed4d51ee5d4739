"""A store on disk: a manifest, and a part for every finished chunk. Which parts exist says what is left.

    manifest.json         what is computed, by what, how to make it again; written once
    parts/000000.parquet  the rows of chunk 0, with the hash of the specification and its own
    claims/, partial/     who computes which chunk now; parts that are being written
    damaged/              parts that were not what had been written: they are made again

A part is written beside the others, flushed and renamed, so that it is there whole or not at all. Processes
that share a folder claim a chunk before they compute it, with a lock of the system's that ends with the
process that holds it; where two compute the same one nevertheless, they write the same part.
"""

import functools
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..inputs import checks
from ..storage.files import FileError, replacing
from . import manifest as manifests
from . import parts
from .columns import ColumnHash, checked
from .job import Columns, Job, sha256_of
from .manifest import Manifest
from .origin import processor

FOLDERS = ("parts", "claims", "partial")
SUFFIX = ".parquet"


class Store:
    """The folder of a job.

    Attributes:
        folder: where it is.
        manifest: what it holds.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        """An existing store, to be read or gone on with.

        Raises:
            FileNotFoundError: there is none.
            FileError: its manifest is damaged or of something else.
        """
        self.folder = checks.path("folder", folder)
        self.manifest: Manifest = manifests.read(self.folder)

    @classmethod
    def open(cls, folder: str | os.PathLike[str], job: Job) -> "Store":
        """The store of a job: a new one where there is none, else the one there is, if it is of this job.

        Raises:
            FileError: it is of another job (the message says what differs), of other versions, or damaged; or
                the folder cannot be made or written.
            ImportError: pyarrow is not installed; it names the extra.
        """
        parts.arrow()  # before a folder is made that nothing can be written to
        path = checks.path("folder", folder)
        with saying(path):
            for name in FOLDERS:
                (path / name).mkdir(parents=True, exist_ok=True)
            with locked(path / "claims" / "manifest.lock"):
                if not (path / manifests.NAME).exists():
                    if found := sorted((path / "parts").glob("*" + SUFFIX)):
                        raise FileError(
                            f"{path} has {len(found)} parts but no manifest; choose another folder"
                        )
                    manifests.write(path, manifests.manifest_of(job))
        store = cls(path)
        try:
            store.manifest.check(job)
        except FileError as error:
            raise FileError(f"{path}: {error}") from None
        return store

    @property
    def count(self) -> int | None:
        """Chunks of the job, None where it does not know."""
        return self.manifest.count

    def part(self, index: int) -> Path:
        """Where the part of a chunk is, or will be."""
        return self.folder / "parts" / f"{index:06d}{SUFFIX}"

    def finished(self) -> list[int]:
        """The chunks whose parts are there, in order; whether they are whole, `damaged` says."""
        try:
            names = os.listdir(self.folder / "parts")
        except OSError as error:
            raise self._lost(error) from error
        stems = [name.removesuffix(SUFFIX) for name in names if name.endswith(SUFFIX)]
        numbers = sorted(int(stem) for stem in stems if stem.isdecimal() and stem == f"{int(stem):06d}")
        return [index for index in numbers if self.count is None or index < self.count]

    def missing(self) -> list[int]:
        """The chunks that are left to do, in order. Raises FileError where the count is not known."""
        if self.count is None:
            raise FileError(f"{self.folder}: how many chunks a {self.manifest.kind} has shows as it goes on")
        there = set(self.finished())
        return [index for index in range(self.count) if index not in there]

    def set_damaged_aside(self) -> list[int]:
        """Read every part; those that are not what was written go to `damaged/`. The chunks they were of."""
        found = []
        for index in self.finished():
            try:
                self._facts_and_columns(index, None)
            except FileNotFoundError:  # by another process, meanwhile
                continue
            except FileError:
                with saying(self.folder), suppress(FileNotFoundError):  # another process was first
                    aside = self.folder / "damaged"
                    aside.mkdir(exist_ok=True)
                    self.part(index).replace(aside / self.part(index).name)
                    found.append(index)
        return found

    def write(self, index: int, columns: Columns, tally: dict[str, int] | None = None) -> None:
        """Write the part of a chunk: there, and on the disk, once this returns.

        Raises:
            FileError: the disk is full, or the folder cannot be written or is gone. Finished parts are safe.
        """
        label = f"chunk {index} of {self.manifest.kind}"
        facts = self._own(index) | {"program": self.manifest.program, "processor": processor(),
                                    "tally": tally or {}}  # fmt: skip
        data = parts.encode(checked(columns, label), facts)
        self._check_there()
        with saying(self.folder), replacing(self.part(index), self.folder / "partial") as file:
            file.write_bytes(data)

    def table(self, index: int, columns: Collection[str] | None = None) -> Columns:
        """The rows of a chunk, all columns or those named.

        Raises:
            FileNotFoundError: it is not there yet.
            FileError: damaged, or of another job.
        """
        return self._facts_and_columns(index, columns)[1]

    def names(self, index: int) -> tuple[str, ...]:
        """The columns of a finished chunk."""
        return parts.names_of(self.part(index))

    def tally(self, index: int) -> dict[str, int]:
        """Counts of a finished chunk (`Job.tally`), without reading its rows."""
        found = self._checked(index, parts.facts_of(self.part(index))).get("tally")
        return {} if not isinstance(found, dict) else {str(k): int(v) for k, v in found.items()}

    def _facts_and_columns(
        self, index: int, columns: Collection[str] | None
    ) -> tuple[dict[str, Any], Columns]:
        facts, found = parts.read(self.part(index), columns)
        return self._checked(index, facts), found

    def _checked(self, index: int, facts: dict[str, Any]) -> dict[str, Any]:
        own = self._own(index)
        if {name: facts.get(name) for name in own} != own:
            raise FileError(f"{self.part(index)} is of another job or chunk, or of one cut otherwise")
        return facts

    def _own(self, index: int) -> dict[str, Any]:
        """What a part says of itself that no part of another store does, nor of another chunk."""
        return {"specification": self.manifest.sha256, "layout": self._layout, "index": index}

    @functools.cached_property
    def _layout(self) -> str:
        return sha256_of(self.manifest.layout)

    def digest(self) -> str:
        """SHA-256 of the table: names, types and bytes of all columns in the order of the rows.

        It does not depend on how the rows were cut into chunks, on who computed them, and in which order.

        Raises:
            FileError: chunks are missing or damaged.
        """
        if self.count is not None and (missing := self.missing()):
            raise FileError(f"{self.folder}: {len(missing)} of {self.count} chunks are missing")
        hashes: dict[str, ColumnHash] = {}
        for index in self.finished():
            table = self.table(index)
            hashes = hashes or {name: ColumnHash(column) for name, column in table.items()}
            if {n: h.form for n, h in hashes.items()} != {n: ColumnHash(c).form for n, c in table.items()}:
                raise FileError(f"{self.part(index)} has other columns than the parts before it")
            for name, column in table.items():
                hashes[name].feed(column)
        return sha256_of([[name, column.hexdigest()] for name, column in hashes.items()])

    def processors(self) -> set[str]:
        """The models of processors that computed the parts: on another one the last bits may differ."""
        return {str(parts.facts_of(self.part(index)).get("processor")) for index in self.finished()}

    def dataset(self) -> Any:
        """The finished parts as a `pyarrow.dataset`, nothing read yet.

        Raises:
            FileError: the first part is damaged.
        """
        parts.arrow()
        import pyarrow.dataset

        files = [str(self.part(i)) for i in self.finished()]
        try:
            return pyarrow.dataset.dataset(files, format="parquet")
        except (pyarrow.ArrowInvalid, OSError) as error:
            raise FileError(f"{self.folder}: a part cannot be read: {error}") from error

    @contextmanager
    def claim(self, index: int) -> Iterator[bool]:
        """Whether this process may compute a chunk now: nobody else does, and its part is not there."""
        path = self.folder / "claims" / f"{index:06d}.lock"
        self._check_there()  # a lock would make its folder anew
        with locked(path, wait=False) as mine:
            yield mine and not self.part(index).exists()
            if mine and self.part(index).exists():
                with suppress(OSError):  # the part says from now on that it is done
                    path.unlink()

    def clear(self) -> None:
        """Remove what dead processes left half-written."""
        for path in (self.folder / "partial").glob("*"):
            stem = path.name.lstrip(".").split(".")[0]
            if stem.isdigit():
                lock = self.folder / "claims" / f"{stem}.lock"
                with suppress(OSError, FileError), locked(lock, wait=False) as mine:
                    if mine:
                        path.unlink()
                        lock.unlink()

    def _check_there(self) -> None:
        if not (self.folder / manifests.NAME).exists():
            raise self._lost(None)

    def _lost(self, error: OSError | None) -> FileError:
        why = "its manifest is gone" if error is None else (error.strerror or str(error))
        return FileError(f"{self.folder} is lost ({why}); what was computed since cannot be kept")


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[bool]:
    """Hold a lock of the system's, which ends with this process; whether it could be had."""
    try:
        import filelock
    except ImportError as error:
        raise ImportError(parts.NEEDS) from error
    lock = filelock.FileLock(path, thread_local=False)
    try:
        with saying(path.parents[1]):
            lock.acquire(timeout=-1 if wait else 0)
    except filelock.Timeout:
        yield False
        return
    except NotImplementedError:  # a disk without locks: two processes may do the same work, and no harm
        yield True
        return
    try:
        yield True
    finally:
        lock.release()


@contextmanager
def saying(folder: Path) -> Iterator[None]:
    """Turn an error of the system into one line that says what is safe, where there is something."""
    try:
        yield
    except (FileError, TimeoutError):
        raise
    except OSError as error:
        said = error.strerror or str(error)
        file = f" ({error.filename})" if error.filename else ""
        advice = "a folder that can be made and written is needed"
        if (folder / "parts").is_dir():
            advice = "the finished parts are safe, and the same call goes on from them"
        raise FileError(f"{folder}: {said}{file}; {advice}") from error
