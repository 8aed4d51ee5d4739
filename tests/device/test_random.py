"""Random numbers of the sweeps: Philox against published vectors, and the normals' distribution."""

import numpy as np
import pytest
import scipy.stats
import warp as wp
from simulators import NUMPY

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.random import make_normal, philox

COUNT = 100_000

# Known-answer vectors of philox4x32-10 distributed with Random123 (Salmon et al. 2011): counter, key, output
ONES = 0xFFFFFFFF
VECTORS = [
    ([0, 0, 0, 0], [0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([ONES] * 4, [ONES] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        [0xA4093822, 0x299F31D0],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]


@wp.kernel(module="unique", enable_backward=False)
def philox_kernel(
    first: int,
    counter: wp.array2d(dtype=wp.uint64),
    key: wp.array2d(dtype=wp.uint64),
    out: wp.array2d(dtype=wp.uint64),
):
    i = first + wp.tid()
    words = philox(counter[i, 0], counter[i, 1], counter[i, 2], counter[i, 3], key[i, 0], key[i, 1])
    for j in range(4):
        out[i, j] = words[j]


def normal_kernel(dtype):
    rng = make_normal(dtype)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(first: int, address: wp.array2d(dtype=int), out: wp.array2d(dtype=dtype)):
        i = first + wp.tid()
        pair = rng.normals(address[i, 0], address[i, 1], address[i, 2], address[i, 3])
        out[i, 0] = pair[0]
        out[i, 1] = pair[1]

    return kernel


def normals(address, device, dtype=wp.float64):
    """Pairs (n, 2) at addresses (n, 4) = seed, world, step, stream."""
    address = wp.array(np.ascontiguousarray(address, dtype=np.int32), dtype=int, device=device)
    out = wp.zeros((address.shape[0], 2), dtype=dtype, device=device)
    launch(normal_kernel(dtype), address.shape[0], [address, out], device)
    return out.numpy()


def along(axis, count=COUNT):
    """Addresses that differ in one component."""
    address = np.tile([7, 3, 5, 200], (count, 1))
    address[:, axis] = np.arange(count)
    return address


def test_philox_gives_the_published_words(device):
    counter, key, expected = (np.array(c, dtype=np.uint64) for c in zip(*VECTORS, strict=True))
    out = wp.zeros((len(counter), 4), dtype=wp.uint64, device=device)
    arrays = [wp.array(a, dtype=wp.uint64, device=device) for a in (counter, key)]
    launch(philox_kernel, len(counter), [*arrays, out], device)
    np.testing.assert_array_equal(out.numpy(), expected)


@pytest.mark.parametrize("axis", range(4), ids=["seed", "world", "step", "stream"])
def test_normals_are_standard_and_independent_along_every_address(device, axis):
    pairs = normals(along(axis), device)
    values = pairs.ravel()
    error = 1.0 / np.sqrt(len(values))
    assert abs(values.mean()) < 4.5 * error
    assert abs(values.var() - 1.0) < 4.5 * np.sqrt(2.0) * error
    assert abs((values**4).mean() - 3.0) < 4.5 * np.sqrt(96.0) * error
    assert scipy.stats.kstest(values, "norm").pvalue > 1e-4
    tail = (np.abs(values) > 3.5).mean()
    assert abs(tail - 4.65e-4) < 4.5 * np.sqrt(4.65e-4) * error
    for a, b in ((pairs[:, 0], pairs[:, 1]), (pairs[:-1, 0], pairs[1:, 0]), (pairs[:-1, 1], pairs[1:, 0])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 4.5 / np.sqrt(len(a))
        assert abs(np.corrcoef(a**2, b**2)[0, 1]) < 4.5 / np.sqrt(len(a))


def test_a_number_depends_on_its_address_only(device):
    address = np.concatenate([along(axis, 500) for axis in range(4)])
    order = np.random.default_rng(0).permutation(len(address))
    np.testing.assert_array_equal(normals(address, device)[order], normals(address[order], device))
    unique = np.unique(address, axis=0)
    assert len(np.unique(normals(unique, device)[:, 0])) == len(unique)


def test_both_precisions_draw_the_same_numbers(device):
    address = along(1, 1000)
    fine, coarse = normals(address, device), normals(address, device, wp.float32)
    np.testing.assert_array_equal(coarse, fine.astype(NUMPY[wp.float32]))
