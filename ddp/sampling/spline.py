"""Splines through knots: for every step the knots that it depends on, and their weights."""

import numpy as np

from slcp_warp.kernels.control.sampling import SUPPORT

SPLINES = ("constant", "linear", "cubic")


def knots_of(horizon: int, given: int | None) -> int:
    """How many knots a plan's spline has."""
    return min(horizon, max(4, round(horizon / 8.0)) if given is None else given)


def spline_weights(kind: str, horizon: int, knots: int) -> tuple[np.ndarray, np.ndarray]:
    """First knot (N,) of every step and the weights (N, 4) of the knots from it on.

    Knots are evenly spread, the first at step 0 and the last at the last step; constant ones begin at even
    shares of the steps. "cubic" is Catmull and Rom's, with the outer slopes held. Knots beyond the last have
    the weight 0 and stand for rows of the array that nothing is in: it has `knots` + 3 rows.
    """
    first, weights = np.zeros(horizon, dtype=np.int32), np.zeros((horizon, SUPPORT))
    for k in range(horizon):
        if kind == "constant" or knots == 1:
            first[k], weights[k, 0] = k * knots // horizon, 1.0
            continue
        place = k * (knots - 1) / max(horizon - 1, 1)
        left = min(int(place), knots - 2)
        t = place - left
        if kind == "linear":
            first[k], weights[k, :2] = left, (1.0 - t, t)
            continue
        row = np.zeros(knots)
        ahead = 0.5 * np.array(
            [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2]
        )
        for offset, weight in zip((-1, 0, 1, 2), ahead, strict=True):
            row[min(max(left + offset, 0), knots - 1)] += weight
        first[k] = min(max(left - 1, 0), max(knots - SUPPORT, 0))
        window = row[first[k] : first[k] + SUPPORT]
        weights[k, : len(window)] = window
    return first, weights
