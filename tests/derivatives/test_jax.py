"""Rollouts in JAX: the tape's numbers, differences, jit, vmap, scan, what is traced once, what is refused."""

from functools import partial

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator
from taped import start, tape_gradient

import slcp_warp as slcp

jax = pytest.importorskip("jax")
slcp_jax = pytest.importorskip("slcp_warp.jax")
jnp = jax.numpy


@pytest.fixture(autouse=True)
def _double(device):
    try:
        there = wp.device_to_jax(device)
    except RuntimeError as error:  # a GPU that this JAX does not see
        pytest.skip(str(error))
    with jax.enable_x64(True), jax.default_device(there):
        yield


def finger(device, dtype=wp.float64):
    return simulator("flicking_finger", device, dtype, "none")


def contact(device, worlds=3, steps=4):
    """A few steps from states in contact."""
    x0, us, _ = start()
    states = finger(device).rollout(x0, us).states[:, 18]
    return jnp.asarray(states[:worlds]), jnp.asarray(us[:worlds, 18 : 18 + steps])


def differences(loss, value, by=1e-6):
    """Central differences of a function by an array, a number at a time."""
    value = np.asarray(value)
    out = np.zeros(value.shape)
    for at in np.ndindex(value.shape):
        move = np.zeros(value.shape)
        move[at] = by
        out[at] = (float(loss(jnp.asarray(value + move))) - float(loss(jnp.asarray(value - move)))) / (2 * by)
    return out


@pytest.mark.parametrize("traced", [False, True], ids=["eager", "jit"])
def test_same_states_and_gradients_as_the_tape(device, traced):
    x0, us, weight = start()
    by_x, by_u, _ = tape_gradient(x0, us, weight, device)
    sim = finger(device)

    def loss(x, u):
        return (slcp_jax.rollout(sim, x, u).states * weight).sum()

    gradient = jax.grad(loss, argnums=(0, 1))
    found = (jax.jit(gradient) if traced else gradient)(jnp.asarray(x0), jnp.asarray(us))
    for one, other in zip(found, (by_x, by_u)):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
    states, status = slcp_jax.rollout(sim, x0, us)  # NumPy's numbers are taken, too
    np.testing.assert_array_equal(states, sim.rollout(x0, us).states)
    assert isinstance(states, jax.Array) and status.dtype == jnp.int32 and status.tolist() == [0, 0, 0]


def test_gradients_are_differences(device):
    """By states, controls, numbers of all parts and of single ones, of all worlds and of each."""
    sim, (x, us) = finger(device), contact(device)
    names = ("friction", f"{sim.scene.bodies[1].name}.mass", "sigma", f"{sim.scene.bodies[0].name}.com_x")
    values = jnp.asarray([0.4, 0.5, 0.6]), jnp.asarray([0.9, 1.0, 1.3]), jnp.asarray(0.08), jnp.asarray(0.13)
    weight = jnp.asarray(start()[2][:, : us.shape[1] + 1])

    def loss(x, us, *numbers):
        return (slcp_jax.rollout(sim, x, us, dict(zip(names, numbers))).states * weight).sum()

    given = (x, us, *values)
    found = jax.jit(jax.grad(loss, argnums=tuple(range(6))))(*given)
    for place, slope in enumerate(found):
        expected = differences(lambda v, p=place: loss(*given[:p], v, *given[p + 1 :]), given[place])
        assert np.abs(expected).max() > 1e-3
        np.testing.assert_allclose(slope, expected, atol=2e-7 * np.abs(expected).max(), rtol=1e-6)

    def shared(friction):  # one row of numbers for all worlds
        return (slcp_jax.rollout(sim, x, us, {"friction": friction}).states * weight).sum()

    half = jnp.asarray(0.5)
    np.testing.assert_allclose(jax.grad(shared)(half), differences(shared, half), rtol=1e-6)


