"""Policies as the commands name them: what `mpc` and `mpc:FILE` plan from."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("typer")

from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.support.policies import named_policies, named_policy


@pytest.fixture(scope="module")
def task():
    """A run as long as a plan: six steps of the finger."""
    return slcp.tasks.flicking_finger().replace(horizon=6, duration=0.3, measures={}, success=None)


def test_mpc_plans_ahead_and_no_further_than_the_run(task):
    policy, facts = named_policy("mpc", task.scene, task)
    assert facts == {"policy": "mpc"} and policy.end == 6
    assert list(policy.starts) == ["shift", "plan", "zero", "noise"]
    run = task.simulator().rollout(task.start, policy=policy, steps=6, record="controls")
    best = ddp.plan(task).best
    assert policy.failures == 0 and abs(cost(task, run) - float(best.cost)) < 1e-6
    longer, _ = named_policy("mpc", task.scene, task.replace(duration=0.35))
    assert longer.end is None


def cost(task, run):
    """Of section V: sum of -theta_3 + .05 |u|^2."""
    return float((0.05 * (run.controls[0] ** 2).sum(1) - run.states[0, :-1, 2]).sum())


def test_mpc_takes_a_file_of_a_plan(task, tmp_path):
    plan = ddp.solve(ddp.problem_of(task), task.start[0], [[0.1, 0.0]] * 6, ddp.Options(max_iterations=3))
    path = plan.save(tmp_path / "plan.npz")
    policy, _ = named_policy(f"mpc:{path}", task.scene, task)
    assert list(policy.starts) == ["shift", "plan", "zero", "noise"] and policy.end == 6
    other = slcp.tasks.hopper_hop()
    with pytest.raises(slcp.InputError, match="was planned for scene 'flicking_finger'"):
        named_policy(f"mpc:{path}", other.scene, other)
    small = replace(plan, us=plan.us[:, :1])
    with pytest.raises(slcp.InputError, match=r"plan.us has shape \(6, 1\)"):
        ddp.MPC(ddp.problem_of(task), plan=small)


def test_the_commands_simulate_with_delays_and_plan_with_them(tmp_path):
    """... and say that they plan without a hold."""
    scene, file = slcp.scenes.cart_pole(), tmp_path / "late.json"
    cost = slcp.costs.terms(scene, [slcp.costs.effort(1.0)])
    own = slcp.Task("late", scene, cost, 20, control_limits=(1.0, 2.0),
                    disturbances=slcp.Disturbances(delay=4 * scene.step_size))  # fmt: skip
    slcp.save_task(own, file)
    law = slcp.policies.Linear([[40.0, 0.0, 1.0, 0.0]], np.zeros(4), [1.5])
    slcp.policies.save_policy(law, tmp_path / "law.npz")
    call("simulate", file, "--policy", tmp_path / "law.npz", "--device", "cpu", "--out", tmp_path / "run.npz")
    run = slcp.Trajectory.load(tmp_path / "run.npz")
    assert (run.controls[0, :4] == 1.0).all() and run.controls.max() > 1.0
    call("simulate", file, "--device", "cpu", "--steps", 3, "--out", tmp_path / "zero.npz")
    assert (slcp.Trajectory.load(tmp_path / "zero.npz").controls == 1.0).all()
    plan = ("--starts", 1, "--passes", 2, "--device", "cpu", "--out", tmp_path / "plan.npz")
    assert "plans are made without" not in call("optimise", file, *plan).stderr
    found = ddp.Result.load(tmp_path / "plan.npz")
    assert found.delay == 4 and found.us.shape == (20, 1) and (found.us[:4] == 1.0).all()
    simulate = ("--policy", tmp_path / "plan.npz", "--device", "cpu", "--out", tmp_path / "run.npz")
    assert "planned to act" not in call("simulate", file, *simulate).stderr
    run = slcp.Trajectory.load(tmp_path / "run.npz")
    np.testing.assert_allclose(run.controls[0], found.us, atol=1e-9)
    slcp.save_task(own.replace(disturbances=slcp.Disturbances()), tmp_path / "early.json")
    said = " ".join(call("simulate", tmp_path / "early.json", *simulate).stderr.split())
    assert f"planned to act {4 * scene.step_size:g} s after they are sent; here they act 0 s after" in said
    slcp.save_task(own.replace(disturbances=slcp.Disturbances(hold=2 * scene.step_size)), file)
    said = " ".join(call("optimise", file, *plan).stderr.split())
    assert f"the task holds controls for {2 * scene.step_size:g} s; plans are made without" in said


def test_a_plan_that_nothing_is_felt_of_says_what_may_help(tmp_path):
    scene = slcp.scenes.cart_pole()
    cost = slcp.costs.terms(scene, [slcp.costs.Term("square", 0.0, control=0)])
    flat = slcp.Task("flat", scene, cost, 5)
    slcp.save_task(flat, tmp_path / "flat.json")
    plan = ("--starts", 1, "--passes", 2, "--device", "cpu", "--out", tmp_path / "plan.npz")
    said = call("optimise", tmp_path / "flat.json", *plan)
    assert "nothing can be felt from here" in " ".join(said.output.split())
    assert "add terms that lead there" in said.stderr


def test_two_of_one_name_are_named():
    with pytest.raises(ValueError, match=r"law.py:net and a/net.npz are both 'net' in tables; rename"):
        named_policies(["zero", "law.py:net", "a/net.npz"], slcp.tasks.flicking_finger().scene)


CART = """
import numpy as np
import slcp_warp as slcp
from slcp_warp import measures
scene = slcp.Scene("cart", bodies=(slcp.Body("cart", 2.0, 0.01, joint="prismatic"),),
                   actuators=(slcp.Actuator("cart"),), step_size=0.05)
