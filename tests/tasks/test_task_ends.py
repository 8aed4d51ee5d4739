"""What ends a run, and what it cost: against loops in NumPy and against plans."""

from dataclasses import replace

import numpy as np
import pytest
from test_disturbances import FORCE, GOAL, SCENE, H, K, N, swept, task

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies

X, SPEED = SCENE.state_index("block.x"), SCENE.state_index("block.vx")
MEASURED = {
    "last": m.final("block.x"), "most": m.largest("block.vx"), "mean": m.mean("block.x"),
    "used": m.integral(m.control(0)), "rate": m.rate("block.x"),
    "first": m.first_time(m.state("block.x") > 0.0),
    "still": m.settled(m.state("block.x") > -1.0), "touched": m.contact_share(), "price": m.cost(),
}  # fmt: skip
STARTS = SCENE.x0 + np.outer(np.linspace(0.0, 0.6, 6), np.eye(8)[X])
FAR = 1.0  # some of the blocks come that far


def failure(far):
    return (m.state("block.x") > far) & (m.control(0) < 1.75) | (m.state("block.vx") > 5.0)


def failing(far):
    still = slcp.Disturbances()
    return task(start=STARTS, measures=MEASURED, disturbances=still, failure=failure(far), success=None)


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_a_run_ends_with_the_step_of_its_failure(device, strategy):
    """Measures are those of a recorded run that was cut off after that step."""
    own = failing(FAR)
    report = swept(device, strategy, own, worlds=6)
    found = report.part("policy", arm="undisturbed")
    options = slcp.Options(residual=report.parts[0]["case"])
    sim = slcp.Simulator(SCENE, options, dtype="float64", device=device, strategy=strategy)
    policy = policies.Linear(K, GOAL, FORCE, limits=(-5.0, 6.0))
    run = sim.rollout(STARTS, policy=policy, steps=N, record=("controls", "impulse", "gap"))
    x, u = run.states, run.controls[:, :, 0]
    u = np.concatenate([u, u[:, -1:]], 1)
    fails = ((x[:, :, X] > FAR) & (u < 1.75)) | (x[:, :, SPEED] > 5.0)
    ended = np.where(fails.any(1), fails.argmax(1), N)
    assert len(set(ended)) > 2 and 0 < fails.any(1).sum() < 6
    np.testing.assert_allclose(found["failure_time"], np.where(fails.any(1), H * ended, np.inf), atol=1e-12)
    np.testing.assert_array_equal(found["success"], ~fails.any(1))
    told = report.summary[-1]["finite"]["failure_time"]
    assert report.measures == (*MEASURED, "failure_time") and told == fails.any(1).sum()
    assert slcp.Report(None, report.source).measures == report.measures  # as of a table
    for i, k in enumerate(ended):
        steps = min(k + 1, N)
        short = sim.rollout(STARTS[i : i + 1], policy=policy, steps=int(steps),
                            record=("controls", "impulse", "gap"))  # fmt: skip
        for name, measure in MEASURED.items():
            if name != "price":
                assert found[name][i] == pytest.approx(short.measure(measure)[0], rel=1e-9, abs=1e-12), name
        assert found["price"][i] == pytest.approx((short.controls**2).sum(), rel=1e-9)


def test_what_acts_on_the_host_ends_alike(device):
    """By launches of a period each: the same ends, times and measures."""

    def act(x, time, worlds):
        return np.clip(FORCE + (x - GOAL) @ K.T, -5.0, 6.0)

    class Host:
        period = 3 * H

    host = Host()
    host.act = act
    own = failing(0.36).replace(measures={name: each for name, each in MEASURED.items() if name != "price"})
    held = policies.Around(policies.Linear(K, GOAL, FORCE), hold=3)
    one = swept(device, "specialised", own, held)
    two = swept(device, "specialised", own, host)
    first, second = (each.part("policy", arm="undisturbed") for each in (one, two))
    assert np.isfinite(first["failure_time"]).any()
    for name in (*own.measures, "failure_time", "success"):
        np.testing.assert_allclose(first[name], second[name], rtol=1e-9, atol=1e-12, err_msg=name)


