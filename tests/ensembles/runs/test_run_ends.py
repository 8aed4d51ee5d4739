"""Runs that end early: killed, stopped, out of disk; the table is that of an uninterrupted one."""

import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager

import pytest
from chunked import Numbers, finished

import slcp_warp as slcp
from slcp_warp.runs.running import run
from slcp_warp.runs.stopping import Stop
from slcp_warp.runs.store import Store
from slcp_warp.runs.worker import compute

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    """Of the table of `Numbers()`, uninterrupted."""
    return finished(tmp_path_factory.mktemp("whole")).digest()


# -- processes that end, and processes beside each other ----------------------------------------------------


def in_another_process(folder, job):
    """A fork that runs a job: it starts in a millisecond, and there are no kernels in it."""
    process = multiprocessing.get_context("fork").Process(target=lambda: run(job, Store.open(folder, job)))
    process.start()
    return process


def test_killed_at_ten_random_moments(tmp_path):
    """At most one chunk is lost each time, and the table is that of an uninterrupted run."""
    job = Numbers(rows=600, chunk=5, seconds=0.01)
    rng = random.Random(3)
    kills = 0
    while kills < 10:
        process = in_another_process(tmp_path / "x", job)
        time.sleep(rng.uniform(0.02, 0.16))
        assert process.exitcode is None, "it was through before it could be killed ten times"
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        kills += 1
    store = Store.open(tmp_path / "x", job)
    left, last = store.missing(), store.finished()
    assert left == list(range(len(last), job.count)), "chunks are finished one after the other"
    assert run(job, store).again == ()
    assert job.ran == left
    assert list((tmp_path / "x" / "partial").iterdir()) == []
    assert store.digest() == finished(tmp_path / "whole", Numbers(rows=600, chunk=50)).digest()


def test_two_processes_share_a_folder(tmp_path, digest):
    job = Numbers(seconds=0.02)
    other = in_another_process(tmp_path / "x", job)
    outcome = run(job, Store.open(tmp_path / "x", job))
    other.join()
    assert other.exitcode == 0 and outcome.complete
    assert 0 < len(job.ran) < job.count, "each did a part of the work"
    assert Store(tmp_path / "x").digest() == digest


def test_a_chunk_that_another_process_has_claimed_is_left_to_it(tmp_path):
    store = Store.open(tmp_path / "x", Numbers())
    with store.claim(3) as mine, store.claim(3) as again:
        assert mine and not again
    with store.claim(3) as mine:
        assert mine


def test_on_a_disk_without_locks_the_same_parts_come_out(tmp_path, digest, monkeypatch):
    def acquire(lock, timeout):
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr("filelock.FileLock.acquire", acquire)
    store = Store.open(tmp_path / "x", Numbers())
    with store.claim(3) as mine, store.claim(3) as again:
        assert mine and again
    assert run(Numbers(), store).complete and store.digest() == digest


def test_a_signal_ends_it_between_chunks(tmp_path, digest):
    for number in (signal.SIGINT, signal.SIGTERM):
        job = Numbers(seconds=0.01)
        handler = signal.getsignal(number)
        store = Store.open(tmp_path / number.name, job)

        def strike(standing, number=number):
            if standing.done == 4:
                os.kill(os.getpid(), number)

        outcome = run(job, store, progress=strike)
        assert not outcome.complete and outcome.signal == number and signal.getsignal(number) == handler
        assert job.ran == store.finished() and len(job.ran) in (4, 5)
        assert run(job, store).complete and store.digest() == digest


def test_a_chunk_that_takes_too_long_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr("slcp_warp.runs.stopping.GRACE", 0.05)

    class Slow(Numbers):
        def run(self, index):
            if index == 2:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(60.0)
            return super().run(index)

    outcome = run(Slow(), Store.open(tmp_path / "x", Slow()))
    assert outcome.computed == (0, 1) and outcome.signal == signal.SIGTERM and outcome.seconds < 30.0


def test_it_can_be_stopped_from_elsewhere(tmp_path):
    stop = Stop()
    store = Store.open(tmp_path / "x", Numbers())
    outcome = run(Numbers(), store, progress=lambda s: stop() if s.done == 3 else None, stop=stop)
    assert outcome.computed == (0, 1, 2) and not outcome.complete


# -- disks that end ------------------------------------------------------------------------------------------


@contextmanager
def small_disk(folder, options):
    """A file system of its own, in memory; skips where it cannot be had."""
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True)
    if made.returncode:
        pytest.skip(f"no file system can be mounted here: {made.stderr.decode().strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_is_one_line_and_finished_parts_are_safe(tmp_path, digest):
    with small_disk(tmp_path / "disk", "size=28k") as disk:
        job = Numbers()
        store = Store.open(disk / "x", job)
        with pytest.raises(slcp.FileError, match="No space left.*finished parts are safe") as raised:
            run(job, store)
        assert "\n" not in str(raised.value)
        there = store.finished()
        assert 0 < len(there) < job.count and store.set_damaged_aside() == []
        assert list((disk / "x" / "partial").iterdir()) == []
        subprocess.run(["mount", "-o", "remount,size=4m", disk], check=True)
        again = Numbers()
        assert run(again, Store.open(disk / "x", again)).complete and again.ran[0] not in there
        assert store.digest() == digest


def test_a_folder_that_can_only_be_read(tmp_path):
    with small_disk(tmp_path / "disk", "size=1m") as disk:
        job = Numbers()
        store = Store.open(disk / "x", job)
        compute(job, store, 0)
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        with pytest.raises(slcp.FileError, match="Read-only file system"):
            run(job, store)
        assert Store(disk / "x").table(0)["row"].tolist() == list(range(10))
        with pytest.raises(slcp.FileError, match="Read-only file system"):
            Store.open(disk / "y", job)


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_where_no_folder_can_be_nothing_is_said_of_parts(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(
        slcp.FileError, match=f"{place}: Not a directory.*; a folder that can be made"
    ) as raised:
        Store.open(tmp_path / place, Numbers())
    assert "parts are safe" not in str(raised.value) and (tmp_path / "file").read_text() == "mine"


def test_a_folder_that_is_lost(tmp_path):
    job = Numbers()
    store = Store.open(tmp_path / "x", job)

    def lose(standing):
        if standing.done == 3:
            shutil.move(tmp_path / "x", tmp_path / "y")

    with pytest.raises(slcp.FileError, match="x: No such file|x is lost"):
        run(job, store, progress=lose)
    assert not (tmp_path / "x").exists()
    assert Store(tmp_path / "y").finished() == [0, 1, 2]
    with pytest.raises(slcp.FileError, match="is lost"):
        store.finished()


def test_a_store_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        Store(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(slcp.FileError, match="file"):
        Store.open(tmp_path / "file", Numbers())
