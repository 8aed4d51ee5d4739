"""`slcp optimise` under the laws that have no noise."""

import contextlib
import signal

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp.measures import signals as measures
from slcp_warp.scripts.commands import optimise
from slcp_warp.scripts.support.records import load_record


def test_optimise_through_hard_contact(tmp_path):
    """A plan without a noise level was lost after it had been made."""
    out = tmp_path / "hard.npz"
    result = call("optimise", "--passes", 2, "--horizon", 15, "--starts", 1, "--residual", "hard",
                  "--method", "gauss-newton", "--device", "cpu", "--out", out)  # fmt: skip
    record = load_record(out, "plan")
    assert record.header["sigma"] is None and np.isnan(record["level_sigma"]).all()
    assert "nan" not in result.output
    call("chart", out, "--out", tmp_path)
    assert (tmp_path / "hard.png").stat().st_size > 10_000


def test_a_plan_ends_where_passes_gain_no_more_than_asked_for(tmp_path):
    """Passes went on to 400 for gains of a millionth."""
    made = {}
    for gain in ("0", "1e9"):
        out = tmp_path / f"{gain}.npz"
        call("optimise", "--passes", 6, "--horizon", 30, "--starts", 1, "--gain", gain,
             "--method", "gauss-newton", "--device", "cpu", "--out", out)  # fmt: skip
        made[gain] = len(load_record(out, "plan")["trace_cost"])
    assert made["1e9"] == 2 < made["0"]


def test_an_interrupted_plan_is_saved(tmp_path, monkeypatch):
    """Ctrl-C after hundreds of passes left nothing."""
    out, said = tmp_path / "plan.npz", []

    def say(text):
        said.append(text)
        if len(said) == 4:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(optimise, "waiting", lambda what: contextlib.nullcontext(say))
    result = call("optimise", "--horizon", 30, "--starts", 2, "--device", "cpu", "--out", out, code=130)
    assert len(said) == 4 and "saved the best of the plans so far, after 4 passes" in result.output
    plan = load_record(out, "plan")
    assert np.isfinite(plan["K"]).all() and len(plan["trace_cost"]) == 5
    before = len(said)
    call("optimise", "--horizon", 30, "--starts", 1, "--passes", 1, "--device", "cpu", "--out", out)
    assert len(said) > before  # signals do again what they did


def test_a_plan_goes_on_from_another(tmp_path):
    """From its controls alone, as of one start; one of another mechanism or length is refused."""
    first, then = tmp_path / "first.npz", tmp_path / "then.npz"
    given = "--horizon", 30, "--method", "gauss-newton", "--device", "cpu"
    call("optimise", *given, "--starts", 1, "--passes", 3, "--out", first)
    call("optimise", *given, "--starts", 1, "--passes", 2, "--from", first, "--out", then)
    costs = [load_record(path, "plan")["trace_cost"] for path in (first, then)]
    assert costs[1][0] < costs[0][-1]  # after its first pass
    wrong = fails("optimise", "--horizon", 31, "--from", first, "--out", then)
    assert "starts has shape (1, 30, 2)" in wrong
    wrong = fails("optimise", "push_to_mark", "--from", first, "--out", then)
    assert "planned for scene 'flicking_finger', not 'push_block'; name, bodies," in wrong


