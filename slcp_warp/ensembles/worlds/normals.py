"""Drawn numbers on the host, from standard normal ones, as `draw_kernel` has them of random ones."""

import math

import numpy as np

from slcp_warp.kernels.ensembles.draws import LAWS

from ...tasks.disturbances.laws import Laws

erfc = np.vectorize(math.erfc, otypes=[float])


def normal_share(z: np.ndarray) -> np.ndarray:
    """The standard normal distribution function."""
    return np.asarray(0.5 * erfc(-z / math.sqrt(2.0)))


def drawn_rows(table: Laws, places: np.ndarray, z: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Rows (B, C) of a table.

    Args:
        places: of the columns that vary, the number of z that each is drawn from.
        z: (B, n) standard normal numbers.
        start: (B,) rows of the table's base that worlds are drawn around.
    """
    base = np.atleast_2d(table.base)
    out: np.ndarray = base[start if len(base) > 1 else np.zeros(len(z), int)].copy()
    for c, place in zip(table.varied, places):
        law, first, mine = LAWS[table.law[c]], table.first[c], z[:, place]
        if law == "uniform":
            out[:, c] = first + (table.second[c] - first) * normal_share(mine)
        elif law == "log-normal":
            out[:, c] *= np.exp(first * mine)
        else:
            out[:, c] += first * mine
    return out
