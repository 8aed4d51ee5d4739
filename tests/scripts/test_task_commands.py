"""Any task by the same commands: plan, run, library, sweep, comparison, pictures."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from PIL import Image
from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.statistics.source import MemorySource
from slcp_warp.kernels.device import cache
from slcp_warp.kernels.device.progress import recorded
from slcp_warp.scripts.app import app
from slcp_warp.scripts.stages.task_sweep import report_tables
from slcp_warp.scripts.support.records import load_record
from slcp_warp.scripts.watch.engine import Engine
from slcp_warp.scripts.watch.scenario import buttons_of
from slcp_warp.scripts.watch.world import Subject

EXAMPLE = Path(__file__).parents[2] / "examples" / "tasks" / "shove.toml"
# The block stops for certain: of plans with the example's weight, alike in cost, roundings choose one whose
# worlds stop in time in .72 to .97 of all.
STOPS = 'weight = 200.0, state = "block.vx"'
TOML = Path(tempfile.mkdtemp()) / "shove.toml"
TOML.write_text(EXAMPLE.read_text().replace('weight = 20.0, state = "block.vx"', STOPS))
assert STOPS in TOML.read_text()


def end_to_end(task, folder, worlds: int, plans: int, *made) -> Path:
    """The commands that every task takes, in turn; the folder of their files. `made`: how the library is."""
    cpu = ("--device", "cpu")
    plan, library, run, report = (folder / n for n in ("plan.npz", "library.npz", "run.npz", "report.csv"))
    call("optimise", task, *cpu, "--out", plan)
    said = call("library", task, "--plans", plans, *made, *cpu, "--out", library).output
    made = ddp.Library.load(library)
    if "end" in made.header:
        assert f" {len(np.unique(made.chain))} of {made.header['chains']} " in said
    call("simulate", task, "--policy", plan, "--residual", "hard", *cpu, "--out", run)
    policies = ("--policy", plan, "--policy", library)
    call("sweep", task, *policies, "--worlds", worlds, *cpu, "--out", report)
    assert "plan less library" in call("compare", report, "plan", "library").output
    call("chart", folder, "--out", folder / "pictures")
    return folder


def check(task: slcp.Task, folder: Path, worlds: int) -> dict:
    """What every task's files must hold; the report's parts."""
    plan, run = load_record(folder / "plan.npz", "plan"), load_record(folder / "run.npz", "trajectory")
    assert plan["us"].shape == (task.horizon, task.scene.nu) and plan.header["task"] == task.name
    assert run["states"].shape[1] == task.steps + 1 and run.simulated.options.residual == "hard"
    assert run["controls"].min() >= plan["lower"].min() and run["controls"].max() <= plan["upper"].max()
    np.testing.assert_array_equal(run["states"][0, 0], task.start[0])
    assert len(ddp.Library.load(folder / "library.npz")) > 0
    parts = parts_of(folder / "report.csv")
    assert {key[:2] for key in parts} == {(p, c) for p in ("plan", "library") for c in ("smoothed", "hard")}
    for key, part in parts.items():
        assert len(part["world"]) == (worlds if key[3] == "disturbed" else len(task.start))
        assert set(task.measures) < part.keys()
    for name in ("plan.png", "library.png", "run_frames.png", "report.png"):
        pixels = np.asarray(Image.open(folder / "pictures" / name).convert("L"))
        assert pixels.std() > 5.0 and pixels[0, 0] == 255, name
    return parts


def test_a_task_of_a_file_goes_end_to_end(tmp_path):
    parts = check(slcp.load_task(TOML), end_to_end(TOML, tmp_path, 64, 4, "--passes", 3), 64)
    for case in ("smoothed", "hard"):
        found = parts["plan", case, 0.02, "disturbed"]
        assert found["success"].mean() > 0.8 and np.ptp(found["drawn_block.mass"]) > 0.2
        assert parts["plan", case, 0.02, "undisturbed"]["success"].all()
        other = parts["library", case, 0.02, "disturbed"]
        np.testing.assert_array_equal(found["drawn_block.mass"], other["drawn_block.mass"])  # the same worlds
    said = " ".join(call("compare", tmp_path / "report.csv", "--sequential").output.split())
    assert "plan less library, the same worlds, 95 % intervals, at all looks" in said
    again = slcp.load_report(tmp_path / "report.csv").save(tmp_path / "report.npz")
    assert call("compare", again).output == call("compare", tmp_path / "report.csv").output
    both = [f"--policy={tmp_path / name}" for name in ("plan.npz", "library.npz")]
    said = call("compare", TOML, *both, "--sequential", "--worlds", 64, "--batch", 32, "--device", "cpu",
                "--out", tmp_path / "compared.npz").output  # fmt: skip
    assert "success of plan less library" in said and "looks" in said
    compared = slcp.load_report(tmp_path / "compared.npz").part("plan", "hard")
    assert len(compared["world"]) in (32, 64)
    np.testing.assert_array_equal(
        compared["success"], parts["plan", "hard", 0.02, "disturbed"]["success"][: len(compared["world"])]
    )
    assert "--policy is of a task with --sequential" in fails("compare", TOML, *both)
    check_questions(tmp_path, parts)
    replayed(tmp_path, parts)
    falsified(tmp_path)
    rare(tmp_path)
    assert "has the policy" in fails("compare", _one_policy(tmp_path))
    assert "there is no policy 'mpc'" in fails("compare", tmp_path / "report.csv", "mpc", "plan")
    still = ("--velocity-sd", 0, "--torque-sd", 0, "--vary", "mass=0", "--duration", 0.4, "--worlds", 3)
    call("sweep", TOML, "--policy", tmp_path / "plan.npz", *still, "--device", "cpu",
         "--residuals", "hard", "--out", tmp_path / "still.npz")  # fmt: skip
    own = parts_of(tmp_path / "still.npz")["plan", "hard", 0.02, "disturbed"]
    assert (
        np.ptp(own["place"]) == 0.0 and own["place"].max() < 0.45
    )  # nothing is disturbed, and it ends early


def check_questions(folder: Path, parts: dict) -> None:
    """What matters, and where it holds: tables and their pictures."""
    plan, own = folder / "plan.npz", ("--device", "cpu", "--out")
    say = call("sensitivity", TOML, "--policy", plan, "--measure", "place", "--samples", 32, *own,
               folder / "sensitivity.csv").output  # fmt: skip
    assert "of place under plan" in say and "block.mass" in say
    call(
        "sensitivity", folder / "report.csv", "--policy", "library", "--out", folder / "sensitivity_free.csv"
    )
    assert ",library,64," in (folder / "sensitivity_free.csv").read_text()
    call("map", TOML, "--policy", plan, "--x", "mass=0.5:1:2", "--y", "friction=1:2:2", "--worlds", 64, *own,
         folder / "map.csv")  # fmt: skip
    lines = [line.split(",") for line in (folder / "map.csv").read_text().splitlines()]
    same = next(line for line in lines if line[:4] == ["mass", "friction", "1.0", "1.0"])
    assert float(same[5]) == parts["plan", "hard", 0.02, "disturbed"]["success"].mean()
    tables = [folder / f"{name}.csv" for name in ("sensitivity", "sensitivity_free", "map")]
    call("chart", *tables, "--out", folder / "answers")
    for table in tables:
        pixels = np.asarray(Image.open(folder / "answers" / f"{table.stem}.png").convert("L"))
        assert pixels.std() > 5.0 and pixels[0, 0] == 255, table
    tables[2].write_text("\n".join(",".join(line) for line in lines[:-1]) + "\n")
    assert "has 3 cells; 2 x 2 are needed" in fails("chart", tables[2])
    assert "--policy is missing" in fails("sensitivity", TOML)
    bad = ("map", TOML, "--policy", plan, "--y", "mass=1:2:3", "--x")
    assert "name=low:high:count is needed" in fails(*bad, "friction=1:2")
    assert "x is 'weight'; a state" in fails(*bad, "weight=1:2:2")
    assert "the values of x is -1.0; it must not be negative" in fails(*bad, "friction==-1:2:2")


def replayed(folder: Path, parts: dict) -> None:
    """Worlds of the report that failed, step by step; a report of something else is noticed."""
    keys = [key for key, part in parts.items() if key[1] == "hard" and not part["success"].all()]
    policy, own = keys[0][0], parts[keys[0]]
    first = np.flatnonzero(~own["success"])[:2]
    arguments = (
        "replay",
        TOML,
        "--policy",
        folder / f"{policy}.npz",
        "--residual",
        "hard",
        "--device",
        "cpu",
    )
    said = call(
        *arguments, "--report", folder / "report.csv", "--most", 2, "--out", folder / "failed.npz"
    ).output
    assert "hard, h = 0.02 s" in said and all(f" {world} " in said for world in first)
    run = slcp.Trajectory.load(folder / "failed.npz")
    x = run.states[:, -1, run.scene.state_index("block.x")]
    np.testing.assert_allclose(x, own["place"][first], rtol=1e-6)
    assert np.isfinite(run.controls).all() and len(run.contacts(0)["step"]) > 10
    one = call(*arguments, "--world", first[-1], "--out", folder / "one.npz").output
    assert " no SOLVED" in one and len(slcp.Trajectory.load(folder / "one.npz")) == 1
    both = ("--report", folder / "report.csv")
    assert "the sweep was of another task, policy, --seed" in fails(*arguments, *both, "--seed", 1)
    assert "case is 'hard, coulomb'; choose from" in fails(*arguments, *both, "--friction", "coulomb")
    assert "one of --report FILE, --world N and --given FILE is needed" in fails(
        *arguments, *both, "--world", 1
    )
    assert "--most is of --report" in fails(*arguments, "--world", 1, "--most", 3)
    assert "step_size is 0.01; choose from [0.02]" in fails(*arguments, *both, "--step-size", 0.01)


def falsified(folder: Path) -> None:
    """The smallest kick that makes the plan fail: it does so again in a task of its own; parts do not."""
    out = folder / "falsified"
    arguments = (TOML, "--policy", folder / "plan.npz", "--device", "cpu")
    said = call("falsify", *arguments, "--by", "kick", "--worlds", 512, "--out", out).output
    assert "kick_0_" in said and "of task" in said
    scenario, task = slcp.load_task(out / "scenario.json"), slcp.load_task(TOML)
    kick = scenario.disturbances.kick_laws(task.scene).base
    plan = ddp.TrackingPolicy(ddp.Result.of(load_record(folder / "plan.npz", "plan")))
    for share, fails_then in ((1.0, True), (0.875, False), (0.5, False)):
        start = scenario.start + share * np.concatenate([np.zeros_like(kick), kick])
        still = task.replace(start=start, disturbances=slcp.Disturbances())
        hard = replace(task.options, residual="hard")
        found = slcp.sweep(still, plan, worlds=1, cases=hard, dtype="float64", device="cpu").part("policy")
        assert found["success"][0] != fails_then
    page = Engine(
        Subject.of(task), pushes=buttons_of(scenario, "found")
    )  # the same kick is a button of the page
    page.send(1, {"do": "push", "name": "found: kick"})
    page.advance(0.0)
    np.testing.assert_allclose(
        page.worlds.state[0, task.scene.nv :], scenario.start[0, task.scene.nv :] + kick
    )
    run = load_record(out / "run.npz", "trajectory")
    assert run["states"].shape[1] == task.steps + 1 and not run["status"].any()
    assert call("chart", out / "falsification.csv", "--out", out / "pictures").exit_code == 0
    for picture in (out / "falsification.png", out / "pictures" / "falsification.png"):
        assert np.asarray(Image.open(picture).convert("L")).std() > 5.0
    broken = folder / "broken.csv"
    broken.write_text((out / "falsification.csv").read_text().replace("drawn", "dawn", 1))
    assert "role is neither" in fails("chart", broken)


def rare(folder: Path) -> None:
    """The share of failures that the sweep counted lies in the interval; the table has the levels' shares."""
    arguments = (TOML, "--policy", folder / "plan.npz", "--device", "cpu", "--islands", 6, "--particles", 60)
    said = call("rare", *arguments, "--length", 6, "--out", folder / "rare.csv",
                "--failing", folder / "failing.npz").output  # fmt: skip
    assert "margin at most" in said and "of task 'shove'" in said
    rows = np.genfromtxt(folder / "rare.csv", delimiter=",", names=True)
    own = parts_of(folder / "report.csv")["plan", "hard", 0.02, "disturbed"]
    counted = 1.0 - own["success"].mean()
    spread = 4.0 * np.sqrt(counted * (1.0 - counted) / len(own["success"]))
    assert rows["low"].min() - spread <= counted <= rows["high"].max() + spread
    call("sweep", *arguments[:5], "--given", folder / "failing.npz", "--residuals", "hard", "--out",
         folder / "failed.csv")  # fmt: skip
    failed = parts_of(folder / "failed.csv")["plan", "hard", 0.02, "disturbed"]
    assert (
        len(failed["world"]) == len(slcp.load_worlds(folder / "failing.npz")) and not failed["success"].any()
    )
    reached = np.atleast_1d(rows["reached"])
    assert (np.diff(reached) <= 0.0).all() and np.isclose(
        reached[-1], np.atleast_1d(rows["share"])[0], rtol=0.5
    )


