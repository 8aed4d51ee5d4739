"""The manifest of a store: what is computed, by what, and how to make it again."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..inputs.errors import ArgumentError
from ..storage.files import FileError, parse_json, read_text, reading, replacing
from .job import Job, Plain, differences, plain, sha256_of
from .origin import COMPARED, program, surroundings

NAME, FORMAT, VERSION = "manifest.json", "slcp-warp-run", 1
SHOWN = 6  # differences in a message


@dataclass(frozen=True)
class Manifest:
    """What a store holds the parts of; written once and never changed.

    Attributes:
        kind: of the job.
        specification: of the job; `sha256` is the hash of its canonical form.
        count: chunks, None where the job does not know.
        layout: how rows are cut into chunks.
        reference: from which `job.rebuild` makes the job; None where it cannot travel, and `bound` says why.
        program: versions that computed, and the digest of the sources.
        device: kind of device.
        provenance: how to make it again.
    """

    kind: str
    specification: Plain
    sha256: str
    count: int | None
    layout: Plain
    reference: Plain | None
    bound: str
    program: dict[str, str]
    device: str
    provenance: Plain

    def check(self, job: Job) -> None:
        """Raise FileError, without the folder, unless a job computes the same in the same chunks."""
        if self.kind != job.kind:
            raise FileError(f"it holds a {self.kind}, not a {job.kind}")
        specification = plain(job.specification(), "specification")
        if sha256_of(specification) != self.sha256:
            lines = differences(self.specification, specification)
            raise FileError(f"it holds another {self.kind}: {_some(lines)}; choose another folder")
        if lines := differences(self.layout, plain(job.layout(), "layout")):
            raise FileError(f"it is cut otherwise: {_some(lines)}; go on as it is cut")
        self.check_program(job.device)

    def check_program(self, device: str | None = None) -> None:
        """Raise FileError, without the folder, unless this program's parts may stand beside those there."""
        here, there = program(), {name: self.program.get(name) for name in COMPARED}
        lines = differences(there, here)
        if device is not None and device != self.device:
            lines += differences({"device": self.device}, {"device": device})
        if lines:
            raise FileError(
                f"its parts are of another program or kind of device: {_some(lines)}; "
                "their bits may differ: go on with what it was begun with, or choose another folder"
            )


def _some(lines: list[str]) -> str:
    rest = len(lines) - SHOWN
    return "; ".join(lines[:SHOWN]) + (f"; and {rest} more" if rest > 0 else "")


def manifest_of(job: Job) -> Manifest:
    """The manifest of a job that begins here and now."""
    specification = plain(job.specification(), "specification")
    reference, bound = None, ""
    try:
        reference = job.reference()
    except ArgumentError as error:
        bound = str(error)
    return Manifest(
        kind=job.kind, specification=specification, sha256=sha256_of(specification), count=job.count,
        layout=plain(job.layout(), "layout"), reference=reference, bound=bound, program=program(),
        device=job.device, provenance=plain(surroundings() | job.provenance(), "provenance"),
    )  # fmt: skip


def write(folder: Path, manifest: Manifest) -> None:
    """Write a manifest, whole or not at all."""
    values = asdict(manifest)
    text = json.dumps({"format": FORMAT, "version": VERSION} | values | {"seal": sha256_of(values)}, indent=1)
    with replacing(folder / NAME) as part:
        part.write_text(text + "\n", encoding="utf-8")


def read(folder: Path) -> Manifest:
    """The manifest of a folder.

    Raises:
        FileNotFoundError: there is none.
        FileError: damaged, or of something else.
    """
    path = folder / NAME
    with reading(path, "the manifest of a run", FileError):
        values = parse_json(read_text(path))
        if not isinstance(values, dict) or values.get("format") != FORMAT:
            raise FileError(f"its format is not {FORMAT!r}")
        if values.get("version") != VERSION:
            raise FileError(f"it has version {values.get('version')!r:.20}; this program reads {VERSION}")
        return _checked(values)


def _checked(values: dict[str, Any]) -> Manifest:
    kinds: dict[str, Any] = {
        "kind": str, "specification": dict, "sha256": str, "count": int | None, "layout": dict,
        "reference": dict | None, "bound": str, "program": dict, "device": str, "provenance": dict,
    }  # fmt: skip
    for name, kind in kinds.items():
        if not isinstance(values.get(name, ...), kind) or isinstance(values[name], bool):
            raise FileError(f"{name} is {values.get(name)!r:.60}")
    if values["count"] is not None and not 0 <= values["count"] < 2**31:
        raise FileError(f"count is {values['count']}")
    if sha256_of(values["specification"]) != values["sha256"]:
        raise FileError("its specification is not what its hash is of: it was changed or damaged")
    known = {name: values[name] for name in kinds}
    if sha256_of(known) != values.get("seal"):
        raise FileError("it is not what was written (its seal differs): it was changed or damaged")
    return Manifest(**known)
