"""How a library's robustness grows with its number of plans."""

from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.sweep import sweep_scene

from ..support.simulators import default_scaling


def size_rows(
    scene: slcp.Scene,
    library: ddp.Library,
    plans: list[int],
    spec: slcp.SweepSpec,
    device: str | None = None,
    progress: Any = None,
) -> list[dict[str, Any]]:
    """A row per number of plans and case; a smaller library is the plans that were made first."""
    library.check_scene(scene)
    rows: list[dict[str, Any]] = []
    scaling = default_scaling(scene)
    number = np.cumsum(library.age == 0)  # of an entry's plan, from 1
    for done, count in enumerate(plans):
        if not 0 < count <= number[-1]:
            raise ValueError(f"--plans contains {count}; the library has {number[-1]}")
        part = library.select(number <= count)
        report = sweep_scene(scene, part.policy(), spec, scaling=scaling, device=device)
        for case in report.cases:
            row = {"plans": count, "controllers": len(part)} | {
                k: case[k] for k in ("residual", "step_size", "worlds")
            }
            for name in ("mean_rate", "share_above"):
                row |= dict(zip((name, f"{name}_low", f"{name}_high"), case[name]))
            rows.append(row)
        if not report.complete:
            break
        if progress is not None:
            progress(done + 1, len(plans))
    return rows
