"""Stores of runs: what is finished stays, what is damaged is made again, nothing foreign enters."""

import json
import random
import shutil
import sys

import numpy as np
import pytest
from chunked import Kept, Numbers, finished

import slcp_warp as slcp
from slcp_warp.runs import origin, parts
from slcp_warp.runs.books import Books
from slcp_warp.runs.job import Job, plain, rebuild, sha256_of
from slcp_warp.runs.manifest import NAME
from slcp_warp.runs.progress import Standing, duration, shown
from slcp_warp.runs.running import run
from slcp_warp.runs.store import Store
from slcp_warp.runs.worker import compute, work

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    """Of the table of `Numbers()`, uninterrupted."""
    return finished(tmp_path_factory.mktemp("whole")).digest()


def whole_table(store):
    tables = [store.table(i) for i in store.finished()]
    return {name: np.concatenate([t[name] for t in tables]) for name in tables[0]}


def test_what_is_written_comes_back_bit_for_bit(tmp_path):
    class Bits(Job):
        kind, count = "bits", 2

        def specification(self):
            return {}

        def run(self, index):
            rng = np.random.default_rng(index)
            kinds = {"f4": np.uint32, "f8": np.uint64, "i8": np.int64, "u1": np.uint8, "i2": np.int16}
            bits = {
                name: rng.integers(0, np.iinfo(of).max, 1000, dtype=of, endpoint=True).view(name)
                for name, of in kinds.items()
            }
            texts = np.array(["", "a", "ü", "long " * 9])[rng.integers(0, 4, 1000)]
            cube = bits["f8"].reshape(-1, 1, 1) * np.ones((1, 3, 2))
            return bits | {"texts": texts, "bool": bits["u1"] > 99, "cube": cube}

    with np.errstate(all="ignore"):
        store = finished(tmp_path / "x", Bits())
        for index in range(2):
            found, made = store.table(index), Bits().run(index)
            assert list(found) == list(made)
            for name, column in made.items():
                assert found[name].shape == column.shape, name
                if name == "texts":
                    assert (found[name] == column).all()
                else:
                    assert found[name].tobytes() == column.tobytes(), name
                    assert found[name].dtype == column.dtype, name


def test_the_digest_depends_on_nothing_but_the_table(tmp_path, digest):
    for chunk in (1, 7, 100):
        assert finished(tmp_path / str(chunk), Numbers(chunk=chunk)).digest() == digest
    assert finished(tmp_path / "seed", Numbers(seed=1)).digest() != digest
    backwards = Store.open(tmp_path / "backwards", Numbers())
    for index in reversed(range(backwards.count)):
        assert compute(Numbers(), backwards, index) is not None
    assert backwards.digest() == digest


def test_some_columns_of_a_part(tmp_path):
    store = finished(tmp_path / "x")
    assert list(store.table(3, ["double", "row"])) == ["double", "row"]
    with pytest.raises(slcp.FileError, match="no column 'height'; there are"):
        store.table(3, ["height"])


def test_the_parts_are_what_others_read(tmp_path):
    store = finished(tmp_path / "x")
    table = whole_table(store)
    assert store.dataset().count_rows() == 100
    pandas = pytest.importorskip("pandas").read_parquet(tmp_path / "x" / "parts")
    assert (pandas["double"].to_numpy() == table["double"]).all() and (pandas["name"] == table["name"]).all()


def test_only_missing_chunks_are_computed(tmp_path, digest):
    job = Numbers()
    store = finished(tmp_path / "x", job)
    for index in (2, 7):
        store.part(index).unlink()
    with pytest.raises(slcp.FileError, match="2 of 10 chunks are missing"):
        store.digest()
    again = Numbers()
    outcome = run(again, Store.open(tmp_path / "x", again))
    assert again.ran == [2, 7] and outcome.computed == (2, 7) and store.digest() == digest


def truncated(path):
    path.write_bytes(path.read_bytes()[:-100])


def emptied(path):
    path.write_bytes(b"")


def text(path):
    path.write_text("no Parquet at all")


def of_another_index(path):
    shutil.copy(path.with_name("000000.parquet"), path)


def without_its_metadata(path):
    parts.arrow().parquet.write_table(parts.arrow().table({"row": [1, 2]}), path)


def a_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    "damage", [truncated, emptied, text, of_another_index, without_its_metadata, a_folder]
)
def test_a_damaged_part_is_set_aside_and_made_again(damage, tmp_path, digest):
    store = finished(tmp_path / "x")
    damage(store.part(4))
    job = Numbers()
    outcome = run(job, Store.open(tmp_path / "x", job))
    assert job.ran == [4] and outcome.again == (4,) and outcome.complete
    assert store.digest() == digest
    assert (tmp_path / "x" / "damaged" / "000004.parquet").exists()


