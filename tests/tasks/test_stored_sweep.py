"""Sweeps of tasks in a folder: the same table however they are cut, ended and gone on with; refusals."""

import concurrent.futures
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from file_examples import push_file
from test_task_sweep import SCENE, kinetic_energy, plan, task

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies
from slcp_warp.ensembles.stored import cutting, travel
from slcp_warp.ensembles.stored.identity import task_identity
from slcp_warp.ensembles.stored.job import SweepJob
from slcp_warp.ensembles.stored.sweep import StoredSweep
from slcp_warp.ensembles.stored.travel import given
from slcp_warp.ensembles.tasks import TaskSweep
from slcp_warp.runs.job import rebuild, sha256_of
from slcp_warp.storage.files import FileError

FIELDS = {"worlds": 30, "seed": 3, "cases": slcp.Options(), "device": "cpu"}
TWO = {"all": plan(), "half": plan(0.5)}


def digest(report):
    return report.source.store.digest()


def test_the_table_is_that_of_a_sweep_in_memory(tmp_path):
    seen = []
    fields = FIELDS | {"chunk": 8}
    stored = slcp.sweep(task(), TWO, out=tmp_path / "run", progress=lambda *a: seen.append(a), **fields)
    memory = slcp.sweep(task(), TWO, **FIELDS)
    a, b = stored.table, memory.table
    assert list(a) == list(b) and len(stored.source.chunks) == 10 and stored.complete
    for name, column in a.items():
        np.testing.assert_array_equal(column, b[name], err_msg=name)
    assert repr(stored.summary) == repr(memory.summary) and str(stored) == str(memory)
    assert stored.compare("all", "half") == memory.compare("all", "half")
    rows = stored.dataset().to_table(filter=None).to_pydict()
    assert list(rows) == list(a) and rows["policy"][0] == "all" and rows["final"] == a["final"].tolist()
    assert memory.dataset().count_rows() == len(b["world"]) == seen[-1][0] == seen[-1][1] == 62


def test_another_order_is_said(tmp_path):
    """It was told that the sweep is cut otherwise, which no chunk mended."""
    slcp.sweep(task(), TWO, out=tmp_path / "run", **FIELDS)
    with pytest.raises(
        FileError, match="in another order; give its policies all, half; cases rem-logistic; "
    ):
        slcp.sweep(task(), dict(reversed(TWO.items())), out=tmp_path / "run", **FIELDS)


def test_a_dataset_of_damaged_parts_is_refused(tmp_path):
    report = slcp.sweep(task(), TWO, out=tmp_path / "run", **FIELDS)
    store = report.source.store
    store.part(0).write_bytes(b"PAR1 no more")
    with pytest.raises(FileError, match="a part cannot be read"):
        slcp.load_report(tmp_path / "run").dataset()


def test_records_are_kept_and_gone_on_with(tmp_path):
    def stop(done, total):
        if done:
            raise KeyboardInterrupt

    kept = {"record": ("block.x",), "record_every": 0.4}
    memory = slcp.sweep(task(), TWO, **kept, **FIELDS).table
    part = slcp.sweep(task(), TWO, out=tmp_path / "run", chunk=7, progress=stop, **kept, **FIELDS)
    assert not part.complete
    stored = StoredSweep.resume(tmp_path / "run")
    stored.run()
    table = stored.report().table
    assert [name for name in table if name.startswith("recorded_")] == [
        f"recorded_block.x_{t}" for t in ("0", "0.4", "0.8", "1.2")
    ]
    for name, column in memory.items():
        np.testing.assert_array_equal(table[name], column, err_msg=name)
    with pytest.raises(FileError, match="record"):
        slcp.sweep(task(), TWO, out=tmp_path / "run", **FIELDS)


def until(limit):
    """Progress that interrupts once so many worlds are done."""

    def progress(done, total):
        if done >= limit:
            raise KeyboardInterrupt

    return progress


