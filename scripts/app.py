"""The command table of `slcp`: each command is registered here and lives in a file of its own."""

import importlib
from typing import Annotated

import typer
import warp as wp

from slcp_warp import __version__

from .chart import chart_command
from .compile import compile_command
from .library import library_command
from .optimise import optimise_command
from .quickstart import quickstart_command
from .scenes import scenes_command
from .simulate import simulate_command
from .size import size_command
from .support.checkout import has_checkout, need_checkout
from .support.screen import one_line_errors
from .surface import surface_command
from .sweep import sweep_command

IN_CHECKOUTS = {  # commands that a wheel leaves out: room and name
    "study": ("studies.ddp", "study_command"),
    "truth": ("studies.particles", "truth_command"),
    "car": ("studies.car", "car_command"),
    "grip": ("studies.grip", "grip_command"),
    "impact": ("studies.impact", "impact_command"),
    "residuals": ("studies.residuals", "residuals_command"),
    "bench": ("benchmarks.commands", "app"),
}

app = typer.Typer(name="slcp", no_args_is_help=True, add_completion=False, rich_markup_mode=None)
app.command("scenes")(scenes_command)
app.command("compile")(compile_command)
app.command("simulate")(simulate_command)
app.command("optimise")(optimise_command)
app.command("library")(library_command)
app.command("sweep")(sweep_command)
app.command("size")(size_command)
app.command("surface")(surface_command)
app.command("chart")(chart_command)
app.command("quickstart")(quickstart_command)


@one_line_errors
def _elsewhere(context: typer.Context) -> None:
    """Only in a checkout of the project."""
    need_checkout(f"slcp {context.info_name}")


def _register(name: str, room: str, attribute: str) -> None:
    """Add a command of IN_CHECKOUTS, or one that says where it is."""
    if not has_checkout():
        anything = {"allow_extra_args": True, "ignore_unknown_options": True}
        app.command(name, context_settings=anything, add_help_option=False)(_elsewhere)
        return
    found = getattr(importlib.import_module(f".{room}", __package__), attribute)
    if isinstance(found, typer.Typer):
        app.add_typer(found, name=name)
    else:
        app.command(name)(found)


for _name, _place in IN_CHECKOUTS.items():
    _register(_name, *_place)


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
