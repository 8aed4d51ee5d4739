"""`slcp bench kills`: sweeps whose processes are killed at random moments, and what their tables are."""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp.runs.store import Store

from ...support.screen import one_line_errors, show_rows

TASK = min(slcp.tasks.NAMED, key=lambda name: slcp.tasks.NAMED[name]().steps)  # the shortest
ROADS = {  # options of `slcp sweep`, and how many workers there are beside the process itself
    "one thread": ((), 0),
    "four processes": (("--processes", "4"), 4),
    "Dask, two workers": (("--dask", "2"), 2),
    "submitit, two jobs": (("--slurm", "2", "--slurm-option", "cluster=local"), 2),
}
PATIENCE = 600.0  # seconds without a new chunk


class Outcome(NamedTuple):
    """What came of a sweep that was killed again and again.

    Attributes:
        main, workers: how many of either were killed.
        most: chunks that a kill of the main process, or of all, left begun and not finished, the most.
        same: whether the table is that of the sweep that ran through.
    """

    main: int
    workers: int
    most: int
    same: bool


def command(folder: Path, policy: Path, worlds: int, chunk: int) -> list[str]:
    """The sweep."""
    return [
        sys.executable, "-P", "-m", "slcp_warp.scripts.main", "sweep", TASK, "--policy", str(policy),
        "--worlds", str(worlds), "--chunk-worlds", str(chunk), "--residuals", "smoothed", "--device", "cpu",
        "--out", str(folder),
    ]  # fmt: skip


def killed(given: list[str], folder: Path, kills: int, workers: int, rng: random.Random) -> Outcome:
    """Run a sweep, kill it or a worker of it at random moments, go on until it is finished but for that."""
    done = {"main": 0, "worker": 0}
    most, process = 0, None
    while sum(done.values()) < kills:
        if process is None:
            process = _started(given)
        goal = _finished(folder) + rng.randrange(1, 12)
        _wait(process, folder, goal)
        time.sleep(rng.uniform(0.0, 0.05))
        mine = _descendants(process.pid)
        victims = mine if workers and mine and rng.random() < 0.5 else [process.pid]
        if process.poll() is not None:  # finished before it was killed often enough
            break
        os.kill(rng.choice(victims), signal.SIGKILL)
        done["main" if victims == [process.pid] else "worker"] += 1
        if victims == [process.pid]:
            process.wait()
            _wait_for_end(mine)
            most, process = max(most, _begun(folder)), None
    if process is not None:
        process.wait()
    return Outcome(done["main"], done["worker"], most, False)


def _started(given: list[str]) -> subprocess.Popen:
    return subprocess.Popen(given, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _finished(folder: Path) -> int:
    return len(os.listdir(folder / "parts")) if (folder / "parts").is_dir() else 0


def _begun(folder: Path) -> int:
    """Chunks that were claimed and are not there."""
    claimed = {path.stem for path in (folder / "claims").glob("*.lock")} - {"manifest"}
    return len(claimed - {path.stem for path in (folder / "parts").glob("*.parquet")})


def _wait(process: subprocess.Popen, folder: Path, goal: int) -> None:
    last, seen = time.monotonic(), -1
    while process.poll() is None and _finished(folder) < goal:
        time.sleep(0.002)
        if _finished(folder) != seen:
            last, seen = time.monotonic(), _finished(folder)
        if time.monotonic() - last > PATIENCE:
            raise RuntimeError(f"no chunk was finished for {PATIENCE:g} s")


def _descendants(pid: int) -> list[int]:
    """Processes that compute below one: those that have loaded the package's kernels."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    found: set[int] = set()
    more = {pid}
    while more:
        more = {child for child, parent in parents.items() if parent in more} - found
        found |= more
    return sorted(child for child in found if _computes(child))


def _computes(pid: int) -> bool:
    try:
        return "warp" in Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return False


def _wait_for_end(pids: list[int]) -> None:
    """Workers end with the process that started them; jobs of a scheduler go on, and share the folder."""
    patience = time.monotonic() + 5.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids) and time.monotonic() < patience:
        time.sleep(0.02)


def _policy(folder: Path) -> Path:
    """Feedback that flicks a little: what it does is of no matter."""
    scene = slcp.load_task(TASK).scene
    gain = np.outer(np.linspace(-1.0, 1.0, scene.nu), np.linspace(-0.5, 0.5, 2 * scene.nv))
    linear = slcp.policies.Linear(gain, scene.x0, np.zeros(scene.nu), (-5.0, 5.0))
    return slcp.policies.save_policy(linear, folder / "linear.npz")


@one_line_errors
def kills_command(
    kills: Annotated[int, typer.Option(min=1, help="Of every road.")] = 10,
    worlds: Annotated[int, typer.Option(min=1, help="Of the sweep.")] = 20000,
    chunk: Annotated[int, typer.Option(min=1, help="Worlds of a chunk.")] = 20,
    seed: Annotated[int, typer.Option(help="Of the moments.")] = 0,
) -> None:
    """Kill sweeps by SIGKILL at random moments, go on, and compare their tables with an uninterrupted one.

    Half of the kills are of a worker, where there are any, the others of the process itself.
    """
    rows = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        policy = _policy(folder)
        subprocess.run(command(folder / "through", policy, worlds, 4096), check=True, capture_output=True)
        digest = Store(folder / "through").digest()
        for name, (options, workers) in ROADS.items():
            run = folder / name.replace(" ", "_").replace(",", "")
            given = [*command(run, policy, worlds, chunk), *options]
            found = killed(given, run, kills, workers, random.Random(seed))
            subprocess.run([*given[:4], "sweep", "--resume", str(run)], check=True, capture_output=True)
            found = found._replace(same=Store(run).digest() == digest)
            rows.append({"road": name, "chunks": Store(run).count} | found._asdict())
            show_rows("tables after kills", rows[-1:])
    if not all(row["same"] for row in rows):
        raise typer.Exit(1)
