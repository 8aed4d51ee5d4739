"""`slcp bench`: what a step, a Jacobian, a second core and a pass of DDP cost, as ratios measured in one run.

The workload is the flicking finger from random legal states under unit-normal torques, h = .05, called from
Python with NumPy arrays, copies included. Times are medians over repeats in which all cases take turns.

A step touches when its contact carries an impulse: MuJoCo's when the pair's distance is negative at the start
of the step, ours when the normal impulse is at least TOUCH. Touching states are timed on stretches of a
simulator's own rollouts in which every step touches.
"""

import functools
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.device import launch
from slcp_warp.options import CHOICES

from .benchmarks.accuracy.command import charts_command
from .benchmarks.cost.fallbacks import bench_fallbacks
from .benchmarks.cost.gradients import bench_gradients, bench_products
from .benchmarks.cost.kernels import SIZES, bench_reach, bench_sizes, print_sizes
from .benchmarks.cost.methods import bench_methods
from .benchmarks.cost.pair import PairError, bench_pair, print_pairs
from .benchmarks.derivatives.jacobians import bench_differences
from .benchmarks.derivatives.precision import bench_finite, bench_precision
from .benchmarks.fuzz.command import fuzz_command
from .benchmarks.peers.mujoco_model import Peer, import_mujoco
from .benchmarks.shared.ours import PAPER, TOUCH, WINDOW, Ours, cpu_threads
from .benchmarks.shared.timing import Case, Result, print_table, tidy_rows, time_interleaved
from .benchmarks.shared.workload import Workload, make_workload, windows
from .benchmarks.stability.command import stability_command
from .support.common import one_line_errors
from .support.tables import write_csv

DTYPES = ("float32", "float64")
Rows = list[dict[str, Any]]

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Measure what the simulator costs, beside MuJoCo's."
)
Worlds = Annotated[int, typer.Option(min=1, help="Worlds of the workload.")]
Steps = Annotated[int, typer.Option(min=WINDOW, help="Steps of each world.")]
Repeats = Annotated[int, typer.Option(min=1, help="Rounds; medians over them are reported.")]
Seed = Annotated[int, typer.Option(help="Seed of the states and torques.")]
Csv = Annotated[Path | None, typer.Option(help="Also write the results here, a row per case.")]


def _peer_windows(peer: Peer, work: Workload) -> tuple[Workload, float]:
    """MuJoCo's touching windows on the workload, and its share of touching steps."""
    states = np.concatenate([work.x0[:, None], peer.rollout(work)], axis=1)
    touching = peer.touching(states[:, :-1])
    return windows(states, work.controls, touching, WINDOW), float(touching.mean())


def _need_mujoco() -> None:
    """End the command with one line where the peer is not installed."""
    try:
        import_mujoco()
    except ModuleNotFoundError as error:
        typer.echo(f"slcp: {error}", err=True)
        raise typer.Exit(1) from None


def _finish(benchmark: str, unit: str, results: list[Result], notes: list[str], clock: str) -> Rows:
    print_table(f"{benchmark}: {clock}", unit, results, notes)
    return tidy_rows(benchmark, results, clock)


def _save(csv: Path | None, rows: Rows) -> None:
    if csv is not None:
        write_csv(csv, rows)
        typer.echo(f"wrote {csv}")


