"""What the commands say: errors as one line, progress bars, tables, what was written."""

import errno
import functools
import itertools
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
import warp as wp
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from slcp_warp.inputs.errors import InputError
from slcp_warp.kernels.device.progress import compiling

WIDE = 160  # characters of a line where nobody sees a terminal
console = Console()
if not console.is_terminal and "COLUMNS" not in os.environ:
    console = Console(width=WIDE)
beside = Console(stderr=True)  # what is of the moment only
TELL_AT = (5.0, 15.0, 30.0)  # of a run without a terminal [s]
BAD_INPUT = 2  # exit code
INTERRUPTED = 130


def one_line_errors(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose bad input ends it with one line and exit code 2, and Ctrl-C with exit code 130."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        wp.config.log_level = wp.LOG_WARNING
        try:
            with warnings_in_a_line():
                command(*args, **kwargs)
        except KeyboardInterrupt:
            typer.echo("slcp: interrupted; nothing was saved", err=True)
            raise typer.Exit(INTERRUPTED) from None
        except MemoryError as error:
            typer.echo(f"slcp: this needs more memory than there is ({one_line(error)})", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except BrokenPipeError:  # who reads what is printed has seen enough; Python closes what is left
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        except (ValueError, InputError, OSError, ImportError) as error:  # ImportError: an extra is missing
            typer.echo(f"slcp: {one_line(error)}", err=True)
            raise typer.Exit(BAD_INPUT) from None

    return run


@contextmanager
def warnings_in_a_line() -> Iterator[None]:
    """RuntimeWarnings as lines of their own, without the place in the code that they come from."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, RuntimeWarning):
                typer.echo(f"slcp: {one_line(message)}", err=True)
            else:
                usual(message, category, *where, **more)

        warnings.showwarning = show
        yield


def one_line(error: Exception) -> str:
    """An error's message in one line; of an error of the system the file first, without its number."""
    text = str(error)
    if isinstance(error, OSError) and error.filename and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    return " ".join(text.split())


class Bar:
    """How far a command is: called with (done, total); `say` puts a text behind it."""

    def __init__(self, show: Callable[[int, int, str], None]) -> None:
        self._show, self._done, self._more = show, (0, 0), ""

    def __call__(self, done: int, total: int) -> None:
        """So many of so many are done."""
        self._done = done, total
        self._show(*self._done, self._more)

    def say(self, text: str) -> None:
        """What is known beside it."""
        self._more = f"; {text}" if text else ""
        self._show(*self._done, self._more)


@contextmanager
def progress_bar(what: str) -> Iterator[Bar]:
    """A progress bar on a terminal, lines now and then elsewhere."""
    if not beside.is_terminal:
        with _lines(f"0 {what}") as tell:
            yield Bar(lambda done, total, more: tell(_of(done, total, what) + more))
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=beside, transient=True) as progress:
        task = progress.add_task(what, total=None)

        def update(done: int, total: int, more: str) -> None:
            progress.update(task, completed=done, total=total or None, description=f"{what}{more}")

        yield Bar(update)


def _of(done: int, total: int, what: str) -> str:
    return f"{done:,} of {total:,} {what}" if total else f"{done:,} {what}"


@contextmanager
def waiting(what: str) -> Iterator[Callable[[str], None]]:
    """A spinner on a terminal, lines now and then elsewhere; yields a callback for another text."""
    if not beside.is_terminal:
        with _lines(what) as tell:
            yield tell
        return
    with beside.status(what) as shown:
        yield shown.update


@contextmanager
def _lines(what: str) -> Iterator[Callable[[str], None]]:
    """The latest text and the time so far as lines on stderr, at `TELL_AT` and every minute."""
    texts, over, start = [what], threading.Event(), time.monotonic()

    def tell() -> None:
        for at in itertools.chain(TELL_AT, itertools.count(60.0, 60.0)):
            if over.wait(max(0.0, start + at - time.monotonic())):
                return
            if not compiling():
                typer.echo(f"slcp: {texts[-1]}, {at:g} s", err=True)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield lambda text: texts.__setitem__(-1, text)
    finally:
        over.set()
        teller.join()


@contextmanager
def timed(what: str, times: dict[str, float] | None = None) -> Iterator[None]:
    """Print how long a stage took, and keep it in `times`."""
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    if times is not None:
        times[what] = seconds
    console.print(f"[dim]{what}: {seconds:.1f} s[/dim]")


def span(seconds: float) -> str:
    """A time in words: "40 s", "12 min", "1.5 h"."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def show_rows(title: str, rows: list[dict[str, Any]]) -> None:
    """Print rows with the same columns as a table."""
    table = Table(title=title, title_justify="left")
    for name in rows[0]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()))
    console.print(table)


def prepared(path: Path, suffix: str | tuple[str, ...] = ".npz", option: str = "--out") -> Path:
    """An output file's path with its folder made, before anything is computed.

    Raises:
        ValueError: another suffix (than one of several), or something else than a file is there.
        OSError: nothing can be written there.
    """
    known = (suffix,) if isinstance(suffix, str) else suffix
    if path.suffix not in known:
        raise ValueError(f"{option} is {path}; a name that ends in {' or '.join(known)} is needed")
    if path.exists() and not path.is_file():
        raise ValueError(f"{option} is {path}, which is no file; another name is needed")
    path.parent.mkdir(parents=True, exist_ok=True)
    _check_writable(path.parent)
    return path


def checked_folder(path: Path, option: str = "--out") -> Path:
    """An output folder's path, before anything is computed; a name with an ending is a file's.

    Raises:
        ValueError: a file's name, or a file is there.
        OSError: nothing can be written there.
    """
    if not path.is_dir() and (path.suffix or path.exists()):
        raise ValueError(f"{option} is {path}; a folder, whose name has no ending, is needed")
    _check_writable(next(each for each in (path, *path.absolute().parents) if each.exists()))
    return path


def _check_writable(folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))


def wrote(path: Path) -> None:
    """Say what was written, and how large it is."""
    typer.echo(f"wrote {path} ({path.stat().st_size / 1e3:.0f} kB)")
