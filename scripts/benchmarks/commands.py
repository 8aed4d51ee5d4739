"""`slcp bench`: what a step, a Jacobian, a second core and a pass of DDP cost, as ratios measured in one run.

The workload is the flicking finger from random legal states under unit-normal torques, h = .05, called from
Python with NumPy arrays, copies included. Times are medians over repeats in which all cases take turns.
"""

import tempfile
from pathlib import Path
from typing import Annotated

import typer
import warp as wp

import slcp_warp as slcp
from slcp_warp.options import CHOICES
from slcp_warp.scenes.registry import NAMED

from ..support.options import Dtype, SceneName
from ..support.paper import SCENE
from ..support.screen import one_line_errors, show_rows
from ..support.simulators import named_scene, numbers
from ..support.tables import write_csv
from ..support.tasks import DEFAULT
from .accuracy.command import charts_command
from .contacts.command import contacts_command
from .contacts.strategies import bench_strategies, print_strategies
from .cost.chunks import bench_chunks
from .cost.compile import bench_compile
from .cost.ddp import bench_ddp
from .cost.fallbacks import bench_fallbacks
from .cost.gradients import bench_gradients, bench_libraries, bench_products
from .cost.jacobian import bench_jacobian, bench_stack_jacobian
from .cost.kept import bench_kept
from .cost.kernels import SIZES, bench_reach, bench_sizes, print_sizes
from .cost.latency import bench_latency
from .cost.methods import bench_methods
from .cost.pair import PairError, bench_pair, print_pairs
from .cost.policies import bench_policies
from .cost.statistics import bench_statistics
from .cost.step import bench_step
from .cost.threads import bench_threads
from .cost.watch import bench_watch
from .derivatives.jacobians import bench_differences
from .derivatives.precision import bench_finite, bench_precision
from .fuzz.command import fuzz_command
from .peers.mujoco_model import import_mujoco
from .shared.ours import DTYPES, WINDOW
from .shared.timing import Rows
from .stability.command import stability_command
from .stability.kills import kills_command

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Measure what the simulator costs, beside MuJoCo's."
)
Worlds = Annotated[int, typer.Option(min=1, help="Worlds of the workload.")]
Steps = Annotated[int, typer.Option(min=WINDOW, help="Steps of each world.")]
Repeats = Annotated[int, typer.Option(min=1, help="Rounds; medians over them are reported.")]
Seed = Annotated[int, typer.Option(help="Seed of the states and torques.")]
Csv = Annotated[Path | None, typer.Option(help="Also write the results here, a row per case.")]


def _need_mujoco() -> None:
    """End the command with one line where the peer is not installed."""
    try:
        import_mujoco()
    except ModuleNotFoundError as error:
        typer.echo(f"slcp: {error}", err=True)
        raise typer.Exit(1) from None


def _save(csv: Path | None, rows: Rows) -> None:
    if csv is not None:
        write_csv(csv, rows)
        typer.echo(f"wrote {csv}")


app.command("charts")(charts_command)
app.command("contacts")(one_line_errors(contacts_command))
app.command("stability")(one_line_errors(stability_command))
app.command("fuzz")(fuzz_command)
app.command("kills")(kills_command)


@app.command("kept")
@one_line_errors
def kept_command(
    policy: Annotated[Path, typer.Option(help="File of `slcp library`.")],
    worlds: Worlds = 40960,
    chunk: Annotated[int, typer.Option(min=1, help="Worlds of a chunk.")] = 2048,
    csv: Csv = None,
) -> None:
    """What keeping a sweep in a folder costs, beside its launches."""
    _save(csv, bench_kept(policy, worlds, chunk))


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
    worlds: Worlds = 1000,
    steps: Steps = 75,
    repeats: Repeats = 9,
    seed: Seed = 0,
    stack: Annotated[
        list[int] | None, typer.Option(min=1, help="Of stacks of so many boxes instead; may be given again.")
    ] = None,
    csv: Csv = None,
) -> None:
    """A = df/dx and B = df/du at touching states, beside a step and MuJoCo's finite differences."""
    if stack:
        _save(csv, bench_stack_jacobian(tuple(stack), repeats, seed))
        return
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


@app.command("libraries")
@one_line_errors
def libraries_command(
    worlds: Worlds = 4096,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each world.")] = 1,
    repeats: Repeats = 21,
    seed: Seed = 0,
    csv: Csv = None,
) -> None:
    """A rollout and its gradient from NumPy, PyTorch and JAX, whichever are installed."""
    _save(csv, bench_libraries(worlds, steps, repeats, seed))


