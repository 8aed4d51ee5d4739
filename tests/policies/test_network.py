"""Networks inside the kernels against PyTorch's own, and what is no such network."""

import numpy as np
import pytest
from test_own import SCENE, STARTS, loose, same_as_by_hand, simulator

import slcp_warp as slcp
from slcp_warp import policies

torch = pytest.importorskip("torch")
nn = torch.nn


def net(*activations, widths=(8, 13, 32, 1)):
    """A module in float64, of random weights that do not vanish at the states of a push."""
    torch.manual_seed(0)
    layers = []
    for given, wanted, activation in zip(widths, widths[1:], activations):
        layers += [nn.Linear(given, wanted), activation] if activation else [nn.Linear(given, wanted)]
    return nn.Sequential(*layers).double()


def of_torch(module):
    return lambda k, x: module(torch.as_tensor(x)).detach().numpy()


NETWORKS = {
    "tanh, relu": (nn.Tanh(), nn.ReLU(), None),
    "elu, softplus, sigmoid": (nn.ELU(0.7), nn.Softplus(2.0, 0.5), nn.Sigmoid()),
    "gelu, leaky": (nn.GELU(), nn.GELU("tanh"), nn.LeakyReLU(0.2)),
    "silu, identity": (nn.SiLU(), nn.Identity(), nn.Tanh()),
}


@pytest.mark.parametrize("activations", NETWORKS.values(), ids=NETWORKS)
def test_controls_are_those_of_the_module(device, activations):
    """At states from everywhere, to the rounding of float64."""
    sim, module = loose(device), net(*activations)
    x0 = SCENE.x0 + 2.0 * np.random.default_rng(0).standard_normal((50, 8))
    run = sim.rollout(x0, policy=policies.Network(module), steps=2, record="controls")
    wanted = of_torch(module)(0, run.states[:, :-1])
    solved = run.status == 0
    assert solved.sum() > 40 and np.ptp(wanted) > 0.05
    np.testing.assert_allclose(run.controls[solved], wanted[solved], rtol=1e-12, atol=1e-13)


def test_a_rollout_is_that_of_the_module_in_a_loop(device):
    """Specialised; sequences inside a sequence, a layer without biases; what is learned meanwhile counts."""
    first = nn.Linear(8, 16, bias=False)
    module = nn.Sequential(nn.Sequential(first, nn.Tanh()), nn.Linear(16, 1)).double()
    policy = policies.Network(module)
    with torch.no_grad():
        first.weight *= 10.0
        module[1].bias += 3.0
    same_as_by_hand(simulator(device), policy, of_torch(module))


def test_networks_of_a_size_share_their_kernels():
    one, two = (policies.Network(net(nn.Tanh(), None, None)) for _ in range(2))
    sim = simulator("cpu", "generic")
    assert (
        one.kernel(sim)[0]
        == two.kernel(sim)[0]
        != policies.Network(net(nn.ReLU(), None, None)).kernel(sim)[0]
    )
    half = policies.Network(net(nn.Tanh(), None, None).float()).kernel(sim)[1]
    assert half.weights.numpy().dtype == np.float64


def broken():
    module = net(None, None, None)
    with torch.no_grad():
        module[1].weight[0, 0] = np.nan
    return module


S = nn.Sequential
BAD = {
    "a function": (lambda: np.tanh, "module is a ufunc; a torch.nn.Sequential is needed"),
    "a layer alone": (lambda: nn.Linear(8, 1), "module is a Linear; a torch.nn.Sequential"),
    "nothing": (S, "module is empty"),
    "an activation first": (lambda: S(nn.Tanh(), nn.Linear(8, 1)), r"has Tanh\(\) after 0 Linear"),
    "two activations": (lambda: S(nn.Linear(8, 1), nn.Tanh(), nn.Tanh()), "after 1 Linear"),
    "an unknown one": (
        lambda: S(nn.Linear(8, 1), nn.Hardswish()),
        r"has Hardswish\(\); known are [^;]*GELU$",
    ),
    "a recurrent layer": (lambda: S(nn.GRU(8, 1)), "module has GRU.* after 0 Linear"),
    "layers that do not fit": (lambda: S(nn.Linear(8, 4), nn.Linear(5, 1)), "gives 4 numbers to Linear"),
    "too wide": (lambda: S(nn.Linear(8, 2000)), "1 to 1024 numbers a layer"),
    "another scene's": (lambda: net(None, None, None, widths=(6, 4, 4, 2)), "takes 6 numbers and gives 2"),
    "NaN": (broken, "module has weights that are not finite"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_network_says_so(case):
    make, text = BAD[case]
    with pytest.raises(slcp.InputError, match=text):
        simulator("cpu", "generic").rollout(STARTS, policy=policies.Network(make()), steps=2)
