"""Numbers of single parts that a module of PyTorch learns; what worlds that a loss leaves out add to them."""

import numpy as np
import pytest
from taped import start
from test_torch import contact, finger, slcp_torch, tensor, torch

import slcp_warp as slcp


def test_a_module_learns_numbers_of_single_parts(device):
    """The gradient of one number is the sum over what has it; PyTorch takes no dots in names."""
    sim = finger(device)
    x, us = contact(device)
    one, all_of = "link2.mass", sim.scene.pair_names[0].partition("/")[0] + ".friction"
    module = slcp_torch.Rollout(sim, learn=(one, all_of))
    assert list(module.state_dict()) == [f"physical.{name.replace('.', ':')}" for name in (one, all_of)]
    module(x, us).states[:, -1].square().sum().backward()
    whole = {name: tensor(sim.params[name], device) for name in ("mass", "friction")}
    slcp_torch.rollout(sim, x, us, whole).states[:, -1].square().sum().backward()
    found = [value.grad for value in module.physical.values()]
    body = [body.name for body in sim.scene.bodies].index("link2")
    torch.testing.assert_close(found, [whole["mass"].grad[body], whole["friction"].grad.sum()])
    with pytest.raises(slcp.ParameterError, match="names 'middle.mass'"):
        slcp_torch.Rollout(sim, learn="middle.mass")
    for wrong in (("mas",), 3):
        with pytest.raises(slcp.InputError, match="learn"):
            slcp_torch.Rollout(sim, learn=wrong)


def test_parts_of_several_numbers_are_named_by_one(device):
    """Two coordinates learned as one number, silently, where they happened to be the same."""
    sim = finger(device)
    with pytest.raises(slcp.ParameterError, match="has 2 numbers; name one, as 'link2.com_x'"):
        slcp_torch.Rollout(sim, learn="link2.com")
    assert slcp_torch.Rollout(sim, learn="link2.com_x").values()["link2.com_x"].ndim == 0


def test_names_may_hold_what_stands_for_a_dot(device):
    scene = slcp.Scene("odd", (slcp.Body("a:b", 2.0, 1.0, joint="prismatic"),), gravity=(0.0, 0.0))
    sim = slcp.Simulator(scene, device=device)
    module = slcp_torch.Rollout(sim, learn=("a:b.mass",))
    states = module(torch.ones(1, 2, dtype=torch.float64), torch.zeros(1, 3, 0, dtype=torch.float64)).states
    assert list(module.values()) == ["a:b.mass"] and states.shape == (1, 4, 2)


def test_no_steps_are_refused():
    scene = slcp.scenes.flicking_finger()
    sim = slcp.Simulator(scene, device="cpu", dtype="float64")
    x = torch.zeros(2, 6, dtype=torch.float64)
    with pytest.raises(slcp.ArrayError, match=r"controls has shape \(2, 0, 2\); at least one step is needed"):
        slcp_torch.rollout(sim, x, torch.zeros(2, 0, 2, dtype=torch.float64))


def test_logarithms_are_learned_of_what_is_positive(device):
    """The gradient by the logarithm is that by the number, times it; a long step stays positive."""
    sim = finger(device)
    x, us = contact(device)
    plain, logs = (
        slcp_torch.Rollout(sim, learn=("link2.mass", "inertia"), log=log) for log in ((), "inertia")
    )
    for module in (plain, logs):
        module(x, us).states[:, -1].square().sum().backward()
    values = logs.values()["inertia"]
    torch.testing.assert_close(values, plain.values()["inertia"])
    torch.testing.assert_close(logs.physical["inertia"].grad, values * plain.physical["inertia"].grad)
    torch.testing.assert_close(logs.physical["link2:mass"].grad, plain.physical["link2:mass"].grad)
    with torch.no_grad():
        logs.physical["inertia"] -= 5.0
    assert (logs.values()["inertia"] > 0.0).all()
    with pytest.raises(slcp.InputError, match="log"):
        slcp_torch.Rollout(sim, learn=("mass",), log=("inertia",))
    with pytest.raises(slcp.ParameterError, match="log names 'gravity', which is .* only what is positive"):
        slcp_torch.Rollout(sim, learn="gravity", log="gravity")


def test_a_failed_world_that_is_left_out_adds_nothing(device):
    x0, us, _ = start()
    us = us[:, :5].copy()
    us[1, 2, 0] = np.nan
    friction = tensor(0.5, device)

    def gradient(worlds, left):
        x, u = tensor(x0[worlds], device, grad=False), tensor(us[worlds], device, grad=False)
        states, status = slcp_torch.rollout(finger(device), x, u, {"friction": friction})
        return torch.autograd.grad(states[left(status)][:, -1].square().sum(), friction)[0]

    found = gradient([0, 1, 2], lambda status: status == 0)
    torch.testing.assert_close(found, gradient([0, 2], lambda status: status >= 0))
    assert gradient([0, 1, 2], lambda status: status >= 0).isnan()
