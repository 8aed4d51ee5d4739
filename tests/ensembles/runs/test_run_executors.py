"""Executors of runs, started for real: the same table from all of them, also when workers are killed."""

import concurrent.futures
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import chunked
import pytest
from chunked import Numbers, finished, starts

import slcp_warp as slcp
from slcp_warp.runs.executors import WorkerError, dask, processes, slurm
from slcp_warp.runs.job import Job
from slcp_warp.runs.running import run
from slcp_warp.runs.stopping import Stop
from slcp_warp.runs.store import Store

pytest.importorskip("pyarrow")
SUPPORT = str(Path(chunked.__file__).parent)


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Workers find the job's module, as they would find one that is installed."""
    monkeypatch.setenv("PYTHONPATH", SUPPORT)


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    """Of 400 numbers, uninterrupted, by this process."""
    return finished(tmp_path_factory.mktemp("whole"), Numbers(400, 40)).digest()


@pytest.fixture(scope="module")
def four():
    with processes(4) as workers:
        yield workers


@pytest.fixture(scope="module")
def cluster():
    pytest.importorskip("distributed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", SUPPORT)
        with dask(2) as workers:
            yield workers


@pytest.fixture
def jobs():
    pytest.importorskip("submitit")
    with slurm(2, cluster="local") as workers:
        yield workers


@pytest.fixture
def threads():
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        yield pool


def killed(pids, stop, kills, rng):
    """A thread that ends workers (of those that are at it) one after the other; how many, in a list."""
    done: list[int] = []

    def strike():
        while len(done) < kills and not stop.is_set():
            time.sleep(rng.uniform(0.05, 0.3))
            at_it = pids()
            if at_it:
                try:
                    os.kill(at_it[0], signal.SIGKILL)
                except ProcessLookupError:
                    continue
                done.append(at_it[0])

    thread = threading.Thread(target=strike)
    thread.start()
    return thread, done


def run_and_kill(executor, tmp_path, kills, seconds=0.03):
    log = tmp_path / "log"
    job = Numbers(400, 5, seconds=seconds, log=log)
    store = Store.open(tmp_path / "x", job)
    dead: list[int] = []

    def at_it():
        """The process that began a chunk last and still lives; none of one that lost three: five end it."""
        begun = starts(log)
        lost = Counter(chunk for chunk, pid in begun if pid in dead)
        alive = [(chunk, pid) for chunk, pid in reversed(begun) if pid not in dead and pid != os.getpid()]
        return [pid for chunk, pid in alive[:1] if lost[chunk] < 3]

    end = threading.Event()
    thread, dead = killed(at_it, end, kills, random.Random(7))
    try:
        outcome = run(job, store, executor)
    finally:
        end.set()
        thread.join()
    assert outcome.complete and outcome.signal == 0 and outcome.again == ()
    return store, len(starts(log)) - job.count, len(dead)