def test_the_cost_of_a_run_is_the_sum_of_its_terms(device):
    Term = slcp.costs.Term
    running = [slcp.costs.effort(0.1), Term("square", 2.0, state="block.x", target=0.5)]
    final = [Term("absolute", 5.0, state="block.vx", width=0.2), Term("cosine", 3.0, state="block.angle")]
    own = failing(9.0).replace(cost=slcp.costs.terms(SCENE, running, final))
    found = swept(device, "specialised", own, worlds=1).part("policy", arm="undisturbed")
    sim = slcp.Simulator(SCENE, slcp.Options(), dtype="float64", device=device)
    policy = policies.Linear(K, GOAL, FORCE, limits=(-5.0, 6.0))
    run = sim.rollout(STARTS, policy=policy, steps=N, record="controls")
    x = run.states
    price = 0.1 * (run.controls[:, :, 0] ** 2).sum(1) + 2.0 * ((x[:, :-1, X] - 0.5) ** 2).sum(1)
    price += 5.0 * (np.sqrt(x[:, -1, SPEED] ** 2 + 0.04) - 0.2) + 3.0 * (1.0 - np.cos(x[:, -1, 3]))
    np.testing.assert_allclose(found["price"], price, rtol=1e-9)


def test_costs_and_failures_that_cannot_be(tmp_path):
    weights = slcp.costs.quadratic(np.eye(8), np.eye(1), target=np.zeros((N + 1, 8)))
    with pytest.raises(slcp.TaskError, match=rf"is of a cost of {N} steps; a run has 100"):
        task(cost=weights, duration=2.0, measures={"cost": m.cost()})
    for wrong, text in (("x", "Task.failure is a str"), (m.final(0) > 1.0, "Task.failure is a Success"),
                        (m.state("block.z") > 1.0, "Task.failure: .*'block.z'")):  # fmt: skip
        with pytest.raises(slcp.InputError, match=text):
            task(failure=wrong)
    for changes, text in (({"name": "two\nlines"}, "a text of printable characters"),
                          ({"nmae": "x"}, r"replace names \['nmae'\]; choose from name, ")):  # fmt: skip
        with pytest.raises(slcp.TaskError, match=text):
            task().replace(**changes)
    with pytest.raises(slcp.TaskError, match="names 'failure_time', which every"):
        task(measures={"failure_time": m.final(0)})
    sim = slcp.Simulator(SCENE, dtype="float64", device="cpu")
    with pytest.raises(slcp.InputError, match="the cost is a task's"):
        sim.rollout(STARTS[0], controls=np.zeros((3, 1))).measure(m.cost())
    slcp.save_task(failing(0.36), tmp_path / "task.json")
    again = slcp.load_task(tmp_path / "task.json")
    assert again.failure.clauses == failure(0.36).clauses and again.measures == MEASURED


def test_what_follows_from_other_fields_follows_them_in_a_task_that_replaces_them():
    """The start of another scene, the duration of a longer plan, a period that is none: these were kept."""
    cart = slcp.Scene("cart", (slcp.Body("cart", 1.0, 0.1, joint="prismatic"),
                               slcp.Body("pole", 1.0, 0.1, joint="revolute", parent="cart")))  # fmt: skip
    other = replace(cart, initial_state=(1.0, 0.5, 0.0, 0.0), step_size=0.5 * cart.step_size)
    own = slcp.Task("t", cart, horizon=40, periods={"pole.angle": "turn"})
    assert own.replace(scene=other).start.tolist() == [[1.0, 0.5, 0.0, 0.0]]
    assert own.replace(start={"pole.angle": 0.1}, scene=other).start.tolist() == [[1.0, 0.1, 0.0, 0.0]]
    assert own.replace(scene=other).duration == pytest.approx(20 * cart.step_size)
    assert own.replace(horizon=80).duration == pytest.approx(80 * cart.step_size)
    assert own.replace(duration=1.0).replace(horizon=80).duration == 1.0
    assert own.replace(periods={}).scene.period is None
    assert own.replace(scene=other).scene.period[1] == pytest.approx(2.0 * np.pi)
