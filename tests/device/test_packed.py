"""Kernels whose arrays have no gaps: what is read without strides, and what keeps others from it."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from slcp_warp import scenes
from slcp_warp.kernels.device.compile import PACKED, _declare, packed
from slcp_warp.kernels.device.digest import own_alone
from slcp_warp.kernels.device.launch import launch, no_gaps
from slcp_warp.kernels.ensembles.generic_rollout import make_policy_rollout_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.generic.step import make_rollout_kernel
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.function import function_kernel
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout
from slcp_warp.kernels.step.step import make_step


def walk(
    first: int, a: wp.array(dtype=wp.float64), rows: wp.array2d(dtype=wp.float64), n: int,
    deep: wp.array3d(dtype=wp.float64), out: wp.array2d(dtype=wp.float64),
):  # fmt: skip
    """Sums over ranges up, down and with holes, of arrays of one axis to three, read and written."""
    i = first + wp.tid()
    inner = rows[i]
    for j in range(n):
        out[i, 0] = out[i, 0] * wp.float64(2.0) + a[j]
    for j in range(1, n):
        out[i, 1] = out[i, 1] * wp.float64(2.0) + inner[j]
    for j in range(n - 1, -1, -2):
        out[i, 2] = out[i, 2] * wp.float64(2.0) + rows[i, j]
    for j in range(n, n):
        out[i, 3] = a[j]
    for j in range(n):
        deep[i, j, 1] = deep[i, j, 0] + deep[i, j, 2]


@wp.struct
class Held:
    a: wp.array(dtype=wp.float64)


@wp.struct
class Around:
    inner: Held


def make_control(dtype, VX, VU, Data):
    """A user's policy."""

    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(data.a[-1])

    return control


def test_a_packed_kernel_computes_what_others_do():
    """Elements and ranges of the C++ that stands before a packed kernel, against NumPy."""
    kernel = _declare(walk, {}, preamble=PACKED)
    rng = np.random.default_rng(0)
    n, worlds = 5, 3
    a, rows = rng.standard_normal(n), rng.standard_normal((worlds, n + 2))
    out = wp.zeros((worlds, 4), dtype=wp.float64, device="cpu")
    deep = rng.standard_normal((worlds, n + 1, 3))
    given = wp.array(np.concatenate((deep, deep), 2), dtype=wp.float64, device="cpu")[:, :, :3]
    launch(kernel, worlds, [wp.array(a), wp.array(rows), n, given, out], "cpu")
    powers = 2.0 ** np.arange(n)[::-1]
    want = np.zeros((worlds, 4))
    want[:, 0] = a @ powers
    want[:, 1] = rows[:, 1:n] @ powers[1:]
    want[:, 2] = rows[:, [4, 2, 0]] @ [4.0, 2.0, 1.0]
    np.testing.assert_allclose(out.numpy(), want, rtol=1e-14)
    deep[:, :n, 1] = deep[:, :n, 0] + deep[:, :n, 2]
    np.testing.assert_array_equal(given.numpy(), deep)


def test_gaps_are_refused():
    """A column of a matrix has gaps; rows of one that is wider have none along their axis."""
    kernel = SimpleNamespace(packed=True, key="a kernel")
    matrix = wp.zeros((4, 6), dtype=wp.float64, device="cpu")
    no_gaps(kernel, [3, matrix, matrix[1], matrix[:, :3]])
    with pytest.raises(ValueError, match=r"argument 2 of a kernel has strides \(48,\) bytes"):
        no_gaps(kernel, [3, matrix[:, 1]])
    no_gaps(SimpleNamespace(key="another"), [matrix[:, 1]])
    around, control = Around(), Held()
    around.inner = control
    control.a = matrix[1]
    no_gaps(kernel, [around])
    control.a = matrix[:, 1]
    around.inner = control
    with pytest.raises(ValueError, match="argument 1 of a kernel has strides"):
        no_gaps(kernel, [around])


def test_a_users_function_may_index_from_the_end():
    """A kernel that is, or calls, a function from outside the package is compiled as Warp has it."""

    def last(first: int, a: wp.array(dtype=wp.float64), out: wp.array(dtype=wp.float64)):
        out[first + wp.tid()] = a[-1]

    kernel = packed(last)
    assert not kernel.packed and not own_alone(last)
    out = wp.zeros(1, dtype=wp.float64, device="cpu")
    launch(kernel, 1, [wp.array([1.0, 2.0, 3.0], dtype=wp.float64, device="cpu"), out], "cpu")
    assert out.numpy() == 3.0


def test_kernels_that_step_are_packed():
    """Those of the package alone: a policy of a user's makes another of it."""
    own = function_kernel(make_control, None, 0, (("a", 1, None),), "a user's")
    assert make_rollout_kernel(wp.float64, "hard").packed
    assert not make_policy_rollout_kernel(wp.float64, "hard", 3, 1, own).packed
    spec = Specialisation(scenes.particle().structure, wp.float64, Method(residual="hard"))
    assert rollout.make_rollout_kernel(spec, OPEN_LOOP, False).packed
    assert make_sweep_kernel(spec, OPEN_LOOP).packed
    assert not rollout.make_rollout_kernel(spec, own, False).packed


def test_a_step_is_part_of_its_kernel():
    """Left to the compiler, a function as large as a step is called: its solution, of a hundred numbers, goes
    through memory, which costs a box on a plane a seventh.
    """
    spec = Specialisation(scenes.particle().structure, wp.float64, Method(residual="hard"))
    assert make_step(spec, False).solve_step.inline_hint == "forceinline"
