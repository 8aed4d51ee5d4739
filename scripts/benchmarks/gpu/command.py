"""`slcp gpu-check`: whether a GPU computes what a CPU does, and how fast, in one command."""

from pathlib import Path
from typing import Annotated

import typer

from ...support.options import Device
from ...support.screen import INTERRUPTED, one_line_errors, prepared, wrote
from .against import compare
from .page import write_page
from .record import Record, read, wrong
from .run import run
from .sections import SECTIONS
from .setting import chosen

DEFAULT = Path("gpu.json")


def chosen_sections(text: str | None) -> list[str]:
    """Sections by name, in their order; ValueError for one that there is not."""
    if text is None:
        return list(SECTIONS)
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        raise ValueError(f"--only is {text!r}; choose from {','.join(SECTIONS)}")
    return [name for name in SECTIONS if name in names]


@one_line_errors
def gpu_check_command(
    out: Annotated[Path, typer.Option(help="What was found (.json); a page (.md) beside it.")] = DEFAULT,
    against: Annotated[Path | None, typer.Option(help="The file of an earlier run, to compare with.")] = None,
    only: Annotated[
        str | None, typer.Option(help=f"Sections, names with commas: {', '.join(SECTIONS)}.")
    ] = None,
    device: Device = None,
    minutes: Annotated[float, typer.Option(min=0.1, help="For all sections together.")] = 9.5,
    arch: Annotated[
        int | None, typer.Option(help="Compile kernels for GPUs of a kind elsewhere, too: 90 for sm_90.")
    ] = None,
    apart: Annotated[bool, typer.Option(help="Every section in a process of its own.")] = True,
) -> None:
    """Check a GPU against the CPU and the equations, then measure it; in less than ten minutes.

    Every section runs in a process of its own, and what it finds is in the file at once: one that fails,
    crashes or hangs does not stop the others. The exit status is 1 where anything is wrong, 2 without a GPU.
    """
    names = chosen_sections(only)
    before = None if against is None else read(against)
    setting = chosen(device, arch)
    path = prepared(out, ".json")
    record = Record(path, setting.device, names)
    compared = None
    try:
        run(record, setting, names, 60.0 * minutes, typer.echo, apart)
    except KeyboardInterrupt:
        typer.echo(f"slcp: interrupted; what was found until then is in {path}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        if before is not None:
            compared = compare(record.content, before)
            record.content["against"] = compared
            record.write()
        write_page(path.with_suffix(".md"), record.content, compared)
    wrote(path)
    wrote(path.with_suffix(".md"))
    bad = wrong(record.content)
    for text in bad:
        typer.echo(f"wrong: {text}")
    for row in (compared or {}).get("newly wrong", []):
        typer.echo(f"newly wrong: {row['section']}: {row['case']}")
    if bad:
        raise typer.Exit(1)
