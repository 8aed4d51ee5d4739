"""Gradients through users' functions and what lies around policies: against loops of single steps."""

import contextlib
import functools
import importlib
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp, policies

torch = pytest.importorskip("torch")
import slcp_warp.torch as slcp_torch  # noqa: E402

STEPS = 20
SCENE = slcp.scenes.opposing_limits(width=0.3)  # a pendulum that swings from one limit to the other
STARTS = np.array([[0.0, 1.0], [0.05, -2.0], [-0.1, 3.0]])


@functools.cache
def pendulum(device, dtype="float64"):
    return slcp.Simulator(SCENE, device=device, dtype=dtype)


def filtered(dtype, VX, VU, Data, Memory):
    """A nonlinear law of a low-pass filter of the state, with a kink."""
    quarter = dtype(0.25)

    @wp.func
    def control(data: Data, world: int, step: int, x: VX, memory: Memory):
        after = Memory()
        for j in range(2):
            after[j] = memory[j] + quarter * (x[j] - memory[j])
        total = data.offset[0]
        for j in range(2):
            total += data.gain[0, j] * wp.sin(after[j])
        return VU(wp.max(total, dtype(-0.8))), after

    return control


def first(dtype, VX, VU, Data, Memory):
    @wp.func
    def begin(data: Data, world: int, x: VX):
        memory = Memory()
        for j in range(2):
            memory[j] = data.scale * x[j]
        return memory

    return begin


GAIN, OFFSET = np.array([[-3.0, 0.7]]), np.array([0.2])


def function(memory=2, **given):
    arrays = {"gain": GAIN, "offset": OFFSET, "scale": 0.5} | given
    return policies.Function(filtered, memory=memory, start=first, **arrays)


def law(k, x, memory, gain, offset):
    """The same in PyTorch."""
    memory = 0.5 * x if memory is None else memory
    memory = memory + 0.25 * (x - memory)
    return torch.clamp(offset + torch.sin(memory) @ gain.T, min=-0.8), memory


def around(control, delay=0, hold=1, limits=(-np.inf, np.inf)):
    """What lies around a policy, in PyTorch."""
    way, held, kept = [], None, None

    def ask(k, x):
        nonlocal held, kept
        if k == 0:
            way.extend([torch.zeros((len(x), 1), dtype=x.dtype, device=x.device)] * delay)
        if k % hold == 0:
            held, kept = control(k, x, kept)
        way.append(held)
        return torch.clamp(way.pop(0), *limits)

    return ask


def in_a_loop(sim, x0, ask, mass):
    states = [x0]
    for k in range(STEPS):
        states.append(slcp_torch.step(sim, states[-1], ask(k, states[-1]), {"mass": mass}).states)
    return torch.stack(states, 1)


def leaves(device):
    x0 = torch.tensor(STARTS, device=device, requires_grad=True)
    mass = torch.tensor(pendulum(device).params["mass"], device=device, requires_grad=True)
    rng = np.random.default_rng(0)
    weight = torch.tensor(rng.standard_normal((len(x0), STEPS + 1, 2)), device=device)
    return x0, mass, weight


