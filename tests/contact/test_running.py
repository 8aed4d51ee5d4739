"""Surfaces that run with a body's coordinate: belts, tracks, treadmills."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import Oracle
from oracle_coulomb import natural_map
from parameter_checks import check, check_jacobians, errors, smooth, states

import slcp_warp as slcp
from slcp_warp import Body, Contact, Scene, Shape
from slcp_warp import measures as m

LAWS = {
    "smoothed": slcp.Options(),
    "hard": slcp.Options("hard"),
    "coulomb": slcp.Options("hard", friction="coulomb"),
}
GRAVITY, MU = 9.81, 0.5


def tracks():
    """A belt on an arm run by a wheel of it, a deck of the world run by a rod that touches it itself."""
    bodies = (
        Body("cart", 1.0, 0.1, joint="prismatic", axis=(0.8, 0.6), com=(0.1, 0.2), angle=0.2),
        Body("arm", 2.0, 0.5, parent="cart", anchor=(0.1, 0.05), damping=0.3, armature=0.2),
        Body("wheel", 0.5, 0.05, parent="arm", anchor=(0.4, 0.1), com=(0.02, 0.0), damping=0.1),
        Body("rod", 1.0, 0.1, anchor=(0.6, 0.75), com=(0.0, 0.1), damping=0.1),
        Body("ball", 0.7, 0.02, joint="free", com=(0.02, -0.01)),
    )
    shapes = (
        Shape("belt", "arm", "capsule", (0.1, 0.5), (0.5, 0.05), 0.2, driven_by="wheel", surface_ratio=0.3),
        Shape("deck", None, "rectangle", (0.6, 0.2), (0.6, -0.2), 0.1, corner_radius=0.05, driven_by="rod",
              surface_ratio=-0.4),
        Shape("rod", "rod", "disc", 0.2, offset=(0.0, -0.5)),
        Shape("ball", "ball", "disc", 0.2, offset=(0.05, 0.0)),
    )  # fmt: skip
    contacts = (Contact("ball", "belt", 0.4), Contact("deck", "ball", 0.5), Contact("rod", "deck", 0.3))
    return Scene("tracks", bodies, shapes, contacts, step_size=0.02, sigma=0.05)


def conveyor(ratio=-1.0, mass=1e3, **deck):
    """A box on a deck of four metres, whose belt is a heavy body that runs at .6 m/s."""
    bodies = (Body("belt", mass, 1.0, joint="prismatic"), Body("box", 2.0, 0.02, joint="free"))
    shape = {"kind": "rectangle", "radius": (2.0, 0.1), "offset": (0.0, -0.1), "corner_radius": 0.01} | deck
    shapes = (
        Shape("deck", None, driven_by="belt", surface_ratio=ratio, **shape),
        Shape("box", "box", "rectangle", (0.1, 0.1), corner_radius=0.005),
    )
    start = {"box.y": 0.1, "box.x": -1.5, "belt.vshift": 0.6}
    return Scene("belt", bodies, shapes, (Contact("deck", "box", MU),), step_size=0.005, initial_state=start)


@pytest.mark.parametrize("law", LAWS)
def test_steps_are_those_of_the_oracle(law):
    scene = tracks()
    x, u, _ = states(scene, 150, speed=2.0)
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64")
    step = sim.step(x, u)
    solved = step.status == 0
    assert solved.mean() > 0.95 and (step.impulse > 1e-3).any(axis=1).mean() > 0.4
    if law == "coulomb":
        assert natural_map(scene, float, x, u, step)[solved].max() < 1e-9
    else:
        exact = Oracle(scene).step(x[solved], u[solved], hard=law == "hard")[0]
        np.testing.assert_allclose(step.state[solved], exact, rtol=1e-8, atol=1e-8)
    still = replace(scene, shapes=tuple(replace(shape, driven_by=None) for shape in scene.shapes))
    other = slcp.Simulator(still, LAWS[law], device="cpu", dtype="float64", strategy="generic").step(x, u)
    assert (np.abs(other.state - step.state).max(axis=1) > 1e-3).mean() > 0.3


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_by_state_and_numbers(law):
    scene = tracks()
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64")
    x, u, force = states(scene, 60)
    step = sim.step(x, u)  # where shapes are deep in each other friction decides nothing, but by rounding
    good = (step.status == 0) & (sim.linearize(x, u).status == 0) & (step.gap.min(axis=1) > -0.1)
    x, u, force = x[good], u[good], force[good]

    def rows(traj, params):
        return (traj.impulse[:, 0] > 0.0).astype(int)

    if law == "coulomb":
        lin, weight = sim.linearize(x, u), np.zeros((len(x), 2, sim.nx))
        weight[:, 1] = np.random.default_rng(0).standard_normal((len(x), sim.nx))
        back = slcp.vjp(sim, x, u[:, None], weight).x0
        np.testing.assert_allclose(back, np.einsum("bij,bi->bj", lin.A, weight[:, 1]), rtol=1e-8, atol=1e-8)
        return
    if law == "smoothed":
        check_jacobians(sim, x, u)
    inside = sim.params.replace(damping=np.maximum(sim.params["damping"], 0.05))
    found = errors(sim, x, u, inside, force, rows if law == "hard" else smooth)
    check({key: error for key, error in found.items() if law != "hard" or key[0] != "sigma"})


@pytest.mark.parametrize("law", ["hard", "coulomb"])
def test_a_belt_carries_a_box_to_its_end(law):
    """v = mu g t until both move alike, with the momentum of both; it falls off where the deck ends."""
    scene = conveyor()
    sim = slcp.Simulator(scene, LAWS[law], device="cpu", dtype="float64")
    run = sim.rollout(scene.x0, steps=1400, record="impulse")
    assert not run.status
    x, vx, belt, y = (
        run.states[:, scene.state_index(name)] for name in ("box.x", "box.vx", "belt.vshift", "box.y")
    )
    t = scene.step_size * np.arange(20)
    if law == "coulomb":  # Anitescu's friction first lifts a box over which a surface runs
        np.testing.assert_allclose(vx[:20], MU * GRAVITY * t, rtol=1e-9, atol=1e-12)
    alike = 1e3 * 0.6 / 1002.0
    assert vx[300] == pytest.approx(alike, rel=1e-9) and belt[300] == pytest.approx(alike, rel=1e-9)
    assert y[600] == pytest.approx(0.1, abs=1e-3) and y[-1] < -1.0 and x[-1] > 2.0
    slip = m.slip("deck/box")  # of the box against the deck, which runs ahead
    assert run.measure(m.largest(abs(slip), start=0.2, end=2.0)) < 1e-9
    first = 0.6 - vx[1] - (0.6 - belt[1])
    assert run.measure(m.largest(abs(slip), end=0.2)) == pytest.approx(first, rel=1e-8)


def test_what_slips_is_measured_against_the_surface():
    """In the kernel of a sweep as in the run that is recorded, and in pictures."""
    scene = conveyor()
    task = slcp.Task(
        "carry", scene, duration=1.0, options=LAWS["coulomb"],
        disturbances=slcp.Disturbances(start={"belt.vshift": 0.1}),
        measures={"slid": m.integral(abs(m.slip("deck/box"))), "most": m.largest(abs(m.slip("box")))},
    )  # fmt: skip
    report = slcp.sweep(task, worlds=5, cases=task.options, dtype="float64", device="cpu")
    part = report.part("none")
    speed = part["drawn_belt.vshift"].astype(float) * 1e3 / 1002.0  # of both at the end
    np.testing.assert_allclose(part["slid"], speed**2 / (2.0 * MU * GRAVITY), rtol=0.05)
    run = slcp.replay(
        task, None, slcp.draw_worlds(task, 5, dtype="float64"), record=("impulse", "gap"), case=task.options,
        dtype="float64", device="cpu",
    )  # fmt: skip
    for name, measure in task.measures.items():
        np.testing.assert_allclose(run.measure(measure), part[name], rtol=1e-5)


def test_a_wheel_on_a_treadmill():
    """A half-plane that runs by a turning body: the wheel is pressed on by gravity and turns with it."""
    bodies = (
        Body("drum", 50.0, 1.0),
        Body("fork", 1.0, 0.01, joint="prismatic", axis=(0.0, 1.0)),
        Body("wheel", 1.0, 0.01, parent="fork", anchor=(0.0, 0.2)),
    )
    shapes = (
        Shape("ground", None, "halfplane", angle=np.pi / 2, driven_by="drum", surface_ratio=0.5),
        Shape("rim", "wheel", "disc", 0.2),
    )
    scene = Scene("mill", bodies, shapes, (Contact("ground", "rim", 0.8),), step_size=0.01)
    sim = slcp.Simulator(scene, LAWS["coulomb"], dtype="float64", device="cpu")
    run = sim.rollout(scene.state({"drum.vangle": 2.0}), steps=100)
    drum, rim = (run.states[-1, scene.state_index(name)] for name in ("drum.vangle", "wheel.vangle"))
    assert not run.status and 1.0 < drum < 2.0
    # the ground runs to the left by .5 m/rad, the lowest point of the rim with it: clockwise
    assert rim == pytest.approx(-0.5 * drum / 0.2, rel=1e-9)
    assert 0.01 * rim / 0.2 == pytest.approx((drum - 2.0) / 0.5, rel=1e-9)  # the impulse at both levers


def test_files_and_names_keep_it(tmp_path):
    scene = conveyor()
    slcp.save_scene(scene, tmp_path / "belt.json")
    loaded = slcp.load_scene(tmp_path / "belt.json")
    assert loaded == scene and loaded.structure == scene.structure
    assert (
        scene.structure
        != replace(scene, shapes=(replace(scene.shapes[0], driven_by=None), scene.shapes[1])).structure
    )


@pytest.mark.parametrize(
    "driver, body, told",
    [
        ("best", None, "shape 'deck', driven_by: no body named 'best'"),
        ("box", None, "driven_by is 'box', whose joint is free; a body with one coordinate"),
        ("belt", "belt", "driven_by is 'belt', with which it moves as a whole"),
        ("belt", "box", "driven_by is 'belt', which does not hang on 'box'"),
        (3, None, "driven_by is 3"),
    ],
)
def test_what_cannot_drive_is_refused(driver, body, told):
    scene = conveyor()
    with pytest.raises(slcp.SceneError, match=told):
        replace(scene, shapes=(replace(scene.shapes[0], driven_by=driver, body=body), scene.shapes[1]))


def test_other_kernels_refuse_it():
    with pytest.raises(
        slcp.StrategyError, match="driven_by of shapes is offered by the generic kernels alone"
    ):
        slcp.Simulator(conveyor(), device="cpu", strategy="specialised")
    assert slcp.Simulator(conveyor(), device="cpu").strategy == "generic"
