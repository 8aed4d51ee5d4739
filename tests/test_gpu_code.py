"""The main kernels compile for sm_90 without a GPU, and the finger's rollout spills little."""

import pytest
import warp as wp

from slcp_warp import scenes
from slcp_warp.kernels import large_step, rollout
from slcp_warp.kernels.method import Method
from slcp_warp.scripts.cubin import sm90_resources

LONG = wp.types.vector(64, float)
FINGER = scenes.flicking_finger().structure


@pytest.mark.slow
def test_finger_rollout_spills_little(tmp_path):
    kernel = rollout.make_rollout_kernel(FINGER, wp.float32, Method(scaling="none"), "open_loop", False)
    used = sm90_resources(kernel, tmp_path)
    assert 0 < used["registers"] <= 255
    assert used["frame"] <= 560, used  # bytes; almost all in the fallback that few worlds enter


@pytest.mark.slow
def test_kernel_of_large_scenes_spills_little(tmp_path):
    used = sm90_resources(large_step.make_large_rollout_kernel(wp.float32, "hard"), tmp_path)
    assert 0 < used["registers"] <= 255
    assert used["frame"] <= 1024, used


def test_parser_sees_local_memory(tmp_path):
    @wp.kernel(module="unique", enable_backward=False)
    def indexed(x: wp.array(dtype=float), i: wp.array(dtype=int)):
        store = LONG()
        for k in range(64):
            store[i[k]] = x[k]
        x[wp.tid()] = store[i[wp.tid()]]

    used = sm90_resources(indexed, tmp_path)
    assert used["frame"] >= 256, used  # 64 floats at run-time indices
