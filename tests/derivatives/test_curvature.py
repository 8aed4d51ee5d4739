"""Second derivatives of generic kernels, by the Lagrangian of a solved step: differences of A and B of random
mechanisms, and what DDP weighs them by.
"""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import near_contact, random_tree
from simulators import scene

import slcp_warp as slcp
from slcp_warp import ddp

LAWS = {
    "smoothed": {},
    "unscaled": {"scaling": "none"},
    "hard": {"residual": "hard"},
    "coulomb": {"residual": "hard", "friction": "coulomb"},
    "leapfrog": {"integrator": "leapfrog"},
    "leapfrog, coulomb": {"residual": "hard", "friction": "coulomb", "integrator": "leapfrog"},
}


def mechanism(seed):
    """Branches, dampers that act late or early, a spring and a tendon that are met late, half of the pairs
    bounce.
    """
    rng = np.random.default_rng(200 + seed)
    sc = random_tree(rng, 4, contacts=True)
    spring = slcp.Spring("body0", "body3", (0.1, 0.2), stiffness=30.0, damping=1.0, length=0.4)
    pairs = tuple(replace(pair, restitution=0.6 * (n % 2)) for n, pair in enumerate(sc.contacts))
    changes = {"implicit_stiffness": bool(seed % 2), "implicit_damping": bool(seed % 2)}
    ends = sc.state_names[1], sc.state_names[sc.nv - 1]
    tendon = slcp.Tendon("tendon", ends, (0.8, -0.5), 25.0, 0.7, 0.1)
    changes["actuators"] = (*sc.actuators, slcp.Actuator(tendon="tendon"))
    return replace(sc, springs=(spring,), tendons=(tendon,), contacts=pairs, **changes), rng


def slopes(sim, x, u, weights, params):
    """The gradient of a weighted next state by x and u, and the status."""
    lin = sim.linearize(x, u if sim.nu else None, params)
    return np.einsum("bi,bij->bj", weights, np.concatenate([lin.A, lin.B], 2)), np.asarray(lin.status)


def by_differences(sim, x, u, weights, params, e):
    """(B, nz, nz), and where all that they are made of is solved and slopes to both sides agree (B,)."""
    z = np.concatenate([x, u], 1)
    here, status = slopes(sim, x, u, weights, params)
    good, columns, kinks = status == 0, [], []
    for unit in e * np.eye(z.shape[1]):
        sides = [slopes(sim, *np.split(z + side * unit, [sim.nx], 1), weights, params) for side in (1, -1)]
        (up, one), (down, two) = sides
        good &= (one == 0) & (two == 0)
        columns.append((up - down) / (2.0 * e))
        kinks.append(np.abs(up + down - 2.0 * here).max(1) / e)
    found = np.stack(columns, 2)
    smooth = np.max(kinks, 0) <= 1e-2 * np.abs(found).max((1, 2)) + 1e-6 * np.abs(here).max(1)
    return found, good & smooth


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(4))
def test_they_are_differences_of_slopes(law, seed):
    sc, rng = mechanism(seed)
    sim = slcp.Simulator(sc, slcp.Options(**LAWS[law]), device="cpu", strategy="generic")
    params = sim.params if sim.options.hard else sim.params.replace(sigma=0.1)
    x = near_contact(sc, rng, 24)
    u, weights = rng.standard_normal((24, sim.nu)), rng.standard_normal((24, sim.nx))
    found, status = slcp.weighted_hessian(sim, x, u, weights, params)
    expected, smooth = by_differences(sim, x, u, weights, params, 3e-7 if sim.options.hard else 2e-6)
    keep = smooth & (status == 0)
    touched = np.abs(sim.step(x, u, params).impulse).max(1) > 1e-3
    assert keep.sum() >= 12 and (keep & touched).sum() >= 4
    size = np.abs(expected).max((1, 2), keepdims=True) + np.abs(slopes(sim, x, u, weights, params)[0]).max()
    bound = 3e-5 if sim.options.hard else 1e-6  # of differences over shorter steps
    assert (np.abs(found - expected) / size)[keep].max() <= bound
    np.testing.assert_array_equal(found, found.swapaxes(1, 2))


@pytest.mark.parametrize("scene_of", ["branches", "stack"])
def test_those_of_all_outputs_add_up_to_the_weighed_ones(scene_of):
    """Weights of q' and v' of a step of one tree, and of bodies of their own; a world without a solution."""
    sc, rng = mechanism(1)
    if scene_of == "stack":
        sc = slcp.scenes.stack(3)
        x = np.tile(sc.x0, (6, 1)) + 1e-3 * rng.standard_normal((6, 18))
    else:
        x = near_contact(sc, rng, 6)
    sim = slcp.Simulator(sc, device="cpu", strategy="generic")
    x[2, 0] = np.nan
    u, weights = rng.standard_normal((6, sim.nu)), rng.standard_normal((6, sim.nx))
    lin = sim.linearize(x, u if sim.nu else None, second=True)
    found, status = slcp.weighted_hessian(sim, x, u, weights)
    h = sim.params["step_size"]
    by_velocity = weights[:, sim.scene.nv :] + h * weights[:, : sim.scene.nv]
    expected = np.einsum("bi,bijk->bjk", by_velocity, lin.second)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_array_equal(status, lin.status)
    assert status[2] == slcp.Status.NONFINITE and not found[2].any() and not lin.second[2].any()
    assert (np.delete(status, 2) == 0).all() and np.abs(np.delete(found, 2, 0)).max((1, 2)).all()


