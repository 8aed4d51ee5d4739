"""The command table of `slcp`: each command is registered here and lives in a file of its own."""

from typing import Annotated

import typer
import warp as wp

from slcp_warp import __version__

from .bench import app as bench_app
from .chart import chart_command
from .library import library_command
from .optimise import optimise_command
from .quickstart import quickstart_command
from .scenes import scenes_command
from .simulate import simulate_command
from .studies.car import car_command
from .studies.ddp import study_command
from .studies.grip import grip_command
from .studies.impact import impact_command
from .studies.particles import truth_command
from .studies.residuals import residuals_command
from .studies.size import size_command
from .surface import surface_command
from .sweep import sweep_command

app = typer.Typer(name="slcp", no_args_is_help=True, add_completion=False, rich_markup_mode=None)
app.command("scenes")(scenes_command)
app.command("simulate")(simulate_command)
app.command("optimise")(optimise_command)
app.command("library")(library_command)
app.command("sweep")(sweep_command)
app.command("size")(size_command)
app.command("chart")(chart_command)
app.command("quickstart")(quickstart_command)
app.command("study")(study_command)
app.command("truth")(truth_command)
app.command("car")(car_command)
app.command("grip")(grip_command)
app.command("impact")(impact_command)
app.command("residuals")(residuals_command)
app.command("surface")(surface_command)
app.add_typer(bench_app, name="bench")


def _print_version(wanted: bool) -> None:
    """Print the version and leave (called before any command runs)."""
    if wanted:
        typer.echo(f"slcp-warp {__version__}")
        raise typer.Exit


@app.callback()
def slcp(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Contact simulation, trajectory optimisation and robustness sweeps for small planar mechanisms."""
    wp.config.log_level = wp.LOG_WARNING