def bench_step(worlds: int = 2000, steps: int = 75, repeats: int = 9, seed: int = 0) -> Rows:
    """A step on one core beside MuJoCo's, over whole rollouts and over touching windows."""
    scene = slcp.scenes.flicking_finger()
    work = make_workload(scene, worlds, steps, seed)
    peer = Peer(scene)
    name, q = f"MuJoCo {peer.version}", work.x0[:200, : scene.nv]
    exact = Peer(scene, ccd_tolerance="1e-12").deviation(q)
    touching, share = _peer_windows(peer, work)
    whole, part = name, f"{name}, touching"
    cases = [
        Case(whole, lambda: peer.rollout(work), work.steps, facts={"touching_share": share}),
        Case(part, lambda: peer.rollout(touching), touching.steps, facts={"touching_share": 1.0}),
    ]
    notes = [
        f"MuJoCo's model differs from the scene by at most {exact.mass_matrix:.1e} of the mass matrix's "
        f"largest entry, {exact.distance:.1e} m in the distance",
        f"touching steps: {name} {share:.1%} (distance < 0); ours: normal impulse >= {TOUCH} N s",
    ]
    with cpu_threads(1):
        for residual in ("rem-logistic", "hard"):
            for dtype in DTYPES:
                ours = Ours(work, dtype, residual)
                label, share = f"{residual} {dtype}", float(ours.touching.mean())
                facts = {"dtype": dtype, "residual": residual, "failed_share": ours.failed}
                for suffix, part_of, touch, reference in (
                    ("", ours.work, share, whole),
                    (", touching", ours.touching_windows, 1.0, part),
                ):
                    run = functools.partial(ours.rollout, part_of)
                    facts = facts | {"touching_share": touch}
                    cases.append(Case(label + suffix, run, part_of.steps, reference, facts=facts))
                notes.append(
                    f"{label}: touching {share:.1%}, worlds not solved and left out {ours.failed:.1%}"
                )
        results = time_interleaved(cases, repeats)
    return _finish("step", "us per step", results, notes, "process CPU time, one thread")


def bench_jacobian(worlds: int = 1000, steps: int = 75, repeats: int = 9, seed: int = 0) -> Rows:
    """The Jacobian pair A, B at touching states, beside a step there and MuJoCo's finite differences."""
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    peer = Peer(slcp.scenes.flicking_finger())
    theirs, _ = _peer_windows(peer, work)
    x, u = theirs.x0[:1000], theirs.controls[:1000, 0]
    forward, centred = (f"MuJoCo {peer.version} {kind}" for kind in ("forward", "centred"))

    def set_states() -> None:
        for state, control in zip(x, u):
            peer.set_state(state, control)

    def differences(both_sides: bool) -> Case:
        label, reference = (centred, forward) if both_sides else (forward, None)
        run = functools.partial(peer.finite_differences, x, u, both_sides)
        return Case(label, run, len(x), reference, overhead=set_states)

    cases = [differences(False), differences(True)]
    with cpu_threads(1):
        for dtype in DTYPES:
            ours = Ours(work, dtype)
            touching = ours.touching_windows
            x0, u0 = touching.x0, np.ascontiguousarray(touching.controls[:, 0])
            linearize = functools.partial(ours.sim.linearize, x0, u0, ours.params)
            step = functools.partial(ours.rollout, touching)
            cases.append(Case(f"{dtype} step", step, touching.steps, facts={"dtype": dtype}))
            cases.append(Case(f"{dtype} A, B", linearize, len(x0), forward, facts={"dtype": dtype}))
        results = time_interleaved(cases, repeats)
    took = {r.case.name: r.seconds for r in results}
    notes = [f"{d}: A, B cost {np.median(took[f'{d} A, B'] / took[f'{d} step']):.2f} steps" for d in DTYPES]
    return _finish("jacobian", "us per call", results, notes, "touching, process CPU time, one thread")


def bench_threads(worlds: int = 20000, steps: int = 50, repeats: int = 9, seed: int = 0) -> Rows:
    """Wall time of a rollout on one core and on all of them."""
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    count = launch.thread_count()
    cases = []

    def run(ours: Ours, threads: int) -> None:
        with cpu_threads(threads):
            ours.rollout(ours.work)

    for dtype in DTYPES:
        ours = Ours(work, dtype)
        one = f"{dtype}, 1 thread"
        for label, threads, reference in ((one, 1, None), (f"{dtype}, {count} threads", count, one)):
            facts = {"dtype": dtype, "threads": threads}
            repeat = functools.partial(run, ours, threads)
            cases.append(Case(label, repeat, ours.work.steps, reference, facts=facts))
    results = time_interleaved(cases, repeats, clock=time.perf_counter)
    best = {r.case.name: r.seconds.min() for r in results}
    notes = []
    for dtype in DTYPES:
        gain = best[f"{dtype}, 1 thread"] / best[f"{dtype}, {count} threads"]
        notes.append(f"{dtype}: {gain:.2f} times as fast, best repeat against best repeat")
    return _finish("threads", "us per step", results, notes, "wall time")