def test_without_actuators_there_are_those_by_the_state():
    sc = replace(mechanism(0)[0], actuators=())
    sim = slcp.Simulator(sc, device="cpu", strategy="generic")
    x = near_contact(sc, np.random.default_rng(3), 3)
    weights = np.ones_like(x)
    found, status = slcp.weighted_hessian(sim, x, np.zeros((3, 0)), weights)
    assert found.shape == (3, sim.nx, sim.nx) and not status.any()
    expected, smooth = by_differences(sim, x, np.zeros((3, 0)), weights, None, 1e-6)
    assert smooth.any()
    np.testing.assert_allclose(found[smooth], expected[smooth], rtol=0, atol=1e-4 * np.abs(expected).max())


def test_a_heavy_body_on_a_light_one_keeps_its_digits():
    """Masses 1e6 to 1, under both scalings."""
    sc = slcp.scenes.stack(2, [1e-3, 1e3], 0.5, size=0.1)
    x = np.tile(sc.x0, (4, 1)) + 1e-3 * np.random.default_rng(5).standard_normal((4, 12))
    for scaling in ("inertia", "none"):
        sim = slcp.Simulator(sc, slcp.Options(scaling=scaling), device="cpu", strategy="generic")
        weights = np.random.default_rng(6).standard_normal(x.shape)
        none = np.zeros((4, 0))
        found, status = slcp.weighted_hessian(sim, x, none, weights)
        expected, smooth = by_differences(sim, x, none, weights, None, 1e-7)
        keep = smooth & (status == 0)
        assert keep.sum() >= 2
        size = np.abs(expected).max((1, 2), keepdims=True)
        assert (np.abs(found - expected) / size)[keep].max() <= 1e-4


@pytest.mark.parametrize("stiffness", [1e8, 1e11])
def test_a_row_beside_a_stiff_tendon_keeps_its_change(stiffness):
    """A stiff tendon amplifies controls: that is checked, in place of what dz of a limit follows, 1e5 times
    the second derivative.
    """
    bodies = (slcp.Body("pressed", 1.0, 0.1, joint="prismatic", upper=1.0), slcp.Body("lever", 1.0, 1e-3),
              slcp.Body("slider", 1.0, 0.1, joint="prismatic"))  # fmt: skip
    tendon = slcp.Tendon("stiff", ("lever.angle", "slider.shift"), (1.0, 1.0), stiffness)
    pulled = slcp.Actuator("pressed"), slcp.Actuator("lever")
    sc = slcp.Scene("tied", bodies, tendons=(tendon,), actuators=pulled, step_size=0.05)
    sim = slcp.Simulator(sc, device="cpu", strategy="generic")
    params = sim.params.replace(sigma=0.05)
    x, u = np.array([[0.99, 0.3, -0.3, 0.5, 0.4, -0.4]]), np.array([[3.0, 1.0]])
    found, status = slcp.weighted_hessian(sim, x, u, np.ones((1, 6)), params)
    expected, _ = by_differences(sim, x, u, np.ones((1, 6)), params, 1e-5)
    assert status[0] == 0 and np.abs(expected).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def finger(horizon=20):
    sim = slcp.Simulator(scene("flicking_finger"), device="cpu", strategy="generic")
    return ddp.Problem(sim, ddp.costs.quadratic(np.eye(6), 0.1 * np.eye(2)), horizon)


def weighed(work, weights):
    """Whether the second derivatives that a workspace holds are those under these weights."""
    sim, d = work.problem.dynamics, work._derivatives
    xs, us = work.xs.numpy()[0], work.us.numpy()[0]
    found, _ = slcp.weighted_hessian(sim, xs[:-1], us, weights[1:])
    held = d.second.numpy()[:, 0]
    assert np.abs(found).max() > 1e-3
    return np.abs(held - found).max() <= 1e-9 * np.abs(found).max()


def costates(work):
    """Of the trajectory and cost that a workspace holds."""
    d = work._derivatives
    lx, fx = d.lx.numpy()[0], d.fx.numpy()[0]
    found = [lx[-1]]
    for k in reversed(range(len(fx))):
        found.append(lx[k] + fx[k].T @ found[-1])
    return np.array(found[::-1])


