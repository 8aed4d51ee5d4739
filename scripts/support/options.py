"""Options that several commands have."""

from typing import Annotated

import typer

import slcp_warp as slcp

NAMES = {"settings": "set", "residuals": "residuals"}  # of options that are called otherwise
DEFAULT_SCENE = next(iter(slcp.scenes.NAMED))
SceneName = Annotated[
    str,
    typer.Option(
        "--scene", help="A .toml, .json or .xml (MJCF) file, or: " + ", ".join(slcp.scenes.NAMED) + "."
    ),
]
Sigma = Annotated[float | None, typer.Option(help="Noise level of the smoothing; default: the scene's.")]
StepSize = Annotated[float | None, typer.Option("--step-size", help="h [s]; default: the scene's.")]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0, ...; default: the best one present.")]
Dtype = Annotated[str, typer.Option(help="float64 or float32.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="A parameter of the scene, name=value or name=v1,v2,.. (repeatable)."),
]
Start = Annotated[
    str | None,
    typer.Option(
        help="Initial state: q1,..,v1,.., or name=value,.. of some; default: the scene's (canonical) start."
    ),
]


def given_options(context: typer.Context) -> set[str]:
    """The parameters that are not at their defaults."""
    return {
        name
        for name in context.params
        if (source := context.get_parameter_source(name)) is not None and source.name != "DEFAULT"
    }


def refuse(context: typer.Context, options: set[str], what: str) -> None:
    """Raise ValueError where options are given that would do nothing.

    Args:
        options: names of parameters of the command.
        what: what they are of, "of a task".
    """
    if found := sorted(given_options(context) & options):
        named = " and ".join(f"--{NAMES.get(name, name).replace('_', '-')}" for name in found)
        raise ValueError(f"{named} {'is' if len(found) == 1 else 'are'} given, {what}")
