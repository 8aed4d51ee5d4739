"""The needed part of Warp's header: the same machine code, and the whole of it where that does not do."""

import numpy as np
import warp as wp
from warp._src import build
from warp._src.context import ModuleBuilder

from slcp_warp.kernels.device import header
from slcp_warp.kernels.device.compile import packed, specialised
from slcp_warp.kernels.device.launch import launch

V3 = wp.types.vector(3, wp.float64)
M3 = wp.types.matrix((3, 3), wp.float64)
FRAMES = "wp::tile_shared_storage_t tile_mem;", "wp::shared_tile_storage = &tile_mem;"


@packed
def arithmetic(first: int, x: wp.array2d(dtype=wp.float64), n: wp.array(dtype=wp.int32)):
    i = first + wp.tid()
    v = V3(x[i, 0], x[i, 1], wp.float64(n[i] % 5))
    m = wp.outer(v, v) + wp.identity(3, wp.float64)
    v = wp.inverse(m) * wp.cross(v, m * v)
    for j in range(n[i]):
        v[j % 3] = wp.log(wp.float64(1.0) + wp.exp(wp.clamp(v[j % 3], wp.float64(-9.0), wp.float64(9.0))))
    x[i, 0] = wp.where(wp.isfinite(v), wp.dot(v, v), wp.float64(-1.0))
    n[i] = (n[i] | 8) & ~1
    x[i, 1] = wp.float64(wp.float32(v[1])) + wp.float64(wp.abs(n[i]))


@specialised
def turned(first: int, x: wp.array(dtype=wp.float64)):
    i = first + wp.tid()
    q = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), wp.float32(x[i]))
    x[i] = wp.float64(wp.quat_rotate(q, wp.vec3(1.0, 0.0, 0.0))[1])


@specialised
def noisy(first: int, x: wp.array(dtype=wp.float32)):
    i = first + wp.tid()
    x[i] = wp.noise(wp.uint32(7), x[i])


def source(kernel):
    """What Warp gives the compiler of a CPU."""
    options = kernel.module.resolve_options(wp.config, block_dim=1) | {"output_arch": None, "block_dim": 1}
    return ModuleBuilder(kernel.module, options, target="cpu").codegen("cpu")


def test_the_machine_code_is_the_same(tmp_path):
    whole = source(arithmetic)
    short = header.shortened(whole)
    assert header.INCLUDED in whole and header.INCLUDED not in short
    assert "mat_t" in short and "quat_t" not in short and "adj_mul" not in short
    objects = []
    for text in (whole, short):
        for part in FRAMES:
            assert part in text
            text = text.replace(part, "")
        (tmp_path / "kernel.cpp").write_text(text)
        build.build_cpu.__wrapped__(
            str(tmp_path / "kernel.o"),
            str(tmp_path / "kernel.cpp"),
            extra_flags=arithmetic.module.options["cpu_compiler_flags"],
            block_dim=1,
        )
        objects.append((tmp_path / "kernel.o").read_bytes())
    assert objects[0] == objects[1]


def test_what_is_named_is_there():
    x = wp.array(np.array([0.3, -2.0]), dtype=wp.float64, device="cpu")
    assert "quat_t" in header.shortened(source(turned))
    launch(turned, 2, [x], "cpu")
    np.testing.assert_allclose(x.numpy(), np.sin([0.3, -2.0]), atol=1e-6)


def test_what_is_elsewhere_takes_the_whole_header():
    assert header.shortened(source(noisy)) is None
    x = wp.array(np.array([0.3, 0.3, 1.4]), dtype=wp.float32, device="cpu")
    launch(noisy, 3, [x], "cpu")
    assert x.numpy()[0] == x.numpy()[1] != x.numpy()[2]


def test_what_the_compiler_refuses_is_compiled_with_the_whole_header(tmp_path):
    file = tmp_path / "kernel.cpp"
    file.write_text(source(arithmetic))
    seen = []

    def picky(_object, path, **options):
        seen.append((header.INCLUDED in file.read_text(), options["use_precompiled_headers"]))
        if not seen[-1][0]:
            raise Exception("CPU kernel build failed with error code 1")

    header.with_needed_header(picky)("kernel.o", str(file), use_precompiled_headers=True)
    assert seen == [(False, False), (True, True)]
