"""Kernels in Warp's cache: found whatever ran before; functions of a user told apart by their code."""

import os
import subprocess
import sys

import pytest
import warp as wp

from slcp_warp.kernels.compile import code_digest

RUN = """
import sys, numpy as np, warp as wp
wp.config.log_level = wp.LOG_WARNING
import slcp_warp as slcp
sim = slcp.Simulator(slcp.scenes.particle(), device="cpu", dtype="float32")
x = sim.scene.x0[None]
for name in sys.argv[1:]:
    sim.step(x) if name == "step" else sim.rollout(x, np.zeros((1, 2, sim.nu), np.float32))
"""


@pytest.mark.slow
def test_kernels_are_found_whatever_ran_before(tmp_path):
    """One process compiles a step and a rollout, others need them alone or the other way round."""
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path), "PYTHONSAFEPATH": "1"}

    def binaries(*names):
        subprocess.run([sys.executable, "-c", RUN, *names], env=environment, check=True, cwd=tmp_path)
        return sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.o"))

    first = binaries("step", "rollout")
    assert len(first) == 2
    assert binaries("rollout", "step") == first
    assert binaries("rollout") == first


def test_a_users_functions_are_told_apart_by_values_in_loops():
    """Values of `wp.static` with a loop's index, which Warp leaves out of a module's hash."""

    def digest(weights, again=1):
        @wp.func
        def cost(x: wp.vec2d):
            total = wp.float64(0.0)
            for i in range(2):
                total += wp.static(weights[i]) * x[i]
            return total

        def kernel(x: wp.array(dtype=wp.vec2d), out: wp.array(dtype=wp.float64)):
            out[0] = cost(x[0])

        return [code_digest(kernel) for _ in range(again)]

    one, other = (wp.float64(1.0), wp.float64(2.0)), (wp.float64(1.0), wp.float64(3.0))
    assert digest(one) == digest(one)
    assert digest(one) != digest(other)
    assert len(set(digest(one, again=2))) == 1