@app.command("policies")
@one_line_errors
def policies_command(
    worlds: Worlds = 4096, steps: Steps = 500, repeats: Repeats = 5, seed: Seed = 0, csv: Csv = None
) -> None:
    """Sweeps under a user's function and networks against linear feedback."""
    _save(csv, bench_policies(worlds, steps, repeats, seed))


@app.command("watch")
@one_line_errors
def watch_command(
    task: Annotated[str, typer.Argument(metavar="TASK", help="As of `slcp watch`.")],
    policy: Annotated[str | None, typer.Option(help="As of `slcp watch`.")] = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="Left alone, and dragged.")] = 20.0,
    minutes: Annotated[float, typer.Option(min=0.1, help="Left alone after that.")] = 1.0,
    every: Annotated[float, typer.Option(min=0.1, help="Minutes of a row of that.")] = 5.0,
    csv: Csv = None,
) -> None:
    """The page's server: pictures a second, load, memory, delay from a move to its picture."""
    _save(csv, bench_watch(task, policy, seconds, minutes, every))


@app.command("latency")
@one_line_errors
def latency_command(
    task: Annotated[str, typer.Option(help="A name of `slcp tasks`, a file, or file.py:name.")] = DEFAULT,
    library: Annotated[
        Path | None, typer.Option(help="Of `slcp library`, whose plan is a second start of every cycle.")
    ] = None,
    passes: Annotated[int, typer.Option(min=1, help="Of DDP a cycle.")] = 2,
    cycles: Annotated[int, typer.Option(min=1, help="Measured cycles.")] = 10000,
    method: Annotated[str | None, typer.Option(help="Of DDP; else what MPC takes by itself.")] = None,
    dtype: Dtype = "float64",
    seed: Seed = 0,
    csv: Csv = None,
) -> None:
    """From a state to the controls: one cycle of MPC of one world, its slowest ones too."""
    _save(csv, bench_latency(task, library, passes, cycles, method, dtype, seed))


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


@app.command("statistics")
@one_line_errors
def statistics_command(
    sizes: Annotated[str, typer.Option(help="Worlds n1,n2,.. of a part.")] = "10000,1000000,10000000",
    csv: Csv = None,
) -> None:
    """What summaries, quantiles, comparisons and sensitivities of a sweep cost, and what memory they take."""
    _save(csv, bench_statistics([int(n) for n in numbers(sizes, "--sizes")]))


@app.command("chunks")
@one_line_errors
def chunks_command(
    count: Annotated[int, typer.Option(min=1, help="Chunks of every size.")] = 50,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    csv: Csv = None,
) -> None:
    """What a chunk of a run on disk costs beside its rows."""
    rows = bench_chunks(count=count, workers=workers)
    shown = ("rows", "kB", "CPU [ms]", "wall [ms]", "check [ms]", f"a worker of {workers} [ms]")
    show_rows("a chunk, less its columns", [{name: row[name] for name in shown} for row in rows])
    if csv is not None:
        write_csv(csv, rows)


@app.command("threads")
@one_line_errors
def threads_command(
    worlds: Worlds = 20000, steps: Steps = 50, repeats: Repeats = 9, seed: Seed = 0, csv: Csv = None
) -> None:
    """A rollout on one core and on all of them."""
    _save(csv, bench_threads(worlds, steps, repeats, seed))


@app.command("compile")
@one_line_errors
def compile_command(scene: SceneName = SCENE, dtype: Dtype = "float64", csv: Csv = None) -> None:
    """Where the CPU time of a cold compile goes: the package, Warp's translation, clang."""
    _save(csv, bench_compile(named_scene(scene), dtype))


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
    scene: Annotated[
        list[str] | None, typer.Option(help="Named scenes instead, under every law; 'all' for all of them.")
    ] = None,
    csv: Csv = None,
) -> None:
    """Registers, compile time and step time over the size of a scene, both strategies; rows out of reach."""
    if scene:
        chosen_scenes = [] if scene == ["all"] else scene
        if unknown := [name for name in chosen_scenes if name not in NAMED]:
            raise typer.BadParameter(f"--scene is {unknown[0]!r}; choose from {', '.join(NAMED)}, all")
        rows = bench_strategies(chosen_scenes, repeats=repeats)
        print_strategies(rows)
        _save(csv, rows)
        return
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
