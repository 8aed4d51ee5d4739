"""`falsify` where single precision alone has failures: they hide nothing."""

from typing import Any

import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures


@wp.func
def rounded(x: Any, u: Any, time: wp.float64):
    """What 1e4 rounds off the velocity: up to 5e-4 m/s in single precision, 1e-12 in double."""
    big = type(x[0])(1e4)
    return wp.abs(((x[1] + big) - big) - x[1])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_failures_of_single_precision_hide_no_others(dtype):
    """Nearly every kick fails in float32, by rounding; in float64 those above 2 m/s do."""
    body = slcp.Body("p", 1.0, 0.1, joint="prismatic")
    scene = slcp.Scene("point", (body,), gravity=(0.0, 0.0), step_size=0.01)
    success = (measures.largest(measures.function(rounded)) < 1e-6) & (measures.final("p.vshift") < 2.0)
    task = slcp.Task("point", scene, duration=0.1, success=success)
    found = slcp.falsify(task, by="kick", worlds=256, dtype=dtype, device="cpu")
    assert found.size == pytest.approx(2.0, rel=0.02)
