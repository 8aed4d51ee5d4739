"""What docs/understand/gradients.md states of options and kinks; the test behind `slcp bench differences`."""

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp.kernels.derivatives.curvature import in_closed_form
from slcp_warp.scripts.benchmarks.derivatives.jacobians import bench_differences


@pytest.mark.parametrize(
    "choice, closed",
    [({"residual": "rem-normal"}, True), ({"residual": "hard"}, True), ({"noise": "state"}, False),
     ({"residual": "erm-normal"}, False), ({"integrator": "trapezoidal"}, False),
     ({"residual": "hard", "friction": "coulomb"}, False)],
)  # fmt: skip
def test_options_with_second_derivatives_in_closed_form(choice, closed):
    assert in_closed_form(slcp.Options(**choice).method) == closed


@pytest.mark.slow
def test_at_a_degenerate_contact_the_hard_derivative_is_the_mean_of_both_sides(device):
    """A particle at rest on the ground without gravity: it neither presses nor leaves."""
    sim = simulator("particle", device, wp.float64, "inertia", "hard")
    h, up = sim.scene.step_size, sim.scene.nv + 1
    x = np.zeros((3, sim.nx))
    x[:, up] = [-1e-6, 0.0, 1e-6]
    lin = sim.linearize(x, None, sim.params.replace(gravity=(0.0, 0.0)))
    assert not lin.status.any()
    np.testing.assert_allclose(lin.A[:, up, up], [0.0, 0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(lin.A[:, up, 1], np.array([-1.0, -0.5, 0.0]) / h, atol=1e-6 / h)


@pytest.mark.slow
def test_derivatives_against_differences_at_random_states():
    said = []
    rows = bench_differences(("flicking_finger", "particle"), ("rem-logistic",), 64, 0, said.append)
    rows += bench_differences(("particle",), ("hard",), 64, 0, said.append)
    assert len(said) == len(rows)  # nothing was left out
    assert {row["state"] for row in rows} == {"penetrating", "touching", "separated"}
    for row in rows:
        assert row["largest"] < 1e-6, row
