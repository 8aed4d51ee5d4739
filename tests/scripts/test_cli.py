"""The command line: every command on tiny settings, its files, and what bad input comes to."""

import dataclasses
import io
import json
import os
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp import ddp, scenes
from slcp_warp.results.pictures.frames import frame_steps
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.results.simulated import Simulated
from slcp_warp.scripts.app import app
from slcp_warp.scripts.benchmarks.commands import app as bench_app
from slcp_warp.scripts.charts.cycle import last_turn
from slcp_warp.scripts.charts.isosurface import isosurface
from slcp_warp.scripts.stages.trajectory import summary
from slcp_warp.scripts.support.records import Record, RecordError, load_policy, load_record, read_kind
from slcp_warp.scripts.support.screen import one_line_errors
from slcp_warp.storage.archive import write_archive

FLOAT32 = ["--device", "cpu", "--dtype", "float32"]


def call(*arguments, code: int = 0):
    """Run a command; its exit code must be `code`."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + str(result.exception)
    return result


def fails(*arguments) -> str:
    """Run a command that must end with exit code 2 and one line; the line."""
    result = call(*arguments, code=2)
    assert not isinstance(result.exception, Exception)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("slcp: "), result.stderr
    return lines[0]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a small plan, library, trajectory, surface and sweep, made by the commands."""
    folder = tmp_path_factory.mktemp("cli")
    call("optimise", "--passes", 4, "--horizon", 30, "--starts", 1, "--method", "second-order",
         "--device", "cpu", "--out", folder / "plan.npz")  # fmt: skip
    call("library", "--plans", 3, "--entries", 2, "--rounds", 1, "--passes", 2, "--horizon", 15,
         "--device", "cpu", "--out", folder / "library.npz")  # fmt: skip
    call("simulate", "--policy", folder / "library.npz", "--worlds", 3, "--steps", 30, "--velocity-sd", 0.5,
         "--out", folder / "cycle.npz", *FLOAT32)  # fmt: skip
    call("surface", "--resolution", 9, "--device", "cpu", "--out", folder / "surface.npz")
    call("sweep", "--policy", folder / "library.npz", "--worlds", 6, "--duration", 6,
         "--residuals", "smoothed", "--start", folder / "cycle.npz",
         "--skip", 0.5, "--vary", "mass=0.1", "--kick-times", 2,
         "--device", "cpu", "--out", folder / "sweep.npz")  # fmt: skip
    return folder


def test_simulate_saves_what_the_simulator_gives(tmp_path):
    path = tmp_path / "new folder" / "free.npz"
    call("simulate", "--steps", 12, "--start", "-0.4,-0.5,0.2,0,0,1", "--step-size", 0.03,
         "--set", "friction=0.3", "--device", "cpu", "--out", path)  # fmt: skip
    record = load_record(path, "trajectory")
    sim = slcp.Simulator(scenes.flicking_finger(), slcp.Options(scaling="none"), device="cpu")
    params = sim.params.replace(step_size=0.03, friction=0.3)
    x0, us = np.array([[-0.4, -0.5, 0.2, 0.0, 0.0, 1.0]]), np.zeros((1, 12, 2))
    expected = sim.rollout(x0, us, params, record=("controls", "impulse", "gap"))  # in the same kernel
    np.testing.assert_array_equal(record["states"], expected.states)
    np.testing.assert_array_equal(record.simulated.parameters["friction"], [0.3])
    assert record.step_size == 0.03 and record.simulated.options.residual == "rem-logistic"
    assert record["impulse"].shape == (1, 12, 6) and record["contact_impulse"].shape == (1, 12, 1, 2)
    call("simulate", "flicking_finger", "--step-size", 0.5, "--device", "cpu", "--out", path)
    seconds = slcp.tasks.flicking_finger().duration
    assert load_record(path, "trajectory")["states"].shape[1] == 1 + round(seconds / 0.5)  # the task's run


def test_optimise_saves_a_policy(made):
    record = load_record(made / "plan.npz", "plan")
    assert record["xs"].shape == (31, 6) and record["trace_cost"].shape == record["trace_level"].shape
    policy, facts = load_policy(made / "plan.npz", scenes.flicking_finger())
    assert isinstance(policy, ddp.TrackingPolicy) and facts["policy"] == "tracking"


