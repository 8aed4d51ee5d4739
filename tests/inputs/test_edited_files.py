"""Files that were changed by hand: every loader refuses the same list of edits, or does not read them.

What comes is one error that names the file; nothing is taken that a program of this project does not write.
"""

import json
import zipfile

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import FORMATS, report, rewritten

import slcp_warp as slcp
from slcp_warp import ddp

NEEDED = {  # arrays of every form that has to be there, and may be of no other shape
    "library": ("x", "u", "K", "cost", "gain", "age", "chain", "plan", "period", "lower", "upper"),
    "sweep": ("table_residual", "table_step_size", "table_world", "table_status", "table_rate",
              "table_spinning", "table_recovery_time", "table_contact_share", "table_lowest_gap",
              "samples_0"),
    "report": ("table_world", "table_success", "table_status", "table_x", "table_drawn_mass_0"),
    "trajectory": ("states", "status", "param_step_size", "param_mass"),
    "plan": ("xs", "us", "K", "k", "Vx", "Vxx", "cost", "status", "iterations", "trace_cost",
             "trace_step_size", "param_step_size"),
    "surface": ("axis0", "axis1", "axis2", "gap", "param_step_size"),
    "policy": ("lower", "upper", "policy.K", "policy.x_ref", "policy.u_ref", "policy.period"),
    "worlds": ("x0",),
}  # fmt: skip
NUMBERS = {  # of these no entry may be NaN
    "library": ("x", "u", "K", "cost", "gain", "period", "lower", "upper"),
    "sweep": ("table_step_size", "table_rate", "table_contact_share", "table_lowest_gap"),
    "report": ("table_drawn_mass_0",),
    "trajectory": ("states", "impulse", "param_step_size", "param_mass"),
    "plan": ("xs", "us", "K", "k", "cost", "param_step_size", "param_mass"),
    "surface": ("axis0", "gap", "param_step_size"),
    "policy": ("lower", "upper", "policy.K", "policy.x_ref", "policy.period"),
    "worlds": ("x0",),
}  # fmt: skip
ABOVE = {  # and none of these negative
    "library": ("period", "age", "chain", "plan"),
    "sweep": ("table_step_size", "table_world", "table_contact_share", "table_recovery_time"),
    "report": ("table_world",),
    "trajectory": ("param_step_size", "param_mass", "param_sigma"),
    "plan": ("param_step_size", "iterations", "trace_step_size", "trace_regularization"),
    "surface": ("param_step_size",),
}  # fmt: skip
NAMES = {  # places of a header, and what they may not hold
    "sweep": {("cases", 0, "step_size"): -0.1, ("cases", 0, "residual"): "hard, gap end",
              ("cases", 0, "worlds"): 2, ("cases", 0, "share_above"): [0.5, 0.6, 0.7],
              ("spec", "duration"): -1.0, ("spec", "sample_every"): 0.0},
    "report": {("parts", 0, "step_size"): -0.05, ("parts", 0, "arm"): "tired", ("parts", 0, "case"): "",
               ("parts", 0, "policy"): 3, ("parts", 2, "arm"): "disturbed",
               ("task", "duration"): 1e-9},
    "trajectory": {("step_size",): -0.05, ("scene",): "hopper", ("residual",): "hard",
                   ("scene_file", "bodies"): [], ("options", "gap"): "open"},
    "plan": {("step_size",): -0.05, ("scene",): "hopper", ("residual",): "hard",
             ("options", "colour"): "red"},
    "surface": {("step_size",): float("nan"), ("scene",): None},
    "policy": {("policy", "delay"): -1, ("policy", "class"): "os:system", ("policy", "hold"): 0},
}  # fmt: skip


def written(folder, name):
    path = folder / f"file{FORMATS[name].suffix}"
    FORMATS[name].write(path)
    with np.load(path) as archive:
        return path, {each: archive[each] for each in archive.files}


def refused(name, path):
    with pytest.raises(FORMATS[name].error) as caught:
        FORMATS[name].load(path)
    text = str(caught.value)
    assert path.name in text and "\n" not in text and len(text) < 600, text
    return text


def each(table):
    return [(name, array) for name in table for array in table[name]]


@pytest.mark.parametrize(("name", "array"), each(NEEDED))
def test_an_array_that_is_missing_or_of_another_shape(tmp_path, name, array):
    path, arrays = written(tmp_path, name)
    rewritten(path, **{array: None})
    assert array.partition("_")[2] in refused(name, path) or name in ("report", "policy")
    sizes = (name, array) in {("policy", "lower"), ("policy", "upper")}  # of whose controls the scene says
    more = np.stack([arrays[array]] * 3)[None] if not sizes else np.zeros((2, 1, 1, 1))
    rewritten(path, **{array: more})
    refused(name, path)


@pytest.mark.parametrize(("name", "array"), each(NUMBERS))
def test_nan_where_a_number_is_needed(tmp_path, name, array):
    path, arrays = written(tmp_path, name)
    values = np.array(arrays[array], float)
    values.reshape(-1)[0] = np.nan
    rewritten(path, **{array: values})
    refused(name, path)


