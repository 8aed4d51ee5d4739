"""The main kernels compile for sm_90 without a GPU: registers where there is room, spills, size of the code.

The fast kernels of the finger fit into registers; what local memory they have is the argument reduction of
the sine and arrays that are indexed at run time: the stack of the library's tree, the sweep's measures. Those
that make the steps which the fast ones leave take all registers and spill. Kernels without contact, and those
of the backward pass, fit.
"""

import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import scenes
from slcp_warp.kernels.control import riccati, rollouts
from slcp_warp.kernels.derivatives.expansion import make_linearize_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.ask import make_ask_kernel
from slcp_warp.kernels.policies.held import HELD
from slcp_warp.kernels.policies.nearest import NEAREST, STACKS
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout
from slcp_warp.kernels.step.relayed import make_rollout_relay
from slcp_warp.kernels.step.rollout import make_transition
from slcp_warp.scripts.benchmarks.cost.cubin import sm90_resources

LONG = wp.types.vector(64, float)
SINE = 32  # bytes of local memory of the argument reduction of sine and cosine
TREE = 12 * STACKS[0]  # of a search in the library's tree


def finger(part="fast", **options):
    structure = scenes.flicking_finger().structure
    return Specialisation(structure, wp.float32, Method(scaling="none", part=part, **options))


def line_search():
    """DDP's rollouts, with the finger's cost."""
    cost = slcp.tasks.flicking_finger().cost.functions(wp.float32, 6, 2)
    step = make_transition(finger())
    functions = step.advance, step.cold_carry, cost.running, cost.final
    return rollouts.make_rollout_kernel(*functions, 6, 2, True, False, wp.float32, step)


FAST = {  # kernel, registers, bytes of local memory, of code
    "rollout": (lambda: make_rollout_relay(finger(), OPEN_LOOP, False), 200, SINE, 72_000),
    "hard rollout": (
        lambda: make_rollout_relay(finger(residual="hard"), OPEN_LOOP, False),
        176,
        SINE,
        66_000,
    ),
    "sweep": (lambda: make_sweep_kernel(finger(), HELD, spans=True), 200, SINE + 48, 132_000),
    "linearisation": (lambda: make_linearize_kernel(finger(), False), 200, SINE + 8, 112_000),
    "library": (lambda: make_ask_kernel(NEAREST, 6, 2, wp.float32), 56, TREE + 32, 24_000),
    "line search": (line_search, 200, SINE + 8, 90_000),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAST)
def test_fast_kernels_of_the_finger_fit_in_registers(tmp_path, name):
    make, registers, frame, code = FAST[name]
    used = sm90_resources(make(), tmp_path)
    assert 0 < used["registers"] <= registers and used["frame"] <= frame and used["code"] <= code, used


@pytest.mark.slow
def test_what_makes_the_steps_that_are_left_spills_within_bounds(tmp_path):
    used = sm90_resources(make_rollout_relay(finger("rest"), OPEN_LOOP, False), tmp_path)
    assert SINE < used["frame"] <= 1_600, used  # bytes: all threads that a GPU may hold get as many
    assert used["code"] <= 220_000, used


@pytest.mark.slow
def test_rollout_without_contact_fits_in_registers(tmp_path):
    structure = scenes.pendulum_chain().structure
    spec = Specialisation(structure, wp.float32, Method())
    kernel = rollout.make_rollout_kernel(spec, OPEN_LOOP, False)
    used = sm90_resources(kernel, tmp_path)
    assert 0 < used["registers"] <= 128 and used["frame"] <= SINE, used  # 16 warps a multiprocessor
    assert used["code"] <= 40_000, used


@pytest.mark.slow
def test_backward_pass_of_ddp_spills_nothing(tmp_path):
    kernel = riccati.make_backward_kernel(6, 2, 3, "second-order", False, wp.float32)
    used = sm90_resources(kernel, tmp_path)
    assert used["registers"] > 0 and used["frame"] == 0, used
    assert used["code"] <= 100_000, used


@pytest.mark.slow
@pytest.mark.parametrize(
    "residual, registers, frame",
    [
        pytest.param("hard", None, 1824, marks=pytest.mark.full, id="hard"),
        pytest.param("none", 184, 64, id="no rows"),
    ],
)
def test_kernels_of_large_scenes_spill_little(tmp_path, residual, registers, frame):
    used = sm90_resources(generic_step.make_rollout_kernel(wp.float32, residual), tmp_path)
    assert used["frame"] <= frame, used
    assert registers is None or 0 < used["registers"] <= registers, used  # 184: 10 warps a multiprocessor


def test_parser_sees_local_memory(tmp_path):
    @wp.kernel(module="unique", enable_backward=False)
    def indexed(x: wp.array(dtype=float), i: wp.array(dtype=int)):
        store = LONG()
        for k in range(64):
            store[i[k]] = x[k]
        x[wp.tid()] = store[i[wp.tid()]]

    used = sm90_resources(indexed, tmp_path)
    assert used["frame"] >= 256, used  # 64 floats at run-time indices
