"""Rollouts in PyTorch: gradcheck, the tape's numbers, torch.func, torch.compile, and what is refused."""

import copy
import gc

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator
from taped import STEPS, start, tape_gradient

import slcp_warp as slcp

torch = pytest.importorskip("torch")
slcp_torch = pytest.importorskip("slcp_warp.torch")


def finger(device, dtype=wp.float64):
    return simulator("flicking_finger", device, dtype, "none")


def tensor(array, device, dtype=torch.float64, grad=True):
    return torch.tensor(array, dtype=dtype, device=wp.device_to_torch(device), requires_grad=grad)


def contact(device, worlds=3, steps=4):
    """A few steps from states in contact."""
    x0, us, _ = start()
    states = finger(device).rollout(x0, us).states[:, 18]
    return tensor(states[:worlds], device), tensor(us[:worlds, 18 : 18 + steps], device)


def test_gradcheck_by_states_controls_and_parameters(device):
    sim = finger(device)
    x, us = contact(device)
    numbers = {
        "friction": tensor([0.4, 0.5, 0.6], device), "mass": tensor(sim.params["mass"], device),
        "step_size": tensor(0.05, device), "sigma": tensor(0.08, device),
    }  # fmt: skip

    def states(x, us, *values):
        return slcp_torch.rollout(sim, x, us, dict(zip(numbers, values))).states

    assert torch.autograd.gradcheck(states, (x, us, *numbers.values()), eps=1e-6, atol=1e-6, rtol=1e-4)

    def kept(x, us):
        return slcp_torch.rollout(sim, x, us, checkpoint=3).states

    assert kept(x, us).shape == (3, 3, 6)
    assert torch.autograd.gradcheck(kept, (x, us), eps=1e-6, atol=1e-6, rtol=1e-4)


@pytest.mark.slow
def test_gradcheck_of_a_free_body_that_rubs(device):
    sim = simulator("rubbing_particle", device, wp.float64, "inertia")
    x = tensor([[0.0, 0.001, 0.1, 0.3, -0.2, 0.0], [0.0, 0.05, 0.0, 0.0, 0.0, 1.0]], device)
    us = torch.zeros((2, 3, 0), dtype=x.dtype, device=x.device)
    friction = tensor([[0.5], [0.7]], device)

    def states(x, friction):
        return slcp_torch.rollout(sim, x, us, {"friction": friction}).states

    assert torch.autograd.gradcheck(states, (x, friction), eps=1e-6, atol=1e-6, rtol=1e-4)


def test_same_gradient_as_the_tape_and_no_copy(device):
    x0, us, weight = start()
    gx, gu, _ = tape_gradient(x0, us, weight, device)
    x, u = tensor(x0, device), tensor(us, device)
    out = slcp_torch.rollout(finger(device), x, u)
    (out.states * tensor(weight, device, grad=False)).sum().backward()
    np.testing.assert_allclose(x.grad.cpu(), gx, atol=1e-9 * np.abs(gx).max())
    np.testing.assert_allclose(u.grad.cpu(), gu, atol=1e-9 * np.abs(gu).max())
    assert out.status.dtype == torch.int32 and not out.status.requires_grad
    one = slcp_torch.rollout(finger(device), x[0], u[0])  # without the batch axis
    assert one.states.shape == (STEPS + 1, 6) and one.status.shape == ()
    torch.testing.assert_close(one.states, out.states[0])


