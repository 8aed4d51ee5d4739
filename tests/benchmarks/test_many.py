"""Study "many": truths of piles, their errors, energy, targets beside MuJoCo, charts from rows alone."""

import dataclasses
import functools

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
pytest.importorskip("mujoco")

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.accuracy import contact_peers, many
from slcp_warp.scripts.benchmarks.accuracy.charts import many as chart
from slcp_warp.scripts.benchmarks.accuracy.charts import many_error, many_rest, many_table
from slcp_warp.scripts.benchmarks.contacts import problems, targets
from slcp_warp.scripts.benchmarks.contacts.worlds import world
from slcp_warp.scripts.benchmarks.mechanics.scene import distance
from slcp_warp.scripts.benchmarks.peers import mujoco
from slcp_warp.scripts.benchmarks.stability.check import Checker

CURVE = (many.Curve("Coulomb"),)


@pytest.fixture(scope="module")
def rows():
    """A stack of 10 at rest for a second and thrown, with a coarse truth, timed once."""
    said = []
    problems.moves.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(problems, "FINE", 0.005)
        patch.setattr(problems, "LONG", 1.0)
        patch.setattr(many, "SETTINGS", ("default", "overdamped"))
        patch.setattr(many, "REPEATS", 1)
        patch.setattr(many, "STEPS", 50)
        patch.setattr(mujoco, "TIMED", 50)
        patch.setattr(contact_peers, "REPEATS", 1)
        found = many.problem_rows("stack:10", True, said.append, (0.02,), CURVE)
        found += many.problem_rows("stack:10", False, said.append, (0.02, 0.005), CURVE)
    problems.moves.cache_clear()
    assert [line.partition(":")[0] for line in said] == ["stack", "stack"]
    return found


def test_what_should_rest_is_judged_by_its_drift(rows):
    still = [row for row in rows if row["problem"] == "stack:10 rests"]
    assert {row["curve"] for row in still} == {"Coulomb", "MuJoCo, default", "MuJoCo, overdamped"}
    for row in still:
        ours = row["program"] == "slcp-warp"
        assert row["error"] < 1e-9 if ours else 1e-9 < row["error"] < 0.05
        assert row["error"] == row["error_self"] and row["missed"] == 0 and row["solved_share"] == 1.0
        assert row["energy_gained"] < 1e-6 and row["cost_of"] == "simulated second" and row["seconds"] > 0.0


def test_what_is_thrown_is_judged_by_the_finest_step(rows):
    thrown = {(row["curve"], row["h"]): row for row in rows if row["problem"] == "stack:10 is thrown"}
    assert thrown["Coulomb", 0.005]["error"] == 0.0 < thrown["Coulomb", 0.02]["error"] < 0.1  # its own truth
    finest = thrown["MuJoCo, overdamped", 0.005]
    assert finest["error_self"] == 0.0 < finest["error"] < 0.2
    for row in thrown.values():
        assert row["error_of"].startswith("median over 16 starts at T = 0.2 s")
        assert 0.0 <= row["penetration"] < 0.1 and row["energy_gained"] < 0.01


def test_the_truth_satisfies_hard_contact_with_coulomb_friction():
    """Its recorded steps, by the stability battery's own account of motion and contact."""
    found = world("stack:10")
    starts = found.starts("tumbling", 2, problems.SEED)
    sim = slcp.Simulator(found.scene, slcp.Options(**problems.LAWS["coulomb"]), device="cpu", dtype="float64")
    params = sim.params.replace(step_size=1e-3)
    done = sim.rollout(starts, np.zeros((2, 20, 0)), params, record=("impulse",))
    assert (done.status == slcp.Status.SOLVED).all()
    scene = dataclasses.replace(found.scene, step_size=1e-3)
    x, method = done.states, sim.options.method
    check = Checker(scene, {}).judge(x[:, :-1], x[:, 1:], done.impulse, None, method)
    assert check.motion.max() < 1e-9 and check.contact.max() < 1e-9


def test_energy_that_a_motion_gains():
    scene = dataclasses.replace(world("discs:1").scene, gravity=(0.0, -10.0))
    t = np.linspace(0.0, 1.0, 11)
    states = np.zeros((1, 11, 6))
    states[0, :, 1], states[0, :, 4] = 5.0 - 5.0 * t**2, -10.0 * t  # falls freely
    assert abs(problems.energy_gained(scene, states)) < 1e-12
    states[0, 7, 3] = 2.0  # 2 J more of 10 J, that is 1 kg a metre higher
    assert problems.energy_gained(scene, states) == pytest.approx(0.2)
    assert np.isnan(problems.energy_gained(world("walker").scene, np.zeros((1, 3, 14))))


