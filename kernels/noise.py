"""Noise level sigma of every row, section IV.B: given for each row, or mapped from covariances of the state.

The step computes a vector sigma only where it depends on the state; a level given for a row is read where it
is used.
"""

import functools
from types import SimpleNamespace

import warp as wp

from .mechanism import make_types
from .method import Method
from .structure import Structure, layout


@functools.cache
def make_noise(s: Structure, dtype: type, method: Method) -> SimpleNamespace:
    """`level[i]`: Warp function (params, row, sigma) -> sigma_i of row i."""
    t = make_types(s, dtype)
    SIGMA = layout(s).offset("sigma")

    def make_level(i: int) -> wp.Function:
        @wp.func
        def level(params: wp.array2d(dtype=dtype), row: int, sigma: t.VR):
            if wp.static(method.state_noise):
                return sigma[wp.static(i)]
            return params[row, wp.static(SIGMA + i)]

        return level

    return SimpleNamespace(level=tuple(make_level(i) for i in range(s.nr)))