def parts_of(path: Path) -> dict:
    report = slcp.load_report(path)
    return {key: report.part(*key) for key in report.source.keys}


def _one_policy(folder: Path) -> Path:
    lines = (folder / "report.csv").read_text().splitlines(keepends=True)
    path = folder / "one.csv"
    path.write_text("".join([lines[0], *(line for line in lines[1:] if line.startswith("plan,"))]))
    return path


@pytest.mark.full
@pytest.mark.parametrize("name", slcp.tasks.NAMED)
def test_every_named_task_goes_end_to_end(tmp_path, name):
    """Libraries of converged plans and several runs: of one walker with three passes a plan none is left."""
    task = slcp.load_task(name)
    parts = check(task, end_to_end(name, tmp_path, 256, 100), 256)
    if task.duration <= task.horizon * task.scene.step_size:  # a plan is as long as a run
        for case in ("smoothed", "hard"):
            assert parts["plan", case, task.scene.step_size, "undisturbed"]["success"].all()
            assert parts["plan", case, task.scene.step_size, "disturbed"]["success"].mean() > 0.5


def test_a_mean_that_leaves_worlds_out_says_so():
    """Beside the share of successes without disturbances, which a measure may be named as."""
    source = MemorySource()
    part = {"world": np.arange(4), "success": np.ones(4, bool), "status": np.zeros(4, int)}
    source.add(("p", "hard", 0.02, "disturbed"), part | {"still": np.array([1.0, np.inf, 3.0, np.inf])})
    (table,) = report_tables(slcp.Report(None, source))
    cells = {column.header: list(column.cells) for column in table.columns}
    assert cells["still"] == ["2 in 50.0 %"] and cells["undisturbed"] == [""]