def test_states_that_are_not_kept_are_made_again(device):
    sim, (x, us) = finger(device), contact(device, steps=7)
    assert slcp_jax.rollout(sim, x, us, checkpoint=3).states.shape == (3, 4, 6)
    kept = slcp_jax.rollout(sim, x, us).states[:, jnp.asarray([0, 3, 6, 7])]
    np.testing.assert_allclose(
        slcp_jax.rollout(sim, x, us, checkpoint=3).states, kept, rtol=1e-11, atol=1e-12
    )

    def last(us, friction, **how):
        states = slcp_jax.rollout(sim, x, us, {"friction": friction}, **how).states
        return (states[:, -1] ** 2).sum() + states[:, 0].sum()

    friction = jnp.full((3,), 0.5)
    found = jax.grad(lambda u, f: last(u, f, checkpoint=3), argnums=(0, 1))(us, friction)
    for one, other in zip(found, jax.grad(last, argnums=(0, 1))(us, friction)):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_worlds_by_vmap_are_worlds_by_batch(device):
    """States, table and both, one dimension and two; of the table's gradient, too."""
    sim, (x, us) = finger(device), contact(device)

    def last(x, u, friction):
        return slcp_jax.rollout(sim, x, u, {"friction": friction}).states[..., -1, :]

    values = jnp.asarray([0.3, 0.6])
    batch = [np.asarray(last(x, us, f)) for f in values]
    np.testing.assert_array_equal(jax.vmap(last, (0, 0, None))(x, us, values[0]), batch[0])
    np.testing.assert_array_equal(jax.vmap(last, (None, None, 0))(x, us, values), batch)
    both = jax.vmap(jax.vmap(last, (None, None, 0)), (0, 0, None))(x, us, values)
    np.testing.assert_array_equal(both, np.swapaxes(batch, 0, 1))
    own = jnp.asarray([[0.3, 0.4, 0.5], [0.6, 0.7, 0.8]])
    np.testing.assert_array_equal(
        jax.vmap(last, (None, None, 0))(x, us, own), [last(x, us, row) for row in own]
    )
    slope = jax.grad(lambda f, x: last(x, us, f).sum())
    found = jax.vmap(slope, (0, None))(values, x)
    np.testing.assert_allclose(found, [slope(f, x) for f in values], rtol=1e-12)
    assert np.ptp(found) > 1e-3
    found = jax.vmap(slope, (0, None))(own, x)
    np.testing.assert_allclose(found, [slope(row, x) for row in own], rtol=1e-12)


def test_a_loop_of_steps_under_a_policy(device):
    """`lax.scan` and `jax.checkpoint`; against differences."""
    sim, (x, _) = finger(device), contact(device)
    gain = jnp.asarray(0.3 * np.random.default_rng(2).standard_normal((6, 2)))

    def loss(gain):
        @jax.checkpoint
        def after(x, _):
            x, status = slcp_jax.step(sim, x, jnp.tanh(x @ gain))
            return x, (x, status)

        _, (states, status) = jax.lax.scan(after, x, length=6)
        return (states**2).sum() + 0.0 * status.sum()

    expected = differences(loss, gain)
    np.testing.assert_allclose(jax.grad(loss)(gain), expected, atol=1e-6 * np.abs(expected).max())


