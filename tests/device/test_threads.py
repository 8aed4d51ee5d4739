"""Objects used from several threads at once: the same bits as from one thread."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.factories import cached

THREADS, TIMES = 8, 25


def together(work, items):
    """work(item) of every item, as many threads as there are starting at one moment; their results."""
    start = threading.Barrier(len(items))

    def run(item):
        start.wait()
        return work(item)

    with ThreadPoolExecutor(len(items)) as pool:
        return list(pool.map(run, items))


@pytest.mark.parametrize("strategy", ["generic", "specialised"])
def test_one_simulator_in_many_threads(strategy):
    """Steps and rollouts of batches of unequal size, many times: bitwise those of one thread."""
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), device="cpu", strategy=strategy)
    rng = np.random.default_rng(0)
    sizes = [1 + 37 * i for i in range(THREADS)]
    starts = [sim.scene.x0 + 0.3 * rng.standard_normal((size, sim.nx)) for size in sizes]
    controls = [rng.standard_normal((size, 4, sim.nu)) for size in sizes]

    def work(i):
        return sim.step(starts[i], controls[i][:, 0]).state, sim.rollout(starts[i], controls[i]).states

    alone = [work(i) for i in range(THREADS)]
    for _ in range(TIMES):
        for mine, theirs in zip(alone, together(work, range(THREADS)), strict=True):
            for one, other in zip(mine, theirs, strict=True):
                np.testing.assert_array_equal(one, other)


def test_workspaces_are_lent_to_one_call_at_a_time():
    """None is lent twice; those kept for later stay within the bound of one launch."""
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), device="cpu", strategy="generic")
    spaces = sim.kernels.stepping.workspaces
    spaces.most = 10
    with spaces.lend(4) as one, spaces.lend(4) as other, spaces.lend(4) as third:
        assert len({work.q.ptr for work in (one, other, third)}) == 3
    assert sum(size for _, kept in spaces._kept.values() for size, _ in kept) == 8
    with spaces.lend(3) as again:
        assert again.q.ptr in (one.q.ptr, other.q.ptr, third.q.ptr)


def test_parameters_are_uploaded_once():
    """Tracked parameters of which two threads ask for the table at once collect in one gradient."""
    for _ in range(50):
        params = simulator("particle").params.track()
        arrays = together(lambda _, p=params: p.array(wp.float64, "cpu"), range(THREADS))
        assert len({id(array) for array in arrays}) == 1


def test_torch_finds_the_simulator_that_it_was_given(monkeypatch):
    """Numbers of things that threads register at once are their own."""
    pytest.importorskip("torch")
    from slcp_warp.torch import operators as torch_operators

    class Slow(list):
        def __len__(self):
            length = super().__len__()
            threading.Event().wait(1e-3)
            return length

    kept = Slow()
    monkeypatch.setattr(torch_operators, "_kept", kept)
    monkeypatch.setattr(torch_operators, "_handles", {})
    things = [object() for _ in range(THREADS)]
    found = together(torch_operators.handle_of, things)
    assert all(kept[handle] is x for handle, x in zip(found, things, strict=True))


def test_a_workspace_of_ddp_in_many_threads():
    """`Workspace.solve` takes turns: every thread gets the solution of its own start."""
    system = ddp.linear_system([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], device="cpu")
    problem = ddp.Problem(system, ddp.costs.quadratic(np.eye(2), np.eye(1), np.eye(2)), 20)
    workspace = ddp.Workspace(problem, 1)
    us = np.zeros((20, 1))

    def work(i):
        return workspace.solve(np.array([1.0 + i, 0.5]), us).xs

    alone = [work(i) for i in range(THREADS)]
    for _ in range(TIMES):
        for mine, theirs in zip(alone, together(work, range(THREADS)), strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_a_factory_is_called_once():
    """Threads that ask for one kernel at once get one kernel: a launch takes the structs of its own only."""
    for _ in range(TIMES):
        calls = []

        @cached
        def make(name, size=1, calls=calls):
            calls.append(name)
            threading.Event().wait(1e-3)
            return object()

        made = together(lambda _, f=make: f("kernel"), range(THREADS))
        assert len(set(map(id, made))) == 1 and calls == ["kernel"]
    assert make("kernel", size=1) is make("kernel", size=1) is not make("other")


@pytest.mark.slow
def test_kernels_made_by_many_threads_at_once():
    """Kernels that nobody made before: every thread makes, loads and launches them."""
    scene = slcp.scenes.particle()  # one row: the smallest there is, with kernels of its own options
    options = slcp.Options(residual="rem-normal", scaling="none")

    def work(_):
        sim = slcp.Simulator(scene, options, device="cpu", strategy="specialised", dtype="float32")
        return sim.rollout(scene.x0, np.zeros((5, sim.nu))).states, sim.step(scene.x0).state

    found = together(work, range(THREADS))
    for states, state in found:
        np.testing.assert_array_equal(states, found[0][0])
        np.testing.assert_array_equal(state, found[0][1])