def test_plans_of_python_are_drawn(made, tmp_path):
    """They hold a trace and no noise levels; of a batch the cheapest is drawn before the others."""
    one = ddp.Result.load(made / "plan.npz").record()
    arrays = {name: each for name, each in one.arrays.items() if "level" not in name}
    many = {name: np.stack([each, each]) for name, each in arrays.items()}
    many["cost"][0] = np.nan  # never solved
    for name, held in (("one", arrays), ("many", many)):
        dataclasses.replace(one, arrays=held).save(tmp_path / f"{name}.npz")
        call("chart", tmp_path / f"{name}.npz", "--out", tmp_path)
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_optimise_from_many_starts_and_noise_levels(made, tmp_path):
    out = tmp_path / "many.npz"
    result = call("optimise", "--passes", 3, "--horizon", 15, "--starts", 2, "--schedules", "--continuation",
                  "0.07,0.05", "--device", "cpu", "--out", out)  # fmt: skip
    record = load_record(out, "plan")
    assert len(record["batch_cost"]) == 16
    np.testing.assert_allclose(record["level_sigma"], [0.1, 0.07, 0.05])
    assert set(record["trace_level"]) == {0, 1, 2} and record.header["sigma"] == 0.05
    assert "0.07" in result.output
    call("chart", out, "--out", tmp_path)
    assert (tmp_path / "many.png").stat().st_size > 10_000


def test_library_reloads_and_says_how_it_was_made(made):
    library = ddp.Library.load(made / "library.npz")
    assert len(library) == 6 and library.header["horizon"] == 15 and library.header["rounds"] == 1
    assert np.unique(library.chain).tolist() == [0, 1]
    assert read_kind(made / "library.npz") == "library"