@pytest.mark.slow
def test_parameters_of_single_parts(device):
    """The same states as with all of them, and the gradients of their numbers; by world or for all."""
    sim, (x, us) = finger(device), contact(device)
    names = [body.name for body in sim.scene.bodies]
    mass = tensor([0.4, 0.5, 0.6], device)  # of the second body, a world's own
    gain = tensor(1.3, device)
    kept = tensor(np.tile(sim.params["mass"], (3, 1)), device, grad=False)
    whole = torch.stack([kept[:, 0], mass, kept[:, 2]], 1)
    both = (
        {f"{names[1]}.mass": mass, f"{names[0]}.com_x": 0.1 * gain},
        {"mass": whole, "com": torch.stack([
            torch.cat([0.1 * gain[None], tensor(sim.params["com"][0, 1:], device, grad=False)]),
            *tensor(sim.params["com"][1:], device, grad=False)])},
    )  # fmt: skip
    found = []
    for params in both:
        run = slcp_torch.rollout(sim, x, us, params)
        loss = (run.states * torch.arange(6.0, dtype=x.dtype, device=x.device)).sum()
        found.append((run.states.detach(), *torch.autograd.grad(loss, [mass, gain])))
    for one, other in zip(*found):
        torch.testing.assert_close(one, other, rtol=1e-12, atol=1e-12)
        assert one.abs().max() > 0.0
    params = sim.params.replace(**{f"{names[1]}.mass": [0.4, 0.5, 0.6], f"{names[0]}.com_x": 0.13})
    np.testing.assert_array_equal(params[f"{names[1]}.mass"], [0.4, 0.5, 0.6])
    np.testing.assert_array_equal(params[f"{names[0]}.com"], [[0.13, params["com"][0, 1]]] * 3)
    assert sim.params[f"{names[1]}.mass"] == sim.params["mass"][1]
    for wrong, text in (
        ({"nobody.mass": mass}, "nobody.mass"), ({f"{names[1]}.masss": mass}, "masss"),
        ({f"{names[1]}.mass": mass[:2]}, "3 worlds|2 worlds"), ({f"{names[1]}.mass": whole}, "has shape"),
    ):  # fmt: skip
        with pytest.raises(slcp.InputError, match=text):
            slcp_torch.rollout(sim, x, us, {"friction": tensor([0.4, 0.5, 0.6], device)} | wrong)