def bench_ddp(repeats: int = 9, horizon: int = 75, passes: int = 30) -> Rows:
    """A pass of DDP from the canonical start: derivatives, backward pass, all step sizes, choice."""
    scene = slcp.scenes.flicking_finger()
    cases = []
    notes = [f"per problem and pass, from u = 0, N = {horizon}, {len(ddp.Options().step_sizes)} step sizes"]
    for dtype in DTYPES:
        sim = slcp.Simulator(scene, PAPER, device="cpu", dtype=dtype)
        problem = ddp.Problem(sim, ddp.costs.flicking_finger(), horizon=horizon, params=sim.params)
        for method in ("second-order", "gauss-newton"):
            options = ddp.Options(max_iterations=passes, method=method, gradient_tolerance=0.0)
            for batch in (1, 32):
                workspace = ddp.Workspace(problem, batch, options)
                run = functools.partial(workspace.run, scene.x0, np.zeros((horizon, sim.nu)))
                done = run()
                accepted = float((workspace.result(done).trace.step_size[0, :done] > 0.0).mean())
                facts = {"dtype": dtype, "method": method, "batch": batch, "horizon": horizon,
                         "step_sizes": len(options.step_sizes), "threads": launch.thread_count(),
                         "passes": done, "accepted_share": accepted}  # fmt: skip
                label = f"{dtype} {method}, batch of {batch}"
                cases.append(Case(label, run, done * batch, facts=facts))
                notes.append(f"{label}: {done} passes, {accepted:.0%} of them with an accepted step")
    results = time_interleaved(cases, repeats, clock=time.perf_counter)
    return _finish("ddp", "ms per pass", results, notes, f"wall time, {launch.thread_count()} threads")


app.command("charts")(charts_command)
app.command("stability")(one_line_errors(stability_command))
app.command("fuzz")(fuzz_command)


@app.command("step")
@one_line_errors
def step_command(
    worlds: Worlds = 2000, steps: Steps = 75, repeats: Repeats = 9, seed: Seed = 0, csv: Csv = None
) -> None:
    """A step on one core, beside MuJoCo's."""
    _need_mujoco()
    _save(csv, bench_step(worlds, steps, repeats, seed))


@app.command("jacobian")
@one_line_errors
def jacobian_command(
    worlds: Worlds = 1000, steps: Steps = 75, repeats: Repeats = 9, seed: Seed = 0, csv: Csv = None
) -> None:
    """A = df/dx and B = df/du at touching states, beside a step and MuJoCo's finite differences."""
    _need_mujoco()
    _save(csv, bench_jacobian(worlds, steps, repeats, seed))


@app.command("methods")
@one_line_errors
def methods_command(
    worlds: Worlds = 1000, steps: Steps = 75, repeats: Repeats = 5, seed: Seed = 0, csv: Csv = None
) -> None:
    """A step with every residual, friction model, integrator and noise, against the default."""
    _save(csv, bench_methods(worlds, steps, repeats, seed))


@app.command("gradients")
@one_line_errors
def gradients_command(
    worlds: Worlds = 4096,
    steps: Steps = 500,
    every: Annotated[int, typer.Option(min=1, help="Steps between checkpoints.")] = 22,
    repeats: Repeats = 3,
    seed: Seed = 0,
    csv: Csv = None,
) -> None:
    """Gradients of rollouts, with and without checkpoints: time against the rollout, and memory."""
    _save(csv, bench_gradients(worlds, steps, every, repeats, seed))


@app.command("differences")
@one_line_errors
def differences_command(
    scene: Annotated[list[str] | None, typer.Option(help="Only this scene; may be given again.")] = None,
    residual: Annotated[
        list[str] | None, typer.Option(help="Only this residual; may be given again.")
    ] = None,
    count: Annotated[int, typer.Option(min=8, help="States of each scene.")] = 64,
    seed: Seed = 0,
    csv: Csv = None,
) -> None:
    """Exact derivatives of a step against central differences, over the named scenes, in float64."""
    for name in scene or ():
        if name not in slcp.scenes.NAMED:
            typer.echo(f"slcp: --scene is {name!r}; choose from {sorted(slcp.scenes.NAMED)}", err=True)
            raise typer.Exit(2)
    chosen = tuple(residual or ("rem-logistic", "hard"))
    for name in chosen:
        if name not in CHOICES["residual"]:
            typer.echo(f"slcp: --residual is {name!r}; choose from {list(CHOICES['residual'])}", err=True)
            raise typer.Exit(2)
    names = tuple(scene or slcp.scenes.NAMED)
    _save(csv, bench_differences(names, chosen, count, seed, typer.echo))


