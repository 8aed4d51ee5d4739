"""States near contact, and differences of functions of them, in float64."""

import functools

import numpy as np
from random_scenes import near_contact
from simulators import scene

STEP = 2e-5
WEIGHTS = {
    1: 45.0 / 60.0,
    2: -9.0 / 60.0,
    3: 1.0 / 60.0,
}  # sixth-order central difference (Richardson, twice)
GAPS = (0.0, 1e-3, -1e-3, 0.01, -0.01, 0.03, np.inf)


def differences(function, x, u, step=STEP):
    """d function / d (x, u), (B, ..., nz), by differences of function(x, u) -> (B, ...) in one batch."""
    nx, z = x.shape[1], np.concatenate([x, u], axis=1)
    count, nz = z.shape
    moves = [(j, k) for j in range(nz) for k in (-3, -2, -1, 1, 2, 3)]
    shifted = np.concatenate([z + k * step * np.eye(nz)[j] for j, k in moves])
    values = function(shifted[:, :nx], shifted[:, nx:])
    out = np.zeros((*values.shape[1:], nz, count))
    for i, (j, k) in enumerate(moves):
        value = np.moveaxis(values[i * count : (i + 1) * count], 0, -1)
        out[..., j, :] += np.sign(k) * WEIGHTS[abs(k)] * value / step
    return np.moveaxis(out, -1, 0)


@functools.cache
def states_near_contact(name, count):
    sc, rng = scene(name), np.random.default_rng(21)
    return near_contact(sc, rng, count, GAPS, spread=0.4), rng.standard_normal((count, sc.nu))
