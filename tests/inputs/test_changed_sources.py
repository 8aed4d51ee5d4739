"""Kernels are made from the files that a process began with, or not at all."""

import os

import pytest

from slcp_warp.kernels import factories


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.setattr(factories, "EVERY", 0.0)
    (tmp_path / "room").mkdir()
    for name in ("a.py", "room/b.py", "note.txt"):
        (tmp_path / name).write_text("1\n")
    (tmp_path / ".#a.py").symlink_to("nobody@nowhere.1")  # as an editor locks a file
    monkeypatch.setattr(factories, "_sources", factories.Sources(tmp_path))
    return tmp_path


def test_what_is_unchanged_is_made_once(sources):
    calls = []

    @factories.cached
    def make(value):
        calls.append(value)
        return value

    assert make(3) == make(3) == 3 and calls == [3]
    (sources / "note.txt").write_text("2\n")
    (sources / "new.py").write_text("2\n")
    (sources / ".#a.py").unlink()
    (sources / "room" / "b.py").touch()
    os.utime(sources / "a.py", ns=(1, 1))
    assert make(4) == 4


@pytest.mark.parametrize("change", ["longer", "other", "gone"])
def test_nothing_is_made_from_other_files(sources, change):
    make = factories.cached(lambda value: value)
    assert make(1) == 1
    path = sources / "room" / "b.py"
    if change == "gone":
        path.unlink()
    else:
        path.write_text("2\n" if change == "other" else "1 + 1\n")
        os.utime(path, ns=(1, 1))
    assert make(1) == 1  # there already
    with pytest.raises(factories.SourcesChangedError, match=f"{path.name} is not the file that this process"):
        make(2)
    with pytest.raises(OSError):
        make(2)


def test_files_are_looked_at_now_and_then(sources, monkeypatch):
    monkeypatch.setattr(factories, "EVERY", 1e9)
    (sources / "a.py").write_text("1 + 1\n")
    assert factories.cached(lambda value: value)(2) == 2