@app.command("products")
@one_line_errors
def products_command(
    worlds: Worlds = 1000, steps: Steps = 50, repeats: Repeats = 5, seed: Seed = 0, csv: Csv = None
) -> None:
    """Vector-Jacobian and Jacobian-vector products, A and B, and weighted Hessians against a rollout."""
    _save(csv, bench_products(worlds, steps, repeats, seed))


@app.command("precision")
@one_line_errors
def precision_command(
    count: Annotated[int, typer.Option(min=8, help="States at which precisions are compared.")] = 20000,
    random: Annotated[int, typer.Option(min=1, help="States among which NaN and Inf are sought.")] = 1000000,
    seed: Seed = 0,
    csv: Csv = None,
) -> None:
    """Derivatives of the finger's step: float32 beside float64, and whether any is no number."""
    _save(csv, bench_precision(count, seed, typer.echo) + bench_finite(random, seed, typer.echo))


@app.command("fallbacks")
@one_line_errors
def fallbacks_command(worlds: Worlds = 32768, steps: Steps = 75, seed: Seed = 0, csv: Csv = None) -> None:
    """How many steps of the finger need more than the solver of few rows."""
    _save(csv, [row for dtype in DTYPES for row in bench_fallbacks(worlds, steps, seed, dtype, typer.echo)])


@app.command("threads")
@one_line_errors
def threads_command(
    worlds: Worlds = 20000, steps: Steps = 50, repeats: Repeats = 9, seed: Seed = 0, csv: Csv = None
) -> None:
    """A rollout on one core and on all of them."""
    _save(csv, bench_threads(worlds, steps, repeats, seed))


@app.command("ddp")
@one_line_errors
def ddp_command(repeats: Repeats = 9, csv: Csv = None) -> None:
    """A pass of DDP on the flicking finger."""
    _save(csv, bench_ddp(repeats))


@app.command("kernels")
@one_line_errors
def kernels_command(
    sizes: Annotated[str, typer.Option(help="Sizes nv x nc.")] = ",".join(f"{a}x{b}" for a, b in SIZES),
    repeats: Repeats = 3,
    gpu_code: Annotated[bool, typer.Option(help="Also compile for sm_90 and read the registers.")] = True,
    cache: Annotated[
        bool, typer.Option(help="Use compiled kernels; compile times then mean nothing.")
    ] = False,
    csv: Csv = None,
) -> None:
    """Registers, compile time and step time over the size of a scene, both strategies; rows out of reach."""
    try:
        chosen = tuple((int(a), int(b)) for a, b in (size.split("x") for size in sizes.split(",")))
    except ValueError:
        raise typer.BadParameter(f"--sizes is {sizes!r}; give sizes such as 3x4,6x12") from None
    with tempfile.TemporaryDirectory() as folder:
        if not cache:
            wp.config.kernel_cache_dir = folder
        rows = bench_sizes(chosen, repeats=repeats, gpu_code=gpu_code)
        print_sizes(rows)
        rows += bench_reach()
    _save(csv, rows)


@app.command("pair")
@one_line_errors
def pair_command(
    other: Annotated[str, typer.Argument(help="Python interpreter of the environment to compare with.")],
    repeats: Annotated[int, typer.Option(min=3, help="Rounds; a ratio is taken inside a round.")] = 15,
    case: Annotated[str | None, typer.Option(help="Only cases whose name contains this.")] = None,
    csv: Csv = None,
) -> None:
    """This version against the one of another environment, case by case in turn."""
    try:
        rows = bench_pair(other, repeats, case)
    except PairError as error:
        typer.echo(f"slcp: {error}", err=True)
        raise typer.Exit(1) from None
    print_pairs(rows)
    _save(csv, rows)


@app.command("all")
@one_line_errors
def all_command(repeats: Repeats = 9, seed: Seed = 0, csv: Csv = None) -> None:
    """Every benchmark, into one CSV."""
    _need_mujoco()
    rows = bench_step(repeats=repeats, seed=seed) + bench_jacobian(repeats=repeats, seed=seed)
    _save(csv, rows + bench_threads(repeats=repeats, seed=seed) + bench_ddp(repeats))
