"""`slcp sweep` in folders: prepared, run by chunks and shares, killed, ended, gone on with."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("typer")
pytest.importorskip("pyarrow")

from file_examples import push_file
from test_cli import call, fails
from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp.runs.store import Store
from slcp_warp.scripts.benchmarks.commands import app as bench_app


def given(folder, worlds=120):
    """Arguments of a sweep of the file's task under both policies."""
    file = push_file(folder)
    policies = ("--policy", f"{file}:gain", "--policy", f"{file}:asked")
    few = ("--worlds", worlds, "--residuals", "smoothed", "--device", "cpu")
    return ("sweep", f"{file}:push", *policies, *few)


@pytest.fixture(scope="module")
def through(tmp_path_factory):
    """The digest of the sweep that ran through."""
    folder = tmp_path_factory.mktemp("through")
    said = call(*given(folder), "--out", folder / "run").output
    assert call("chart", folder / "run", "--out", folder / "pictures").exit_code == 0
    assert (folder / "pictures" / "run.png").stat().st_size > 5000
    assert "chunks are in" in said and "gain" in said and "asked" in said
    return Store(folder / "run").digest()


def test_chunks_and_shares_of_a_job_array(tmp_path, through):
    run = tmp_path / "run"
    said = call(*given(tmp_path), "--out", run, "--chunk-worlds", 20, "--prepare").output
    assert "242 worlds in 14 chunks, 14 of them to do" in said.replace("\n", " ")
    assert "1 of 14 chunks are in" in call("sweep", "--resume", run, "--chunk", 13).output
    assert "1 of 14 chunks are in" in call("sweep", "--resume", run, "--chunk", 13).output  # done already
    assert "7 of 14" in call("sweep", "--resume", run, "--chunk", "0/2").output.replace("8", "7")
    assert "there are 0 to 13" in fails("sweep", "--resume", run, "--chunk", 14)
    assert "from 0/2 to 1/2" in fails("sweep", "--resume", run, "--chunk", "2/2")
    for text in ("x", "1/0"):
        assert "I, or I/N" in fails("sweep", "--resume", run, "--chunk", text)
    for option, value in (("--worlds", 7), ("--seed", 0), ("--chunk-worlds", 3), ("--dtype", "float64")):
        said = fails("sweep", "--resume", run, option, value)
        assert f"given with {option[2:].replace('-', '_')}; the folder has" in said
    call(*given(tmp_path), "--out", run, "--chunk", "1/2")  # the whole call does, too
    assert Store(run).digest() == through
    said = call("sweep", "--resume", run).output
    assert "14 of 14 chunks" in said and "success" in said
    assert "gain less asked" in call("compare", run).output
    report = slcp.load_report(run)
    assert report.task.name == "push" and report.complete and len(report.table["world"]) == 242


def test_what_does_not_go_together(tmp_path):
    run = tmp_path / "run"
    assert "need a folder" in fails(*given(tmp_path), "--out", tmp_path / "a.csv", "--processes", 2)
    assert "one of them" in fails(*given(tmp_path), "--out", run, "--processes", 2, "--dask", 2)
    assert "run in this process" in fails(*given(tmp_path), "--out", run, "--processes", 2, "--chunk", 1)
    assert "without --slurm" in fails(*given(tmp_path), "--out", run, "--slurm-option", "a=1")
    assert "name=value" in fails(*given(tmp_path), "--out", run, "--slurm", 2, "--slurm-option", "a")
    assert "the folder has them" in fails(*given(tmp_path), "--resume", run)
    assert "no such file" in fails("sweep", "--resume", run)
    assert "--policy is missing" in fails("sweep", "flicking_finger")
    assert "only sweeps of a task" in fails("sweep", "--policy", "x.npz", "--out", run)
    assert not run.exists()


@pytest.mark.slow
def test_signals_end_it_and_it_goes_on(tmp_path, through):
    """Killed at random moments and ended by SIGTERM and Ctrl-C: exit codes, and at last the same table."""
    run, rng = tmp_path / "run", random.Random(4)
    arguments = [str(each) for each in (*given(tmp_path), "--out", run, "--chunk-worlds", 2)]
    command = [sys.executable, "-P", "-m", "slcp_warp.scripts.main", *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    codes = []
    for how in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        process = subprocess.Popen(command, **pipes)
        before = _parts(run)
        while process.poll() is None and _parts(run) < before + rng.randrange(1, 12):
            time.sleep(0.001)
        process.send_signal(how)
        _, said = process.communicate(timeout=60)
        codes.append(process.returncode)
        assert how == signal.SIGKILL or f"go on by: slcp sweep --resume {run}" in said
        assert before < _parts(run) < 122, said
    assert codes == [-signal.SIGKILL, 143, 130]
    call("sweep", "--resume", run)
    assert Store(run).digest() == through and not list((run / "partial").iterdir())


@pytest.mark.full
def test_sweeps_of_every_road_are_killed():
    """The bench's, with few kills: processes of this machine, Dask, submitit's local executor."""
    for package in ("distributed", "submitit"):
        pytest.importorskip(package)
    result = CliRunner().invoke(bench_app, ["kills", "--kills", "3", "--worlds", "6000"])
    assert result.exit_code == 0, result.output


def _parts(run):
    return len(os.listdir(run / "parts")) if (run / "parts").is_dir() else 0
