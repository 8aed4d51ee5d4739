"""Benchmarks and studies lie in a checkout: found from inside of one, said to be there from outside."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import slcp_warp
from slcp_warp.scripts.support.checkout import ROOMS, checkout_scripts

pytest.importorskip("typer")
ROOT = Path(__file__).resolve().parents[2]
SPAWNED = """
import multiprocessing
from slcp_warp.scripts.benchmarks.fuzz.draws import decades
if __name__ == "__main__":
    from concurrent.futures import ProcessPoolExecutor
    import numpy as np
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        print(pool.submit(decades, np.random.default_rng(0), 2.0, 2.0, 1).result())
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Runs an interpreter that sees the package as a wheel installs it."""
    site = tmp_path_factory.mktemp("site")
    package = site / "slcp_warp"
    (package / "scripts").mkdir(parents=True)
    for path in (ROOT / "slcp_warp").iterdir():
        (package / path.name).symlink_to(path)
    for name in ("kernels", "ddp"):
        (package / name).symlink_to(ROOT / name)
    for path in (ROOT / "scripts").iterdir():
        if path.name not in ROOMS:
            (package / "scripts" / path.name).symlink_to(path)
    paths = os.pathsep.join([str(site), *filter(None, sys.path)])

    def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
        here = {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-S", *arguments]  # -S: without the finder of an editable install
        return subprocess.run(
            command, cwd=folder, env=os.environ | here, capture_output=True, text=True, timeout=300
        )

    return run


def test_a_checkout_is_found_from_below(tmp_path):
    (tmp_path / "deep" / "deeper").mkdir(parents=True)
    for room in ROOMS:
        (tmp_path / "scripts" / room).mkdir(parents=True)
    project = tmp_path / "pyproject.toml"
    for text, found in (
        (f'[project]\nname = "slcp-warp"\nversion = "{slcp_warp.__version__}"\n', tmp_path / "scripts"),
        ('[project]\nname = "slcp-warp"\nversion = "0.0.9"\n', None),
        ('[project]\nname = "other"\nversion = "0.1.0"\n', None),
        ("[tool.ruff]\n", None),
        ("not = [toml", None),
    ):
        project.write_text(text)
        assert checkout_scripts(tmp_path / "deep" / "deeper") == found
    assert checkout_scripts(ROOT / "tests") == ROOT / "scripts"


@pytest.mark.parametrize("command", [("bench", "step", "--worlds", "3"), ("car", "--help")])
def test_outside_of_a_checkout_one_line_says_where_they_are(python, tmp_path, command):
    done = python(tmp_path, "-m", "slcp_warp.scripts.main", *command)
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"slcp: slcp {command[0]}: only inside of a checkout")
    assert "scripts/benchmarks and scripts/studies" in line
    assert slcp_warp.__version__ in line


def test_inside_of_a_checkout_they_run(python):
    done = python(ROOT / "docs", "-m", "slcp_warp.scripts.main", "bench", "fuzz", "--help")
    assert done.returncode == 0 and "--structures" in done.stdout, done.stderr
    done = python(ROOT / "docs", "-m", "slcp_warp.scripts.main", "car", "--help")
    assert done.returncode == 0 and "hairpin" in done.stdout, done.stderr


def test_spawned_processes_find_them(python, tmp_path):
    script = tmp_path / "spawned.py"
    script.write_text(SPAWNED)
    done = python(ROOT, str(script))
    assert done.stdout.strip() == "[100.]", done.stderr


def test_no_command_takes_the_name_of_another():
    """Former names of studies are commands, too: the later of two of one name would be what runs."""
    from slcp_warp.scripts.app import app, paper

    for group in (app, paper):
        names = [each.name for each in group.registered_commands]
        assert len(set(names)) == len(names), names
