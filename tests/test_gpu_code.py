"""The main kernels compile for sm_90 without a GPU, and the finger's rollout spills little."""

import pytest
import warp as wp
from cubin import kernel_resources

from slcp_warp import scenes
from slcp_warp.kernels import rollout
from slcp_warp.kernels.method import Method

LONG = wp.types.vector(64, float)
FINGER = scenes.flicking_finger().structure


def sm90_resources(kernel, folder):
    wp.compile_aot_module(kernel.module, arch=90, module_dir=str(folder), use_ptx=False)
    files = list(folder.rglob("*.cubin"))
    assert len(files) == 1, f"one cubin was expected, {files} were written"
    resources = kernel_resources(files[0].read_bytes())
    forward = {name: used for name, used in resources.items() if name.endswith("kernel_forward")}
    assert len(forward) == 1 and "registers" in next(iter(forward.values())), forward
    return next(iter(forward.values()))


@pytest.mark.slow
def test_finger_rollout_spills_little(tmp_path):
    kernel = rollout.make_rollout_kernel(FINGER, wp.float32, Method(scaling="none"), "open_loop", False)
    used = sm90_resources(kernel, tmp_path)
    assert 0 < used["registers"] <= 255
    assert used["frame"] <= 448, used  # bytes; almost all in the fallback that few worlds enter


def test_parser_sees_local_memory(tmp_path):
    @wp.kernel(module="unique", enable_backward=False)
    def indexed(x: wp.array(dtype=float), i: wp.array(dtype=int)):
        store = LONG()
        for k in range(64):
            store[i[k]] = x[k]
        x[wp.tid()] = store[i[wp.tid()]]

    used = sm90_resources(indexed, tmp_path)
    assert used["frame"] >= 256, used  # 64 floats at run-time indices