def test_jacobians_of_a_step(device):
    sim, (x, us) = finger(device), contact(device)
    params = {"friction": jnp.asarray([0.3, 0.4, 0.5])}
    found = jax.jit(lambda x, u: slcp_jax.linearize(sim, x, u, params))(x, us[:, 0])
    expected = sim.linearize(x, us[:, 0], sim.params.replace(friction=np.array([[0.3], [0.4], [0.5]])))
    for name in ("A", "B", "status"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    one = slcp_jax.linearize(sim, x[0])
    assert one.A.shape == (6, 6) and one.B.shape == (6, 2) and one.status.shape == ()
    each = jax.vmap(lambda x: slcp_jax.linearize(sim, x).A)(x)
    np.testing.assert_array_equal(each, slcp_jax.linearize(sim, x).A)
    with pytest.raises(NotImplementedError, match="the Jacobians of slcp_warp.jax.linearize have no deriv"):
        jax.grad(lambda x: slcp_jax.linearize(sim, x).A.sum())(x)
    at = jax.lax.stop_gradient
    assert not jax.grad(lambda x: slcp_jax.linearize(sim, at(x)).A.sum())(x).any()


def test_a_failed_world_has_a_status_and_nan(device):
    x0, us, _ = start()
    us = us[:, :5].copy()
    us[1, 2, 0] = np.nan
    sim = finger(device)
    assert slcp_jax.rollout(sim, x0, us).status.tolist() == [0, int(slcp.Status.NONFINITE), 0]
    found = jax.grad(lambda x: slcp_jax.rollout(sim, x, us).states[:, -1].sum())(jnp.asarray(x0))
    assert np.isnan(found[1]).all() and np.isfinite(found[jnp.asarray([0, 2])]).all()


def test_without_worlds_without_controls_without_a_batch(device):
    sim, (x, us) = finger(device), contact(device)
    none = jnp.zeros((0, 3, 2))
    assert slcp_jax.rollout(sim, jnp.zeros((0, 6)), none).states.shape == (0, 4, 6)
    assert (
        jax.grad(lambda u: slcp_jax.rollout(sim, jnp.zeros((0, 6)), u).states.sum())(none).shape == none.shape
    )
    assert slcp_jax.linearize(sim, jnp.zeros((0, 6))).A.shape == (0, 6, 6)
    one = slcp_jax.rollout(sim, x[0], us[0])
    np.testing.assert_array_equal(one.states, slcp_jax.rollout(sim, x, us).states[0])
    assert one.status.shape == () and slcp_jax.step(sim, x[0], us[0, 0]).states.shape == (6,)
    for found, expected in (  # controls for all worlds
        (slcp_jax.rollout(sim, x, us[0]), slcp_jax.rollout(sim, x, us[:1].repeat(3, 0))),
        (slcp_jax.step(sim, x, us[0, 0]), slcp_jax.step(sim, x, us[:1, 0].repeat(3, 0))),
    ):
        np.testing.assert_array_equal(found.states, expected.states)
    free = simulator("rubbing_particle", device, wp.float64, "inertia")
    state = jnp.asarray([[0.0, 0.001, 0.1, 0.3, -0.2, 0.0]])
    np.testing.assert_array_equal(slcp_jax.step(free, state).states, free.step(state).state)
    assert jax.grad(lambda x: slcp_jax.step(free, x).states.sum())(state).shape == (1, 6)


def test_an_external_force(device):
    sim, (x, us) = finger(device), contact(device)
    force = np.random.default_rng(1).standard_normal((3, 3, 3))
    expected = sim.rollout(np.asarray(x), np.asarray(us), external_force=force).states
    np.testing.assert_array_equal(slcp_jax.rollout(sim, x, us, external_force=force).states, expected)

    def loss(force, x):
        return slcp_jax.rollout(sim, x, us, external_force=force).states.sum()

    with pytest.raises(slcp.ArrayError, match="external_force is differentiated, but has no gradient"):
        jax.grad(loss)(jnp.asarray(force), x)
    kept = jax.grad(lambda x: loss(jax.lax.stop_gradient(force * x.sum()), x))(x)
    assert np.isfinite(kept).all() and kept.any()


def test_a_function_is_traced_once_for_its_shapes(device):
    """Without `jax.jit`, too: what JAX calls is kept, so that a loop neither compiles nor grows."""
    from slcp_warp.jax.foreign import backward_of, forward_of

    sim, (x, us) = finger(device), contact(device)
    gradient = jax.grad(lambda x, u: slcp_jax.rollout(sim, x, u).states.sum())
    gradient(x, us), slcp_jax.rollout(sim, x, us)
    calls = forward_of(sim, 0, False), backward_of(sim, 0, False)
    before = [len(call.call_descriptors) for call in calls]
    for factor in (1.0, 2.0):
        gradient(factor * x, us), slcp_jax.rollout(sim, factor * x, us)
    assert [len(call.call_descriptors) for call in calls] == before and min(before) > 0


def test_float32(device):
    sim, (x, us) = finger(device, wp.float32), contact(device)
    with jax.enable_x64(False):
        x, us = jnp.asarray(x, jnp.float32), jnp.asarray(us, jnp.float32)
        whole = jax.grad(lambda x: slcp_jax.rollout(sim, x, us).states[:, -1].sum())(x)

        def chained(x):
            for k in range(us.shape[1]):
                x = slcp_jax.step(sim, x, us[:, k]).states
            return x.sum()

        found = jax.grad(chained)(x)
        assert found.dtype == jnp.float32
        np.testing.assert_allclose(found, whole, atol=1e-4, rtol=1e-3)
        with pytest.raises(slcp.ArrayError, match="computes in float64, which JAX has not got: .*enable_x64"):
            slcp_jax.rollout(finger(device), x, us)


def test_bad_input_is_named(device):
    sim, (x, us) = finger(device), contact(device)
    roll, step, linearize = (partial(f, sim) for f in (slcp_jax.rollout, slcp_jax.step, slcp_jax.linearize))
    single, pushes = jnp.float32(1.0), np.zeros((2, 3, 3))
    for wrong, text in (
        (lambda: roll(x.astype(jnp.float32), us), "x0 is a JAX array of float32; one of float64 is needed"),
        (lambda: roll("here", us), "x0 is 'here'; "),
        (lambda: roll(x, us[..., :1]), r"controls has shape \(3, 4, 1\); \(B, N, 2\) or \(N, 2\)"),
        (lambda: roll(x, us[:2]), r"controls has shape \(2, 4, 2\); \(3, N, 2\) is needed"),
        (lambda: roll(x, us[:, :0]), "at least one step is needed"),
        (lambda: roll(x, us, {"weight": x}), r"no parameter \['weight'\]"),
        (lambda: roll(x, us, {"mass": x[:2, :3]}), "params are given for 2 worlds, x0 for 3"),
        (lambda: roll(x, us, {"friction": single}), "friction is a JAX array of float32; one of float64"),
        (lambda: roll(x, us, {"friction": -0.5}), "friction is -0.5; it must not be negative"),
        (lambda: linearize(x, None, {"friction": -0.5}), "friction is -0.5; it must not be negative"),
        (lambda: roll(x, us, {"mass": jnp.inf}), "mass is inf; it must be finite"),
        (lambda: roll(x, us, sim.params.track()), "params are tracked, .* give arrays by name"),
        (lambda: roll(x, us, checkpoint=0), "checkpoint is 0"),
        (lambda: step(x, us[:2, 0]), r"u has shape \(2, 2\); \(3, 2\) or \(2,\) is needed"),
        (lambda: linearize(x, us[:2, 0]), r"u has shape \(2, 2\); \(3, 2\) or \(2,\) is needed"),
        (lambda: roll(x, us, external_force=pushes), "is given for 2 worlds, x0 for 3"),
    ):  # fmt: skip
        with pytest.raises(slcp.InputError, match=text):
            wrong()
    with pytest.raises(slcp.ArgumentTypeError, match="params is a list; Parameters or a dict of arrays"):
        slcp_jax.rollout(sim, x, us, [0.5])
    for traced in (lambda m: roll(x, us, {"mass": m}).states, lambda m: linearize(x, None, {"mass": m}).A):
        with pytest.raises(
            (jax.errors.JaxRuntimeError, ValueError), match="ParameterError: mass is -1.0; it must be pos"
        ):
            jax.block_until_ready(jax.jit(traced)(-1.0))
    loss = jax.grad(lambda m: slcp_jax.rollout(sim, x, us, {"mass": m}).states.sum())
    with pytest.raises(NotImplementedError, match="second derivatives of slcp_warp.jax"):
        jax.grad(loss)(1.0)
    with pytest.raises(NotImplementedError, match="second derivatives of slcp_warp.jax"):
        jax.hessian(lambda x: slcp_jax.rollout(sim, x, us).states.sum())(x)


def test_options_without_derivatives_step_and_say_so(device):
    options = slcp.Options(residual="hard", gap="end")
    sim = slcp.Simulator(scene("flicking_finger"), options, device=device, dtype="float64")
    x, us = contact(device)
    np.testing.assert_array_equal(
        slcp_jax.rollout(sim, x, us).states, sim.rollout(np.asarray(x), np.asarray(us)).states
    )
    with pytest.raises(slcp.OptionError, match="'end', which has no derivatives"):
        jax.grad(lambda x: slcp_jax.rollout(sim, x, us).states.sum())(x)


def test_simulators_take_and_give_jax_arrays(device):
    sim, (x, us) = finger(device), contact(device)
    run = sim.rollout(x, us)
    assert isinstance(run.states, jax.Array) and isinstance(run.status, jax.Array)
    np.testing.assert_array_equal(run.states, sim.rollout(np.asarray(x), np.asarray(us)).states)
    assert isinstance(sim.step(x[0]).state, jax.Array) and sim.step(x[0]).state.shape == (6,)
    assert isinstance(sim.linearize(x).A, jax.Array)
    assert "3 worlds" in repr(run) and run.table()[sim.scene.state_names[0]].shape == (15,)
    with pytest.raises(slcp.ArrayError, match="x0 is traced by JAX; inside jax.jit, grad or vmap use"):
        jax.jit(lambda x: sim.rollout(x, us).states)(x)
    with pytest.raises(slcp.ArrayError, match="is .*; an array of numbers is needed"):
        sim.step(x > 0.0)
    A, b = jnp.asarray([[2.0, 1.0], [1.0, 2.0]]), jnp.asarray([-1.0, 0.5])
    solved = slcp.solve_complementarity(A, b, residual="hard")
    assert isinstance(solved.impulse, jax.Array)
    np.testing.assert_allclose(solved.impulse, [0.5, 0.0], atol=1e-12)


def test_a_failed_world_that_is_left_out_adds_nothing(device):
    """To the gradients of what all worlds share, by whatever way it is left out."""
    x0, us, _ = start()
    us = us[:, :5].copy()
    us[1, 2, 0] = np.nan
    sim, solved = finger(device), jnp.asarray([0, 2])

    def loss(friction, shared, left_out):
        states, status = slcp_jax.rollout(sim, jnp.asarray(x0), us + shared, {"friction": friction})
        return left_out((states[:, -1] ** 2).sum(1), status)

    def alone(friction, shared):
        states = slcp_jax.rollout(sim, x0[[0, 2]], us[[0, 2]] + shared, {"friction": friction}).states
        return (states[:, -1] ** 2).sum()

    friction, shared = jnp.asarray(0.5), jnp.zeros((5, 2))
    expected = jax.grad(alone, argnums=(0, 1))(friction, shared)
    for left_out in (
        lambda each, status: each[solved].sum(),
        lambda each, status: jnp.where(status == 0, each, 0.0).sum(),
    ):
        found = jax.jit(jax.grad(lambda f, s, way=left_out: loss(f, s, way), argnums=(0, 1)))(
            friction, shared
        )
        for one, other in zip(found, expected):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_generic_kernels(device):
    options = slcp.Options(scaling="none")
    sim = slcp.Simulator(
        scene("flicking_finger"), options, device=device, dtype="float64", strategy="generic"
    )
    x, us = contact(device)
    own, shared = finger(device), jnp.asarray(0.5)

    def loss(sim, x, us, friction):
        return (slcp_jax.rollout(sim, x, us, {"friction": friction}).states ** 2).sum()

    found, expected = (jax.grad(partial(loss, each), argnums=(0, 1, 2))(x, us, shared) for each in (sim, own))
    for one, other in zip(found, expected):
        np.testing.assert_allclose(one, other, atol=1e-8 * np.abs(other).max())
    jacobians = (slcp_jax.linearize(each, x, us[:, 0]).A for each in (sim, own))
    np.testing.assert_allclose(*jacobians, atol=1e-8)


def test_an_interrupt_is_an_error_and_no_result(device, monkeypatch):
    from slcp_warp.jax import foreign

    def interrupted(*_):
        raise KeyboardInterrupt

    sim, (x, us) = finger(device), contact(device)
    expected = slcp_jax.rollout(sim, x, us).states
    with monkeypatch.context() as patch:
        patch.setattr(foreign, "roll_out", interrupted)
        with pytest.raises((jax.errors.JaxRuntimeError, ValueError), match="stopped by KeyboardInterrupt"):
            jax.block_until_ready(slcp_jax.rollout(sim, x, us))
    np.testing.assert_array_equal(slcp_jax.rollout(sim, x, us).states, expected)
