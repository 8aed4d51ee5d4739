"""How far a step is from Coulomb's law and from its equation of motion, by the oracle of the tests."""

import numpy as np
from oracle import Oracle
from simulators import rounded


def natural_map(sc, dtype, x, u, step, **changes):
    """The worst violation of Coulomb's contact law in every world, relative to the size of its terms."""
    s = sc.structure
    numbers = {k: rounded(dtype, v)[0] for k, v in {**sc.default_parameters(), **changes}.items()}
    oracle = Oracle(sc, **numbers)
    x, u = rounded(dtype, x, u)
    q, v0 = x[:, : sc.nv], x[:, sc.nv :]
    v, lam = np.asarray(step.state, float)[:, sc.nv :], np.asarray(step.impulse, float)
    problem = oracle.problem(x, u)
    gaps, jac, _ = oracle.rows(q)
    contacts = [oracle.contact_jacobian(q, k) for k in range(len(s.pairs))]
    inverse, h = np.linalg.inv(problem["M"]), problem["h"][..., None]
    rows = np.zeros(jac.shape)
    rate = np.zeros(gaps.shape)
    for i, row in enumerate(s.rows):
        if row.kind == "limit" or row.sign == 0:
            rows[:, i], rate[:, i] = jac[:, i], gaps[:, i] / h[..., 0]
        else:
            rows[:, i] = contacts[row.index][1 if row.sign > 0 else 2]
            rate[:, i] = gaps[:, i] / h[..., 0] if row.sign > 0 else 0.0
    diag = np.maximum(np.einsum("bij,bjk,bik->bi", rows, inverse, rows), 1e-30)
    w = np.einsum("bij,bj->bi", rows, v) + rate
    size = np.abs(rate) + np.einsum("bij,bj->bi", np.abs(rows), np.abs(v0) + np.abs(problem["vfree"]))
    size = size.max(1) + 1e-12
    motion = np.einsum("bij,bj->bi", problem["M"], v) - problem["f"] - np.einsum("bij,bi->bj", rows, lam)
    fast = (np.abs(v) + np.abs(v0) + np.abs(problem["vfree"])).max(1) + 1e-12
    worst = np.abs(np.einsum("bij,bj->bi", inverse, motion)).max(1) / fast
    for i, row in enumerate(s.rows):
        a = diag[:, i] * lam[:, i]
        if row.kind == "limit" or row.sign >= 0:
            miss = np.abs(np.minimum(a, w[:, i]))
        else:
            mu = np.broadcast_to(oracle.p["friction"], (len(x), len(s.pairs)))[:, row.index]
            bound = diag[:, i] * mu * np.maximum(lam[:, i - 1], 0.0)
            miss = np.abs(a - np.clip(a - w[:, i], -bound, bound))
        worst = np.maximum(worst, miss / size)
    return worst
