"""Rollouts and their gradients inside a captured graph: the same bits as without one."""

import numpy as np
import pytest
import warp as wp
from simulators import simulator

STEPS, WORLDS = 20, 300  # enough worlds that launches outside of a graph are split over threads


def test_a_step_that_a_tape_records_is_not_captured():
    """docs/understand/gradients.md: a rollout over one step is what a graph takes."""
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    x = wp.array(sim.scene.x0[None], dtype=wp.float64, device="cpu", requires_grad=True)
    plain = sim.step(x).state.numpy().copy()
    with wp.ScopedCapture(device="cpu") as capture:  # without a tape it is
        state = sim.step(x).state
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(state.numpy(), plain)
    with pytest.raises(NotImplementedError), wp.ScopedCapture(device="cpu"), wp.Tape():
        sim.step(x)


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
