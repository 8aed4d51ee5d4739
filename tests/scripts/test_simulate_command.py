"""`slcp simulate` says what overlaps, where a world fails, and which options exclude others."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp import ddp


def test_simulate_says_what_overlaps_where_a_world_fails(tmp_path):
    """A disc of .25 m in the middle of a box of .4 m, whose sides are capsules of .02 m .18 m off."""
    held = slcp.Scene(
        name="held",
        bodies=tuple(slcp.Body(name, 1.0, 0.01, joint="free") for name in ("box", "ball")),
        shapes=(
            *slcp.box("b", "box", 0.4, 0.4, corner_radius=0.02, sides=True),
            slcp.Shape("disc", "ball", "disc", 0.25),
        ),
        contacts="auto",
    )
    file, out = tmp_path / "held.json", tmp_path / "held.npz"
    slcp.save_scene(held, file)
    given = ("simulate", "--scene", file, "--steps", 3, "--residual", "hard", "--device", "cpu", "--out", out)
    lines = call(*given, code=1).stderr.splitlines()
    start = next(line for line in lines if line.startswith("slcp: the start overlaps: "))
    assert all(f"b{side}/disc by 0.09" in start for side in ("01", "12", "23", "30"))
    failed = next(line for line in lines if line.startswith("slcp: world 0 is INFEASIBLE in step 1 of 3; "))
    assert failed.count("/disc by 0.09") == 3 and failed.endswith("and 5 more")
    assert out.exists()
    apart = call(*given, "--start", "0,0,0,2,0,0,0,0,0,0,0,0").stderr
    assert "overlaps" not in apart


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--set", "mass=1", "--set", "mass=2"], "--set mass is given more than once"),
        (["--set", "step_size=.1", "--step-size", ".2"], "--set step_size and --step-size are both given"),
        (["--set", "sigma=.1", "--sigma", ".2"], "--set sigma and --sigma are both given"),
        (["--steps", "99999999999999999999"], "--steps is 99999999999999999999; a whole number below 2^31"),
        (["--steps", "2000000000", "--worlds", "1000"], "--steps would take 1.192e+05 GiB"),
        (["--residual", "hard", "--sigma", ".1"], "--sigma is 0.1, which the hard problem has not"),
    ],
)
def test_what_would_be_dropped_or_does_not_fit_is_refused(options, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert says in fails("simulate", "--device", "cpu", *options)
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_takes_policies_by_name_and_cases_once(tmp_path):
    out = tmp_path / "still.npz"
    call("sweep", "--policy", "zero", "--worlds", 2, "--duration", 1, "--residuals", "hard", "--step-sizes",
         0.05, "--device", "cpu", "--out", out)  # fmt: skip
    assert slcp.SweepReport.load(out).cases[0]["worlds"] == 2
    said = fails("sweep", "push_to_mark", "--policy", "zero", "--residuals", "hard,hard", "--device", "cpu")
    assert "--residuals is 'hard,hard', which names hard more than once" in said


def test_a_start_may_name_some_of_its_numbers(tmp_path):
    out = tmp_path / "run.npz"
    arguments = ("simulate", "push_to_mark", "--steps", 2, "--device", "cpu", "--out", out)
    call(*arguments, "--start", "block.x=0.3, block.vx=-1")
    first, task = slcp.Trajectory.load(out).states[0, 0], slcp.load_task("push_to_mark")
    named = {"block.x": 0.3, "block.vx": -1.0}
    expected = [named.get(name, x) for name, x in zip(task.scene.state_names, task.start[0])]
    np.testing.assert_allclose(first, expected)
    assert "--start block.x is 'far'" in call(*arguments, "--start", "block.x=far", code=2).stderr
    assert "block.z" in call(*arguments, "--start", "block.z=1", code=2).stderr


def test_plans_whose_gains_are_none_are_named(tmp_path):
    task = slcp.load_task("push_to_mark")
    plan = ddp.solve(ddp.problem_of(task), task.start[0], options=ddp.Options(max_iterations=2))
    arguments = ("simulate", "push_to_mark", "--steps", 2, "--device", "cpu", "--out", tmp_path / "run.npz")
    for changes, said in (
        ({"min_pivot": np.array(0.1)}, ""),
        (
            {"min_pivot": np.array(-0.1)},
            "ended MAX_ITERATIONS where Q_uu is not positive definite: no minimum",
        ),
        (
            {"status": np.array(int(ddp.Status.DYNAMICS_FAILED))},
            "ended DYNAMICS_FAILED: the dynamics, the cost",
        ),
    ):
        path = replace(plan, **changes).save(tmp_path / "plan.npz")
        told = " ".join(call(*arguments, "--policy", path).stderr.split())
        assert said in told if said else "ended" not in told


def test_who_has_read_enough_ends_it_quietly(tmp_path):
    """Of a pipe that is closed; the file is written."""
    code = "from slcp_warp.scripts.app import app; app()"
    rows = [f"{name},hard,0.1,disturbed,{i},{i / 10},{name == 'a'},0" for name in "ab" for i in range(9)]
    report, out = tmp_path / "report.csv", tmp_path / "found.csv"
    head = "policy,case,step_size,arm,world,drawn_mass,success,status"
    report.write_text("\n".join([head, *rows]) + "\n")
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-c", code, "sensitivity", str(report), "--out", str(out)]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True,
                          env=os.environ | {"PYTHONSAFEPATH": "1"})  # fmt: skip
    os.close(write)
    assert done.returncode in (0, 1) and "Broken pipe" not in done.stderr and out.exists()
