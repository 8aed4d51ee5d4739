"""What DDP makes of a simulator: the same derivatives along a batch of trajectories as at single states."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.dynamics import WarpDynamics, dynamics_of, linear_system
from slcp_warp.ddp.dynamics.protocol import REQUIRED


def test_a_simulator_has_nothing_of_the_protocol_that_ddp_makes_for_it():
    own = {"nx", "nu", "dtype", "device", "parameter_array"}  # what a simulator is asked for by others, too
    asked = [*REQUIRED, "prepare_linearize", "state_type", "control_type", "carry_type", "kernel_key"]
    assert [name for name in asked if hasattr(slcp.Simulator, name) and name not in own] == []
    assert [name for name in asked if hasattr(WarpDynamics, name) and name.endswith("_type")] == []


def test_a_problem_keeps_the_simulator_that_it_was_given():
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    problem = ddp.Problem(sim, ddp.costs.quadratic(np.eye(6), np.eye(2)), 3)
    assert problem.dynamics is sim and problem.params is sim.params
    made = dynamics_of(sim)
    assert all(getattr(made, name) is not None for name in REQUIRED) and dynamics_of(made) is made


def test_derivatives_along_trajectories_are_those_of_single_states(device):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    made, rng = dynamics_of(sim), np.random.default_rng(4)
    problems, steps, nz = 3, 4, sim.nx + sim.nu
    xs = sim.scene.x0 + 0.5 * rng.standard_normal((problems, steps + 1, sim.nx))
    us = rng.standard_normal((problems, steps, sim.nu))
    fx, fu = sim.empty(problems, steps, sim.nx, sim.nx), sim.empty(problems, steps, sim.nx, sim.nu)
    second = sim.empty(problems * steps, made.nw, nz, nz)
    status = wp.full((problems, steps), -1, dtype=wp.int32, device=sim.device)
    active = wp.array([1, 0, 1], dtype=wp.int32, device=sim.device)
    table = made.parameter_array(sim.params, problems)
    arrays = [wp.array(a, dtype=sim.dtype, device=sim.device) for a in (xs, us)]
    made.linearize_into(*arrays, table, fx, fu, second, status, active)
    chosen = [0, 2]
    at = sim.linearize(xs[chosen, :-1].reshape(-1, sim.nx), us[chosen].reshape(-1, sim.nu), second=True)
    np.testing.assert_array_equal(fx.numpy()[chosen].reshape(at.A.shape), at.A)
    np.testing.assert_array_equal(fu.numpy()[chosen].reshape(at.B.shape), at.B)
    curved = second.numpy().reshape(problems, steps, made.nw, nz, nz)
    np.testing.assert_array_equal(curved[chosen].reshape(at.second.shape), at.second)
    assert not fx.numpy()[1].any() and (status.numpy()[1] == -1).all()
    lift = sim.empty(problems, made.nw, sim.nx)
    made.lift_into(table, lift)
    weights = rng.standard_normal((problems, sim.nx))
    mine = np.einsum("bwi,bi,bwjk->bjk", lift.numpy(), weights, curved[:, 0])
    whole, _ = slcp.weighted_hessian(sim, xs[chosen, 0], us[chosen, 0], weights[chosen])
    np.testing.assert_allclose(mine[chosen], whole, rtol=1e-12, atol=1e-12 * np.abs(whole).max())


def test_what_lacks_a_part_of_the_protocol_is_refused_by_name():
    whole = linear_system(np.eye(2), np.ones((2, 1)), device="cpu")
    assert dynamics_of(whole) is whole
    for name in REQUIRED:
        some = {other: getattr(whole, other) for other in REQUIRED if other != name}
        with pytest.raises(TypeError, match=f"dynamics must have '{name}'"):
            dynamics_of(SimpleNamespace(**some))