task = slcp.Task("cart", scene, duration=1.0, measures={"place": measures.final("cart.shift")},
                 success=measures.final("cart.shift") > 1.0,
                 disturbances=slcp.Disturbances(parameters={"cart.mass": 0.3}))
def push(force):
    return slcp.policies.OpenLoop(np.full((20, 1), force), 0.05)
"""


def test_two_designs_are_compared_by_their_reports(tmp_path, monkeypatch):
    """A cart of half the mass goes twice as far, in worlds of the same factors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.py").write_text(
        CART
        + """
light = task.replace(scene=slcp.Scene("cart", bodies=(slcp.Body("cart", 1.0, 0.01, joint="prismatic"),),
                     actuators=(slcp.Actuator("cart"),), step_size=0.05))
three, four = push(3.0), push(4.0)
"""
    )
    for name in ("task", "light"):
        call("sweep", f"cart.py:{name}", "--policy", "cart.py:three", "--worlds", 30, "--device", "cpu",
             "--out", f"{name}.npz")  # fmt: skip
    said = " ".join(call("compare", "light.npz", "--other", "task.npz").output.split())
    assert "three less three of the other report, the same worlds" in said
    one, two = (slcp.load_report(f"{name}.npz").part("three") for name in ("light", "task"))
    np.testing.assert_allclose(one["place"], 2.0 * two["place"], rtol=1e-5)
    assert f"{(one['place'] - two['place']).mean():.3g} [" in said
    assert "no policy 'four' in the other report" in fails(
        "compare", "light.npz", "three", "four", "--other", "task.npz"
    )
    assert "--other is of reports" in fails("compare", "cart.py:task", "--policy", "cart.py:three",
                                            "--sequential", "--other", "task.npz")  # fmt: skip


def test_what_could_not_be_saved_is_said_before_the_search(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.py").write_text(
        CART
        + """
def asked(force):
    return slcp.policies.Callback(lambda x, time: np.full((len(x), 1), force))
"""
    )
    monkeypatch.setattr(slcp, "tune", None)
    tune = ("tune", "cart.py:task", "--policy", "cart.py:asked", "--number", "force=1:20", "--device", "cpu")
    said = fails(*tune, "--save", "asked.npz")
    assert "--save: policy is a Callback, which is no data" in said and "in the table of --out" in said


def test_numbers_of_a_policy_in_a_file_are_tuned(tmp_path, monkeypatch):
    """The least force that moves nine carts in ten by a metre; what was found is a policy in a file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.py").write_text(CART)
    tune = ("tune", "cart.py:task", "--policy", "cart.py:push", "--worlds", 50, "--test-worlds", 60)
    least = (*tune, "--number", "force=1:20", "--minimise", "force", "--success", 0.9, "--log", "force")
    said = call(*least, "--rounds", 12, "--device", "cpu", "--save", "push.npz").output
    assert "least force with success in 90 % of the worlds: force = " in said and "success [%]" in said
    force = slcp.policies.load_policy("push.npz").us.min()
    tried = np.genfromtxt("tuned.csv", delimiter=",", names=True)
    assert 4.0 < force < 10.0 and force == tried["force"][tried["success_share"] >= 0.9].min()
    call("tune", "cart.py:task", "--policy", "push.npz", "--parameter", "cart.mass==1:20", "--maximise",
         "cart.mass=", "--success", 0.9, "--worlds", 5, "--test-worlds", 5, "--device", "cpu")  # fmt: skip
    heaviest = np.genfromtxt("tuned.csv", delimiter=",", names=True)
    found = heaviest[heaviest["success_share"] == 1.0]
    assert found["cartmass"].max() == pytest.approx(force * 0.525, rel=0.02)  # FAR: 0.05^2 20 21 / 2
    call("map", "cart.py:task", "--policy", "cart.py:push", "--x", "force=1:20:3", "--y", "cart.mass==1:9:2",
         "--number", "force", "--worlds", 5, "--device", "cpu")  # fmt: skip
    shares = np.genfromtxt("map.csv", delimiter=",", names=True)["success"]
    assert shares.tolist() == [0.0, 1.0, 1.0, 0.0, 0.0, 1.0]  # 1 m needs m / .525 N: 1.9 N, 17.1 N
    for wrong, text in (
        (("--policy", "push.npz", "--number", "force=1:2"), "file.py:name of a function of force is needed"),
        (("--policy", "cart.py:pull", "--number", "force=1:2"), "cart.py has no function 'pull'"),
        (("--policy", "cart.py:push", "--number", "force=1"), "--number is 'force=1'; name=low:high"),
        (("--policy", "push.npz"), "numbers and parameters are both empty"),
    ):
        assert text in fails("tune", "cart.py:task", *wrong, "--device", "cpu")