def started(*arguments):
    """`chunked.py` with these arguments, in a process of its own."""
    program = [sys.executable, str(Path(SUPPORT) / "chunked.py"), *map(str, arguments)]
    return subprocess.Popen(program, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("name", ["four", "cluster", "jobs", "threads"])
def test_the_table_does_not_depend_on_who_computes_it(name, request, tmp_path, digest):
    seen = []
    job = Numbers(400, 10, log=tmp_path / "log")
    store = Store.open(tmp_path / "x", job)
    outcome = run(job, store, request.getfixturevalue(name), progress=seen.append)
    assert outcome.complete and sorted(outcome.computed) == list(range(40))
    assert seen[-1].done == 40 and seen[-1].tally["rows"] == 400
    assert store.digest() == digest
    assert sorted(index for index, _ in starts(tmp_path / "log")) == list(range(40)), "each once"
    others = {pid for _, pid in starts(tmp_path / "log")} - {os.getpid()}
    assert len(others) == {"four": len(others), "cluster": 2, "jobs": 2, "threads": 0}[name]
    assert (name == "threads") == (not others)


@pytest.mark.parametrize("times", [3, pytest.param(10, marks=pytest.mark.full)])
def test_killed_processes_lose_a_chunk_each(times, four, tmp_path, digest):
    store, more, kills = run_and_kill(four, tmp_path, times)
    assert kills == times and more <= kills and store.digest() == digest


@pytest.mark.parametrize("times", [1, pytest.param(10, marks=pytest.mark.full)])
def test_a_killed_worker_of_dask_loses_a_chunk(times, cluster, tmp_path, digest):
    store, more, kills = run_and_kill(cluster, tmp_path, times)
    assert kills == times and more <= kills and store.digest() == digest


@pytest.mark.full
@pytest.mark.parametrize("times", [1, 10])
def test_a_killed_job_of_submitit_loses_a_chunk(times, jobs, tmp_path, digest):
    """With -s: what ten kills cost. A new array of jobs takes longer to begin than a worker."""
    store, more, kills = run_and_kill(jobs, tmp_path, times, 0.03 if times == 1 else 0.3)
    print(f"{kills} kills, {more} chunks begun twice")
    assert kills == times and more <= kills and store.digest() == digest


def test_the_process_that_spreads_is_killed(tmp_path, digest):
    """Its four workers end with it; each loses at most the chunk that it computed."""
    log = tmp_path / "log"
    program = [
        sys.executable,
        str(Path(SUPPORT) / "chunked.py"),
        tmp_path / "x",
        "400",
        "5",
        "0.05",
        log,
        "4",
    ]
    process = subprocess.Popen([*map(str, program)])
    while len(starts(log)) < 20:
        time.sleep(0.01)
        assert process.poll() is None
    process.kill()
    process.communicate()
    pids = {pid for _, pid in starts(log)}
    assert len(pids) == 4
    patience = time.monotonic() + 20.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids) and time.monotonic() < patience:
        time.sleep(0.02)
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids), "workers outlived it"
    begun = len(starts(log))
    job = Numbers(400, 5, log=log)
    store = Store.open(tmp_path / "x", job)
    assert begun - len(store.finished()) <= 4
    assert run(job, store).again == ()
    assert store.digest() == digest


def test_sigterm_ends_it_soon_and_the_rest_goes_on(tmp_path, digest):
    log = tmp_path / "log"
    program = [
        sys.executable,
        str(Path(SUPPORT) / "chunked.py"),
        tmp_path / "x",
        "400",
        "5",
        "0.05",
        log,
        "2",
    ]
    process = subprocess.Popen([*map(str, program)], stdout=subprocess.PIPE, text=True)
    while len(starts(log)) < 10:
        time.sleep(0.01)
        assert process.poll() is None
    process.terminate()
    said, _ = process.communicate(timeout=30)
    complete, number, computed = said.split()
    job = Numbers(400, 5, log=log)
    store = Store.open(tmp_path / "x", job)
    assert complete == "False" and number == "15" and process.returncode == 0
    assert len(store.finished()) == int(computed) < 80
    assert run(job, store).complete and store.digest() == digest


def test_a_chunk_that_takes_too_long_is_given_up_by_workers(four, tmp_path, monkeypatch):
    monkeypatch.setattr("slcp_warp.runs.spreading.GRACE", 0.1)
    stop = Stop()
    job = Numbers(40, 10, seconds=60.0)
    threading.Timer(0.5, stop).start()
    outcome = run(job, Store.open(tmp_path / "x", job), four, stop=stop)
    assert not outcome.complete and outcome.computed == () and outcome.seconds < 30.0
    quick = Numbers(40, 10)
    assert run(quick, Store.open(tmp_path / "y", quick), four).complete, "new workers take their places"


def test_an_error_in_a_chunk_ends_it_and_is_told(four, jobs, threads, tmp_path):
    for name, executor in {"four": four, "jobs": jobs, "threads": threads}.items():
        job = Numbers(100, 10, fails=3)
        store = Store.open(tmp_path / name, job)
        with pytest.raises((ValueError, WorkerError), match="there is no number 3"):
            run(job, store, executor)
        assert 3 not in store.finished()


