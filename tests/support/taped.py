"""The finger's rollouts on a `wp.Tape`, with a loss that is linear in the states."""

import functools

import numpy as np
import warp as wp
from simulators import scene, simulator

STEPS = 75


@wp.kernel(module="unique")
def weighted_sum(
    states: wp.array3d(dtype=wp.float64),
    weight: wp.array3d(dtype=wp.float64),
    loss: wp.array(dtype=wp.float64),
):
    b, k = wp.tid()
    total = wp.float64(0.0)
    for j in range(states.shape[2]):
        total += weight[b, k, j] * states[b, k, j]
    wp.atomic_add(loss, 0, total)


@functools.cache
def start(worlds=3):
    """States, controls and weights of a loss; the finger flicks the ellipse within the rollouts."""
    rng = np.random.default_rng(5)
    x0 = scene("flicking_finger").x0 + 0.1 * rng.standard_normal((worlds, 6))
    us = rng.standard_normal((worlds, STEPS, 2))
    return x0, us, rng.standard_normal((worlds, STEPS + 1, 6))


def finger(device):
    return simulator("flicking_finger", device, wp.float64, "none")


def on_device(array, device, grad=True):
    return wp.array(np.ascontiguousarray(array), dtype=wp.float64, device=device, requires_grad=grad)


def loss_of(states, weight, device):
    loss = wp.zeros(1, dtype=wp.float64, device=device, requires_grad=True)
    wp.launch(weighted_sum, dim=states.shape[:2], inputs=[states, on_device(weight, device, False), loss],
              device=device)  # fmt: skip
    return loss


def tape_gradient(x0, us, weight, device):
    """Gradients by x0 and controls of sum(weight * states), and the rollout's status."""
    x0, us = on_device(x0, device), on_device(us, device)
    with wp.Tape() as tape:
        traj = finger(device).rollout(x0, us)
        loss = loss_of(traj.states, weight, device)
    tape.backward(loss)
    return x0.grad.numpy(), us.grad.numpy(), traj.status.numpy()
