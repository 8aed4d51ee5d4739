"""Reports in files: what is loaded is what was saved, and the tables open in other programs."""

import json

import numpy as np
import pytest
from file_examples import report, rewritten

import slcp_warp as slcp

SUFFIXES = (".npz", ".parquet")


def equal(a: slcp.Report, b: slcp.Report) -> bool:
    assert a.source.keys == b.source.keys and a.complete == b.complete and a.measures == b.measures
    for key in a.source.keys:
        one, other = a.part(*key), b.part(*key)
        assert list(one) == list(other)
        for name, column in one.items():
            assert column.dtype == other[name].dtype
            np.testing.assert_array_equal(column, other[name])
    return True


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("complete", [True, False])
def test_what_is_loaded_is_what_was_saved(tmp_path, suffix, complete):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    given = report(complete=complete)
    path = given.save(tmp_path / f"report{suffix}")
    found = slcp.Report.load(path)
    assert found.complete == complete
    assert equal(found, given) and repr(found.summary) == repr(given.summary)
    assert found.task.name == given.task.name and repr(found.task.measures) == repr(given.task.measures)
    assert repr(found.task.success) == repr(given.task.success) and str(found) == str(given)
    assert equal(slcp.Report.load(found.save(tmp_path / f"again{suffix}")), given)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_report_without_rows_and_one_without_a_task(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    empty = slcp.Report(report().task)
    assert slcp.Report.load(empty.save(tmp_path / f"empty{suffix}")).source.keys == ()
    nameless = slcp.Report(None, report().source)
    found = slcp.Report.load(nameless.save(tmp_path / f"nameless{suffix}"))
    assert found.task is None and found.measures == ("x", "time") and equal(found, nameless)


def test_csv_holds_the_table(tmp_path):
    given = report()
    path = given.save(tmp_path / "report.csv")
    lines = path.read_text().splitlines()
    table = given.table
    assert lines[0] == ",".join(table) and len(lines) == 1 + len(table["world"])
    assert lines[1].split(",") == [str(column[0].item()) for column in table.values()]
    assert slcp.Report(None).save(tmp_path / "empty.csv").read_text() == ""


def test_csv_warns_of_what_it_does_not_say(tmp_path):
    with pytest.warns(RuntimeWarning, match="report.csv will not say that the sweep was interrupted; .npz"):
        report(complete=False).save(tmp_path / "report.csv")


def test_parquet_opens_in_other_programs(tmp_path):
    dataset = pytest.importorskip("pyarrow.dataset")
    path = report().save(tmp_path / "report.parquet")
    table = report().table
    rows = dataset.dataset(path).to_table(filter=dataset.field("policy") == "a")
    assert rows.num_rows == (table["policy"] == "a").sum()
    for package, read in (
        ("pandas", lambda p: p.read_parquet(path)),
        ("polars", lambda p: p.read_parquet(path)),
        ("duckdb", lambda p: p.sql(f"select * from '{path}'").fetchnumpy()),
    ):
        found = read(pytest.importorskip(package))
        for name, column in table.items():
            np.testing.assert_array_equal(np.asarray(found[name]).astype(column.dtype), column, err_msg=name)


LIES = {
    "another format": {"format": "slcp-warp-sweep"},
    "another version": {"version": 2},
    "no parts": {"parts": None},
    "no list of parts": {"parts": {}},
    "complete as a number": {"complete": 1},
    "a task that is none": {"task": {"format": "slcp-task", "version": 1}},
    "a task of another kind": {"task": [1]},
}


@pytest.mark.parametrize("what", LIES)
def test_headers_that_lie(tmp_path, what):
    path = report().save(tmp_path / "report.npz")
    rewritten(path, LIES[what])
    with pytest.raises(slcp.FileError, match=r"report\.npz"):
        slcp.Report.load(path)


PARTS = {
    "rows": ("rows", 2),
    "negative rows": ("rows", -1),
    "rows as text": ("rows", "3"),
    "a flag": ("rows", True),
    "a step size": ("step_size", 0.0),
    "no policy": ("policy", None),
    "unknown columns": ("columns", ["mass"]),
    "a column twice": ("columns", ["world", "world", "success", "status"]),
    "no status": ("columns", ["world", "x", "time", "success"]),
    "columns of numbers": ("columns", [1, 2]),
    "no world first": ("columns", ["success", "world", "status"]),
    "the same part twice": ("policy", "b"),
    "no measure of the task": ("columns", ["world", "success", "status"]),
}


@pytest.mark.parametrize("what", PARTS)
def test_parts_that_lie(tmp_path, what):
    path = report().save(tmp_path / "report.npz")
    with np.load(path) as archive:
        parts = json.loads(str(archive["header"]))["parts"]
    name, value = PARTS[what]
    parts[0][name] = value
    rewritten(path, {"parts": parts})
    with pytest.raises(slcp.FileError, match=r"report\.npz"):
        slcp.Report.load(path)


COLUMNS = {
    "worlds that fall": ("world", np.array([2, 1, 0, 0, 1, 2, 0])),
    "half worlds": ("world", np.arange(7.0)),
    "negative worlds": ("world", np.array([-1, 1, 2, 0, 1, 2, 0])),
    "no flags": ("success", np.zeros(7)),
    "no status": ("status", np.full(7, 99)),
    "too few rows": ("x", np.zeros(6)),
    "a matrix": ("x", np.zeros((7, 2))),
    "texts": ("x", np.full(7, "a")),
}


@pytest.mark.parametrize("what", COLUMNS)
def test_columns_that_are_none(tmp_path, what):
    path = report().save(tmp_path / "report.npz")
    name, value = COLUMNS[what]
    rewritten(path, **{f"table_{name}": value})
    with pytest.raises(slcp.FileError, match=r"report\.npz"):
        slcp.Report.load(path)


def test_other_files_are_refused(tmp_path):
    for call in (slcp.Report.load, report().save):
        with pytest.raises(slcp.InputError, match="ends in '.txt'"):
            call(tmp_path / "report.txt")
    with pytest.raises(FileNotFoundError, match="no such file"):
        slcp.Report.load(tmp_path / "absent.npz")
    assert list(tmp_path.iterdir()) == []
