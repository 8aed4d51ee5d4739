"""Study "derivatives", MJX and Drake: error of a step's Jacobians of the finger against their cost.

As in derivatives.py, which has MuJoCo C: every program is judged against the converged derivative of
its own step, here in float64. States: `touching`, where the exact distance is negative on MuJoCo's own way;
`onset`, our first step in which the contact acts, the gap still open.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import slcp_warp as slcp

from ..peers.drake import EPS, Drake
from ..peers.mjx import MJX
from ..peers.peer import installed
from ..shared.differences import converged, relative
from ..shared.rows import Rows, Say, report
from ..shared.timing import Case, time_interleaved
from .derivatives import judged, peer_touching, point, states

COUNT = 32  # states of each kind
REPEATS = 5
H = 0.05
NOTE = "of its own step; how far its model is off stands in study contact"


def rows(say: Say) -> Rows:
    """A row for each of the two that is installed, and kind of state."""
    out: Rows = []
    scene = slcp.scenes.flicking_finger()
    kinds: dict[str, np.ndarray] = {}
    for peer in installed((MJX, Drake), say):
        kinds = kinds or {"touching": peer_touching(COUNT), "onset": states(COUNT)["onset"]}
        linear = peer.linearization(scene, H)
        for name, run in linear.jacobians.items():
            begin = time.perf_counter()
            run(kinds["touching"])
            compiling = time.perf_counter() - begin
            facts = {
                "program": peer.name,
                "version": peer.version,
                "compile_seconds": compiling,
                "note": NOTE,
            }
            out += [
                row(linear.step, run, z, kind, f"{peer.name}, {name}", facts) for kind, z in kinds.items()
            ]
    return report(say, out, "problem", "curve", "error", "error_p90", "seconds")


def row(
    step: Callable[[np.ndarray], np.ndarray],
    run: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    kind: str,
    curve: str,
    facts: dict[str, Any],
) -> dict[str, Any]:
    """Error and cost of Jacobians at states z (B, nx + nu); the cost is the process's, all its threads."""
    truth, uncertainty = converged(step, z)
    error = judged(relative(run(z), truth), uncertainty)
    seconds = time_interleaved([Case(curve, lambda: run(z), len(z))], REPEATS)[0].seconds
    low, middle, high = (float(x) for x in np.percentile(seconds, [10, 50, 90]))
    knob = {"knob": "eps", "value": EPS} if "differences" in curve else {"knob": "derivative", "value": 0.0}
    return point(kind, curve, **facts) | error | knob | {
        "seconds": middle, "seconds_p10": low, "seconds_p90": high, "seconds_best": float(seconds.min()),
        "repeats": REPEATS, "clock": "process CPU", "batch": len(z), "dtype": str(run(z).dtype),
    }  # fmt: skip