def test_a_plan_begins_with_what_a_policy_shows(tmp_path):
    """Its controls in the undisturbed task, with its delay, are the first trajectory."""
    file, out, late = tmp_path / "hand.py", tmp_path / "plan.npz", tmp_path / "late.json"
    file.write_text(
        "import numpy as np\nfrom slcp_warp import policies\n"
        "hand = policies.Linear(np.array([[-4.0, 0, 0, 0, -1.0, 0, 0, 0]]), np.full(8, 0.3), [2.0])\n"
    )
    task = slcp.tasks.push_to_mark()
    slcp.save_task(task.replace(disturbances=slcp.Disturbances(delay=2 * task.scene.step_size)), late)
    for given, delay in (("push_to_mark", 0), (late, 2)):
        arguments = "optimise", given, "--starts", 1, "--passes", 0, "--device", "cpu", "--out", out
        call(*arguments, "--from", f"{file}:hand")
        us, xs = load_record(out, "plan")["us"], load_record(out, "plan")["xs"]
        for k in range(5):
            sent = 2.0 - 4.0 * (xs[k, 0] - 0.3) - (xs[k, 4] - 0.3)
            np.testing.assert_allclose(us[k + delay, 0], np.clip(sent, -20.0, 20.0), rtol=1e-12)
        assert not us[:delay].any()
    assert "no such file" in fails("optimise", "push_to_mark", "--from", "nowhere.npz", "--out", out)


def test_a_plan_is_tried_in_its_task(tmp_path):
    """Plans that do nothing were written without a word."""
    out, weak = tmp_path / "plan.npz", tmp_path / "weak.json"
    slcp.save_task(slcp.tasks.push_to_mark().replace(control_limits=(-1e-3, 1e-3)), weak)
    given = "--starts", 4, "--passes", 40, "--method", "gauss-newton", "--device", "cpu", "--out", out
    said = call("optimise", weak, *given)
    assert "success   0 of 1" in said.output
    assert "undisturbed, this plan is no success of the task: try more --starts" in said.output
    said = call("optimise", "push_to_mark", *given)
    assert "success   1 of 1" in said.output and "no success" not in said.output
    assert "the start overlaps" not in said.output
    sunk = slcp.tasks.push_to_mark()
    start = sunk.start + np.eye(8)[sunk.scene.state_index("block.y")] * -0.02
    slcp.save_task(sunk.replace(start=start), weak)
    said = call("optimise", weak, *given)
    assert "slcp: the start overlaps: " in said.output and " by 0.02" in said.output
    said = call("simulate", "push_to_mark", "--policy", out, "--device", "cpu", "--out", tmp_path / "run.npz")
    run = slcp.Trajectory.load(tmp_path / "run.npz")
    place = run.measure(slcp.tasks.push_to_mark().measures["place"])[0]
    assert f"place     {place:.4g}" in said.output and "success   1 of 1" in said.output
    priced = slcp.tasks.push_to_mark().replace(failure=measures.Signal("cost") > 1e9)
    slcp.save_task(priced, weak)
    said = call("simulate", weak, "--policy", out, "--device", "cpu", "--out", tmp_path / "run.npz")
    assert "place" in said.output and "success" not in said.output  # costs are a sweep's
    said = call("optimise", "push_to_mark", *given, "--horizon", 40)
    assert "success" not in said.output  # shorter than a run


def test_a_continuation_ends_at_its_last_noise_level(tmp_path):
    """Its file stated the first one; with a delay every level began with the first one's steps, too."""
    out, late = tmp_path / "plan.npz", tmp_path / "late.json"
    task = slcp.tasks.flicking_finger()
    slcp.save_task(task.replace(disturbances=slcp.Disturbances(delay=2 * task.scene.step_size)), late)
    call("optimise", late, "--horizon", 20, "--starts", 1, "--passes", 3, "--method", "gauss-newton",
         "--continuation", "0.2,0.1", "--device", "cpu", "--out", out)  # fmt: skip
    plan = slcp.ddp.Result.load(out)
    assert load_record(out, "plan")["level_sigma"].tolist()[1:] == [0.2, 0.1]
    assert np.unique(plan.simulated.parameters["sigma"]).tolist() == [0.1]
    sim = slcp.Simulator(task.scene, plan.simulated.options, device="cpu", dtype="float64")
    run = sim.rollout(plan.xs[0], plan.us, plan.simulated.parameters)
    np.testing.assert_allclose(run.states, plan.xs, atol=1e-9)
