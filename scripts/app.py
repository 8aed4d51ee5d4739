"""The command table of `slcp`: each command is registered here and lives in a file of its own."""

import importlib
from typing import Annotated, Any

import typer
import warp as wp

from slcp_warp import __version__

from .commands.chart import chart_command
from .commands.compare import compare_command
from .commands.compile import compile_command
from .commands.falsify import falsify_command
from .commands.identify import identify_command
from .commands.library import library_command
from .commands.map import map_command
from .commands.optimise import optimise_command
from .commands.rare import rare_command
from .commands.replay import replay_command
from .commands.scenes import scenes_command
from .commands.sensitivity import sensitivity_command
from .commands.simulate import simulate_command
from .commands.sweep import sweep_command
from .commands.tasks import tasks_command
from .commands.tune import tune_command
from .commands.watch import watch_command
from .paper.quickstart import quickstart_command
from .paper.size import size_command
from .paper.surface import surface_command
from .support.checkout import has_checkout, need_checkout
from .support.screen import one_line_errors

IN_CHECKOUTS = {  # commands of `slcp paper` and `slcp` that a wheel leaves out: room and name
    "study": ("studies.ddp", "study_command"),
    "truth": ("studies.particles", "truth_command"),
    "car": ("studies.car", "car_command"),
    "grip": ("studies.grip", "grip_command"),
    "impact": ("studies.impact", "impact_command"),
    "residuals": ("studies.residuals", "residuals_command"),
    "mpc": ("studies.online.mpc", "mpc_command"),
    "sensors": ("studies.online.sensors", "sensors_command"),
    "success": ("studies.online.arms", "arms_command"),
    "published": ("studies.published.command", "published_command"),
    "starts": ("studies.starts.command", "starts_command"),
    "schedules": ("studies.starts.schedules", "schedules_command"),
    "bench": ("benchmarks.commands", "app"),
    "gpu-check": ("benchmarks.gpu.command", "gpu_check_command"),
}
OUTSIDE = ("bench", "gpu-check")  # of IN_CHECKOUTS: beside `slcp paper`

app = typer.Typer(name="slcp", no_args_is_help=True, add_completion=False, rich_markup_mode=None)
paper = typer.Typer(
    help="The paper's experiment and studies, and those that go on from them.", no_args_is_help=True
)
app.add_typer(paper, name="paper")
app.command("tasks")(tasks_command)
app.command("scenes")(scenes_command)
app.command("compile")(compile_command)
app.command("simulate")(simulate_command)
app.command("optimise")(optimise_command)
app.command("library")(library_command)
app.command("sweep")(sweep_command)
app.command("replay")(replay_command)
app.command("compare")(compare_command)
app.command("sensitivity")(sensitivity_command)
app.command("map")(map_command)
app.command("tune")(tune_command)
app.command("identify")(identify_command)
app.command("rare")(rare_command)
app.command("falsify")(falsify_command)
app.command("chart")(chart_command)
app.command("watch")(watch_command)
app.command("quickstart")(quickstart_command)


@one_line_errors
def _elsewhere(context: typer.Context) -> None:
    """Only in a checkout of the project."""
    need_checkout(f"slcp {context.info_name}")


def _of_the_paper(name: str, command: Any, **settings: Any) -> None:
    """Add a command to `slcp paper`, and hidden below its former name."""
    paper.command(name, **settings)(command)
    app.command(name, hidden=True, **settings)(command)


def _register(name: str, room: str, attribute: str) -> None:
    """Add a command of IN_CHECKOUTS, or one that says where it is."""
    if not has_checkout():
        anything: dict[str, Any] = {
            "context_settings": {"allow_extra_args": True, "ignore_unknown_options": True}
        }
        if name in OUTSIDE:
            app.command(name, add_help_option=False, **anything)(_elsewhere)
        else:
            _of_the_paper(name, _elsewhere, add_help_option=False, **anything)
        return
    found = getattr(importlib.import_module(f".{room}", __package__), attribute)
    if isinstance(found, typer.Typer):
        app.add_typer(found, name=name)
    elif name in OUTSIDE:
        app.command(name)(found)
    else:
        _of_the_paper(name, found)


_of_the_paper("size", size_command)
_of_the_paper("surface", surface_command)
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
