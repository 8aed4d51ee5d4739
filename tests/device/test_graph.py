"""Rollouts and their gradients inside a captured graph: the same bits as without one."""

import numpy as np
import pytest
import warp as wp
from simulators import simulator

STEPS, WORLDS = 20, 300  # enough worlds that launches outside of a graph are split over threads


def steps_on_a_tape(sim, x0, us):
    """Gradients by x0 and us (N, B, nu) of the sum of all states of N steps."""
    one = wp.full(x0.shape, 1.0, dtype=x0.dtype, device=x0.device)
    x0.grad.zero_()
    us.grad.zero_()
    states = [x0]
    with wp.Tape() as tape:
        for k in range(us.shape[0]):
            states.append(sim.step(states[-1], us[k]).state)
    tape.backward(grads={state: one for state in states[1:]})
    return states[-1]


@pytest.fixture
def taped_steps(device):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    rng = np.random.default_rng(9)
    starts = sim.scene.x0 + 0.1 * rng.standard_normal((2, 5, 6))
    x0 = wp.array(starts[0], dtype=wp.float64, device=device, requires_grad=True)
    us = wp.array(rng.standard_normal((3, 5, 2)), dtype=wp.float64, device=device, requires_grad=True)
    return sim, starts, x0, us


def test_steps_that_a_tape_records_in_a_graph(device, taped_steps):
    sim, starts, x0, us = taped_steps
    plain = []
    for start in starts:
        x0.assign(start)
        state = steps_on_a_tape(sim, x0, us)
        plain.append([a.numpy().copy() for a in (state, x0.grad, us.grad)])
    with wp.ScopedCapture(device=device) as capture:
        state = steps_on_a_tape(sim, x0, us)
    for start, want in zip(starts, plain):
        x0.assign(start)
        wp.capture_launch(capture.graph)
        for got, array in zip((state, x0.grad, us.grad), want):
            np.testing.assert_array_equal(got.numpy(), array)
    assert not np.array_equal(plain[0][1], plain[1][1]) and np.any(plain[0][2])


def test_a_backward_pass_reads_nothing_until_its_end(device, taped_steps, monkeypatch):
    sim, _, x0, us = taped_steps
    read, numpy = [], wp.array.numpy
    monkeypatch.setattr(wp.array, "numpy", lambda array: read.append(array.shape) or numpy(array))
    monkeypatch.setattr(wp, "synchronize_device", lambda *_: read.append("synchronised"))
    steps_on_a_tape(sim, x0, us)
    assert read == [(2,)]  # whether a loss asks for impulses or gaps


def test_a_loss_of_impulses_in_a_graph_has_no_gradient(device, taped_steps):
    sim, _, x0, us = taped_steps
    asked = np.zeros((5, sim.nr))
    asked[1, 0] = 1.0
    by_impulse = wp.array(asked, dtype=wp.float64, device=device)
    with wp.ScopedCapture(device=device) as capture:
        with wp.Tape() as tape:
            step = sim.step(x0, us[0])
        tape.backward(grads={step.impulse: by_impulse})
    wp.capture_launch(capture.graph)
    none = np.isnan(x0.grad.numpy()).all(1)
    assert none.tolist() == [False, True, False, False, False]
    assert np.isnan(us.grad.numpy()[0]).all(1).tolist() == none.tolist()


def test_forward_and_backward_in_a_graph(device):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    rng = np.random.default_rng(8)
    starts = sim.scene.x0 + 0.1 * rng.standard_normal((2, WORLDS, 6))
    x0 = wp.array(starts[0], dtype=wp.float64, device=device, requires_grad=True)
    controls = rng.standard_normal((WORLDS, STEPS, 2))
    us = wp.array(controls, dtype=wp.float64, device=device, requires_grad=True)
    ones = wp.full((WORLDS, STEPS + 1, 6), 1.0, dtype=wp.float64, device=device)

    def gradient():
        x0.grad.zero_()
        us.grad.zero_()
        with wp.Tape() as tape:
            states = sim.rollout(x0, us).states
        tape.backward(grads={states: ones})
        return states

    def numbers(states):
        return states.numpy().copy(), x0.grad.numpy().copy(), us.grad.numpy().copy()

    plain = []
    for start in starts:  # compiles the kernels: a graph must find them loaded
        x0.assign(start)
        plain.append(numbers(gradient()))
    with wp.ScopedCapture(device=device) as capture:
        states = gradient()
    for start, want in zip(starts, plain):
        x0.assign(start)
        wp.capture_launch(capture.graph)
        for got, array in zip(numbers(states), want):
            np.testing.assert_array_equal(got, array)
    assert not np.array_equal(plain[0][1], plain[1][1])
