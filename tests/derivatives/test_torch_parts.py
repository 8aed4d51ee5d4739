"""Numbers of single parts that a module of PyTorch learns."""

import pytest
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
