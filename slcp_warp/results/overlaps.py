"""What overlaps, by the names of pairs and limits, from the distances of rows; and where worlds failed."""

from collections.abc import Callable

import numpy as np

from ..description.scene import Scene
from ..inputs.arrays import Array, to_numpy
from ..options import Status
from ..storage.printed import ROWS, Table

OVERLAP = 1e-6  # from which on rows are said to overlap [m, rad]
SEEN = 1e-12  # from which on a rounding may be what was wedged
MOST = 8  # names in a text


def overlaps(scene: Scene, gap: np.ndarray, most: int = MOST, least: float = OVERLAP) -> str:
    """What overlaps, the deepest first: "ground/ball by 0.01", in how many worlds of several; or "".

    Args:
        scene: gives the names.
        gap: (B, nr) signed distances of rows [m, rad]; NaN: not known.
        most: names in the text.
        least: what is no more does not overlap [m, rad].
    """
    depth: dict[str, np.ndarray] = {}
    for row, column in zip(scene.row_names, -gap.T):
        name = row.removesuffix(" +").removesuffix(" -")
        depth[name] = np.fmax(depth.get(name, column), column)
    found = {name: each for name, each in depth.items() if (each > least).any()}
    said = []
    for name, each in sorted(found.items(), key=lambda item: -np.nanmax(item[1])):
        many = f" in {(each > least).sum()} of {len(each)} worlds" if len(each) > 1 else ""
        said.append(f"{name} by {np.nanmax(each):.3g}{many}")
    more = [f"and {len(said) - most} more"] if len(said) > most else []
    return ", ".join([*said[:most], *more])


def failed(
    scene: Scene, status: Array, gaps: Callable[[np.ndarray], np.ndarray], most: int = ROWS
) -> list[tuple[int, str, str]]:
    """The first worlds that are not SOLVED: number, status, and what overlaps in the state they failed at.

    Args:
        scene: gives the names.
        status: of all worlds.
        gaps: distances of rows (K, nr) of worlds by their numbers (K,), in that state.
        most: worlds.
    """
    codes = np.ravel(to_numpy(status))
    worlds = np.flatnonzero(codes != Status.SOLVED)[:most]
    if not len(worlds):
        return []
    said = (_said(scene, row) for row in gaps(worlds))
    return [(int(i), Status(codes[i]).name, text) for i, text in zip(worlds, said)]


def _said(scene: Scene, gap: np.ndarray) -> str:
    """What overlaps in a state (nr,) that had no next one; by roundings alone what is wedged is lost, too."""
    if found := overlaps(scene, gap[None], 3):
        return found
    if np.isnan(gap).any():
        return "unknown"
    least = overlaps(scene, gap[None], 3, SEEN)
    return f"roundings: {least}; Options(depenetration_speed=) lets them stay" if least else "nothing"


def failed_table(scene: Scene, status: Array, gaps: Callable[[np.ndarray], np.ndarray]) -> Table:
    """The same as a table, without rows where all are SOLVED."""
    rows = failed(scene, status, gaps)
    count = int((np.ravel(to_numpy(status)) != Status.SOLVED).sum())
    title = "worlds that are not SOLVED" + (f", {len(rows)} of {count:,}" if count > len(rows) else "")
    return Table(title, ("world", "status", "overlaps there"), rows, left=3, width=160)
