"""`slcp identify`: a mechanism's numbers from logs."""

from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.policies import KalmanFilter
from slcp_warp.storage.python import python_name
from slcp_warp.storage.rows import save_rows

from ..support.options import DEFAULT_SCENE, Device, SceneName, Seed, Settings, Start, StepSize
from ..support.policies import of_python
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.simulators import make_params, make_simulator, named_scene, parse_settings, start_state

HEAD = ("name", "value", "low", "high", "deviation_left")


@one_line_errors
@with_rules
def identify_command(
    logs: Annotated[list[Path], typer.Argument(help="Tables, .csv: time, sensors and controls by name.")],
    sensor: Annotated[
        list[str],
        typer.Option(
            help="name=standard deviation, of a measured state; or file.py:name, a dict of sensors."
        ),
    ],
    process: Annotated[
        float, typer.Option(help="By which velocities stray from the model in a second, about.")
    ],
    parameter: Annotated[
        list[str] | None,
        typer.Option(help="name=deviation of its logarithm, or name=low:high; the same for all it names."),
    ] = None,
    bias: Annotated[list[str] | None, typer.Option(help="name=standard deviation, of a sensor.")] = None,
    start_spread: Annotated[
        list[str] | None, typer.Option(help="name=standard deviation, of a state at the start of a log.")
    ] = None,
    scene: SceneName = DEFAULT_SCENE,
    start: Start = None,
    process_noise: Annotated[
        float, typer.Option(help="Standard deviation of the logarithm of a factor on --process.")
    ] = 1.0,
    sensor_noise: Annotated[float, typer.Option(help="The same of every sensor's.")] = 0.0,
    tied: Annotated[
        bool, typer.Option(help="Mass and inertia of a body are one number where both are looked for.")
    ] = True,
    judge: Annotated[list[Path] | None, typer.Option(help="A log that is kept back, to judge by.")] = None,
    rules: OneRule = NO_RULE,
    step_size: StepSize = None,
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    out: Annotated[Path, typer.Option(help="Table of the numbers, .csv.")] = Path("identified.csv"),
) -> None:
    """Find numbers of a mechanism, and how well they are known, from logs of sensors and controls."""
    path = prepared(out, ".csv")
    sim = make_simulator(named_scene(scene), rules, device)
    x0 = None if start is None else start_state(sim.scene, start, sim.scene.x0)
    filter = KalmanFilter(
        sim, _sensors(sensor), process, parse_settings(start_spread, "--start-spread"), x0,
        make_params(sim, step_size, None, settings),
    )  # fmt: skip
    measured, controls = zip(*(slcp.load_log(log, filter) for log in logs))
    kept = [slcp.load_log(log, filter) for log in judge or []]
    with timed("search"), progress_bar("rounds") as progress:
        found = slcp.identify(
            filter, list(measured), list(controls), dict(map(_law, parameter or [])),
            bias=parse_settings(bias, "--bias"), process_noise=process_noise, sensor_noise=sensor_noise,
            tied=tied, seed=seed, progress=progress,
        )  # fmt: skip
    rows = [(name, *value, found.learned[name]) for name, value in found.values.items()]
    save_rows(path, HEAD, rows)
    console.print(str(found), markup=False, highlight=False)
    for log, (seen, us) in zip(judge or [], kept):
        _tell(log, found.judge([seen], [us]))
    wrote(path)


def _tell(log: Path, fit: Any) -> None:
    """How well a log that was kept back is explained."""
    text = f"{log}: off by {fit.rms:.3g} of the deviations that are foretold, {100.0 * fit.beyond:.2g} %"
    console.print(f"{text} beyond three", markup=False, highlight=False)
    for line in fit.told():
        console.print(f"  ! {line}", markup=False, highlight=False)


def _sensors(given: list[str]) -> dict[str, Any]:
    """Sensors by name, of "name=sd" and of "file.py:name"."""
    found: dict[str, Any] = parse_settings([each for each in given if not of_python(each)], "--sensor")
    for each in filter(of_python, given):
        file, _, name = each.rpartition(":")
        sensors, _ = python_name(Path(file), name)
        if not isinstance(sensors, dict):
            raise ValueError(f"--sensor: {name!r} of {file} is a {type(sensors).__name__}; a dict is needed")
        if twice := found.keys() & sensors.keys():
            raise ValueError(
                f"--sensor: {', '.join(sorted(twice))} is given twice; one sensor of a name is needed"
            )
        found |= sensors
    return found


def _law(text: str) -> tuple[str, slcp.LogNormal | slcp.Uniform]:
    """What is known before of --parameter, of "name=sd" or "name=low:high"."""
    name, _, value = text.partition("=")
    try:
        given = [float(each) for each in value.split(":")]
    except ValueError:
        given = []
    if len(given) not in (1, 2):
        raise ValueError(f"--parameter is {text!r:.60}; name=deviation or name=low:high is needed")
    if len(given) == 1:
        return name, slcp.LogNormal(given[0], shared=True)
    return name, slcp.Uniform(given[0], given[1], shared=True)
