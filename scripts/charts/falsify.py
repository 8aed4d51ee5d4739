"""The smallest failing disturbance beside the sizes of those that a sweep draws."""

from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.ensembles.questions.rare.falsification import COLUMNS
from slcp_warp.storage.files import FileError

from ..support.tables import number, read_csv
from .style import BLACK, BLUE, GREY, RED, plt, save

MOST = 14  # components that are drawn, the largest


def read_falsification(path: Path) -> tuple[np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Sizes that were drawn, which of them fail, and what was found: name, value, sd.

    Raises:
        FileError: another table, or numbers that are none.
    """
    rows = read_csv(path, "a table of `slcp falsify`", COLUMNS)
    known = {"drawn", "found"}
    if not known >= {row["role"] for row in rows}:
        raise FileError(f"{path}: role is neither of {', '.join(sorted(known))}")
    drawn = [row for row in rows if row["role"] == "drawn"]
    found = [
        {"name": row["name"], "value": number(path, row, "value"), "sd": number(path, row, "sd")}
        for row in rows
        if row["role"] == "found"
    ]
    sizes = np.array([number(path, row, "sd") for row in drawn])
    return sizes, np.array([row["failed"] == "True" for row in drawn]), found


def falsify_chart(file: Path, path: Path) -> Path:
    """Sizes of drawn disturbances, with those that fail; the smallest that fails, and what it is made of."""
    sizes, failed, found = read_falsification(file)
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.0, 3.6), layout="constrained", width_ratios=(1.4, 1.0)
    )
    smallest = float(np.linalg.norm([row["sd"] for row in found])) if found else np.nan
    bins = np.linspace(0.0, 1.05 * np.nanmax([sizes.max(), smallest]), 60)
    counts, _, _ = left.hist(sizes, bins, color=BLUE, label="drawn")
    foot = -0.06 * counts.max()
    left.vlines(sizes[failed], foot, 0.0, color=RED, lw=0.8, label=f"of them {failed.sum()} fail")
    left.set_ylim(bottom=foot)
    if found:
        left.axvline(smallest, color=BLACK, lw=1.5, ls="--", label=f"smallest that fails: {smallest:.3g}")
    left.set_xlabel("size of the disturbance [standard deviations]")
    left.set_ylabel(f"of {len(sizes)} that were drawn")
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    shown = sorted(found, key=lambda row: -abs(row["sd"]))[:MOST][::-1]
    right.barh(range(len(shown)), [row["sd"] for row in shown], color=GREY)
    right.set_yticks(range(len(shown)), [f"{row['name']} = {row['value']:.3g}" for row in shown])
    right.set_ylim(-1.0, max(len(shown), 3))
    right.axvline(0.0, color=BLACK, lw=0.8)
    right.set_xlabel("standard deviations")
    right.set_title("the smallest that fails" if found else "none was found that fails", loc="left")
    return save(figure, path)
