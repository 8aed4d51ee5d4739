"""The box-constrained quadratic program of one DDP step against all of its active sets, from any start."""

from itertools import product

import numpy as np
import pytest
import warp as wp

from slcp_warp.kernels.control.backward.box_qp import make_small_solver

NU = 3
PROGRAMS = 400
VECTOR, MATRIX = wp.types.vector(NU, wp.float64), wp.types.matrix((NU, NU), wp.float64)
FACES = np.array(list(product((-1, 0, 1), repeat=NU)))  # held below, free, held above


@pytest.fixture(scope="module")
def launch():
    """``(h, g, lower, upper, start)`` -> y and the free set of each program."""
    box_qp = make_small_solver(2, NU, wp.float64).box_qp

    @wp.kernel(module="unique")
    def kernel(
        h: wp.array(dtype=MATRIX),
        g: wp.array(dtype=VECTOR),
        lower: wp.array(dtype=VECTOR),
        upper: wp.array(dtype=VECTOR),
        start: wp.array(dtype=VECTOR),
        y: wp.array(dtype=VECTOR),
        free: wp.array(dtype=VECTOR),
    ):
        i = wp.tid()
        found, inside, _factor, _pivot = box_qp(h[i], g[i], lower[i], upper[i], start[i])
        y[i] = found
        free[i] = inside

    def run(h, *vectors):
        arrays = [wp.array(h, dtype=MATRIX, device="cpu")]
        arrays += [wp.array(v, dtype=VECTOR, device="cpu") for v in vectors]
        out = [wp.zeros(len(h), dtype=VECTOR, device="cpu") for _ in range(2)]
        wp.launch(kernel, len(h), inputs=arrays, outputs=out, device="cpu")
        return [each.numpy() for each in out]

    return run


def minimum(h, g, lower, upper):
    """The only point of the box that meets the optimality conditions, and its face, by trying every face."""
    for face in FACES:
        free = face == 0
        y = np.where(face < 0, lower, np.where(face > 0, upper, 0.0))
        if free.any():
            y[free] = np.linalg.solve(h[np.ix_(free, free)], -(g + h @ y)[free])
        slope = g + h @ y
        if ((lower <= y) & (y <= upper))[free].all() and (face * slope < 0)[~free].all():
            return y, face
    raise AssertionError("no face holds the minimum")


@pytest.mark.parametrize("condition", [1e1, 1e4, 1e7])
@pytest.mark.parametrize("away", [0.0, 1e-16, 1e-13, 1e-9, 1.0])
def test_same_minimum_and_face_from_any_start(launch, condition, away):
    """Starts are `away` from where limits meet, or from the minimum, inside the box and out of it."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(PROGRAMS, NU, NU)))[0]
    h = np.einsum("bij,j,bkj->bik", turn, np.geomspace(1.0, condition, NU), turn)
    g = rng.normal(size=(PROGRAMS, NU)) * condition ** rng.uniform(size=(PROGRAMS, 1))
    lower, upper = -rng.uniform(size=(2, PROGRAMS, NU)) * [[[1.0]], [[-1.0]]]
    known = [minimum(*each) for each in zip(h, g, lower, upper)]
    best, face = np.array([y for y, _ in known]), np.array([f for _, f in known])
    corner = np.where(rng.random((PROGRAMS, NU)) < 0.5, lower, upper)
    near = np.where(rng.random((PROGRAMS, 1)) < 0.5, corner, best)
    start = near + away * rng.normal(size=(PROGRAMS, NU))
    y, free = launch(h, g, lower, upper, start)
    assert {0, 1, 2, 3} <= set((face != 0).sum(axis=1))  # every number of held controls
    np.testing.assert_array_equal(free, face == 0)
    np.testing.assert_allclose(y, best, rtol=0.0, atol=1e-15 * condition + 1e-14)
    assert ((lower <= y) & (y <= upper)).all()
