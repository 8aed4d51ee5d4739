"""What a task's cost asks of the state: the targets of its terms."""

from typing import Any

import numpy as np

from slcp_warp.kernels.control.cost_terms import FIELDS, KINDS, make_terms

TO_A_TARGET = ("square", "cosine", "absolute")  # terms that are least at it


def goal(task: Any) -> np.ndarray | None:
    """The first start of a `Task` with every position at its term's target, the last term's of it.

    (2 nv,) with zero velocities; None where the cost asks for no place, or is no sum of terms.
    """
    nv, cost = task.scene.nv, task.cost
    if cost.make is not make_terms or cost.weights.ndim > 1:
        return None
    rows = cost.weights[1:].reshape(-1, FIELDS)
    running = int(cost.weights[0])
    x, asked = task.start[0].copy(), False
    x[nv:] = 0.0
    later = []
    for kind, component, weight, target, _, minus in (*rows[:running], *rows[running:]):
        if weight > 0.0 and component < nv and KINDS[int(kind)] in TO_A_TARGET:
            later += [(int(component), target, int(minus))] if minus >= 0 else []
            if minus < 0:
                x[int(component)] = target
            asked = True
    for component, target, minus in later:
        x[component] = x[minus] + target
    return x if asked else None