def test_a_beam_starts_clear_of_its_supports(monkeypatch):
    found = {}

    def no_truth(scene, starts, duration, components):
        found.update(scene=scene, starts=starts)
        raise ValueError("none is needed")

    monkeypatch.setattr(problems, "truth_of", no_truth)
    problems.moves.cache_clear()
    with pytest.raises(ValueError, match="none is needed"):
        problems.moves("beam:8")
    scene, q = found["scene"], found["starts"][:, :3]
    clear = [distance(scene, q, k).min() for k in range(len(scene.all_contacts))]
    assert len(clear) == 8 and 0.0 < min(clear) < 0.1


def step_row(scene, motion, program, seconds, **more):
    row = {
        "scene": scene, "motion": motion, "program": program, "dtype": "float64", "seconds": seconds,
        "law": "", "model": "", "bodies": 3, "batch": 4, "seen": 4, "made": 300, "unsolved": 0, "ratio": 1.0,
    }  # fmt: skip
    return row | more


def costs():
    """A machine that runs MuJoCo's boxes in half the time of the one of the targets."""
    peer = functools.partial(step_row, motion="tumbling", program="MuJoCo", ratio="", unsolved="")
    ours = functools.partial(step_row, motion="tumbling", program="slcp-warp")
    out = [peer("walker", seconds=4e-6, model="same pairs")]
    for scene, time in targets.MUJOCO["tumbling"].items():
        out += [peer(scene, seconds=0.5e-6 * time, model="boxes")]
        out += [peer(scene, seconds=0.4e-6 * time, model="same pairs")]
    out += [
        ours("stack:3", seconds=0.7e-6, law="hard"),
        ours("stack:10", seconds=5e-6, law="hard", unsolved=1),
    ]
    return [*out, ours("walker", seconds=0.4e-6, law="smoothed")]


def test_targets_scale_with_the_machine():
    found = {(v.scene, v.what): v for v in targets.verdicts(costs())}
    three = found["stack:3", "time beside MuJoCo's boxes"]
    assert (
        three.measured == pytest.approx(0.7 / 6.0) and three.most == pytest.approx(1.5 / 12.0) and three.met
    )
    ten = found["stack:10", "time beside MuJoCo's boxes"]
    assert ten.measured == pytest.approx(5.0 / 22.5) and not ten.met
    assert found["stack:10", "share of steps unsolved"].measured == pytest.approx(1 / 300)
    walker = found["walker", "us, scaled to the machine of the targets"]
    assert walker.measured == pytest.approx(0.8) and walker.most == 0.9 and walker.met
    lines = targets.table(costs())
    assert lines[0].startswith("4 of 6 are met") and "stack:10" in lines[4] and lines[-1].endswith("met |")


def test_charts_from_rows_alone(rows, tmp_path):
    steps = [many.as_study(row) for row in costs()]
    modules = {"many.png": chart, "many_error.png": many_error, "many_rest.png": many_rest}
    modules |= {"many.md": many_table}
    for name, module in modules.items():
        assert module.draw([*rows, *steps], tmp_path / name).stat().st_size > 1000
    text = (tmp_path / "many.md").read_text()
    assert "| stack:10 rests | " in text and "| stack:3 | tumbling | hard | 0.7 |" in text
    with pytest.raises(ValueError, match="has costs only"):
        many_error.draw(steps, tmp_path / "none.png")


def test_equal_errors_and_those_that_are_not_reached():
    def row(program, value, error, seconds):
        return {"study": "many", "problem": "a", "program": program, "curve": program, "value": value,
                "error": error, "seconds": seconds, "missed": 0, "solved_share": 1.0}  # fmt: skip

    ours = [row("slcp-warp", 0.02, 0.1, 2e-6), row("slcp-warp", 0.01, 0.01, 20e-6)]
    theirs = [
        row("MuJoCo", 0.02, 0.1, 4e-6),
        row("MuJoCo", 0.01, 0.001, 10e-6),
        row("MuJoCo", 0.005, 0.2, 1.0),
    ]
    assert many_error.quotients([*ours, *theirs]) == pytest.approx([0.0, 2.0])
    assert many_error.least([*ours, *theirs]) == pytest.approx(2.0)
    assert many_error.said([*ours, *theirs], "error") == "2, 1 of 2 not reached"
