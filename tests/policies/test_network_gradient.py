"""Gradients through a network's rollout against a loop over single differentiable steps, and differences."""

import numpy as np
import pytest
from simulators import simulator
from taped import start

import slcp_warp as slcp

torch = pytest.importorskip("torch")
import slcp_warp.torch as slcp_torch  # noqa: E402

STEPS = 30


def finger(device):
    import warp as wp

    return simulator("flicking_finger", device, wp.float64, "none")


def network(device):
    torch.manual_seed(0)
    layers = torch.nn.Linear(6, 16), torch.nn.Tanh(), torch.nn.Linear(16, 2)
    return torch.nn.Sequential(*layers).double().to(device)


def case(device):
    x0 = torch.tensor(start()[0], device=device, requires_grad=True)
    mass = torch.tensor(finger(device).params["mass"], device=device, requires_grad=True)
    rng = np.random.default_rng(0)
    weight = torch.tensor(rng.standard_normal((len(x0), STEPS + 1, 6)), device=device)
    return x0, mass, weight


def in_a_loop(sim, x0, module, mass):
    states = [x0]
    for _ in range(STEPS):
        states.append(slcp_torch.step(sim, states[-1], module(states[-1]), {"mass": mass}).states)
    return torch.stack(states, 1)


def test_gradients_are_those_of_the_steps_one_after_another(device):
    sim, module, (x0, mass, weight) = finger(device), network(device), case(device)
    wanted = [x0, mass, *module.parameters()]
    run = slcp_torch.closed_loop(sim, x0, module, STEPS, {"mass": mass})
    loop = in_a_loop(sim, x0, module, mass)
    assert not run.status.any()
    np.testing.assert_allclose(run.states.detach().cpu(), loop.detach().cpu(), rtol=0, atol=1e-9)
    found = torch.autograd.grad((weight * run.states).sum(), wanted)
    exact = torch.autograd.grad((weight * loop).sum(), wanted)
    for one, other in zip(found, exact):
        scale = float(other.abs().max())
        assert scale > 0.0
        np.testing.assert_allclose(one.cpu(), other.cpu(), rtol=0, atol=1e-7 * scale)


def test_one_world_without_a_batch_and_no_more_than_is_wanted(device):
    sim, module, (x0, _, weight) = finger(device), network(device), case(device)
    alone = slcp_torch.closed_loop(sim, x0[0].detach(), module, STEPS)
    both = slcp_torch.closed_loop(sim, x0, module, STEPS)
    assert alone.states.shape == (STEPS + 1, 6)
    np.testing.assert_array_equal(alone.states.detach().cpu(), both.states[0].detach().cpu())
    (weight[0] * alone.states).sum().backward()
    assert x0.grad is None and all(p.grad.abs().max() > 0.0 for p in module.parameters())


def test_a_world_that_fails_has_no_gradient(device):
    sim, module, (x0, _, weight) = finger(device), network(device), case(device)
    bad = x0.detach().clone()
    bad[0, 0] = torch.nan
    bad.requires_grad_()
    run = slcp_torch.closed_loop(sim, bad, module, STEPS)
    (gradient,) = torch.autograd.grad((weight * run.states).sum(), bad, retain_graph=True)
    assert run.status[0] == slcp.Status.NONFINITE and not run.status[1:].any()
    assert torch.isfinite(gradient[1:]).all() and torch.isnan(gradient[0]).all()
    (left_out,) = torch.autograd.grad((weight * run.states)[1:].sum(), bad)
    torch.testing.assert_close(left_out[1:], gradient[1:])
    assert not left_out[0].any()


def test_bad_input_says_so():
    sim, x0 = finger("cpu"), torch.tensor(start()[0])
    for module, steps, text in (
        (network("cpu").float(), 3, "module has 0.weight of torch.float32 on cpu; torch.float64"),
        (network("cpu")[:1], 3, "takes 6 numbers and gives 16"),
        (network("cpu")[0], 3, "module is a Linear"),
        (network("cpu"), 0, "steps is 0"),
    ):
        with pytest.raises(slcp.InputError, match=text):
            slcp_torch.closed_loop(sim, x0, module, steps)
    with pytest.raises(slcp.ArrayError, match="x0 is torch.float32"):
        slcp_torch.closed_loop(sim, x0.float(), network("cpu"), 3)