def test_sweep_writes_a_table_and_a_report(made):
    report = slcp.SweepReport.load(made / "sweep.npz")
    assert len(report.cases) == 2 and report.spec["scene"] == "flicking_finger"
    assert report.spec["entries"] == 6 and report.spec["kick_times"] == [2.0]
    rows = (made / "sweep.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * 6 and rows[0].startswith("residual,step_size,world")


def test_every_picture_is_drawn(made, tmp_path):
    call("size", "--library", made / "library.npz", "--plans", "1,3", "--worlds", 4, "--device", "cpu",
         "--out", made / "size.csv")  # fmt: skip
    call("chart", made, "--out", tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"plan.png", "library.png", "surface.png", "sweep.png", "size.png", "cycle_cycle.png",
                     "cycle_frames.png", "cycle.gif"}  # fmt: skip
    for path in tmp_path.glob("*.png"):
        pixels = np.asarray(Image.open(path).convert("L"))
        assert pixels.shape[0] > 300 and pixels.std() > 5.0 and pixels[0, 0] == 255, path
    with Image.open(tmp_path / "cycle.gif") as gif:
        assert gif.n_frames == 15 and (tmp_path / "cycle.gif").stat().st_size < 1.5e6


def test_every_number_of_the_summary_can_be_read():
    """Of a mechanism of many degrees of freedom, with long names, on a narrow terminal."""
    scene = scenes.walker()
    states = np.random.default_rng(0).normal(size=(1, 3, 2 * scene.nv)) * 1e-5
    simulated = Simulated.of(slcp.Simulator(scene, device="cpu"))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(summary(slcp.Trajectory(states, np.zeros(1, int), simulated=simulated)))
    text = console.export_text()
    assert "1 solved" in text and all(f" {value:.4g}" in text for value in states[0, [0, 2]].ravel())
    assert all(f" {body.name}" in text for body in scene.bodies)


def test_a_scene_with_a_ground_is_drawn(tmp_path):
    ball = ("simulate", "--scene", "ball_drop", "--steps", 60)
    ball += ("--device", "cpu", "--out", tmp_path / "ball.npz")
    deep = call(*ball, "--start", "0,0.09,0,0,0,0").stderr
    assert "slcp: the start overlaps: ground/ball by 0.01" in deep.splitlines()
    assert "overlaps" not in call(*ball).stderr
    call("chart", tmp_path / "ball.npz", "--out", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "ball.npz",
        "ball_numbers.png",
        "ball_frames.png",
        "ball.gif",
    }


@pytest.mark.slow
def test_quickstart(tmp_path):
    result = call("quickstart", "--quick", "--device", "cpu", "--out", tmp_path / "q")
    text = (tmp_path / "q" / "report.md").read_text()
    for name in ("plan.png", "library.png", "cycle.gif", "sweep.png", "size.png"):
        assert f"figures/{name}" in text and (tmp_path / "q" / "figures" / name).is_file()
    assert "At least 90%" in text and "Report:" in result.output
    assert slcp.SweepReport.load(tmp_path / "q" / "data" / "sweep.npz").complete


# --- bad input ---


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["simulate", "--scene", "car"], "flicking_finger"),
        (["simulate", "--start", "1,2"], "6 are needed"),
        (["simulate", "--start", "a,b"], "comma-separated numbers"),
        (["simulate", "--start", "nan,0,0,0,0,0"], "finite"),
        (["simulate", "--steps", "0"], "at least 1"),
        (["simulate", "--residual", "soft"], "choose one of"),
        (["simulate", "--dtype", "float16"], "float64"),
        (["simulate", "--device", "gpu9"], "gpu9"),
        (["simulate", "--sigma", "-1"], "positive"),
        (["simulate", "--sigma", "0"], "hard"),
        (["simulate", "--set", "mass"], "name=value"),
        (["simulate", "--set", "mass=-1"], "mass"),
        (["simulate", "--set", "cup.mass=1"], "parameters names 'cup.mass'; there are link1.mass"),
        (["simulate", "--policy", "nowhere.npz"], "no such file"),
        (["simulate", "--out", "x.txt"], ".npz"),
        (["optimise", "--method", "newton"], "newton"),
        (["optimise", "--continuation", "0.1,0.2"], "decrease"),
        (["library", "--plans", "0"], "at least 1"),
        (["library", "--rounds", "-1"], "at least 0"),
        (["library", "--entries", "9"], "at most the offset"),
        (["surface", "--scene", "pendulum_chain"], "contact pair"),
        (["chart", "nowhere.npz"], "no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line(arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    device = [] if "--device" in arguments or arguments[0] in ("chart", "compare") else ["--device", "cpu"]
    assert says in fails(*arguments, *device)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--read", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--case", "nowhere"], "choose from ['rest', "),
        (["--mujoco", "-1"], "--mujoco is -1.0; a positive step size is needed"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_batteries_are_one_line(arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert says in fails("bench", "stability", *arguments)


def test_errors_of_every_command_are_one_line():
    commands = app.registered_commands + bench_app.registered_commands
    commands += next(g for g in app.registered_groups if g.name == "paper").typer_instance.registered_commands
    wrapper = one_line_errors(print).__code__
    assert len(commands) > 30
    assert [c.name for c in commands if c.callback.__code__ is not wrapper] == []


def test_a_missing_extra_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)  # as where it is not installed
    (tmp_path / "s.xml").write_text("<mujoco/>")
    said = fails("simulate", "--scene", tmp_path / "s.xml", "--out", tmp_path / "t.npz")
    assert said == "slcp: reading MJCF needs the package mujoco: pip install 'slcp-warp[mjcf]'"


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    said = fails("simulate", "--out", tmp_path / "file" / "t.npz")
    assert said.startswith(f"slcp: {tmp_path / 'file'}: ") and "Errno" not in said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--worlds", "0"], "at least 1"),
        (["--residuals", "soft"], "soft"),
        (["--vary", "colour=0.1"], "colour"),
        (["--vary", "mass"], "name=value"),
        (["--step-sizes", "0.9"], "0.9"),
        (["--device", "gpu9"], "gpu9"),
        (["--scene", "grasp"], "flicking_finger"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_sweeps_are_one_line(made, arguments, says, tmp_path):
    assert says in fails("sweep", "--policy", made / "library.npz", "--out", tmp_path / "s.npz", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_broken_files_are_one_line(made, tmp_path):
    whole = (made / "library.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "objects.npz", header=np.array({"format": 1}, dtype=object))
    for name in ("half", "text", "other", "objects"):
        for command in (["chart"], ["simulate", "--policy"]):
            assert f"{name}.npz cannot be read" in fails(*command, tmp_path / f"{name}.npz")
    assert "holds a library" in fails(
        "sweep", "--policy", made / "library.npz", "--start", made / "library.npz"
    )
    assert "holds no .npz" in fails("chart", _empty(tmp_path))
    assert "--world" in fails("chart", made / "cycle.npz", "--world", 7)


def _empty(folder):
    (folder / "empty").mkdir()
    return folder / "empty"


def test_records_of_other_versions_and_contents(tmp_path):
    arrays = {f"axis{i}": np.arange(2.0) for i in range(3)} | {"gap": np.zeros((2, 2, 2))}
    simulated = Simulated.of(slcp.Simulator(scenes.flicking_finger(), device="cpu"))
    record = Record("surface", arrays, simulated)
    record.save(tmp_path / "a.npz")
    assert load_record(tmp_path / "a.npz", "surface").header["version"] == 2
    with np.load(tmp_path / "a.npz") as archive:
        data = dict(archive)
    header = json.loads(str(data.pop("header"))) | {"version": 9}
    write_archive(tmp_path / "b.npz", header, data)
    with pytest.raises(RecordError, match="version 9; this program reads 1 or 2"):
        load_record(tmp_path / "b.npz", "surface")
    Record("surface", {"gap": np.zeros(3)}, simulated).save(tmp_path / "c.npz")
    with pytest.raises(RecordError, match="axis0"):
        load_record(tmp_path / "c.npz", "surface")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert json.loads(str(archive["header"]))["slcp_warp"] == slcp.__version__


# --- Ctrl-C ---


def test_interrupted_sweep_is_saved(made, tmp_path, monkeypatch):
    from slcp_warp.scripts.stages import sweep as module

    original = module.sweep_scene

    def interrupted(*args, progress=None, **kwargs):
        def stop(done, total):
            raise KeyboardInterrupt

        return original(*args, progress=stop, **kwargs)

    monkeypatch.setattr(module, "sweep_scene", interrupted)
    out = tmp_path / "part.npz"
    result = call("sweep", "--policy", made / "library.npz", "--worlds", 5, "--duration", 6,
                  "--device", "cpu", "--out", out, code=130)  # fmt: skip
    assert "interrupted; saved the 5 worlds" in result.stderr
    report = slcp.SweepReport.load(out)
    assert not report.complete and len(report.cases) == 1


# --- drawing ---


def test_shapes_are_where_the_contact_says(made):
    """Drawn ellipses overlap exactly where the recorded gap is negative, to a pixel's accuracy."""
    record = load_record(made / "surface.npz", "surface")
    axes = [record[f"axis{i}"] for i in range(3)]
    mechanism = Mechanism(record.scene, record.simulated.world(0))
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    centre, angle = mechanism.shapes(q)
    turn = np.linspace(0.0, 2.0 * np.pi, 721)
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    reach = sum(
        np.hypot(*(mechanism.params["radius"][s][:, None, None] * np.stack(
            [np.cos(turn - angle[:, s, None]), np.sin(turn - angle[:, s, None])])))
        for s in (1, 2)
    )  # fmt: skip
    distance = ((centre[:, 2] - centre[:, 1]) @ normal.T - reach).max(axis=1)
    np.testing.assert_allclose(record["gap"].ravel(), distance, atol=2e-3)


def test_isosurface_of_a_sphere():
    """Closed and outward: the divergence theorem gives the volume; all corners lie on the sphere."""
    axis = np.linspace(-1.3, 1.3, 41)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    triangles = isosurface([axis] * 3, x * x + y * y + z * z - 1.0)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    volume = np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
    assert volume == pytest.approx(4.0 * np.pi / 3.0, rel=5e-3)
    assert area == pytest.approx(4.0 * np.pi, rel=5e-3)
    np.testing.assert_allclose(np.linalg.norm(triangles, axis=2), 1.0, atol=2e-3)


def test_isosurface_where_there_is_none():
    assert isosurface([np.arange(3.0)] * 3, np.ones((3, 3, 3))).shape == (0, 3, 3)


def test_last_turn_and_frames():
    angle = np.linspace(0.0, 7.0, 141)
    states = np.zeros((1, 141, 6))
    states[0, :, 2] = angle
    impulse = np.zeros((1, 140, 6))
    impulse[0, 103, -1] = 1.0  # of the last row, a contact's
    sim = slcp.Simulator(scenes.flicking_finger(), device="cpu")
    simulated = Simulated.of(sim, sim.params.replace(step_size=0.1))
    run = slcp.Trajectory(states, np.zeros(1, int), impulse=impulse, simulated=simulated)
    cycle = last_turn(run)
    assert np.pi <= cycle.states[-1, 2] - cycle.states[0, 2] < np.pi + 0.06
    chosen = frame_steps(cycle, 10)
    assert len(chosen) == 10 and cycle.impulse[chosen].max() == 1.0


def test_the_command_line_starts_without_drawing_libraries():
    code = "import slcp_warp.scripts.app, sys; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONSAFEPATH": "1"})