def test_a_broken_report_is_one_line(tmp_path):
    path = tmp_path / "report.csv"
    head = "policy,case,step_size,arm,world,x,success,status\n"
    for text, says in (
        (head, "it has no rows"),
        ("a,b\n1,2\n", "it has no columns policy, case"),
        (head + "plan,hard,0.1,disturbed,0,1.0,yes,0\n", "column 'success' holds 'yes'"),
        (
            head + "plan,hard,0.1,disturbed,0,wide,True,0\n",
            "column 'x': could not convert string to float: 'wide'",
        ),
        (
            head + 2 * "plan,hard,0.1,disturbed,0,1.0,True,0\n",
            "('plan', 'hard', 0.1, 'disturbed'): column 'world' holds no rising whole numbers",
        ),
        (head + "plan,hard,0.1,disturbed,0.5,1.0,True,0\n", "column 'world' holds 0.5; whole numbers"),
        (head + "plan,hard,0.1,disturbed,0,1.0,True,99\n", "column 'status' holds 99; one of [0, 1"),
        (head + "plan,hard,0.1", "it is cut off or damaged"),
    ):
        path.write_text(text)
        assert says in fails("compare", path)
        assert "slcp: " in fails("chart", path)


def test_differences_have_the_bounds_of_their_intervals(tmp_path):
    """Which are not as far below as above; of what is not finished a word is said."""
    rows = [f"{name},hard,0.1,disturbed,{i},{name == 'a'},0" for name in "ab" for i in range(5)]
    path = tmp_path / "five.csv"
    path.write_text("\n".join(["policy,case,step_size,arm,world,success,status", *rows]) + "\n")
    one, low, high = slcp.load_report(path).compare("a", "b")["success"]
    assert f"{one:.3g} [{low:.3g}, {high:.3g}]" in call("compare", path).output
    path.write_text("\n".join(["policy,case,step_size,arm,world,success,status", *rows[:-1]]) + "\n")
    for said in (call("compare", path), call("chart", path, "--out", tmp_path / "figures")):
        assert "five.csv is not finished: of the 9 worlds that are there alone" in said.stderr
    apart = [row.replace("b,hard,0.1,disturbed,", "b,hard,0.1,disturbed,1") for row in rows]
    path.write_text("\n".join(["policy,case,step_size,arm,world,success,status", *apart]) + "\n")
    assert "a and b have no world in common" in fails("compare", path)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["simulate", "juggle"], "is no task; a .toml or .json file, file.py:name or one of"),
        (["optimise", "absent.toml"], "absent.toml: no such file"),
        (["library", "absent.py:lift"], "absent.py: no such file"),
        (["sweep", "juggle", "--policy", "a.npz"], "is no task"),
        (["sweep", "catch", "--policy", "a.npz", "--set", "mass=1"], "--set and --observe are of --scene"),
        (["sweep", "catch", "--policy", "a.npz", "--residuals", "soft"], "--residuals is 'soft'"),
        (["sweep", "--policy", "a.npz", "--policy", "b.npz"], "only a task takes several"),
        (
            ["sweep", "catch", "--policy", "a.npz", "--given", "w.npz", "--vary", "mass=1", "--worlds", "9"],
            "--vary and --worlds are given, with --given, whose worlds have their own",
        ),
        (
            ["compare", "catch", "a", "b", "--policy", "a.npz", "--policy", "b.npz", "--sequential"],
            "a is a name of a report's policy",
        ),
        (["falsify", "catch", "--policy", "a.npz"], "a.npz"),
        (["rare", "catch", "--policy", "zero", "--residual", "soft"], "--residual is 'soft'; choose"),
        (["replay", "catch", "--policy", "zero"], "one of --report FILE, --world N and --given FILE"),
        (["replay", "catch", "--policy", "zero", "--report", "nowhere.csv"], "no such file"),
        (["compile", "juggle"], "SCENE is 'juggle'"),
        (["compile", "particle", "--what", "plan"], "there is nothing to plan"),
        (["compare", "nowhere.csv"], "no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line(arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert says in fails(*arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_what_a_task_needs_is_compiled_ahead(monkeypatch, tmp_path):
    """Planning and sweeping it compile nothing any more."""
    monkeypatch.setattr(cache, "_loaded", {})
    call("compile", TOML, "--what", "plan,sweep", "--dtype", "float64", "--device", "cpu")
    task = slcp.load_task(TOML)
    sim = task.simulator(device="cpu")
    with recorded() as kernels:
        found = ddp.plan(task, 2, sim=sim, options=ddp.Options(max_iterations=2))
        policy = ddp.TrackingPolicy(found.best, task.scene.state_period)
        slcp.sweep(task, policy, worlds=4, cases=task.options, dtype="float64", device="cpu")
    assert [kernel.kernel for kernel in kernels] == []


def test_tasks_are_listed():
    text = call("tasks").output
    for name, make in slcp.tasks.NAMED.items():
        assert f"{name}: nv {make().scene.nv}" in text and ", ".join(make().measures) in text


def test_former_names_of_the_papers_commands_are_hidden():
    paper = next(group for group in app.registered_groups if group.name == "paper").typer_instance
    names = {command.name: command.callback for command in paper.registered_commands}
    assert {"size", "surface", "study", "residuals"} <= names.keys()
    hidden = {command.name: command.callback for command in app.registered_commands if command.hidden}
    assert hidden == names
