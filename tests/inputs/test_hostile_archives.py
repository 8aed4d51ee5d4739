"""Archives made to hurt: bombs, lies about sizes, foreign types, numbers that cannot be."""

import json
import os
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import FORMATS, library, outcome, rewritten

from slcp_warp import ddp
from slcp_warp.storage.archive import open_archive, write_archive
from slcp_warp.storage.files import FileError

NAN, INF = np.nan, np.inf


def written(folder, name):
    form = FORMATS[name]
    path = folder / f"file{form.suffix}"
    form.write(path)
    return form, path


def repacked(path, change=None, **options):
    """The archive written again member by member; `change` edits (name, bytes) and may give several."""
    with zipfile.ZipFile(path) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    with zipfile.ZipFile(path, "w", **options) as archive:
        for member in members:
            for name, data in change(*member) if change else [member]:
                archive.writestr(name, data)


def npy(header, data=b"", version=1):
    """A .npy file with a header text of its own."""
    size = struct.pack("<H" if version == 1 else "<I", len(header))
    return b"\x93NUMPY" + bytes([version, 0]) + size + header.encode() + data


def only(name, data):
    """Replace one member's bytes."""
    return lambda n, old: [(n, data if n == name else old)]


X = "x.npy"
FLOAT = "{'descr': '<f8', 'fortran_order': False, 'shape': %s, }\n"
LIBRARIES = {
    "twice the same array": lambda n, d: [(n, d)] * (1 + (n == X)),
    "a huge shape": only(X, npy(FLOAT % "(6, 1000000000000)")),
    "a shape beyond integers": only(X, npy(FLOAT % f"(6, {10**30})")),
    "negative shapes": only(X, npy(FLOAT % "(-6, -4)", bytes(192))),
    "no entries, much width": only(X, npy(FLOAT % "(0, 1000000000000)")),
    "objects": only(X, npy("{'descr': '|O', 'fortran_order': False, 'shape': (6, 4), }\n", b"\x80\x04N.")),
    "records": only(X, npy((FLOAT % "(6, 4)").replace("'<f8'", "[('a', '<f8')]"), bytes(192))),
    "texts without letters": only(
        "header.npy", npy("{'descr': '<U0', 'fortran_order': False, 'shape': (), }\n")
    ),
    "a header without end": only(X, npy("(" * 60_000)),
    "a header of Python": only(X, npy((FLOAT % "()").replace("'<f8'", "__import__('os').abort()"))),
    "a large header": only(X, npy(" " * 2**22, version=2)),
    "an array cut off": only(X, npy(FLOAT % "(6, 4)", bytes(100))),
    "an array that goes on": only(X, npy(FLOAT % "(6, 4)", bytes(200))),
    "no array": only(X, b"hello"),
    "letters that are none": only(
        "header.npy", npy("{'descr': '<U2', 'fortran_order': False, 'shape': (), }\n", b"\xff" * 8)
    ),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("what", LIBRARIES)
def test_members_that_are_not_what_they_say(tmp_path, what):
    form, path = written(tmp_path, "library")
    repacked(path, LIBRARIES[what])
    assert outcome(form, path) is None


@pytest.mark.parametrize(
    "shape", ["(6, 1000000000000)", f"(6, {10**30})", "(-6, -4)", "(0, 1000000000000)", "(6, 5)"]
)
def test_a_shape_is_judged_before_memory_is_set_aside(tmp_path, shape):
    """Whatever memory there is: a system may promise what it does not have."""
    _, path = written(tmp_path, "library")
    repacked(path, only(X, npy(FLOAT % shape, bytes(192))))
    with pytest.raises(FileError, match="'x' has shape"), open_archive(path) as archive:
        archive.read("x")


@pytest.mark.parametrize("kind", [bool, complex, "U3", "S3", "M8[s]"])
def test_only_numbers_are_numbers(tmp_path, kind):
    path = tmp_path / "file.npz"
    np.savez(path, header=np.array("{}"), x=np.zeros(3, kind))
    with pytest.raises(FileError, match="'x' is of type .*; numbers needed"), open_archive(path) as archive:
        archive.read("x")


@pytest.mark.parametrize("text", [
    '{"format": "slcp-warp-library", "version": 1, "version": 1}', "[1]", "3", "null", "", "{",
    '{"a": ' * 100_000, "[" * 100_000, '{"format": "slcp-warp-library", "version": true}',
    '{"format": ["slcp-warp-library"]}',
    '{"format": "slcp-warp-library", "version": 1e400}', '{"format": {}, "version": {}}',
])  # fmt: skip
def test_headers(tmp_path, text):
    for name in ("library", "sweep", "trajectory"):
        form, path = written(tmp_path, name)
        with np.load(path) as archive:
            data = dict(archive)
        np.savez(path, **(data | {"header": np.array(text.replace("library", name))}))
        assert outcome(form, path) is None


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions(tmp_path, method):
    form, path = written(tmp_path, "library")
    repacked(path, compression=method)
    assert outcome(form, path) is None


@pytest.mark.parametrize(("place", "value"), [(8, 1), (10, 6), (10, 97), (24, 2**31), (20, 0), (42, 2**31)])
def test_lies_in_the_directory(tmp_path, place, value):
    """Encrypted, an unknown compression (NotImplementedError), other sizes, another place."""
    form, path = written(tmp_path, "library")
    data = bytearray(path.read_bytes())
    at = data.find(b"PK\1\2")
    size = 2 if place < 20 else 4
    data[at + place : at + place + size] = value.to_bytes(size, "little")
    path.write_bytes(bytes(data))
    assert outcome(form, path) is None


def test_a_name_in_the_directory_that_the_array_has_not(tmp_path):
    """Arrays that may be missing, controls or impulses of a run, were lost by one damaged letter."""
    form, path = written(tmp_path, "trajectory")
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    for name in names:
        data = bytearray(whole)
        data[data.rindex(name.encode())] ^= 1
        path.write_bytes(bytes(data))
        assert outcome(form, path) is None, name


def test_a_directory_that_is_too_long(tmp_path):
    path = tmp_path / "file.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for i in range(30_000):
            archive.writestr(f"array{i:06}.npy", b"")
    assert outcome(FORMATS["library"], path) is None
    with pytest.raises(FileError, match="lists its arrays in"), open_archive(path):
        pass


BOMB = """
import resource, sys, zipfile
import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.support.records import load_record, RecordError
used = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmSize"))
resource.setrlimit(resource.RLIMIT_AS, (1024 * used + 2**27,) * 2)  # 128 MB more than what is loaded
for path, kind in zip(sys.argv[1::2], sys.argv[2::2]):
    try:
        {"library": ddp.Library.load, "sweep": slcp.SweepReport.load,
         "trajectory": lambda p: load_record(p, "trajectory")}[kind](path)
        print("loaded")
    except ValueError as error:
        print(type(error).__name__, error)
"""


def bomb(path, name):
    """Put 384 MB of zeros into a member that is named so; the file is a hundredth of that."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    members.pop(name, None)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for other, data in members.items():
            archive.writestr(other, data)
        with archive.open(name, "w", force_zip64=True) as file:
            file.write(npy(FLOAT % f"({3 * 2**24},)"))
            for _ in range(6):
                file.write(bytes(2**26))


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="memory is bounded by Linux")
def test_bombs_take_no_memory(tmp_path):
    """A member that nobody needs is not unpacked; one that is needed is refused before it is."""
    arguments = []
    for kind, member in (("library", "other"), ("library", "x"), ("sweep", "other"), ("sweep", "table_rate"),
                         ("trajectory", "param_mass")):  # fmt: skip
        form = FORMATS[kind]
        path = tmp_path / f"{kind}_{member}.npz"
        form.write(path)
        bomb(path, f"{member}.npy")
        assert path.stat().st_size < 10 * 2**20
        arguments += [str(path), kind]
    safe = os.environ | {"PYTHONSAFEPATH": "1"}
    done = subprocess.run([sys.executable, "-c", BOMB, *arguments], capture_output=True, text=True, env=safe)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines] == [
        "loaded", "LibraryError", "loaded", "FileError", "RecordError"
    ]  # fmt: skip
    assert all("more memory than there is" in line for line in lines if line != "loaded"), lines


def test_the_limit_can_be_set(tmp_path, monkeypatch):
    form, path = written(tmp_path, "library")
    monkeypatch.setenv("SLCP_WARP_MOST_BYTES", "600")
    assert outcome(form, path) is None
    monkeypatch.setenv("SLCP_WARP_MOST_BYTES", "1e9")
    with pytest.raises(ddp.LibraryError, match="SLCP_WARP_MOST_BYTES must be a whole number"):
        form.load(path)


SENSE = {
    "library": {
        "a negative period": {"period": np.array([0.0, -1.0, 0.0, 0.0])},
        "a chain of halves": {"chain": np.full(6, 0.5)},
        "a negative age": {"age": np.full(6, -1)},
        "costs of another length": {"cost": np.zeros(5)},
        "an infinite gain": {"K": np.full((6, 2, 4), INF)},
        "truths for numbers": {"x": np.zeros((6, 4), bool)},
        "complex states": {"x": np.zeros((6, 4), complex)},
    },
    "sweep": {
        "a status of 77": {"table_status": np.full(3, 77)},
        "columns of unequal length": {"table_rate": np.zeros(4)},
        "a column of two axes": {"table_rate": np.zeros((3, 1))},
        "a column missing": {"table_rate": None},
        "texts for rates": {"table_rate": np.full(3, "fast")},
        "numbers for residuals": {"table_residual": np.zeros(3)},
        "samples of other worlds": {"samples_0": np.zeros((4, 3))},
        "no samples": {"samples_0": None},
    },
    "trajectory": {
        "a status of 77": {"status": np.full(2, 77)},
        "a step too few": {"controls": np.zeros((2, 2, 0))},
        "states of another scene": {"states": np.ones((2, 4, 99))},
        "NaN in a solved world": {"states": np.full((2, 4, 6), NAN)},
        "a negative mass": {"param_mass": np.array([-1.0])},
        "parameters of other worlds": {"param_step_size": np.full(5, 0.1)},
        "a parameter missing": {"param_mass": None},
    },
    "plan": {
        "another horizon": {"us": np.zeros((7, 2))},
        "a trace of another length": {"trace_cost": np.zeros(9)},
        "a level beyond": {"trace_level": np.full(4, 3)},
        "no pass": {"trace_cost": np.zeros(0)},
        "NaN gains": {"K": np.full((2, 2, 6), NAN)},
    },
    "surface": {
        "an axis that falls": {"axis0": np.array([1.0, 0.0])},
        "a gap for another grid": {"gap": np.zeros((2, 2, 3))},
        "NaN": {"gap": np.full((2, 2, 2), NAN)},
    },
}  # fmt: skip


def test_a_file_that_is_only_rewritten_is_read(tmp_path):
    for name in SENSE:
        form, path = written(tmp_path, name)
        rewritten(path)
        assert outcome(form, path) is not None


@pytest.mark.parametrize(("name", "what"), [(name, what) for name in SENSE for what in SENSE[name]])
def test_arrays_that_make_no_sense(tmp_path, name, what):
    form, path = written(tmp_path, name)
    rewritten(path, **SENSE[name][what])
    assert outcome(form, path) is None


FIELDS = {
    "sweep": ({"cases": None}, {"cases": {}}, {"cases": [3]}, {"cases": [{}]}, {"spec": []}, {"spec": {}},
              {"complete": 1}, {"complete": None}, {"cases": []}),
    "trajectory": ({"scene_file": None}, {"scene_file": 3}, {"scene_file": {"format": "x"}},
                   {"options": None}, {"options": {"residual": "soft"}}, {"options": {"colour": 1}},
                   {"options": {"gap": []}},
                   {"version": 3}, {"version": None}),
}  # fmt: skip


@pytest.mark.parametrize(("name", "fields"), [(n, f) for n in FIELDS for f in FIELDS[n]], ids=str)
def test_header_fields_that_make_no_sense(tmp_path, name, fields):
    form, path = written(tmp_path, name)
    rewritten(path, fields)
    assert outcome(form, path) is None


@pytest.mark.parametrize("change", [
    {"worlds": 4}, {"worlds": -1}, {"worlds": True}, {"worlds": None}, {"residual": 3}, {"step_size": -0.1},
    {"step_size": NAN}, {"statuses": {"SOLVED": 2}}, {"statuses": {"LOST": 3, "SOLVED": 0}}, {"statuses": []},
    {"mean_rate": [1.0, 2.0]}, {"mean_rate": "fast"}, {"share_above": [True, 0, 0]},
])  # fmt: skip
def test_cases_that_make_no_sense(tmp_path, change):
    form, path = written(tmp_path, "sweep")
    with np.load(path) as archive:
        (case,) = json.loads(str(archive["header"]))["cases"]
    rewritten(path, {"cases": [case | change]})
    assert outcome(form, path) is None


def test_a_header_that_cannot_be_written_is_refused(tmp_path):
    endless = {}
    endless["itself"] = endless
    for header in ({"a": object()}, {"a": np.zeros(3)}, endless):
        with pytest.raises(FileError, match="file.npz: its header holds what JSON cannot"):
            library(header=header).save(tmp_path / "file.npz")
    assert list(tmp_path.iterdir()) == []


def test_only_what_is_needed_is_looked_at(tmp_path):
    """Other arrays, whatever they are, do no harm."""
    form, path = written(tmp_path, "library")
    rewritten(path, other=np.array([None], dtype=object))
    assert len(form.load(path)) == 6


SOUND = [
    np.zeros(3),
    np.array(2.5),
    np.ones((2, 3), np.float32),
    np.asfortranarray(np.eye(4)[:, :3]),
    np.array("text"),
    np.array(["a", "bb"]),
    np.zeros((0, 3), np.int32),
    np.array([True]),
    np.ones((2, 1, 2), ">f8"),
]


def test_headers_are_those_of_numpy_without_pythons_parser(tmp_path, monkeypatch):
    """In CPython 3.11 a thread that parses makes another's raise: a sound policy was told to be damaged."""
    path = tmp_path / "sound.npz"
    write_archive(path, {"a": 1}, {f"n{i}": array for i, array in enumerate(SOUND)})

    def mismatch(*_):
        raise SystemError("AST constructor recursion depth mismatch (before=76, after=69)")

    monkeypatch.setattr("ast.literal_eval", mismatch)
    with open_archive(path) as archive:
        for i, array in enumerate(SOUND):
            found = archive.read(f"n{i}", "fibU")
            np.testing.assert_array_equal(found, array)
            assert found.shape == array.shape and found.flags.f_contiguous == array.flags.f_contiguous