def test_float32_steps_chain_to_a_rollout(device):
    sim = finger(device, wp.float32)
    x0, us, _ = start()
    x, u = tensor(x0, device, torch.float32), tensor(us[:, :5], device, torch.float32)
    whole = slcp_torch.rollout(sim, x, u).states[:, -1]
    (gradient,) = torch.autograd.grad(whole.sum(), x)
    state = x
    for k in range(5):
        state = slcp_torch.step(sim, state, u[:, k]).states
    (chained,) = torch.autograd.grad(state.sum(), x)
    torch.testing.assert_close(state, whole, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(chained, gradient, atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("first", [slice(0, 1), 0], ids=["one world", "no batch axis"])
def test_slices_of_one_world(device, first):
    sim = finger(device)
    x, us = contact(device)

    def gradients(worlds):
        state, u = x[worlds], us[worlds]
        state = slcp_torch.rollout(sim, state, u[..., 2:3, :]).states[..., -1, :]  # slices with odd strides
        for k in range(2):
            state = slcp_torch.step(sim, state, u[..., k, :]).states
        state = slcp_torch.rollout(sim, state, u, checkpoint=3).states[..., -1, :]
        return torch.autograd.grad(state.reshape(-1, sim.nx)[0].square().sum(), (x, us))

    torch.testing.assert_close(gradients(first), gradients(slice(0, 2)))


def test_a_failed_world_has_a_status_and_nan(device):
    x0, us, _ = start()
    us = us[:, :5].copy()
    us[1, 2, 0] = np.nan
    x, u = tensor(x0, device), tensor(us, device)
    out = slcp_torch.rollout(finger(device), x, u)
    assert out.status.tolist() == [0, int(slcp.Status.NONFINITE), 0]
    out.states[:, -1].sum().backward()
    assert x.grad[1].isnan().all() and x.grad[[0, 2]].isfinite().all()


def test_torch_func(device):
    sim = finger(device)
    x, us = (t.detach() for t in contact(device))

    def last(x, u):
        return slcp_torch.rollout(sim, x, u).states[-1]

    by_hand = torch.autograd.functional.jacobian(lambda x: last(x, us[0]), x[0])
    torch.testing.assert_close(torch.func.jacrev(last)(x[0], us[0]), by_hand)
    each = torch.func.vmap(last)(x, us)  # worlds by vmap are worlds by batch
    torch.testing.assert_close(each, slcp_torch.rollout(sim, x, us).states[:, -1], atol=1e-10, rtol=1e-10)

    def loss(friction):
        return slcp_torch.rollout(sim, x, us, {"friction": friction}).states[:, -1].sum()

    values = torch.tensor([0.3, 0.6], dtype=torch.float64, device=x.device)
    slopes = torch.func.vmap(torch.func.grad(loss))(values)
    for value, slope in zip(values, slopes):
        torch.testing.assert_close(torch.func.grad(loss)(value), slope, atol=1e-9, rtol=1e-9)


def compiled_and_eager(loss, *inputs):
    """Gradients (2, inputs) of a function compiled as one graph, and then in eager mode."""
    torch._dynamo.reset()
    compiled = torch.compile(loss, backend="aot_eager", fullgraph=True)
    return [torch.autograd.grad(f(*inputs), inputs) for f in (compiled, loss)]


def assert_same(found, expected):
    """Equal to rounding, finite, and none of them zero everywhere."""
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected):
        assert one.isfinite().all() and one.abs().max() > 1e-6
        torch.testing.assert_close(one, other)


def test_torch_compile_keeps_it_whole(device):
    x, us = contact(device)
    fresh = slcp.Simulator(  # the first use of this simulator is under torch.compile
        scene("flicking_finger"), slcp.Options(scaling="none"), device=device, dtype="float64"
    )
    found, expected = compiled_and_eager(
        lambda *xu: slcp_torch.rollout(fresh, *xu).states[:, -1].square().sum(), x, us
    )
    assert found[0].shape == x.shape and found[1].shape == us.shape
    assert_same(found, expected)


@pytest.mark.slow
def test_torch_compile_with_parameters(device):
    sim = finger(device)
    x, us = contact(device)
    friction = tensor(0.4, device)

    def loss(x, friction):
        return slcp_torch.rollout(sim, x, us, {"friction": friction}).states[:, -1].square().sum()

    assert_same(*compiled_and_eager(loss, x, friction))
    module = slcp_torch.Rollout(sim, learn=("friction", "mass"))
    learned = compiled_and_eager(
        lambda x, *_: module(x, us).states[:, -1].square().sum(), x, *module.parameters()
    )
    assert_same(*learned)
    other = sim.params.replace(friction=0.2)
    compiled = torch.compile(slcp_torch.rollout, backend="aot_eager", fullgraph=True)
    for params in (sim.params, other):  # a constant of the graph: another one traces again
        expected = slcp_torch.rollout(sim, x, us, params).states
        torch.testing.assert_close(compiled(sim, x, us, params).states, expected)


@pytest.mark.slow
def test_torch_compile_with_two_calls(device):
    sim = finger(device)
    x, us = contact(device)

    def steps(x, us):
        for k in range(2):
            x = slcp_torch.step(sim, x, us[:, k], {"friction": 0.4}).states
        return slcp_torch.rollout(sim, x, us).states[:, -1].square().sum()

    found, expected = compiled_and_eager(steps, x, us)
    assert found[0].shape == x.shape and found[1].shape == us.shape
    assert_same(found, expected)


def test_a_module_learns_friction(device):
    sim = finger(device)
    x0, us, _ = start()
    x, u = tensor(x0, device, grad=False), tensor(us[:, :40], device, grad=False)
    with torch.no_grad():
        truth = slcp_torch.rollout(sim, x, u, {"friction": tensor(0.3, device)}).states
    module = slcp_torch.Rollout(sim, learn=("friction",))
    optimiser = torch.optim.LBFGS(module.parameters(), line_search_fn="strong_wolfe")

    def closure():
        optimiser.zero_grad()
        loss = (module(x, u).states - truth).square().mean()
        loss.backward()
        return loss

    for _ in range(3):
        optimiser.step(closure)
    assert abs(module.physical["friction"].item() - 0.3) < 1e-4
    assert sim.params["friction"] == 0.5  # the module learns on a copy


def test_bad_input_is_named(device):
    sim = finger(device)
    x, us = contact(device)
    with pytest.raises(slcp.ArrayError, match="x0 is torch.float32 on .*; a tensor of torch.float64"):
        slcp_torch.rollout(sim, x.float(), us)
    with pytest.raises(slcp.ArrayError, match="controls is a ndarray; a tensor of torch.float64"):
        slcp_torch.rollout(sim, x, us.detach().cpu().numpy())
    with pytest.raises(slcp.ArrayError, match=r"controls has shape \(3, 4, 1\); \(B, N, 2\) or \(N, 2\)"):
        slcp_torch.rollout(sim, x, us[..., :1])
    with pytest.raises(slcp.ParameterError, match=r"no parameter \['weight'\]"):
        slcp_torch.rollout(sim, x, us, {"weight": x})
    with pytest.raises(slcp.ParameterError, match="friction is -0.5; it must not be negative"):
        slcp_torch.rollout(sim, x, us, {"friction": tensor(-0.5, device)})
    with pytest.raises(slcp.ArrayError, match="params are given for 2 worlds, x0 for 3"):
        slcp_torch.rollout(sim, x, us, {"friction": tensor([0.5, 0.6], device)})
    with pytest.raises(slcp.ParameterError, match="mass is inf; it must be finite"):
        slcp_torch.rollout(sim, x, us, {"mass": np.inf})
    with pytest.raises(slcp.ParameterError, match="radius .* is 0.0; an ellipse's must be positive"):
        slcp_torch.rollout(sim, x, us, {"radius": tensor(0.0, device)})
    with pytest.raises(slcp.ParameterError, match="shape_angle of .* is 0.3; it was built with the angle 0"):
        slcp_torch.rollout(sim, x, us, {"shape_angle": tensor(0.3, device)})
    with pytest.raises(slcp.ParameterError, match="params are tracked, .* give tensors by name"):
        slcp_torch.rollout(sim, x, us, sim.params.track())
    with pytest.raises(slcp.ArrayError, match="external_force requires a gradient"):
        slcp_torch.rollout(sim, x, us, external_force=tensor(np.zeros((3, 3, 3)), device))
    with pytest.raises(ValueError, match="checkpoint is 0"):
        slcp_torch.rollout(sim, x, us, checkpoint=0)
    state = slcp_torch.rollout(sim, x, us).states[:, -1].square().sum()
    (gradient,) = torch.autograd.grad(state, x, create_graph=True)
    with pytest.raises(NotImplementedError, match="second derivatives of slcp_warp.torch rollouts"):
        gradient.sum().backward()


@pytest.mark.slow
def test_a_number_as_covariance_is_times_the_identity(device):
    sim = slcp.Simulator(
        scene("flicking_finger"), slcp.Options(noise="state", scaling="none"), device=device, dtype="float64"
    )
    x, us = contact(device)
    for value in (0.01, [0.01, 0.02, 0.03]):
        given = {"position_covariance": tensor(value, device)}
        expected = slcp_torch.rollout(sim, x, us, sim.params.replace(position_covariance=value)).states
        torch.testing.assert_close(slcp_torch.rollout(sim, x, us, given).states, expected)
    with pytest.raises(slcp.ParameterError, match="position_covariance is nan; it must be finite"):
        slcp_torch.rollout(sim, x, us, {"position_covariance": tensor(np.nan, device)})


def test_backward_after_the_simulator_went_out_of_scope(device):
    x, us = contact(device)

    def states():
        options = slcp.Options(scaling="none")
        sim = slcp.Simulator(scene("flicking_finger"), options, device=device, dtype="float64")
        return slcp_torch.rollout(sim, x, us).states

    late = states()
    gc.collect()
    late.sum().backward()
    found = x.grad.clone()
    x.grad = None
    slcp_torch.rollout(finger(device), x, us).states.sum().backward()
    torch.testing.assert_close(found, x.grad)


def test_options_without_derivatives_say_so(device):
    sim = slcp.Simulator(
        scene("flicking_finger"), slcp.Options(residual="hard", gap="end"), device=device, dtype="float64"
    )
    x, us = contact(device)
    with pytest.raises(slcp.OptionError, match="'end', which has no derivatives"):
        slcp_torch.rollout(sim, x, us, {"friction": tensor(0.5, device)})


def test_a_disc_that_is_learned_keeps_one_radius():
    """Only the first number of its two has a gradient; `Parameters.replace` refuses two different ones."""
    sim = simulator("grasp")
    module = slcp_torch.Rollout(sim, learn=("radius",))
    with torch.no_grad():
        module.physical["radius"][:, 0] += 0.01
    like = torch.zeros(1, dtype=torch.float64)
    table = slcp_torch.table.parameter_table(sim, module.values(), like).detach().numpy()
    start = sim.params.layout.offset("radius")
    radius = table[0, start : start + 6].reshape(3, 2)
    np.testing.assert_array_equal(sim.params.replace(radius=radius)["radius"], sim.params["radius"] + 0.01)


def test_jacobians_of_one_world_in_common_kernels():
    """An expanded status of one world has no stride that Warp takes."""
    sim = slcp.Simulator(slcp.scenes.stack(3), device="cpu", dtype="float64")
    assert sim.strategy == "generic"
    x = torch.tensor(sim.scene.x0[None])

    def after(y):
        return slcp_torch.step(sim, y, torch.zeros(len(y), sim.nu, dtype=torch.float64))[0]

    rows = torch.func.jacrev(after)(x)[0, :, 0]
    torch.testing.assert_close(rows, torch.autograd.functional.jacobian(after, x)[0, :, 0])
    assert rows.abs().max() > 0.5


def test_a_number_for_all_is_of_what_the_scene_has(device):
    """Friction of two contacts, one built without: a scalar, or one a world, as in NumPy; parameters and
    copies of an equal scene; no worlds.
    """
    bodies = tuple(slcp.Body(name, 1.0, 0.1, joint="free") for name in "ab")
    shapes = (slcp.Shape("floor", None, "halfplane", angle=np.pi / 2),
              *(slcp.Shape(f"disc{name}", name, "disc", 0.1) for name in "ab"))  # fmt: skip
    contacts = slcp.Contact("floor", "disca", 0.5), slcp.Contact("floor", "discb", None)
    own = slcp.Scene("two", bodies, shapes, contacts, initial_state=(0, 0.1, 0, 1, 0.1, 0, *(0.0,) * 6))
    sim = slcp.Simulator(own, device=device, strategy="generic")
    x = np.tile(own.x0, (3, 1))
    x[:, 6] = 1.0
    expected = sim.rollout(x, np.zeros((3, 5, 0)), sim.params.replace(friction=0.3)).states
    states, us = tensor(x, device), tensor(np.zeros((3, 5, 0)), device)
    for value in (0.3, [0.3] * 3, [[0.3]] * 3):
        friction = tensor(value, device)
        run = slcp_torch.rollout(sim, states, us, {"friction": friction})
        np.testing.assert_allclose(run.states.detach().cpu(), expected, rtol=0, atol=1e-12)
        assert torch.autograd.grad(run.states.sum(), friction)[0].abs().sum() > 0.0
    with pytest.raises(slcp.ParameterError, match="'floor/discb' is 0.3; it was built without friction"):
        slcp_torch.rollout(sim, states, us, {"friction": tensor([0.3, 0.3], device)})
    for same in (slcp.Parameters(own), copy.deepcopy(sim.params)):
        slcp_torch.rollout(sim, states, us, same)
    none = tensor(np.zeros((0, 12)), device)
    for keep in (None, 2):
        run = slcp_torch.rollout(sim, none, us[:0], checkpoint=keep)
        assert torch.autograd.grad(run.states.sum(), none)[0].shape == (0, 12)
    assert sim.rollout(np.zeros((0, 12)), np.zeros((0, 5, 0)), checkpoint=2).states.shape == (0, 4, 12)
