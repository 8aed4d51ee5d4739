"""Columns of tables, whatever way these lie in memory."""

import numpy as np
import pytest
import warp as wp

from slcp_warp.ensembles.worlds.columns import read_columns
from slcp_warp.kernels.device import tables


@pytest.mark.parametrize("by_columns", [False, True])
def test_columns_are_read_by_their_places(monkeypatch, by_columns):
    monkeypatch.setattr(tables, "by_columns", lambda rows, device: by_columns)
    values = np.arange(12.0).reshape(4, 3)
    made = tables.make_table(values, wp.float64, "cpu")
    for places in ([], [2], np.array([1, 0])):
        read = read_columns(made, places)
        assert len(read) == len(places)
        for place, column in zip(places, read):
            np.testing.assert_array_equal(column, values[:, place])
    deep = wp.array(np.arange(24.0).reshape(4, 2, 3), dtype=wp.float64, device="cpu")
    np.testing.assert_array_equal(read_columns(deep, [4])[0], 4.0 + 6.0 * np.arange(4))
