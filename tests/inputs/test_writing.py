"""Files are written whole or not at all: full disks, kills and broken writers leave the old one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
pytest.importorskip("resource")

import resource

import matplotlib.pyplot as plt
from file_examples import FORMATS, library, sweep_report, trajectory

import slcp_warp as slcp
from slcp_warp.scripts.charts.style import save
from slcp_warp.storage.files import replacing, write_text

OURS = [name for name in FORMATS if name not in ("toml", "mjcf", "task in toml")]  # only read


def picture(path):
    figure, _ = plt.subplots()
    save(figure, path)


WRITERS = {name: (FORMATS[name].suffix, FORMATS[name].write) for name in OURS} | {
    "picture": (".png", picture),
    "table": (".csv", lambda path: sweep_report().save(path)),
    "text": (".md", lambda path: write_text(path, "x" * 1000)),
}


def is_alone(path):
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file(tmp_path, name):
    """A limit on the size of files does what a full disk does: a write fails on the way."""
    suffix, write = WRITERS[name]
    path = tmp_path / f"file{suffix}"
    write(path)
    whole = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (16, hard))
    try:
        with pytest.raises(OSError, match="cannot be written .*; what was there is unchanged") as caught:
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert str(path) in str(caught.value)
    assert path.read_bytes() == whole
    is_alone(path)


def test_a_disk_that_is_really_full(tmp_path):
    """On a small file system of its own, where this user may make one."""
    script = f"""
        mount -t tmpfs -o size=64k none {tmp_path} || exit 77
        {sys.executable} -c "
from pathlib import Path
from file_examples import library
import numpy as np
path = Path('{tmp_path}/library.npz')
library().save(path)
whole = path.read_bytes()
noise = np.random.default_rng(0).standard_normal(9000)
large = library().select(np.arange(9000) % 6)
large.cost[:] = noise
try:
    large.save(path)
except OSError as error:
    print('No space left' in str(error), path.read_bytes() == whole, len(list(path.parent.iterdir())))
"
    """
    support = Path(__file__).parents[1] / "support"
    paths = os.pathsep.join(filter(None, [str(support), os.environ.get("PYTHONPATH")]))
    if shutil.which("unshare") is None:
        pytest.skip("no small file system can be made here")
    done = subprocess.run(["unshare", "--mount", "bash", "-c", script], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": paths})  # fmt: skip
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip("no small file system can be made here")
    assert done.stdout.split() == ["True", "True", "1"], done.stderr


def test_a_kill_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.md"
    write_text(path, "old")
    code = f"""
import os, signal
from slcp_warp.storage.files import replacing
with replacing({str(path)!r}) as part:
    part.write_text("half of the n")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | {"PYTHONSAFEPATH": "1"})
    assert done.returncode != 0 and path.read_text() == "old"


@pytest.mark.parametrize("error", [ValueError("wrong"), KeyboardInterrupt()], ids=repr)
def test_a_writer_that_fails_leaves_the_old_file(tmp_path, error):
    path = tmp_path / "a.md"
    write_text(path, "old")
    with pytest.raises(type(error)):
        with replacing(path) as part:
            part.write_text("half of the n")
            raise error
    assert path.read_text() == "old"
    is_alone(path)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    places = [tmp_path / "nowhere" / "a.npz", tmp_path / "file" / "a.npz", tmp_path / "folder.npz"]
    places[2].mkdir()
    for path in places:
        for thing in (library(), sweep_report(), trajectory()):
            with pytest.raises(OSError, match="cannot be written") as caught:
                thing.save(path)
            assert str(path) in str(caught.value)


def test_links_and_rights_stay(tmp_path):
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "real.json").chmod(0o640)
    (tmp_path / "link.json").symlink_to("real.json")
    slcp.save_scene(slcp.scenes.particle(), tmp_path / "link.json")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").stat().st_mode & 0o777 == 0o640
    assert slcp.load_scene(tmp_path / "real.json") == slcp.scenes.particle()