def test_a_sweep_goes_on_where_it_was(tmp_path):
    """Interrupted three times, cut otherwise, moved: the table has the bits of one that ran through."""
    through = slcp.sweep(task(), TWO, out=tmp_path / "through", chunk=30, **FIELDS)

    for limit in (1, 17, 40):
        part = slcp.sweep(task(), TWO, out=tmp_path / "run", chunk=7, progress=until(limit), **FIELDS)
        done = sum(part.source.worlds(key) for key in part.source.keys)
        assert not part.complete and limit <= done < limit + 8 and len(part.table["world"]) == done
    shutil.move(tmp_path / "run", tmp_path / "moved")
    stored = StoredSweep.resume(tmp_path / "moved")
    before = len(stored.store.finished())
    outcome = stored.run()
    assert outcome.complete and len(outcome.computed) == 12 - before and before > 5
    report = stored.report()
    assert report.complete and digest(report) == digest(through) and str(report) == str(through)
    again = slcp.sweep(task(), TWO, out=tmp_path / "moved", chunk=3, **FIELDS)  # as it is cut already
    assert again.complete and len(again.source.chunks) == 12


@pytest.mark.parametrize(
    "changes, policy, text",
    [
        ({"seed": 4}, TWO, "seed: 3 there, 4 here"),
        ({"worlds": 31}, TWO, "worlds: 30 there, 31 here"),
        ({"cases": slcp.Options(scaling="none")}, TWO, "cases.rem-logistic.scaling: 'inertia' there, 'none'"),
        ({"step_sizes": (0.03,)}, TWO, "step_sizes: "),
        ({"dtype": "float64"}, TWO, "dtype: 'float32' there, 'float64' here"),
        ({}, {"all": plan(), "half": plan(0.4)}, "policies.half.numbers: "),
        ({}, {"all": plan()}, r"policies.half: \{"),
    ],
)
def test_another_sweep_in_the_folder_is_refused(tmp_path_factory, changes, policy, text):
    folder = tmp_path_factory.getbasetemp() / "one_sweep"
    slcp.sweep(task(), TWO, out=folder, chunk=30, **FIELDS)
    with pytest.raises(FileError, match=f"it holds another sweep: .*{text}"):
        slcp.sweep(task(), policy, out=folder, **(FIELDS | changes))
    other = task(disturbances=slcp.Disturbances(torque=0.4))
    with pytest.raises(FileError, match="task.disturbances.* there, "):
        slcp.sweep(other, TWO, out=folder, **FIELDS)


def test_given_worlds_are_kept_and_gone_on_with(tmp_path):
    """Every third of the drawn worlds: the rows that these have among all, also after an interruption."""
    drawn = slcp.draw_worlds(task(), 30, 3, device="cpu")
    third = drawn[::3]
    whole = slcp.sweep(task(), TWO, **FIELDS).part("half")

    own = FIELDS | {"worlds": third}
    part = slcp.sweep(task(), TWO, out=tmp_path / "run", chunk=4, progress=until(1), **own)
    assert not part.complete
    stored = StoredSweep.resume(tmp_path / "run")
    stored.run()
    found = stored.report().part("half")
    for name in ("final", "success", "drawn_block.mass"):
        np.testing.assert_array_equal(found[name], whole[name][::3], err_msg=name)
    with pytest.raises(FileError, match="given: "):
        slcp.sweep(task(), TWO, out=tmp_path / "run", **(own | {"worlds": drawn[1::3]}))
    (tmp_path / "run" / "inputs" / "worlds.npz").unlink()
    with pytest.raises(FileError, match="worlds.npz: no such file: it is needed to go on"):
        StoredSweep.resume(tmp_path / "run")


def test_names_and_plans_of_a_task_decide_nothing(tmp_path):
    slcp.sweep(task(), plan(), out=tmp_path, chunk=30, **FIELDS)
    same = task(name="other", horizon=20, duration=1.2, options=slcp.Options(residual="hard"))
    assert slcp.sweep(same, plan(), out=tmp_path, **FIELDS).complete


def test_a_cost_that_is_measured_decides():
    """Costs are of plans, and decide no run; what a measure or the success says of them does."""

    def of(weight, **changes):
        return task_identity(task(cost=slcp.costs.terms(SCENE, [slcp.costs.effort(weight)]), **changes))

    for judged in ({"measures": {"price": m.cost()}, "success": None}, {"success": m.cost() < 3.0}):
        assert of(1.0, **judged) == of(1.0, **judged) != of(2.0, **judged)
    assert of(1.0) == of(2.0) == task_identity(task())


def test_a_disk_that_is_full_before_the_first_part(tmp_path, monkeypatch):
    """One line as ever, and nothing that workers need is missing once there is room again."""

    def full(*given):
        raise OSError(28, "No space left on device")

    for name in ("save_task", "save_policy"):
        with monkeypatch.context() as patch, pytest.raises(FileError, match="No space left.*the same call"):
            patch.setattr(travel, name, full)
            StoredSweep.open(tmp_path, TaskSweep(task(), TWO, **FIELDS), chunk=30)
    StoredSweep.open(tmp_path, TaskSweep(task(), TWO, **FIELDS), chunk=30)
    assert StoredSweep.resume(tmp_path).job.count == 4


