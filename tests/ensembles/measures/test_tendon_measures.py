"""How hard tendons pull in sweeps: against what speeds bodies up, what holds a weight, and rollouts."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.tasks.notation import measure_content, measure_of

STEPS, H, G = 60, 0.01, 9.81


def train(limited: bool, **fields) -> slcp.Scene:
    """A rider on a cart, on one line: tendons of both coordinates and of one, three controls."""
    cart = slcp.Body("cart", 2.0, 0.01, joint="prismatic")
    rider = slcp.Body("rider", 0.7, 0.01, "cart", joint="prismatic")
    most = {"force_limit": 3.0, "force_sigma": 0.4} if limited else {}
    tendons = (
        slcp.Tendon("both", ("cart.shift", "rider.shift"), (1.0, -0.6), 90.0, 0.8, 0.1, **most),
        slcp.Tendon("one", ("rider.shift",), (1.5,), -4.0, 0.3),
    )
    motors = (
        slcp.Actuator(tendon="one", gear=0.5),
        slcp.Actuator(tendon="both", gear=2.0),
        slcp.Actuator(tendon="both", gear=-0.3),
    )
    return slcp.Scene("train", (cart, rider), actuators=motors, tendons=tendons, step_size=H, **fields)


ASKED = {
    "both": m.integral(m.tendon_force("both")),
    "one": m.integral(m.tendon_force(1)),
    "rms": m.rms(m.tendon_force("both")),
    "most": m.largest(abs(m.tendon_force("both"))),
    "pulled": m.share_of_time(m.tendon_force("both") > 0.0),
    "mean": m.mean(m.tendon_force("one"), where=m.state("cart.vshift") > 0.0),
    "cart": m.change("cart.vshift"),
    "rider": m.change("rider.vshift"),
}


def pushing(scene: slcp.Scene) -> slcp.policies.Linear:
    gains = -np.array([[1.0, 0.5, 0.2, 0.1], [3.0, 0.2, 0.4, 0.0], [0.0, 1.0, 0.0, 0.5]])
    return slcp.policies.Linear(gains, scene.x0, [0.4, 1.5, -0.7])


def task_of(scene: slcp.Scene, **changes) -> slcp.Task:
    drawn = {
        "parameters": {
            "cart.mass": slcp.Uniform(1.0, 3.0),
            "both.tendon_stiffness": slcp.Uniform(0.0, 300.0),
            "one.tendon_damping": slcp.Uniform(0.0, 2.0),
        },
        "start": {"cart.vshift": slcp.Normal(0.5), "rider.shift": slcp.Normal(0.2)},
        "delay": slcp.Uniform(0.0, 0.03),
        "torque": 0.2,
    }
    return slcp.Task("train", scene, duration=STEPS * H, measures=ASKED,
                     disturbances=slcp.Disturbances(**drawn), **changes)  # fmt: skip


KINDS = [("specialised", False), ("generic", False), ("generic", True)]


@pytest.mark.parametrize("implicit", [True, False])
@pytest.mark.parametrize("strategy, limited", KINDS)
@pytest.mark.parametrize("law", ["hard", "rem-logistic"])
def test_what_pulls_speeds_bodies_up(device, strategy, limited, implicit, law):
    """Nothing else does: M (v - v0) is the time integral of the tendons' forces, c_j of each on coordinate j,
    whatever a world's numbers, controls and step are.
    """
    scene = train(limited, implicit_damping=implicit, implicit_stiffness=implicit)
    task = task_of(scene)
    report = slcp.sweep(
        task, pushing(scene), worlds=24, cases=slcp.Options(law), device=device, dtype="float64",
        strategy=strategy
    )  # fmt: skip
    of = report.part("policy")
    assert (of["status"] == 0).all()
    cart, rider = of["drawn_cart.mass"], 0.7
    both, one = of["both"], of["one"]
    scale = 1e-6 * (np.abs(both).max() + np.abs(one).max())  # masses are told in single precision
    moved = (cart + rider) * of["cart"] + rider * of["rider"]
    np.testing.assert_allclose(moved, both, rtol=0, atol=scale)
    own = rider * (of["cart"] + of["rider"])
    np.testing.assert_allclose(own, 1.5 * one - 0.6 * both, rtol=0, atol=1e-4 * scale)
    assert np.ptp(both) > 0.1 and np.ptp(one) > 0.1
    assert 0.0 < of["pulled"].mean() < 1.0
    if limited:
        assert (of["most"] <= 3.0 + 1e-12).all() and (of["most"] > 2.9).sum() > 12
    else:
        assert of["most"].max() > 10.0


@pytest.mark.parametrize("strategy, limited", KINDS)
def test_a_replay_says_the_same(device, strategy, limited):
    """Of worlds with late, noisy controls, from states that it records in single precision."""
    scene = train(limited)
    task, push = task_of(scene), pushing(scene)
    given = {"device": device, "dtype": "float64", "strategy": strategy}
    of = slcp.sweep(task, push, worlds=5, cases=slcp.Options("hard"), **given).part("policy")
    worlds, case = slcp.draw_worlds(task, 5), slcp.Options("hard")
    run = slcp.replay(task, push, worlds, case=case, record="controls", **given)
    for name, measure in ASKED.items():
        np.testing.assert_allclose(run.measure(measure), of[name], rtol=1e-5, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("strategy, limited", KINDS[1:])
def test_a_replay_ends_where_a_failure_did(device, strategy, limited, tmp_path):
    """Of what was told to be far away, and stands still at once, servos ask for more than ever they did."""
    scene = train(limited)
    task, push = task_of(scene, failure=abs(m.state("cart.vshift")) > 0.6), pushing(scene)
    given = {"device": device, "dtype": "float64", "strategy": strategy}
    of = slcp.sweep(task, push, worlds=8, cases=slcp.Options("hard"), **given).part("policy")
    worlds, case = slcp.draw_worlds(task, 8), slcp.Options("hard")
    run = slcp.replay(task, push, worlds, case=case, record="controls", **given)
    early = of["failure_time"] < (STEPS - 2) * H
    assert 2 <= early.sum() and len(np.unique(of["failure_time"][early])) > 1
    again = slcp.Trajectory.load(run.save(tmp_path / "run.npz"))
    for name, measure in ASKED.items():
        for each in (run, again, run[:]):
            np.testing.assert_allclose(each.measure(measure), of[name], rtol=1e-5, atol=1e-5, err_msg=name)
    np.testing.assert_allclose(run[early].measure(ASKED["rms"]), of["rms"][early], rtol=1e-5)
    steps = np.round(of["failure_time"][early] / H).astype(int) + 1
    for forces, made in zip(run.tendon_forces[early], steps):
        assert np.abs(forces[:made]).max() > 0.0 and not forces[made:].any()
    bad = run.record()
    bad.header["made"] = [0] * 8
    with pytest.raises(slcp.FileError, match="made is .*; 8 whole numbers from 1 to 60"):
        slcp.Trajectory.load(bad.save(tmp_path / "bad.npz"))


@pytest.mark.parametrize("law, sigma", [("hard", 0.5), ("rem-logistic", 0.0), ("rem-logistic", 0.5)])
def test_a_servo_that_holds_a_weight_gives_its_weight(device, law, sigma):
    """1.2 kg at rest, told a place; a wall that it is driven into takes what is more than the weight."""
    lift = slcp.Body("lift", 1.2, 0.01, joint="prismatic", axis=(0.0, 1.0), upper=0.2)
    drive, motor = slcp.limited_servo(lift, 400.0, 20.0, force_sigma=sigma)
    scene = slcp.Scene("lift", (lift,), actuators=(motor,), tendons=(drive,), step_size=H)
    asked = {
        "gives": m.final(m.tendon_force("lift_servo")),
        "at its limit": m.share_of_time(m.tendon_force("lift_servo") > 20.0 - 1e-9, start=1.0),
        "pressed": m.final(m.state("lift.shift")),
    }
    task = slcp.Task("lift", scene, duration=3.0, measures=asked)
    told = {name: slcp.policies.Linear(np.zeros((1, 2)), scene.x0, [u]) for name, u in
            {"holds": 0.1, "presses": 4.0}.items()}  # fmt: skip
    report = slcp.sweep(task, told, worlds=1, cases=slcp.Options(law), device=device, dtype="float64")
    holds, presses = (report.part(name) for name in told)
    assert holds["gives"][0] == pytest.approx(1.2 * G, rel=1e-6)
    assert holds["at its limit"][0] == 0.0
    assert presses["gives"][0] == pytest.approx(20.0, rel=1e-9)  # 1,600 N are asked for: the mean, too, is 20
    assert presses["at its limit"][0] == 1.0


def test_files_have_it():
    for measure in (ASKED["most"], ASKED["mean"], m.final(m.tendon_force(0))):
        assert measure_of(measure_content(measure), "") == measure
    assert repr(ASKED["both"].of) == "tendon_force('both')"
    with pytest.raises(slcp.InputError, match="tendon_force"):
        m.since_start(m.tendon_force("both"))


def test_errors_name_what_there_is():
    scene = train(False)
    still = slcp.policies.Linear(np.zeros((3, 4)), scene.x0, [0.0, 0.0, 0.0])

    def swept(of, scene=scene, **options):
        task = slcp.Task("train", scene, duration=0.1, measures={"f": m.final(of)})
        return slcp.sweep(task, still, worlds=1, cases=slcp.Options("hard", **options), device="cpu")

    with pytest.raises(slcp.ArgumentError, match="tendon is 'bothe'; there are both, one"):
        swept(m.tendon_force("bothe"))
    with pytest.raises(slcp.ArgumentError, match="tendon is 2; a number from 0 to 1"):
        swept(m.tendon_force(2))
    with pytest.raises(slcp.ArgumentTypeError, match="which is None; a name or a whole number"):
        m.tendon_force(None)
    with pytest.raises(slcp.ArgumentError, match="tendon_force: the trapezoidal rule"):
        swept(m.tendon_force("both"), integrator="trapezoidal")
    with pytest.raises(slcp.ArgumentError, match="there are none"):
        slcp.scenes.flicking_finger().tendon_index(0)
    run = slcp.Simulator(scene, slcp.Options("hard"), device="cpu").rollout(scene.x0, np.zeros((5, 3)))
    with pytest.raises(slcp.ArgumentError, match="record='controls'"):
        run.measure(m.final(m.tendon_force("both")))


def test_a_picture_has_the_forces_where_they_are_known():
    pytest.importorskip("matplotlib")
    scene = train(False)
    sim = slcp.Simulator(scene, slcp.Options("hard"), device="cpu", dtype="float64", strategy="specialised")
    for record in ((), ("controls",)):
        run = sim.rollout(np.tile(scene.x0, (2, 1)), np.ones((2, 5, 3)), record=record)
        drawn = {ax.get_ylabel(): ax for ax in run.plot(1).axes}
        assert ("tendon [N, N m]" in drawn) == bool(record)
    lines = {line.get_label(): line.get_ydata() for line in drawn["tendon [N, N m]"].get_lines()}
    assert list(lines) == ["both", "one"]
    np.testing.assert_array_equal(lines["both"][:-1], run.tendon_forces[1, :, 0])
