"""What --out means, by one rule for all commands; options that would do nothing; and times below a step."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import report
from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp.inputs.times import nearest_steps
from slcp_warp.scripts.commands.sensitivity import samples_within

TOML = Path(__file__).parents[2] / "examples" / "tasks" / "shove.toml"
ZERO = ("--policy", "zero")
FILES = {  # commands that write a file, without their --out
    "simulate": ("simulate", "--steps", 2),
    "optimise": ("optimise", TOML),
    "library": ("library", TOML),
    "sweep of a task": ("sweep", TOML, *ZERO),
    "sweep of a scene": ("sweep", *ZERO),
    "map": ("map", TOML, *ZERO, "--x", "mass=1:2:2", "--y", "friction=1:2:2"),
    "sensitivity": ("sensitivity", TOML, *ZERO),
    "rare": ("rare", TOML, *ZERO),
    "tune": ("tune", TOML, *ZERO, "--parameter", "mass=1:2"),
    "compare": ("compare", TOML, *ZERO, *ZERO, "--sequential"),
    "scenes": ("scenes",),
    "tasks": ("tasks",),
    "surface": ("paper", "surface"),
}
FOLDERS = {
    "falsify": ("falsify", TOML, *ZERO),
    "chart": ("chart", "report.csv"),
    "watch": ("watch", "cart_pole", "--no-browser"),
    "quickstart": ("quickstart", "--quick"),
}


@pytest.mark.parametrize("command", FILES)
def test_what_no_command_writes_is_refused_before_anything_is_computed(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "--out is x.mat" in fails(*FILES[command], "--out", "x.mat")
    assert os.listdir() == []


@pytest.mark.parametrize("command", FILES)
def test_a_folder_in_a_files_place_is_refused_before_anything_is_computed(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ending = {
        "scenes": "png",
        "tasks": "png",
        "map": "csv",
        "sensitivity": "csv",
        "rare": "csv",
        "tune": "csv",
    }
    ending |= {"sweep of a task": "csv"}
    name = f"x.{ending.get(command, 'npz')}"
    (tmp_path / name).mkdir()
    assert f"--out is {name}, which is no file" in fails(*FILES[command], "--out", name)
    assert os.listdir() == [name] and os.listdir(name) == []


@pytest.mark.parametrize("command", FOLDERS)
def test_a_files_name_in_a_folders_place_is_refused(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    for name in ("x.csv", "taken"):
        assert f"--out is {name}; a folder" in fails(*FOLDERS[command], "--out", name)
    assert os.listdir() == ["taken"]


def test_worlds_that_fail_have_a_file_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "--failing is x.csv" in fails(*FILES["rare"], "--failing", "x.csv")


IDLE = {  # options that would do nothing, and what is said
    ("compare", "report.csv", "--out", "x.npz"): "--out is given, of a task",
    ("compare", "report.csv", "--worlds", 5, "--measure", "x"): "--measure and --worlds are given",
    ("compare", "report.csv", "--gap", "end"): "--gap is given",
    ("sensitivity", "report.csv", "--samples", 5): "--samples is given, of a task",
    ("sensitivity", "report.csv", "--worlds", 5): "--worlds is given, of a task",
    ("sensitivity", TOML, *ZERO, "--worlds", 500, "--samples", 5): "--samples is given, and --worlds",
    ("sensitivity", TOML, *ZERO, "--worlds", 3): "--worlds is 3",
    ("simulate", TOML, "--scene", "hopper"): "--scene is given, and a task",
    ("sweep", TOML, *ZERO, "--scene", "hopper"): "--scene is given",
    ("sweep", TOML, *ZERO, "--threshold", 2): "--threshold is given",
    ("sweep", TOML, *ZERO, "--skip", 2): "--skip is given, without --start",
    ("watch", "--replay", "x.npz", "--worlds", 3): "--worlds is given, of a TASK",
}


@pytest.mark.parametrize("arguments", IDLE, ids=str)
def test_an_option_that_would_do_nothing_is_refused(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report().save("report.csv")
    assert IDLE[arguments] in fails(*arguments)
    assert os.listdir() == ["report.csv"]


def test_a_sensitivity_of_so_many_worlds(tmp_path):
    task = slcp.load_task(TOML)
    samples = samples_within(500, task)
    said = call("sensitivity", TOML, *ZERO, "--measure", "travel" if "travel" in task.measures else "success",
                "--worlds", 500, "--device", "cpu", "--out", tmp_path / "s.csv").output  # fmt: skip
    rows = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    each = len(np.atleast_1d(rows)) + 2
    assert samples * each <= 500 < (samples + 1) * each and f"{samples * each:,}" in said


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_search_runs_in_the_precision_that_is_asked_for(dtype, tmp_path, monkeypatch):
    asked = {}

    def search(*_args, **given):
        asked.update(given)
        raise slcp.ArgumentError("enough")

    monkeypatch.setattr(slcp, "falsify", search)
    assert "enough" in fails(*FOLDERS["falsify"], "--dtype", dtype, "--out", tmp_path / "found")
    assert asked["dtype"] == dtype


def block(**changes):
    values = {"cost": slcp.costs.terms(slcp.scenes.push_block(), [slcp.costs.effort(1.0)]), "horizon": 5}
    return slcp.Task("push", slcp.scenes.push_block(), **(values | changes))


@pytest.mark.parametrize("duration", [1e-9, 0.4])
def test_a_run_of_less_than_half_a_step_is_refused(duration, tmp_path):
    """At every door: tasks, their files and commands, sweeps of other step sizes."""
    h = slcp.scenes.push_block().step_size
    span, least = duration * h, 0.51 * h
    with pytest.raises(slcp.InputError, match=r"Task\.duration is .* less than half a step"):
        block(duration=span)
    task = block(duration=least)
    assert task.steps == 1
    path = slcp.save_task(task, tmp_path / "task.json") or tmp_path / "task.json"
    text = path.read_text()
    path.write_text(text.replace(repr(least), repr(span)))
    assert "Task.duration is" in fails("simulate", path, "--out", tmp_path / "x.npz")
    path.write_text(text)
    assert "less than half a step" in fails(
        "sweep", path, *ZERO, "--duration", span, "--out", tmp_path / "x.csv"
    )
    assert "less than half a step" in fails(
        "simulate", path, "--step-size", 4.0 * h, "--out", tmp_path / "x.npz"
    )
    with pytest.raises(slcp.InputError, match="less than half a step of step_sizes"):
        slcp.sweep(task, slcp.policies.Linear(np.zeros((1, 8)), np.zeros(8), [0.0]), step_sizes=[4.0 * h])


def test_spans_are_the_nearest_steps():
    """A half up; a tenth in tenths is one step whatever the last place of its quotient is."""
    for steps in range(1, 60):
        for span in (0.1 * steps, 0.1 * steps + 0.04, 0.1 * steps - 0.04):
            assert nearest_steps("span", span, 0.1) == steps
    assert [nearest_steps("span", each, 0.5) for each in (0.25, 0.74, 0.75, 1.0)] == [1, 1, 2, 2]
