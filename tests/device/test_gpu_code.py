"""The main kernels compile for sm_90 without a GPU: registers where there is room, spills, size of the code.

The fast kernels of the finger have 128 registers and spill a little, which was measured to be faster than
fitting into 188 to 200 (docs/performance.md); other local memory of theirs is the argument reduction of the
sine and arrays that are indexed at run time: the stack of the library's tree, the sweep's measures. Those
that make the steps which the fast ones leave take all registers and spill. Kernels without contact, and those
of the backward pass, fit.
"""

import pytest
import warp as wp

from slcp_warp import scenes
from slcp_warp.kernels.control.backward import riccati
from slcp_warp.kernels.control.backward.riccati_lanes import make_lanes_kernel
from slcp_warp.kernels.generic import step as generic_step
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step.relayed import make_rollout_relay
from slcp_warp.scripts.benchmarks.cost.cubin import sm90_resources
from slcp_warp.scripts.benchmarks.gpu.predicted import FAST, SINE, finger

LONG = wp.types.vector(64, float)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAST)
def test_fast_kernels_of_the_finger_spill_within_bounds(tmp_path, name):
    most = FAST[name]
    used = sm90_resources(most.make(), tmp_path)
    assert 0 < used["registers"] <= most.registers, used
    assert used["frame"] <= most.frame and used["code"] <= most.code, used


@pytest.mark.full
def test_what_makes_the_steps_that_are_left_spills_within_bounds(tmp_path):
    used = sm90_resources(make_rollout_relay(finger("rest"), OPEN_LOOP, False), tmp_path)
    assert SINE < used["frame"] <= 2_304, used  # bytes: all threads that a GPU may hold get as many
    assert used["code"] <= 250_000, used


@pytest.mark.slow
@pytest.mark.parametrize("part, registers", [("fast", 88), ("rest", 128)])  # 23 and 16 warps a multiprocessor
def test_rollout_without_contact_fits_in_registers(tmp_path, part, registers):
    """Where the mass matrix has few digits, v' is refined by the kernel for the rest."""
    structure = scenes.pendulum_chain().structure
    spec = Specialisation(structure, wp.float32, Method(part=part))
    used = sm90_resources(make_rollout_relay(spec, OPEN_LOOP, False), tmp_path)
    assert 0 < used["registers"] <= registers and used["frame"] <= SINE, used
    assert used["code"] <= 42_000, used


@pytest.mark.slow
def test_backward_pass_of_ddp_spills_nothing(tmp_path):
    kernel = riccati.make_backward_kernel(6, 2, 3, "second-order", False, wp.float32)
    used = sm90_resources(kernel, tmp_path)
    assert used["registers"] > 0 and used["frame"] == 0, used
    assert used["code"] <= 100_000, used


@pytest.mark.slow
def test_backward_pass_by_lanes_spills_nothing(tmp_path):
    used = sm90_resources(make_lanes_kernel(6, 2, 3, "second-order", False, wp.float32), tmp_path)
    assert 0 < used["registers"] <= 128 and used["frame"] == 0, used
    assert used["code"] <= 76_000, used


@pytest.mark.slow
@pytest.mark.parametrize(
    "residual, level, registers, frame",
    [
        pytest.param("hard", 3, None, 11072, marks=pytest.mark.full, id="hard, in one piece"),
        pytest.param("hard", 2, None, 23_040, marks=pytest.mark.full, id="hard"),
        pytest.param("none", 3, 208, 8320, id="no rows"),
    ],
)
def test_kernels_of_large_scenes_spill_little(tmp_path, residual, level, registers, frame):
    """What they take today: views of a world's workspaces, structs of some ninety arrays, lie in local memory
    (64 and 1,824 B before there were views), twice where functions are left apart, which those with contacts
    are since an H200 stepped worlds as fast so (in one piece 11,464 B, too many).
    """
    kernel = generic_step.make_rollout_kernel(wp.float32, residual)
    wp.set_module_options({"optimization_level": level}, kernel.module)
    used = sm90_resources(kernel, tmp_path)
    assert used["frame"] <= frame, used
    assert registers is None or 0 < used["registers"] <= registers, used  # 208: 9 warps a multiprocessor


def test_parser_sees_local_memory(tmp_path):
    @wp.kernel(module="unique", enable_backward=False)
    def indexed(x: wp.array(dtype=float), i: wp.array(dtype=int)):
        store = LONG()
        for k in range(64):
            store[i[k]] = x[k]
        x[wp.tid()] = store[i[wp.tid()]]

    used = sm90_resources(indexed, tmp_path)
    assert used["frame"] >= 256, used  # 64 floats at run-time indices
