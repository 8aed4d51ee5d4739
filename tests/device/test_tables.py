"""Tables laid out column by column, as on a GPU: the same bits wherever a world's own numbers are read."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.device import tables
from slcp_warp.stepping.generic import WORKSPACE_BYTES, Workspaces, workspace_bytes

WORLDS, STEPS = 6, 5


def by_columns(call):
    """What a function gives under the layout of a CPU and under that of a GPU."""
    rows = call()
    made = []

    def noted(count, device):
        made.append(count > 1)
        return count > 1

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "by_columns", noted)
        columns = call()
    assert any(made)
    return rows, columns


def same(pair):
    for a, b in zip(*pair, strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


def numbers(sim):
    rng = np.random.default_rng(5)
    mass = sim.params["mass"] * rng.uniform(0.8, 1.2, (WORLDS, 3))
    x = sim.scene.x0 + 0.1 * rng.standard_normal((WORLDS, 6))
    return mass, x, rng.standard_normal((WORLDS, STEPS, 2))


def test_columns_are_columns(monkeypatch):
    monkeypatch.setattr(tables, "by_columns", lambda rows, device: True)
    values = np.arange(12.0).reshape(4, 3)
    made = tables.make_table(values, wp.float64, "cpu", requires_grad=True)
    assert made.strides == (8, 32) == made.grad.strides and made.requires_grad
    copied = tables.copy_table(made)
    assert copied.strides == (8, 32) and copied.ptr != made.ptr
    np.testing.assert_array_equal(copied.numpy(), values)
    assert tables.empty_table((4, 3), wp.float32, "cpu").strides == (4, 16)


def steps_and_derivatives():
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    mass, x, us = numbers(sim)
    weights = np.ones((WORLDS, STEPS + 1, 6))

    def found():
        params = sim.params.replace(mass=mass)
        step, roll, lin = (
            sim.step(x, us[:, 0], params),
            sim.rollout(x, us, params),
            sim.linearize(x, us[:, 0], params),
        )
        pulled = slcp.vjp(sim, x, us, weights, params, parameters="mass")
        return step.state, roll.states, lin.A, lin.B, pulled.x0, pulled.controls, pulled.parameters["mass"]

    pair = by_columns(found)
    same(pair)
    assert np.ptp(pair[0][-1][:, :2], axis=0).all()  # the third body is not near


def test_gradients_of_numbers_that_worlds_share():
    """The table has one row; what every world adds to its gradient has a row each."""
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    _, x, us = numbers(sim)

    def found():
        params = sim.params.track()
        start = wp.array(x, dtype=wp.float64, device="cpu")
        with wp.Tape() as tape:
            states = sim.rollout(start, wp.array(us, dtype=wp.float64, device="cpu"), params).states
        tape.backward(grads={states: wp.ones(states.shape, dtype=wp.float64, device="cpu")})
        gradient = params.gradient("mass")
        params.zero_gradient()
        assert not params.gradient("mass").any()
        return (gradient,)

    same(by_columns(found))


def torch_rollouts():
    import torch

    from slcp_warp import torch as differentiable

    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    given = numbers(sim)

    def found():
        mass, x, us = (torch.tensor(a, requires_grad=True) for a in given)
        for checkpoint in (None, 2):
            run = differentiable.rollout(sim, x, us, {"mass": mass}, checkpoint=checkpoint)
            (run.states**2).sum().backward()
        return run.states.detach(), x.grad, us.grad, mass.grad

    same(by_columns(found))


@pytest.mark.full
@pytest.mark.parametrize("what", ["steps_and_derivatives", "torch_rollouts"])
def test_kernels_with_strides(what):
    """Those that step read a CPU's tables without: a process of its own has them with strides, as a GPU."""
    if what == "torch_rollouts":
        pytest.importorskip("torch")
    code = f"import warp as wp; wp.config.optimization_level = 0; import test_tables; test_tables.{what}()"
    env = os.environ | {"SLCP_STRIDES": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    child = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=600)
    assert child.returncode == 0, child.stderr


def test_plans_and_sweeps():
    problem, x0, us = cart_pole("cpu", "float64")
    own = problem.with_params(step_size=np.linspace(0.04, 0.05, WORLDS))

    def planned():
        done = ddp.solve(own, np.tile(x0, (WORLDS, 1)), us, ddp.Options(max_iterations=3))
        return done.xs, done.K, done.cost

    same(by_columns(planned))
    task = slcp.tasks.flicking_finger()

    def drawn():
        worlds = slcp.ensembles.worlds.draws.draw_worlds(task, WORLDS, 1, device="cpu")
        return worlds.params, worlds.x0

    same(by_columns(drawn))


def test_workspaces_fill_a_gpu():
    cpu, gpu = SimpleNamespace(is_cpu=True), SimpleNamespace(is_cpu=False, total_memory=80_000_000_000)
    assert workspace_bytes(cpu) == WORKSPACE_BYTES
    assert workspace_bytes(gpu) == 5_000_000_000  # 132 multiprocessors with 256 threads each, of 150 kB
    assert workspace_bytes(SimpleNamespace(is_cpu=False, total_memory=2**30)) == WORKSPACE_BYTES


def test_workspaces_are_found_again_on_a_stream():
    """PyTorch's stream is a new object of Warp's with the same handle at every call."""
    made = []
    spaces = Workspaces(lambda slots: made.append(slots) or object(), 1000, "cpu")

    def lent(handle):
        spaces.device = SimpleNamespace(is_cuda=True, stream=SimpleNamespace(cuda_stream=handle))
        with spaces.lend(4) as work:
            return work

    first = lent(7)
    assert lent(7) is first and lent(8) is not first and lent(7) is first and made == [4, 4]
