"""Solvers of the oracle: (17) by continuation and Newton, (1) by least distances, one world at a time."""

import itertools

import numpy as np
from scipy.optimize import nnls


def softplus(x, sigma):
    """s(x) = sigma log(1 + exp(x / sigma)), stable."""
    return np.maximum(x, 0.0) + sigma * np.log1p(np.exp(-np.abs(x) / sigma))


def _newton(a_mat, b, scale, sigma, z, floor, iterations=100):
    """Root z of A s(z) / D + b - s(-z) for one world, by damped Newton; -> z, largest residual.

    `floor` keeps rows that determine the same velocity from making the matrix singular; the root stays.
    """

    def evaluate(z):
        return a_mat @ (softplus(z, sigma) / scale) + b - softplus(-z, sigma)

    value = evaluate(z)
    for _ in range(iterations):
        up = 0.5 + 0.5 * np.tanh(0.5 * z / sigma)
        move = np.linalg.solve(a_mat * (up / scale) + np.diag(np.maximum(1.0 - up, floor)), -value)
        length, old = 1.0, np.linalg.norm(value)
        while length > 1e-9:
            trial = evaluate(z + length * move)
            if np.linalg.norm(trial) <= (1.0 - 1e-4 * length) * old:
                break
            length *= 0.5
        if length <= 1e-9:
            break
        z, value = z + length * move, trial
    return z, np.max(np.abs(value))


def solve_smooth(problem):
    """v' and lambda of REM-logistic (17), sigma lowered from a large value; a world at a time."""
    shape = problem["b"].shape
    nr = shape[-1]
    if nr == 0:
        return problem["vfree"], np.zeros(shape)
    flat = {
        k: problem[k].reshape((-1,) + problem[k].shape[len(shape) - 1 :]) for k in ("A", "b", "D", "sigma")
    }
    impulse = np.zeros((len(flat["b"]), nr))
    for i in range(len(impulse)):
        a, b, d, sigma = (flat[k][i] for k in ("A", "b", "D", "sigma"))
        best = np.inf
        for floor in (1e-14, 1e-10, 1e-7, 1e-4):
            z = -b
            for factor in (256.0, 64.0, 16.0, 4.0, 1.0):
                z, miss = _newton(a, b, d, factor * sigma, z, floor)
            if miss < best:
                best, impulse[i] = miss, softplus(z, sigma) / d
            if miss < 1e-14 * max(1.0, np.max(np.abs(b))):
                break
    impulse = impulse.reshape(shape)
    push = np.einsum("...ij,...i->...j", problem["J"], impulse)
    return problem["vfree"] + np.linalg.solve(problem["M"], push[..., None])[..., 0], impulse


def solve_hard(problem):
    """v' and lambda of the exact problem (1): Lawson and Hanson's least distances; nan if infeasible."""
    shape = problem["b"].shape
    impulse = np.zeros(shape)
    for i in np.ndindex(shape[:-1]):
        jac, b, mass = problem["J"][i], problem["b"][i], problem["M"][i]
        root = np.linalg.cholesky(mass)  # y = L'(v - vfree): min |y| with G y >= -b
        g = np.linalg.solve(root, jac.T).T
        dual, _ = nnls(np.vstack([g.T, -b[None]]), np.r_[np.zeros(len(mass)), 1.0], maxiter=1000)
        rest = np.vstack([g.T, -b[None]]) @ dual - np.r_[np.zeros(len(mass)), 1.0]
        if -rest[-1] < 1e-12:
            impulse[i] = np.nan  # no velocity satisfies all rows
            continue
        acting = dual > 1e-14 * dual.max(initial=0.0)  # the set is known: solve it afresh for the last digits
        if acting.any():
            block = problem["A"][i][np.ix_(acting, acting)]
            impulse[i][acting] = np.linalg.lstsq(block, -b[acting], rcond=1e-13)[0]
    push = np.einsum("...ij,...i->...j", problem["J"], impulse)
    return problem["vfree"] + np.linalg.solve(problem["M"], push[..., None])[..., 0], impulse


def solve_hard_by_trial(a, b):
    """lambda of 0 <= lambda _|_ A lambda + b >= 0 by trying all sets of acting rows, smallest first."""
    for size in range(len(b) + 1):
        for active in itertools.combinations(range(len(b)), size):
            s = list(active)
            trial = np.zeros(len(b))
            if s:
                trial[s] = np.linalg.lstsq(a[np.ix_(s, s)], -b[s], rcond=None)[0]
            w = a @ trial + b
            if min(trial.min(initial=0.0), w.min()) > -1e-9 and np.max(np.abs(trial * w)) < 1e-9:
                return trial
    return None
