"""Sums over worlds against exact ones; rows copied with gaps, types changed."""

import math

import numpy as np
import pytest
import warp as wp

from slcp_warp.kernels.device.reduce import STRIP, add_rows
from slcp_warp.kernels.device.tables import copy_rows


@pytest.mark.parametrize("worlds", [1, STRIP, STRIP + 1, 2 * STRIP**2 + 7])
def test_sums_are_exact_to_few_roundings(device, worlds):
    """One after the other 131,079 numbers of .1 in float32 are off by 4e-3."""
    rng = np.random.default_rng(worlds)
    part = np.stack([np.full(worlds, 0.1), rng.uniform(0.0, 1.0, worlds)], 1).astype(np.float32)
    exact = [5.0 + math.fsum(column.astype(float)) for column in part.T]
    total = wp.full((1, 2), 5.0, dtype=wp.float32, device=device)
    add_rows(wp.array(part, dtype=wp.float32, device=device), total)
    levels = 1 + math.ceil(math.log(max(worlds, 2), STRIP))
    np.testing.assert_allclose(total.numpy()[0], exact, rtol=levels * STRIP * 2.0**-24)
    if worlds > STRIP:
        np.testing.assert_allclose(total.numpy()[0], exact, rtol=1e-5)


def test_sums_have_the_same_bits_with_any_threads(device, monkeypatch):
    part = wp.array(np.random.default_rng(0).standard_normal((5000, 3)), dtype=wp.float32, device=device)
    found = []
    for threads in (1, 4):
        monkeypatch.setattr("slcp_warp.kernels.device.launch._default_threads", threads)
        total = wp.zeros((1, 3), dtype=wp.float32, device=device)
        add_rows(part, total)
        found.append(total.numpy().copy())
    np.testing.assert_array_equal(*found)


def test_every_world_s_own_and_arrays_with_gaps(device):
    rows = np.arange(24.0).reshape(4, 3, 2)
    part = wp.array(rows, dtype=wp.float32, device=device)
    total = wp.full((4, 3, 2), 1.0, dtype=wp.float32, device=device)
    add_rows(part[:, 1], total[:, 2])
    np.testing.assert_array_equal(total.numpy()[:, 2], 1.0 + rows[:, 1])
    assert np.all(total.numpy()[:, :2] == 1.0)
    turned = wp.zeros((2, 4), dtype=wp.float32, device=device).transpose()
    copy_rows(part[:, 2], turned)
    np.testing.assert_array_equal(turned.numpy(), rows[:, 2])
