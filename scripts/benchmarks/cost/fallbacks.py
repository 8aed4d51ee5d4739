"""How many steps of the finger go beyond the solver of few rows: to general Newton, to the interior point.

The kernels do not count. So each of the two is replaced by one that reports NONFINITE, and the worlds that
do are counted, in a process of its own with a cache of kernels of its own: a kernel's name would not tell the
replaced one from the real one.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, no_type_check

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.contact.problem import make_problem
from slcp_warp.kernels.mechanism.kinematics import make_types
from slcp_warp.kernels.solvers import convex as solve
from slcp_warp.kernels.solvers.newton import make_newton
from slcp_warp.kernels.status import NONFINITE

from ..shared.workload import make_workload

PARTS = {"newton": "general Newton iteration", "interior": "interior point"}


def bench_fallbacks(
    worlds: int, steps: int, seed: int, dtype: str, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Rows of share and count for every part, over the states of rollouts of `make_workload`."""
    scene = slcp.scenes.flicking_finger()
    work = make_workload(scene, worlds, steps, seed)
    rows: list[dict[str, Any]] = []
    for residual in ("rem-logistic", "hard"):
        sim = slcp.Simulator(scene, slcp.Options(residual, scaling="none"), device="cpu", dtype=dtype)
        states = sim.rollout(work.x0, work.controls).states[:, :-1].reshape(-1, sim.nx)
        for part, name in PARTS.items():
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "states.npz"
                np.savez(file, x=states, u=work.controls.reshape(-1, sim.nu))
                environment = os.environ | {"WARP_CACHE_PATH": folder}
                command = [sys.executable, "-m", __name__, part, residual, dtype, str(file)]
                said = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
            count = int(said.stdout.split()[-1])
            rows.append({"residual": residual, "dtype": dtype, "part": name, "steps": len(states),
                         "entered": count, "share": count / len(states)})  # fmt: skip
            say(f"{residual}, {dtype}: {name} in {count} of {len(states)} steps ({count / len(states):.2g})")
    return rows


def _replace(part: str) -> None:
    """Make one part of the solver say NONFINITE as soon as it is entered."""

    @no_type_check
    def make_no_interior(spec):
        s, dtype, _ = spec
        t = make_types(s, dtype)
        VR, Problem, NR, BAD = t.VR, make_problem(s, dtype), s.nr, dtype(np.nan)

        @wp.func
        def interior(world: t.World, p: Problem, z: VR):
            out = VR()
            for i in range(wp.static(NR)):
                out[i] = BAD
            return out, out, 1, 0

        return interior

    @no_type_check
    def make_no_newton(spec):
        s, dtype, _ = spec
        n, t = make_newton(spec), make_types(s, dtype)
        VR, Problem, Point = t.VR, make_problem(s, dtype), n.Point

        @wp.func
        def newton(world: t.World, p: Problem, z: VR):
            return Point(), z, wp.static(NONFINITE), 0

        n.newton = newton
        return n

    if part == "newton":
        vars(solve)["make_newton"] = make_no_newton
    else:
        vars(solve)["make_interior"] = make_no_interior


def _count(part: str, residual: str, dtype: str, file: str) -> int:
    """Steps that enter a part."""
    wp.config.log_level = wp.LOG_ERROR
    _replace(part)
    options = slcp.Options(residual, scaling="none")
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), options, device="cpu", dtype=dtype)
    with np.load(file) as archive:
        status = sim.step(archive["x"], archive["u"]).status
    return int((status == slcp.Status.NONFINITE).sum())


if __name__ == "__main__":
    print(_count(*sys.argv[1:]))