def test_a_pass_weighs_by_costates_first_and_then_by_the_value_function():
    """Also where the line search found nothing: then by the value function about this very trajectory."""
    work = ddp.Workspace(finger(), 1)
    x0, us = scene("flicking_finger").x0[None], 0.5 * np.random.default_rng(0).standard_normal((1, 20, 2))
    for again in (False, True):  # what a workspace solved before is no value function of the next problem
        work.start(x0, (1.0 - 0.5 * again) * us)
        work.differentiate()
        first = costates(work)
        assert weighed(work, first)
        work.backward()
        before, xs = work.Vx.numpy()[0].copy(), work.xs.numpy().copy()
        work._state.fresh.zero_()
        work.differentiate()
        assert weighed(work, before) and not weighed(work, first)
        work.search()
        assert np.abs(work.xs.numpy() - xs).max() > 1e-6
        work.differentiate()
        assert weighed(work, before) and not weighed(work, costates(work))


def test_gaps_and_limits_begin_with_costates_again():
    """Multiple shooting and rounds of state limits end where single shooting without limits does, if these
    are far away; where they are not they hold.
    """
    problem, x0 = finger(), scene("flicking_finger").x0
    us = 0.3 * np.random.default_rng(1).standard_normal((20, 2))
    plain = ddp.solve(problem, x0, us)
    shot = ddp.solve(problem, x0, plain.us, xs0=plain.xs + 1e-3 * np.sin(np.arange(21))[:, None])
    assert plain.status == shot.status == ddp.Status.CONVERGED
    np.testing.assert_allclose(shot.cost, plain.cost, rtol=1e-9)
    low, high = np.full(6, -50.0), np.full(6, 50.0)
    wide = ddp.solve(replace(problem, state_limits=(low, high)), x0, us)
    np.testing.assert_allclose(wide.cost, plain.cost, rtol=1e-9)
    low[3] = 0.8 * plain.xs[:, 3].min()  # a speed
    held = ddp.solve(replace(problem, state_limits=(low, high)), x0, us)
    assert low[3] < -0.1 and held.status == ddp.Status.CONVERGED and held.cost > plain.cost
    assert held.xs[1:, 3].min() >= low[3] * (1.0 + 1e-3)


def test_where_a_spring_has_no_length_steps_are_shorter():
    """Its ends 2e-6 m apart on a disc of 5 m, beside a kernel of its own in closed form."""
    sc = slcp.Scene(
        "sprung", (slcp.Body("a", 1.0, 0.1, joint="free"),), (slcp.Shape("d", "a", "disc", 5.0),),
        springs=(slcp.Spring(None, "a", stiffness=100.0, damping=2.0),), step_size=0.01,
    )  # fmt: skip
    x, w = np.array([[2e-6, 1e-6, 0.1, 0.3, -0.2, 0.1]]), np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 0.0]])
    found = [
        slcp.weighted_hessian(slcp.Simulator(sc, device="cpu", strategy=way), x, np.zeros((1, 0)), w)[0]
        for way in ("generic", "specialised")
    ]
    np.testing.assert_allclose(*found, rtol=0, atol=1e-4 * np.abs(found[1]).max())


def test_no_problems_have_plans_of_none():
    plan = ddp.solve(finger(), np.zeros((0, 6)), np.zeros((0, 20, 2)))
    assert plan.xs.shape == (0, 21, 6) and plan.status.shape == (0,)


@pytest.mark.full
def test_passes_are_as_many_as_with_kernels_of_its_own():
    """V_x of the pass before does as well as that of the pass; costates in all of them take twice as many."""
    x0 = scene("flicking_finger").x0
    us = 0.5 * np.random.default_rng(7).standard_normal((24, 50, 2))
    passes = {}
    for strategy in ("generic", "specialised"):
        sim = slcp.Simulator(
            scene("flicking_finger"), slcp.Options(scaling="none"), device="cpu", strategy=strategy
        )
        problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, 50)
        plan = ddp.solve(problem, np.tile(x0, (24, 1)), us, ddp.Options(max_iterations=300))
        assert (plan.status == ddp.Status.CONVERGED).mean() > 0.9
        passes[strategy] = plan.iterations.mean()
    assert passes["generic"] <= 1.4 * passes["specialised"]


def test_they_do_not_depend_on_the_unit_of_length():
    """Two boxes of .1 m and of .1 mm, with velocities, gravity and sigma to match."""
    found = []
    rng = np.random.default_rng(8)
    noise, weights = 1e-3 * rng.standard_normal((3, 12)), rng.standard_normal((3, 12))
    for unit in (1.0, 1e-3):
        sc = slcp.scenes.stack(2, [1.0, 2.0], 0.5, size=0.1 * unit)
        sim = slcp.Simulator(sc, device="cpu", strategy="generic")
        of = np.tile([unit, unit, 1.0], 4)  # of every state
        params = sim.params.replace(gravity=(0.0, -9.81 * unit), sigma=0.1 * unit)
        hessian, status = slcp.weighted_hessian(
            sim, sc.x0 + noise * of, np.zeros((3, 0)), weights / of, params
        )
        assert not status.any()
        found.append(hessian * of[:, None] * of)
    np.testing.assert_allclose(*found, rtol=0, atol=1e-7 * np.abs(found[0]).max())
    assert np.abs(found[0]).max() > 1.0