def test_no_flipped_bit_goes_unseen(tmp_path):
    store = finished(tmp_path / "x")
    data = store.part(4).read_bytes()
    rng = random.Random(5)
    for place in [0, len(data) - 1, *rng.sample(range(len(data)), 200)]:
        damaged = bytearray(data)
        damaged[place] ^= 1 << rng.randrange(8)
        store.part(4).write_bytes(damaged)
        with pytest.raises(slcp.FileError):
            store.table(4)


def test_a_part_of_another_run_is_foreign(tmp_path, digest):
    other = finished(tmp_path / "other", Numbers(seed=1))
    store = finished(tmp_path / "x")
    shutil.copy(other.part(4), store.part(4))
    with pytest.raises(slcp.FileError, match="of another job"):
        store.table(4)
    assert run(Numbers(), store).again == (4,) and store.digest() == digest


@pytest.mark.parametrize(
    "job, said",
    [
        (Numbers(seed=3), r"another numbers: seed: 0 there, 3 here; choose another folder"),
        (Numbers(rows=90), r"rows: 100 there, 90 here"),
        (Numbers(deep={"a": [1, 2]}), r"more\.deep: '\(nothing\)' there, {'a': \[1, 2\]} here"),
        (Numbers(chunk=20), r"cut otherwise: chunk: 10 there, 20 here; go on as it is cut"),
    ],
)
def test_another_job_in_the_folder_is_refused_with_what_differs(job, said, tmp_path):
    finished(tmp_path / "x")
    with pytest.raises(slcp.FileError, match=said):
        Store.open(tmp_path / "x", job)


def test_another_version_or_device_is_refused(tmp_path, monkeypatch):
    finished(tmp_path / "x")
    job = Numbers()
    job.device = "NVIDIA Z100"
    with pytest.raises(slcp.FileError, match="device: 'cpu' there, 'NVIDIA Z100' here"):
        Store.open(tmp_path / "x", job)
    now = origin.program()
    monkeypatch.setattr("slcp_warp.runs.manifest.program", lambda: now | {"slcp-warp": "9.9"})
    with pytest.raises(slcp.FileError, match=f"slcp-warp: '{slcp.__version__}' there, '9.9' here"):
        Store.open(tmp_path / "x", Numbers())


@pytest.mark.parametrize(
    "content, said",
    [
        ("", "cannot be read as the manifest of a run"),
        ("{", "cannot be read as the manifest of a run"),
        ('{"format": "something"}', "its format is not 'slcp-warp-run'"),
        ('{"format": "slcp-warp-run", "version": 9}', "version 9; this program reads 1"),
        ('{"format": "slcp-warp-run", "version": 1}', "kind is None"),
    ],
)
def test_a_damaged_or_foreign_manifest_is_refused(content, said, tmp_path):
    store = finished(tmp_path / "x")
    before = store.part(0).read_bytes()
    (tmp_path / "x" / NAME).write_text(content)
    with pytest.raises(slcp.FileError, match=said):
        Store.open(tmp_path / "x", Numbers())
    assert store.part(0).read_bytes() == before


def test_a_manifest_that_was_changed_is_refused(tmp_path):
    finished(tmp_path / "x")
    path = tmp_path / "x" / NAME
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 1'))
    with pytest.raises(slcp.FileError, match="not what its hash is of"):
        Store.open(tmp_path / "x", Numbers(seed=1))


@pytest.mark.parametrize(
    "was, now",
    [('"chunk": 10', '"chunk": 5'), ('"count": 10', '"count": 9'), ('"device": "cpu"', '"device": "cuda"')],
)
def test_a_manifest_is_sealed_as_a_whole(was, now, tmp_path):
    """How it is cut and what it is of decide what a part's rows are as much as the specification."""
    finished(tmp_path / "x")
    path = tmp_path / "x" / NAME
    text = path.read_text()
    assert was in text
    path.write_text(text.replace(was, now))
    with pytest.raises(slcp.FileError, match="it is not what was written"):
        Store(tmp_path / "x")


def test_a_part_of_the_same_numbers_cut_otherwise_is_foreign(tmp_path, digest):
    fine = finished(tmp_path / "fine", Numbers(chunk=5))
    store = finished(tmp_path / "x")
    store.part(1).write_bytes(fine.part(1).read_bytes())
    with pytest.raises(slcp.FileError, match="cut otherwise"):
        store.table(1)
    assert run(Numbers(), store).again == (1,) and store.digest() == digest


@pytest.mark.parametrize("name", ["2.parquet", "²3.parquet", "0000001.parquet", "٣.parquet", "x.parquet"])
def test_files_of_other_names_are_no_parts(name, tmp_path, digest):
    store = finished(tmp_path / "x")
    shutil.copy(store.part(1), store.part(1).with_name(name))
    assert store.finished() == list(range(10)) and store.digest() == digest
    assert run(Numbers(), store).computed == ()


