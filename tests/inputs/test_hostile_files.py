"""Every format that is read, damaged in every way: a valid object, or one error that names the file."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import FORMATS, outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import slcp_warp as slcp
from slcp_warp.scripts.support.records import read_kind


@pytest.fixture(params=FORMATS)
def example(request, tmp_path):
    """A format and a valid file of it."""
    form = FORMATS[request.param]
    path = tmp_path / f"file{form.suffix}"
    form.write(path)
    return form, path


def same_again(form, path, loaded):
    """What was loaded is whole: it can be written and read once more."""
    if hasattr(loaded, "save"):
        loaded.save(path)
    elif isinstance(loaded, slcp.Scene) and path.suffix == ".json":
        slcp.save_scene(loaded, path)
    assert outcome(form, path) is not None


def test_the_examples_are_valid(example):
    form, path = example
    loaded = form.load(path)
    assert loaded is not None
    same_again(form, path, loaded)


def test_a_file_cut_off_anywhere(example):
    form, path = example
    whole = path.read_bytes()
    for length in sorted({*range(min(60, len(whole))), *np.linspace(0, len(whole) - 1, 60, dtype=int)}):
        path.write_bytes(whole[:length])
        loaded = outcome(form, path)
        assert loaded is None or path.suffix in (".toml", ".csv", ".xml", ".json"), length


def test_a_byte_flipped_anywhere(example):
    form, path = example
    whole = path.read_bytes()
    kind = type(form.load(path))
    rng = np.random.default_rng(5)
    for place in rng.integers(len(whole), size=120):
        data = bytearray(whole)
        data[place] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(data))
        loaded = outcome(form, path)
        assert loaded is None or isinstance(loaded, kind), place


@pytest.mark.parametrize("name", FORMATS)
def test_any_bytes_mutated(name, tmp_path_factory):
    """Slices replaced, doubled, dropped: by Hypothesis."""
    form = FORMATS[name]
    path = tmp_path_factory.mktemp("mutated") / f"file{form.suffix}"
    form.write(path)
    whole = path.read_bytes()

    @settings(max_examples=40, deadline=None, derandomize=True, database=None,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(
        st.lists(
            st.tuples(st.floats(0, 1), st.integers(0, 40), st.binary(max_size=40)), min_size=1, max_size=4
        )
    )
    def mutate(edits):
        data = whole
        for place, length, put in edits:
            at = int(place * len(data))
            data = data[:at] + put + data[at + length :]
        path.write_bytes(data)
        loaded = outcome(form, path)
        if loaded is not None:
            same_again(form, path, loaded)

    mutate()


CONTENTS = {
    "nothing": b"",
    "zeros": bytes(100_000),
    "noise": np.random.default_rng(1).bytes(100_000),
    "text": b"x,u,K\n1,2,3\n",
    "brackets": b"[" * 200_000,
    "tables": b'{"a":' * 200_000,
    "a pickle": b"\x80\x04\x95\x0c\x00\x00\x00\x00\x00\x00\x00\x8c\x08builtins\x94.",
    "an array": b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }",
    "an empty archive": b"PK\5\6" + bytes(18),
    "UTF-16": "format = 'slcp-scene'".encode("utf-16"),
}


@pytest.mark.parametrize("content", CONTENTS)
def test_a_file_of_something_else(example, content):
    form, path = example
    path.write_bytes(CONTENTS[content])
    assert outcome(form, path) is None


def test_a_file_of_every_other_format(example, tmp_path):
    form, path = example
    for name, other in FORMATS.items():
        if other is not form:
            other.write(tmp_path / f"other{other.suffix}")
            path.write_bytes((tmp_path / f"other{other.suffix}").read_bytes())
            assert outcome(form, path) is None, name


def test_what_is_no_plain_file(example, tmp_path):
    """A folder, a pipe on which nobody writes, a device without an end, and nothing at all."""
    form, path = example
    path.unlink()
    with pytest.raises(FileNotFoundError, match=path.name):
        form.load(path)
    path.mkdir()
    assert outcome(form, path) is None
    path.rmdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(path)
        assert outcome(form, path) is None
        path.unlink()
    if Path("/dev/zero").exists():
        path.symlink_to("/dev/zero")
        assert outcome(form, path) is None


def test_a_file_that_is_too_large(example):
    """By its size alone: it has holes, and takes no room on the disk."""
    form, path = example
    with open(path, "r+b") as file:
        file.truncate(16 * 2**30)
    assert outcome(form, path) is None


def test_failures_inside_are_one_error(example, monkeypatch):
    """What no file of a test brings about: no permission, memory that runs out, a disk that fails."""
    form, path = example
    for failure in (
        PermissionError(13, "Permission denied"),
        MemoryError(),
        OSError(5, "Input/output error"),
    ):

        def fail(*arguments, failure=failure, **options):
            raise failure

        with monkeypatch.context() as patch:
            patch.setattr("builtins.open", fail)
            assert outcome(form, path) is None


def test_a_kind_is_named_or_refused(tmp_path):
    path = tmp_path / "file.npz"
    for name in ("library", "sweep", "trajectory", "plan", "surface"):
        FORMATS[name].write(path)
        assert read_kind(path) == name
