"""Statuses of worlds in words."""

from typing import Any

import numpy as np

from ..inputs.arrays import to_numpy
from ..options import Status


def statuses(status: Any) -> str:
    """How many worlds ended how: "3 SOLVED, 1 INFEASIBLE"."""
    codes, counts = np.unique(np.ravel(to_numpy(status)), return_counts=True)
    known = {int(s): s.name for s in Status}
    return ", ".join(f"{n:,} {known.get(int(code), code)}" for code, n in zip(codes, counts))