def test_two_processes_find_the_same_damaged_part(tmp_path, monkeypatch, digest):
    """One sets it aside while the other reads it; a part that goes meanwhile is one to be made."""
    store = finished(tmp_path / "x")
    store.part(4).write_bytes(b"not a part")
    found = Store._facts_and_columns

    def slowly(self, index, columns):
        try:
            return found(self, index, columns)
        except slcp.FileError:
            self.part(index).unlink()
            raise

    monkeypatch.setattr(Store, "_facts_and_columns", slowly)
    assert store.set_damaged_aside() == []
    listed = iter([list(range(10))] * 2)
    monkeypatch.setattr(Store, "finished", lambda self: next(listed))
    books = Books(store, None)
    assert books.again == [] and books.done == set(range(10)) - {4}
    monkeypatch.undo()
    assert run(Numbers(), store).computed == (4,) and store.digest() == digest


def test_a_worker_that_outlives_a_folder_computes_what_is_there_now(tmp_path):
    """The same folder, made anew for another seed, is named by the same reference."""
    for seed in (0, 1):
        shutil.rmtree(tmp_path / "x", ignore_errors=True)
        job = Kept(tmp_path / "x", seed)
        store = Store.open(tmp_path / "x", job)
        work(str(tmp_path / "x"), job.reference(), [0, 3])
        np.testing.assert_array_equal(store.table(3)["double"], job.run(3)["double"])


def test_parts_without_a_manifest_are_refused(tmp_path):
    finished(tmp_path / "x")
    (tmp_path / "x" / NAME).unlink()
    with pytest.raises(slcp.FileError, match="10 parts but no manifest"):
        Store.open(tmp_path / "x", Numbers())


def test_the_manifest_says_how_to_make_it_again(tmp_path):
    manifest = finished(tmp_path / "x").manifest
    assert manifest.sha256 == sha256_of(manifest.specification)
    assert {"command", "commit", "time", "cpu", "python"} <= manifest.provenance.keys()
    assert manifest.program["slcp-warp"] == slcp.__version__ and len(manifest.program["sources"]) == 16
    job = rebuild(manifest.reference)
    assert isinstance(job, Numbers) and sha256_of(plain(job.specification(), "")) == manifest.sha256


@pytest.mark.parametrize("make", ["os:system", "nowhere:at_all", "chunked:Numbers", "json:", ":", 3])
def test_a_reference_calls_only_what_makes_jobs(make):
    with pytest.raises(slcp.ArgumentError, match="reference"):
        rebuild({"make": make, "arguments": {}})


@pytest.mark.parametrize(
    "columns, said",
    [
        ({}, "columns by name are needed"),
        ({"a": np.zeros(3), "b": np.zeros(2)}, "equal ones are needed"),
        ({"a": np.array([None, 1])}, "column 'a' is of type object"),
        ({"a": np.zeros(3, complex)}, "numbers of at most 64 bits"),
    ],
)
def test_what_cannot_be_kept_is_refused(columns, said, tmp_path):
    store = Store.open(tmp_path / "x", Numbers())
    with pytest.raises(slcp.ArgumentError, match=said):
        store.write(0, columns)
    assert store.finished() == []


# -- how far it is -------------------------------------------------------------------------------------------


def test_progress_says_rate_time_left_and_failures(tmp_path, capsys):
    job, seen = Numbers(), []
    run(job, Store.open(tmp_path / "x", job), progress=seen.append)
    assert [s.done for s in seen] == list(range(11)) and seen[-1].tally["rows"] == 100
    failures = sum(int((~t["good"]).sum()) for t in (job.run(i) for i in range(job.count)))
    assert seen[-1].tally["failures"] == failures > 0
    assert np.isnan(seen[0].rate) and np.isnan(seen[0].left) and seen[-1].left == 0.0

    half = Standing(done=5, count=10, tally={"rows": 50, "failures": 7}, fresh=20, seconds=4.0)
    assert half.rate == 5.0 and half.left == 10.0
    assert str(half) == "5/10 chunks, 50 rows, 5 a second, 10 s left, 7 failures"
    with shown("numbers") as progress:
        progress(half)
    assert capsys.readouterr().err == f"numbers: {half}\n"


def test_durations_as_a_person_says_them():
    assert [duration(s) for s in (0.4, 59.4, 185, 99_000)] == ["0 s", "59 s", "3:05 min", "27:30:00 h"]


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    for name in ("filelock", "pyarrow"):
        with (
            monkeypatch.context() as patch,
            pytest.raises(ImportError, match=r"pip install 'slcp-warp\[data\]'"),
        ):
            patch.setitem(sys.modules, name, None)
            Store.open(tmp_path / name, Numbers())
    assert not (tmp_path / "pyarrow").exists()


def test_specifications_are_plain_values():
    assert plain({"a": (1, np.float32(0.5)), "b": np.arange(2)}, "x") == {"a": [1, 0.5], "b": [0, 1]}
    with pytest.raises(slcp.ArgumentError, match="specification holds what JSON cannot"):
        plain({"f": print}, "specification")
    assert json.dumps(plain({"low": -np.inf}, "x")) == '{"low": -Infinity}'
