"""Corner radii of rectangles in tables of parameters: half of the shorter side at most, whatever is drawn."""

import numpy as np

from slcp_warp.kernels.structure import RECTANGLE, Structure, layout


def columns_of_corners(s: Structure) -> np.ndarray:
    """Columns (R, 3) of the corner radius of each rectangle and of the half width and height that it keeps
    within.
    """
    start = {name: first for name, first, _ in layout(s).columns}
    rectangles = [i for i, shape in enumerate(s.shapes) if shape.kind == RECTANGLE]
    rows = [
        (start["corner_radius"] + i, start["radius"] + 2 * i, start["radius"] + 2 * i + 1) for i in rectangles
    ]
    return np.array(rows, np.int32).reshape(-1, 3)


def with_corners_within(s: Structure, table: np.ndarray) -> np.ndarray:
    """Parameters (B, P) whose corner radii are those that a world has."""
    out = table.copy()
    for corner, width, height in columns_of_corners(s):
        out[:, corner] = np.minimum(out[:, corner], np.minimum(out[:, width], out[:, height]))
    return out
