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
    found = factories.Sources(tmp_path)
    monkeypatch.setattr(factories, "_sources", found)
    return found


def test_what_is_unchanged_is_made_once(sources):
    calls = []

    @factories.cached
    def make(value):
        calls.append(value)
        return value

    assert make(3) == make(3) == 3 and calls == [3]
    (sources.folder / "note.txt").write_text("2\n")
    assert make(4) == 4


@pytest.mark.parametrize("change", ["longer", "touched", "new", "gone"])
def test_nothing_is_made_from_other_files(sources, change):
    make = factories.cached(lambda value: value)
    assert make(1) == 1
    path = sources.folder / "room" / ("c.py" if change == "new" else "b.py")
    if change == "gone":
        path.unlink()
    elif change == "touched":
        os.utime(path, ns=(1, 1))
    else:
        path.write_text("1 + 1\n")
    assert make(1) == 1  # there already
    with pytest.raises(factories.SourcesChangedError, match=f"{path.name} is not the file that this process"):
        make(2)
    with pytest.raises(OSError):
        make(2)


def test_files_are_looked_at_now_and_then(sources, monkeypatch):
    monkeypatch.setattr(factories, "EVERY", 1e9)
    (sources.folder / "a.py").write_text("1 + 1\n")
    assert factories.cached(lambda value: value)(2) == 2
