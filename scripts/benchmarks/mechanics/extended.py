"""Linear systems of many worlds in whatever precision their numbers have: LAPACK knows no extended one."""

import numpy as np

from slcp_warp.description.kinematics import Array


def solve(matrix: Array, right: Array) -> Array:
    """matrix^-1 right for matrices (B, n, n) and right-hand sides (B, n, m), by Gauss's elimination with
    partial pivoting.
    """
    a, x = matrix.copy(), right.copy()
    worlds, n = np.arange(len(a)), a.shape[1]
    for c in range(n):
        best = c + np.argmax(np.abs(a[:, c:, c]), 1)
        for rows in (a, x):
            rows[worlds, c], rows[worlds, best] = rows[worlds, best], rows[worlds, c]
        share = a[:, c + 1 :, c] / a[:, c, c][:, None]
        a[:, c + 1 :] -= share[..., None] * a[:, c][:, None]
        x[:, c + 1 :] -= share[..., None] * x[:, c][:, None]
    for c in reversed(range(n)):
        x[:, c] /= a[:, c, c][:, None]
        x[:, :c] -= a[:, :c, c][..., None] * x[:, c][:, None]
    return x