def test_names_in_python_files_travel(tmp_path):
    """A task and policies of a user's file: rebuilt elsewhere, refused once the file says something else."""
    file = push_file(tmp_path)
    given_as = {name: f"{file}:{name}" for name in ("gain", "asked")}
    fields = FIELDS | {"worlds": 4, "chunk": 3}
    report = slcp.sweep(f"{file}:push", given_as, out=tmp_path / "run", **fields)
    store = report.source.store
    assert list((tmp_path / "run" / "inputs").iterdir()) == []
    assert store.manifest.reference["arguments"]["task"] == f"{file}:push"
    job = rebuild(store.manifest.reference)
    assert isinstance(job, SweepJob) and sha256_of(job.specification()) == store.manifest.sha256
    assert job.layout() == store.manifest.layout and job.texts["policy gain"] == f"{file}:gain"
    part, again = store.table(2), job.run(2)
    for name, column in part.items():
        np.testing.assert_array_equal(column, again[name], err_msg=name)
    np.testing.assert_allclose(report.part("gain")["x"], report.part("asked")["x"], atol=1e-5)  # float32
    push_file(tmp_path, 2.0)
    with pytest.raises(FileError, match="policies.gain.numbers: .*policies.asked.file: "):
        StoredSweep.resume(tmp_path / "run")
    file.unlink()
    with pytest.raises(FileError, match="make the call that began it again"):
        StoredSweep.resume(tmp_path / "run")


class Nothing:
    def submit(self, *given):
        raise AssertionError("a world ran")


def test_code_of_another_compiler_is_refused(tmp_path, monkeypatch):
    """Flags decide how kernels round: parts of two kinds do not stand side by side."""
    slcp.sweep(task(), plan(), out=tmp_path, chunk=30, **FIELDS)
    monkeypatch.setenv("SLCP_CPU_FLAGS", "-march=x86-64")
    for go_on in (StoredSweep.resume, lambda folder: slcp.sweep(task(), plan(), out=folder, **FIELDS)):
        with pytest.raises(FileError, match="device: 'cpu .*' there, 'cpu -march=x86-64' here"):
            go_on(tmp_path)


def test_what_cannot_travel_stays_in_its_process(tmp_path):
    """A measure of a function runs into a folder here; elsewhere it is refused before."""
    own = task(measures={"most": m.largest(m.function(kinetic_energy))}, success=None)
    report = slcp.sweep(own, plan(), out=tmp_path / "own", **(FIELDS | {"worlds": 3, "chunk": 3}))
    assert report.complete and (report.part("policy")["most"] > 0.0).all()
    code = report.source.store.manifest.specification["task"]["measures"]["most"]["of"]["function"]
    assert code["function"]["name"] == "kinetic_energy" and len(code["function"]["code"]) == 64
    with pytest.raises(FileError, match="goes on only by the call that began it: task 'push': measures"):
        StoredSweep.resume(tmp_path / "own")
    with pytest.raises(slcp.InputError, match="'file.py:name'"):
        slcp.sweep(own, plan(), out=tmp_path / "new", executor=Nothing(), chunk=3, **FIELDS)
    around = policies.Around(policies.Callback(lambda x, time: np.zeros(1)))
    for policy in (around, policies.Callback(lambda x, time: np.zeros(1))):
        with pytest.raises(slcp.InputError, match="'file.py:name'|acts on the host"):
            slcp.sweep(task(), policy, out=tmp_path / "host", chunk=3, **FIELDS)
    with pytest.raises(slcp.InputError, match="executor is given, but no out"):
        slcp.sweep(task(), plan(), executor=Nothing(), **FIELDS)


@pytest.mark.slow
def test_other_processes_give_the_same_table(tmp_path):
    """Numbers travel in the folder, Python by its name; a worker that is killed loses nothing but time."""
    file, fields = push_file(tmp_path), FIELDS | {"worlds": 60}
    mixed = {"numbers": plan(), "kernel": f"{file}:gain", "host": f"{file}:asked"}
    here = slcp.sweep(f"{file}:push", mixed, out=tmp_path / "here", chunk=60, **fields)
    killed = []

    def kill(done, total):
        if done > 20 and not killed:
            killed.append(next(iter(workers.pools.pools[0]._processes)))
            os.kill(killed[0], signal.SIGKILL)

    with slcp.runs.processes(2) as workers:
        there = slcp.sweep(
            f"{file}:push", mixed, out=tmp_path / "there", chunk=4, executor=workers, progress=kill, **fields
        )
    assert there.complete and killed and digest(there) == digest(here) and str(there) == str(here)


