"""`slcp surface`: signed distances of the contact pairs on a grid of configurations (Fig. 2's data)."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from ..stages.surface import surface
from ..support.options import Device, SceneName
from ..support.paper import RANGE
from ..support.screen import one_line_errors, prepared, wrote
from ..support.simulators import make_simulator, named_scene, numbers


@one_line_errors
def surface_command(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("surface.npz"),
    scene: SceneName = "flicking_finger",
    resolution: Annotated[int, typer.Option(help="Points per coordinate.")] = 49,
    low: Annotated[str | None, typer.Option(help="Lower ends q1,q2,q3; default: the finger's.")] = None,
    high: Annotated[str | None, typer.Option(help="Upper ends q1,q2,q3.")] = None,
    device: Device = None,
) -> None:
    """Save the signed distance of a scene's first contact pair on a grid."""
    path = prepared(out)
    lower = numbers(low, "--low", 3) if low else np.array(RANGE)[:, 0]
    upper = numbers(high, "--high", 3) if high else np.array(RANGE)[:, 1]
    sim = make_simulator(named_scene(scene), device=device, dtype="float32")
    surface(sim, tuple(zip(lower, upper)), resolution).save(path)
    wrote(path)