@pytest.mark.parametrize(("name", "array"), each(ABOVE))
def test_numbers_below_zero(tmp_path, name, array):
    path, arrays = written(tmp_path, name)
    values = np.array(arrays[array])
    values.reshape(-1)[0] = -1
    rewritten(path, **{array: values})
    refused(name, path)


@pytest.mark.parametrize(("name", "place"), each(NAMES), ids=str)
def test_a_header_that_says_what_cannot_be(tmp_path, name, place):
    path, arrays = written(tmp_path, name)
    header = json.loads(str(arrays["header"]))
    inside = header
    for key in place[:-1]:
        inside = inside[key]
    assert place[-1] in (*inside, "colour") or isinstance(inside, list)
    inside[place[-1]] = NAMES[name][place]
    rewritten(path, {key: header[key] for key in {place[0]}})
    refused(name, path)


@pytest.mark.parametrize("name", NEEDED)
def test_an_array_more_is_not_unpacked(tmp_path, name):
    """One that says to be of terabytes: not looked at, or refused for its name."""
    path, _ = written(tmp_path, name)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("another.npy", b"\x93NUMPY\1\0\x46\0{'descr': '<f8', 'shape': (1000000000000,)}")
    if name in ("worlds", "policy"):
        refused(name, path)
    else:
        assert FORMATS[name].load(path) is not None


@pytest.mark.parametrize("said", [{"delay": -1}, {"delay": 2.5}, {"horizon": 3}, {"horizon": "2"}], ids=str)
def test_a_plan_whose_header_is_of_another(tmp_path, said):
    path, _ = written(tmp_path, "plan")
    assert ddp.Result.load(path).us.shape == (2, 2)
    rewritten(path, said)
    with pytest.raises(slcp.FileError, match=r"file\.npz cannot be read as a plan"):
        ddp.Result.load(path)


ROWS = {
    "an unknown arm": {"arm": "tired"},
    "a negative step size": {"step_size": "-0.05"},
    "a step size that is none": {"step_size": "nan"},
    "a status beyond": {"status": "77"},
    "an unsolved success": {"status": "2", "success": "True"},
    "a measure of an unsolved world": {"status": "2", "success": "False"},
    "half a world": {"world": "0.5"},
    "a world twice": {"world": "1"},
    "no policy": {"policy": ""},
    "a drawn number that is none": {"drawn_mass_0": "nan"},
}  # fmt: skip


def edited(path, **values):
    """The table with other values in its first row, of world 0, solved, a success."""
    head, first, *rest = path.read_text().splitlines()
    row = dict(zip(head.split(","), first.split(","))) | values
    path.write_text("\n".join([head, ",".join(row.values()), *rest, ""]))


@pytest.mark.parametrize("what", ROWS)
def test_rows_of_a_table_that_no_sweep_gives(tmp_path, what):
    path = report().save(tmp_path / "file.csv")
    edited(path, **ROWS[what])
    refused("report table", path)


def test_a_table_is_loaded_as_far_as_it_holds(tmp_path):
    """The same rows, part by part, without the task; a world that is missing is told, not made up."""
    given = report()
    path = given.save(tmp_path / "file.csv")
    found = slcp.load_report(path)
    assert found.task is None and found.complete and found.source.keys == given.source.keys
    for key in given.source.keys:
        own, other = given.part(*key), found.part(*key)
        assert list(own) == list(other)
        for name, column in own.items():
            np.testing.assert_allclose(other[name].astype(float), column.astype(float), rtol=1e-12)
    assert repr(found.summary) == repr(given.summary)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, rows[0], *rows[2:], ""]))
    assert not slcp.load_report(path).complete


@pytest.mark.parametrize("lost", [1, 2])
def test_a_report_that_says_it_is_complete_has_all_worlds(tmp_path, lost):
    """A row that was taken out, in the middle of a part or at its end, where another has it."""
    path, arrays = written(tmp_path, "report")
    parts = json.loads(str(arrays["header"]))["parts"]
    parts[0]["rows"] -= 1
    tables = {n: np.delete(a, lost, axis=0) for n, a in arrays.items() if n.startswith("table_")}
    rewritten(path, {"parts": parts}, **tables)
    assert "complete" in refused("report", path)
    rewritten(path, {"complete": False})
    assert not FORMATS["report"].load(path).complete


def test_columns_of_parquet_are_judged_as_those_of_archives(tmp_path):
    """Written with a seal that is right, as a program that means harm would."""
    pytest.importorskip("pyarrow")
    from slcp_warp.runs import parts

    for change in ({"arm": "tired"}, {"step_size": -0.05}):
        path = report().save(tmp_path / "file.parquet")
        facts, rows = parts.read(path)
        facts["parts"][0] |= change
        path.write_bytes(parts.encode(rows, facts))
        assert next(iter(change)) in refused("report in columns", path)
