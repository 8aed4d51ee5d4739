"""`slcp scenes`: the named scenes, each with a picture of its motion, on one sheet."""

from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp

from ..support.options import Device
from ..support.screen import one_line_errors, prepared, progress_bar, wrote


@one_line_errors
def scenes_command(
    out: Annotated[Path, typer.Option(help="The picture.")] = Path("scenes.png"),
    device: Device = None,
) -> None:
    """List the named scenes and draw them on one sheet."""
    from ..charts.scene_sheet import motion, sheet  # it loads matplotlib

    path = prepared(out, ".png")
    motions: dict[str, Any] = {}
    with progress_bar("scenes") as update:
        for i, (name, make) in enumerate(slcp.scenes.NAMED.items()):
            scene = make()
            motions[name] = (scene, motion(scene, device))
            update(i + 1, len(slcp.scenes.NAMED))
    for name, (scene, _) in motions.items():
        about = (slcp.scenes.NAMED[name].__doc__ or "").strip().splitlines()[0]
        typer.echo(f"{name}: nv {scene.nv}, nu {scene.nu}, rows {scene.structure.nr}. {about}")
    wrote(sheet(motions, path))
