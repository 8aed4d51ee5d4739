"""How a sweep is cut into chunks, as JSON values."""

from typing import Any

from ...runs.job import Plain
from ...storage.files import FileError
from ..chunks import ARMS, Chunks, Part


def layout_of(chunks: Chunks) -> Plain:
    """The parts of a sweep, each as a list of its fields."""
    return {"parts": [list(part) for part in chunks.parts]}


def chunks_of(layout: Any) -> Chunks:
    """The chunks of a layout.

    Raises:
        FileError: it is none.
    """
    listed = layout.get("parts") if isinstance(layout, dict) else None
    parts = [_part(fields) for fields in listed] if isinstance(listed, list) else []
    if not parts:
        raise FileError("its layout names no parts of a sweep")
    return Chunks(parts)


def _part(fields: Any) -> Part:
    if not isinstance(fields, list) or len(fields) != len(Part._fields):
        raise FileError(f"its layout has the part {fields!r:.80}")
    policy, case, step_size, arm, worlds, at_once = fields
    counts = all(type(n) is int and n > 0 for n in (worlds, at_once))
    number = isinstance(step_size, int | float) and not isinstance(step_size, bool) and step_size > 0.0
    if not (isinstance(policy, str) and isinstance(case, str) and number and arm in ARMS and counts):
        raise FileError(f"its layout has the part {fields!r:.80}")
    return Part(policy, case, float(step_size), arm, worlds, at_once)
