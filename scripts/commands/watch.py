"""`slcp watch`: a mechanism in the browser, to look at and to pull at."""

import asyncio
import threading
import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.ensembles.worlds.nominal import nominal
from slcp_warp.storage.archive import open_archive
from slcp_warp.storage.files import FileError, reading

from ..support.options import Device, refuse
from ..support.policies import POLICY, named_policies
from ..support.rules import NO_RULES, RULES, Rules, with_rules
from ..support.screen import INTERRUPTED, checked_folder, console, one_line_errors
from ..support.simulators import default_scaling, named_scene
from ..support.tasks import found_task
from ..watch.engine import Engine
from ..watch.player import Player
from ..watch.record import FORMAT, Replay
from ..watch.run import Run
from ..watch.scenario import buttons_of
from ..watch.world import Subject

OF_TASKS = {"policy", "worlds", "seed", "scenario", "out", *RULES}  # options of no use to a recorded run


@one_line_errors
@with_rules
def watch_command(
    context: typer.Context,
    what: Annotated[
        str | None,
        typer.Argument(metavar="TASK", help="A task or a scene: a name, a file, or file.py:name."),
    ] = None,
    policy: Annotated[list[str] | None, typer.Option(help=f"{POLICY}; several to choose from.")] = None,
    worlds: Annotated[int, typer.Option(min=1, max=64, help="Worlds side by side.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of further starts, of kicks and pushes.")] = 0,
    scenario: Annotated[
        list[str] | None, typer.Option(help="Task whose kicks and pushes are buttons, as of `slcp falsify`.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of what is recorded.")] = Path("."),
    replay: Annotated[Path | None, typer.Option(help="Show a record or a trajectory instead.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="On the loopback; 0: any.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page.")] = True,
    rules: Rules = NO_RULES,
    device: Device = None,
) -> None:
    """Watch a task's mechanism in the browser, in real time, and pull at its bodies with the mouse."""
    from ..watch.server import PageServer  # it needs the extra `watch`

    if (what is None) == (replay is None):
        raise ValueError("a TASK to watch, or --replay FILE, is needed, and not both")
    engine: Engine
    if replay is not None:
        refuse(context, OF_TASKS, "of a TASK, not of --replay")
        engine = Player(shown(replay), device)
    else:
        assert what is not None
        checked_folder(out)
        subject = watched(what, worlds, seed, rules)
        policies = named_policies(policy or [], subject.scene, subject.task)
        if subject.task is not None:
            h = subject.scene.step_size
            policies = {name: nominal(each, subject.task, h) for name, each in policies.items()}
        out.mkdir(parents=True, exist_ok=True)
        pushes = {} if subject.task is None else buttons_of(subject.task, seed=seed)
        for each in map(slcp.load_task, scenario or []):
            if each.scene.structure != subject.scene.structure:
                raise ValueError(f"--scenario is task {each.name!r}, of another mechanism than {what}")
            pushes |= buttons_of(each, each.name, seed)
        engine = Engine(subject, policies, out, pushes, device)
    engine.prepare()
    server = PageServer(engine, port)
    try:
        asyncio.run(_serve(server, browser))
    except KeyboardInterrupt:  # how it ends; what was being recorded is on disk by now
        raise typer.Exit(INTERRUPTED) from None


def shown(path: Path) -> Replay | Run:
    """A file's record, or its trajectory."""
    with reading(path, "a watched run or a trajectory", FileError), open_archive(path) as archive:
        kind = archive.header.get("format")
    return Replay(path) if kind == FORMAT else Run(path)


async def _serve(server: Any, browser: bool) -> None:
    started = threading.Event()
    serving = asyncio.create_task(server.run(started))
    while not started.is_set() and not serving.done():
        await asyncio.sleep(0.01)
    if not serving.done():
        console.print(f"{server.address}\n[dim]Ctrl-C ends it[/dim]")
        if browser and not webbrowser.open(server.address):
            console.print("[dim]no browser could be opened: open the address in one on this machine[/dim]")
    await serving


def watched(name: str, worlds: int, seed: int, rules: Rules = NO_RULES) -> Subject:
    """What a name or a file says: a task, or a scene at its start."""
    task = found_task(name)
    if task is not None:
        return Subject.of(task, worlds, seed, rules)
    scene = named_scene(name, "TASK")
    options = slcp.Options(scaling=default_scaling(scene))
    start = scene.x0[None].repeat(worlds, axis=0)
    return Subject(scene.name, scene, options, start, rules=rules)