def test_a_chunk_that_always_ends_its_worker_is_given_up(four, tmp_path):
    job = Numbers(100, 10, dies=3)
    store = Store.open(tmp_path / "x", job)
    with pytest.raises(WorkerError, match="has lost its worker 5 times.*finished parts are safe"):
        run(job, store, four)
    assert 3 not in store.finished()


def test_a_script_that_starts_itself_again_is_told_why(tmp_path):
    """Without `if __name__ == "__main__"` every worker would run the script."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nfrom chunked import Numbers\nfrom slcp_warp.runs import Store, processes, run\n"
        "job = Numbers()\nrun(job, Store.open(sys.argv[1], job), processes(1))\n"
    )
    program = [sys.executable, str(script), str(tmp_path / "x")]
    done = subprocess.run(program, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert "WorkerError" in last and 'below if __name__ == "__main__"' in last


def test_a_worker_that_is_killed_while_it_begins_is_started_again(tmp_path):
    """It says nothing of the script that started it."""
    killed = []

    def kill():
        while not killed:
            for pool in workers.pools.pools:
                killed.extend(getattr(pool, "_processes", None) or {})
            time.sleep(1e-3)
        os.kill(killed[0], signal.SIGKILL)

    with processes(1) as workers:
        killer = threading.Thread(target=kill)
        killer.start()
        outcome = run(Numbers(), Store.open(tmp_path / "x", Numbers()), workers)
        killer.join()
    assert outcome.complete and len(killed) == 1


def test_a_worker_with_another_version_is_refused(tmp_path):
    context = multiprocessing.get_context("spawn")
    job = Numbers(100, 10)
    store = Store.open(tmp_path / "x", job)
    with concurrent.futures.ProcessPoolExecutor(1, context, chunked.of_another_version) as pool:
        with pytest.raises(slcp.FileError, match="a worker is refused: .*there, '9.9' here"):
            run(job, store, pool)
    assert store.finished() == []


def test_what_cannot_travel_is_refused_before_anything_runs(four, tmp_path):
    class Closure(Numbers):
        reference = Job.reference

    job = Closure()
    with pytest.raises(slcp.ArgumentError, match="cannot be handed to other processes"):
        run(job, Store.open(tmp_path / "x", job), four)
    assert job.ran == []

    class Otherwise(Numbers):
        def reference(self):
            return Numbers(seed=9).reference()

    with pytest.raises(slcp.ArgumentError, match="workers would rebuild another numbers"):
        run(Otherwise(), Store.open(tmp_path / "x", job), four)


@pytest.mark.parametrize(
    "call, said",
    [
        (lambda: processes(0), "count is 0"),
        (lambda: processes(devices="cuda:0"), "names of GPUs"),
        (lambda: processes(devices=[]), "names of GPUs"),
        (lambda: slurm(cluster="pbs"), "cluster is 'pbs'"),
        (lambda: dask(0), "cluster is 0"),
        (lambda: run(Numbers(), None, executor="dask"), "executor is a str"),
    ],
)
def test_wrong_executors_are_refused(call, said):
    with pytest.raises(slcp.InputError, match=said):
        call()


def test_a_worker_has_its_gpu_and_its_share_of_the_cores(monkeypatch):
    monkeypatch.delenv("SLCP_WARP_THREADS", raising=False)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    of = processes(devices=("cuda:1", "cuda:3")).pools.surroundings
    assert of == [
        {"SLCP_WARP_THREADS": "4", "CUDA_VISIBLE_DEVICES": "1"},
        {"SLCP_WARP_THREADS": "4", "CUDA_VISIBLE_DEVICES": "3"},
    ]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,5,6,7")
    assert processes(devices=("cuda:1",)).pools.surroundings[0]["CUDA_VISIBLE_DEVICES"] == "5"
    assert [s["SLCP_WARP_THREADS"] for s in processes(3).pools.surroundings] == ["2"] * 3