def same_gradients(sim, policy, ask, x0, mass, weight, own, arrays=None):
    run = slcp_torch.closed_loop(sim, x0, policy, STEPS, {"mass": mass}, arrays)
    loop = in_a_loop(sim, x0, ask, mass)
    assert not run.status.any()
    np.testing.assert_allclose(run.states.detach().cpu(), loop.detach().cpu(), rtol=0, atol=1e-9)
    found = torch.autograd.grad((weight * run.states).sum(), [x0, mass, *own])
    exact = torch.autograd.grad((weight * loop).sum(), [x0, mass, *own])
    for one, other in zip(found, exact):
        scale = float(other.abs().max())
        assert scale > 0.0
        np.testing.assert_allclose(one.cpu(), other.cpu(), rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("between", [{}, {"delay": 2, "hold": 3, "limits": (-0.5, 0.6)}])
def test_a_function_that_remembers(device, between):
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    gain, offset = (torch.tensor(a, device=device, requires_grad=True) for a in (GAIN, OFFSET))
    policy = policies.Around(function(), **between) if between else function()
    ask = around(lambda k, x, memory: law(k, x, memory, gain, offset), **between)
    same_gradients(sim, policy, ask, x0, mass, weight, [gain, offset], {"gain": gain, "offset": offset})


@pytest.mark.parametrize("plans", [1, len(STARTS)])
@pytest.mark.parametrize("between", [{}, {"delay": 2, "limits": (-0.3, 0.4)}])
def test_a_plan_that_is_tracked(device, between, plans):
    """Shorter than the run, so that its last step is held; one for all worlds or one each; of other steps."""
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    rng = np.random.default_rng(5)
    us, xs = rng.standard_normal((plans, STEPS - 3, 1)), 0.3 * rng.standard_normal((plans, STEPS - 2, 2))
    K = rng.standard_normal((plans, STEPS - 3, 1, 2))
    plan = SimpleNamespace(us=us, xs=xs, K=K)
    tracked = ddp.TrackingPolicy(plan, control_limits=(-0.6, 0.7))
    u, x, gain = (torch.tensor(a, device=device) for a in (us, xs, K))

    def control(k, state, memory):
        at = min(k, STEPS - 4)
        found = u[:, at] + (gain[:, at] @ (state - x[:, at])[:, :, None])[:, :, 0]
        return torch.clamp(found, -0.6, 0.7), memory

    policy = policies.Around(tracked, **between) if between else tracked
    same_gradients(sim, policy, around(control, **between), x0, mass, weight, [])
    h = float(sim.params["step_size"])
    timed = ddp.TrackingPolicy(plan, control_limits=(-0.6, 0.7), step_size=2.0 * h)
    own = [slcp_torch.closed_loop(sim, x0, each, STEPS).states for each in (timed, timed.at(h))]
    assert torch.equal(*own)
    five = SimpleNamespace(us=np.repeat(us[:1], 5, 0), xs=np.repeat(xs[:1], 5, 0), K=np.repeat(K[:1], 5, 0))
    with pytest.raises(slcp.InputError, match="5"):
        slcp_torch.closed_loop(sim, x0, ddp.TrackingPolicy(five), 3)


def test_around_a_network_and_around_linear_feedback(device):
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    torch.manual_seed(0)
    module = torch.nn.Sequential(torch.nn.Linear(2, 1), torch.nn.Tanh()).double().to(device)
    between = {"delay": 1, "hold": 2, "limits": (-0.4, 0.5)}
    ask = around(lambda k, x, memory: (module(x), None), **between)
    policy = policies.Around(policies.Network(module), **between)
    same_gradients(sim, policy, ask, x0, mass, weight, list(module.parameters()))
    K, x_ref = torch.tensor(GAIN, device=device), torch.tensor(STARTS[0], device=device)
    feedback = policies.Linear(GAIN, STARTS[0], OFFSET, limits=(-0.3, 0.5))
    u_ref = torch.tensor(OFFSET, device=device)
    ask = around(lambda k, x, memory: (torch.clamp(u_ref + (x - x_ref) @ K.T, -0.3, 0.5), None), delay=1)
    same_gradients(sim, policies.Around(feedback, delay=1), ask, x0, mass, weight, [])


def test_around_what_lies_around(device):
    """A delay of 2 steps that is asked in every third one: what it was sent the last time has arrived."""
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    gain, offset = (torch.tensor(a, device=device, requires_grad=True) for a in (GAIN, OFFSET))
    kept, sent = None, [torch.zeros((len(STARTS), 1), dtype=x0.dtype, device=device)]

    def ask(k, x):
        nonlocal kept
        if k % 3 == 0:
            u, kept = law(k, x, kept, gain, offset)
            sent.append(u)
        return sent[-2]

    policy = policies.Around(policies.Around(function(), delay=2), hold=3)
    same_gradients(sim, policy, ask, x0, mass, weight, [gain, offset], {"gain": gain, "offset": offset})


def test_noise_of_a_sensor_is_what_the_kernel_saw(device):
    """Differences of the whole rollout: its noise does not change with the start."""
    sim, (x0, _, weight) = pendulum(device), leaves(device)
    policy = policies.Around(function(), noise=0.05, hold=2, seed=3)
    run = slcp_torch.closed_loop(sim, x0, policy, STEPS)
    clean = slcp_torch.closed_loop(sim, x0, policies.Around(function(), hold=2), STEPS)
    assert float((run.states - clean.states).detach().abs().max()) > 1e-3
    (found,) = torch.autograd.grad((weight * run.states).sum(), x0)
    along = torch.tensor(np.random.default_rng(4).standard_normal(x0.shape), device=device)
    with torch.no_grad():
        ends = [slcp_torch.closed_loop(sim, x0 + e * along, policy, STEPS).states for e in (1e-6, -1e-6)]
    slope = float((weight * (ends[0] - ends[1])).sum()) / 2e-6
    assert slope == pytest.approx(float((found * along).sum()), rel=1e-5)


def test_every_launch_is_on_pytorchs_stream(device, monkeypatch):
    """Of a policy with a noisy sensor, there and back; on a CPU the stream is made up."""
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    inside, seen, launch = [], [], wp.launch

    @contextlib.contextmanager
    def stream(tensor):
        inside.append(tensor)
        yield
        inside.pop()

    for name in ("asked", "closed_loop", "followed", "network", "operators"):
        module = importlib.import_module(f"slcp_warp.torch.{name}")
        monkeypatch.setattr(module, "stream", stream)
    monkeypatch.setattr(wp, "launch", lambda *a, **k: seen.append(bool(inside)) or launch(*a, **k))
    policy = policies.Around(function(), noise=0.05, hold=2, seed=3)
    run = slcp_torch.closed_loop(sim, x0, policy, STEPS, {"mass": mass})
    (weight * run.states).sum().backward()
    slcp_torch.rollout(sim, x0.detach(), torch.zeros((len(x0), 2, 1), dtype=x0.dtype, device=device))
    assert len(seen) > STEPS and all(seen)


def test_single_precision_and_one_world(device):
    sim, (x0, _, weight) = pendulum(device, "float32"), leaves(device)
    single = x0[0].detach().float().requires_grad_()
    gain = torch.tensor(GAIN, device=device, dtype=torch.float32, requires_grad=True)
    with pytest.raises(slcp.InputError, match="mass"):
        slcp_torch.closed_loop(sim, single, function(), 5, {"mass": -single[0]}, {"gain": gain})
    run = slcp_torch.closed_loop(sim, single, function(), 5, arrays={"gain": gain})
    assert run.states.shape == (6, 2)
    fine = torch.tensor(GAIN, device=device, requires_grad=True)
    exact = slcp_torch.closed_loop(pendulum(device), x0[0], function(), 5, arrays={"gain": fine})
    (weight[0, :6].float() * run.states).sum().backward()
    (weight[0, :6] * exact.states).sum().backward()
    for one, other in ((gain, fine), (single, x0)):
        reference = other.grad if other is fine else other.grad[0]
        scale = float(reference.abs().max())
        np.testing.assert_allclose(one.grad.cpu(), reference.cpu(), rtol=0, atol=2e-3 * scale)


def assigned_twice(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        u = VU()
        u[0] = data.gain[0] * x[0]
        u[0] = u[0] * u[0]
        return u

    return control


def test_what_has_no_right_gradient_says_so():
    sim, x0 = pendulum("cpu"), torch.tensor(STARTS, requires_grad=True)
    wrong = policies.Function(assigned_twice, gain=[1.0])
    assert not slcp_torch.closed_loop(sim, x0.detach(), wrong, 3).status.any()  # no gradient is asked for
    double = torch.ones(2, dtype=torch.float64)
    callback = policies.Callback(lambda x, time: 0.0)
    for policy, arrays, text in (
        (wrong, None, "Warp's adjoint of 'function assigned twice' by the state is not its derivative"),
        (callback, None, "policy is a Callback, through which no gradient flows"),
        (function(), {"gains": double}, "arrays names 'gains'; the policy has gain, offset, scale"),
        (function(), {"gain": double}, r"arrays\['gain'\] has shape \(2,\); 2 axes"),
        (function(), {"scale": double}, "by a number there is none"),
        (function(), {"gain": double.float()}, r"arrays\['gain'\] is torch.float32 on cpu"),
        (function(), {"gain": GAIN}, r"arrays\['gain'\] is a ndarray"),
        (policies.Linear(GAIN, np.zeros(2), OFFSET), {"K": double}, "a Linear has none"),
    ):
        with pytest.raises(slcp.InputError, match=text):
            slcp_torch.closed_loop(sim, x0, policy, 3, arrays=arrays)


@pytest.mark.parametrize("kind", ["linear", "module", "network", "function"])
def test_what_is_asked_for_once_too_often_says_so(device, kind):
    """Second derivatives, which were dropped; policies of other worlds, read beyond their end."""
    sim, (x0, mass, weight) = pendulum(device), leaves(device)
    module = torch.nn.Sequential(torch.nn.Linear(2, 1)).to(x0.device, torch.float64)
    policy = {
        "linear": policies.Linear(GAIN, np.zeros(2), OFFSET), "module": module,
        "network": policies.Network(module), "function": function(),
    }[kind]  # fmt: skip
    run = slcp_torch.closed_loop(sim, x0, policy, 4, {"mass": mass})
    slopes = torch.autograd.grad((weight[:, :5] * run.states).sum(), [x0, mass], create_graph=True)
    assert all(slope.requires_grad for slope in slopes)
    with pytest.raises(NotImplementedError, match="second derivatives of slcp_warp.torch rollouts"):
        sum(slope.square().sum() for slope in slopes).backward()
    empty = torch.zeros((0, 2), dtype=torch.float64, device=x0.device, requires_grad=True)
    nothing = slcp_torch.closed_loop(sim, empty, policy, 4)
    nothing.states.sum().backward()
    assert nothing.states.shape == (0, 5, 2) and empty.grad.shape == (0, 2)
    five = policies.Linear(np.tile(GAIN, (5, 1, 1)), np.zeros(2), OFFSET)
    for each in (five, policies.Around(five, delay=1)):
        with pytest.raises(slcp.InputError, match="policy holds 5 trajectories; 1 or 3 is needed"):
            slcp_torch.closed_loop(sim, x0, each, 2)