def test_threads_give_the_same_table(tmp_path):
    """Noise of every step depends on the world's number alone, whichever thread has the chunk before it."""
    fields = FIELDS | {"worlds": 400}
    alone = slcp.sweep(task(), TWO, out=tmp_path / "alone", chunk=400, **fields)
    with concurrent.futures.ThreadPoolExecutor(8) as threads:
        found = slcp.sweep(task(), TWO, out=tmp_path / "threads", chunk=10, executor=threads, **fields)
    assert found.complete and digest(found) == digest(alone)


@pytest.mark.parametrize("suffix", [".npz", ".parquet", ".csv"])
def test_the_report_of_a_folder_is_saved_as_one_of_memory(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    stored = slcp.sweep(task(), TWO, out=tmp_path / "run", **FIELDS)
    memory = slcp.sweep(task(), TWO, **FIELDS)
    found = slcp.load_report(stored.save(tmp_path / f"report{suffix}"))
    assert found.complete and found.source.keys == memory.source.keys
    for key in memory.source.keys:
        one, other = found.part(*key), memory.part(*key)
        assert list(one) == list(other) and any(name.startswith("drawn_") for name in one) == (
            key[3] == "disturbed"
        )
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_two_processes_agree_on_the_hash(tmp_path):
    code = """
import sys
sys.path[:0] = sys.argv[1:3]
from file_examples import push_file
from test_task_sweep import plan, task
import slcp_warp as slcp
from slcp_warp.ensembles.stored.job import SweepJob
from slcp_warp.ensembles.tasks import TaskSweep
from slcp_warp.runs.job import sha256_of
fields = {"worlds": 30, "seed": 3, "cases": slcp.Options(), "device": "cpu"}
work = TaskSweep(task(), {"all": plan(), "half": plan(0.5)}, **fields)
print(sha256_of(SweepJob(work, ".").specification()))
"""
    here = Path(__file__).parent
    command = [sys.executable, "-P", "-c", code, str(here), str(here.parent / "support")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    job = SweepJob(TaskSweep(task(), TWO, **FIELDS), tmp_path)
    assert run.stdout.split()[-1] == sha256_of(job.specification()), run.stderr


def test_chunks_take_about_a_second(monkeypatch):
    """Sizes follow a rate that is measured, on as many threads as a chunk will have, and bounds hold."""
    work = TaskSweep(task(start=np.tile(task().start, (5, 1))), TWO, **(FIELDS | {"worlds": 10**7}))
    monkeypatch.setattr(cutting, "_rate", lambda work, part: 5000.0 if part.policy == "all" else 9.0)
    assert cutting.measured(work) == [4096, 5, 1024, 5]
    monkeypatch.setattr(cutting, "MOST_CHUNKS", 10**9)
    assert cutting.measured(work) == [4096, 5, 8, 5]
    monkeypatch.setattr(cutting, "thread_count", lambda: 4)
    assert cutting.measured(work, threads=1) == [1024, 5, 2, 2]
    work.cut(cutting.measured(work))
    assert len(work.chunks) == -(-(10**7) // 4096) + 10**7 // 8 + 2
    assert work.chunks.worlds == 2 * (10**7 + 5)


def test_a_report_says_what_does_not_fit(tmp_path, monkeypatch):
    report = slcp.sweep(task(), TWO, out=tmp_path, chunk=30, **FIELDS)
    monkeypatch.setattr(report.source, "worlds", lambda key: 10**12)
    for name in ("table", "parts"):
        with pytest.raises(slcp.InputError, match=f"Report.{name}: the rows would take .* GiB; cpu has"):
            getattr(report, name)


def test_tasks_and_policies_as_texts(tmp_path):
    """Names of tasks and files of policies are data: they are kept, and nothing has to be there later."""
    file = policies.save_policy(plan(), tmp_path / "mine.npz")
    found, named, texts = given("flicking_finger", {"file": file, "object": TWO["half"]})
    assert found.name == "flicking_finger" and not texts
    assert type(named["file"]) is type(named["object"]) is type(plan())
