"""Given worlds of a task, step by step."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...inputs.times import nearest_steps
from ...measures.reductions import first_time
from ...options import Options
from ...parameters import Parameters
from ...results import Trajectory
from ...results.measured import RECORDED
from ...results.simulated import Simulated
from ...simulator import Simulator
from ...tasks.task import Task
from ..launch import Recorded
from ..tasks import case_of, judged_of
from ..worlds import Worlds
from ..worlds.draws import Given
from ..worlds.others import warn_of_others
from ..worlds.placed import placed
from .made_again import recorded, steps_told


def replay(
    task: Task,
    policy: Any,
    worlds: Worlds,
    *,
    record: Sequence[str] | str = (),
    case: Options | None = None,
    seed: int = 0,
    step_size: float | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
) -> Trajectory:
    """The states of given worlds in every step, as a sweep's own kernels make them: of those of its worlds
    that failed, `draw_worlds(task, ...)[failed]` with the sweep's seed, case, step size and precision.

    A world that is not solved, or that the task's failure ends, stands still from there on:
    `Trajectory.failures` says what overlaps in the state that has no next one. States are recorded in single
    precision of their distance from the start.

    Args:
        task: whose disturbances say when kicks are, what is pushed, and what is drawn in single steps.
        policy: as of a sweep.
        worlds: with their numbers, from which noise of single steps follows.
        record: any of "controls", as they acted (within limits, delayed, with noise), "impulse", "gap", as of
            `Simulator.rollout`, for `Trajectory.contacts` and measures; NaN from a step on that was not
            solved, and nothing acts where the world had ended. Impulses and gaps are those of every step made
            once more, which arrives where the sweep's did but for a thousandth of the world's velocities; one
            that leads elsewhere, as contact with several solutions may, has NaN for its impulses, and there
            is a RuntimeWarning. On a GPU a record takes the kernel without the fast path, whose states are
            those of the sweep to rounding.
        case: options of the steps; None: the task's.
        seed: of the noise of single steps.
        step_size: [s]; None: the one that the worlds have, or the scene's.
        dtype, device, strategy: as of a `Simulator`.

    Raises:
        ArgumentError: worlds with several step sizes, or of another shape than the task needs; a record of
            something else.
    """
    wanted = checks.names("record", record, RECORDED)
    checks.instance("task", task, Task, "a slcp_warp.Task")
    given = checks.instance("worlds", worlds, Worlds, "slcp_warp.Worlds").numpy()
    if not len(given):
        raise ArgumentError("worlds has none; at least one is needed")
    options = task.options if case is None else checks.instance("case", case, Options, "slcp_warp.Options")
    sizes = given.step_sizes(task.scene.step_size)
    if len(sizes) > 1:
        raise ArgumentError(f"worlds have {len(sizes)} step sizes; one is needed")
    h = sizes[0] if step_size is None else checks.number("step_size", step_size, 0.0, above=True)
    given = given.at_step_size(h)
    warn_of_others(task, given, 3)
    assert task.duration is not None
    sim = Simulator(task.scene, options, device=device, dtype=dtype, strategy=strategy)
    steps = nearest_steps("Task.duration", task.duration, h)
    each = sim.nx + len(wanted) * (sim.nx + sim.nu + 2 * sim.nr + 3 * len(task.scene.bodies))
    checks.memory("worlds: their states", len(given) * (steps + 1) * each, 8, sim.device)
    judged = judged_of(task)  # those of a sweep, whose kernels are shared
    draws = Given(sim, task, given, h)
    run = case_of(
        task, sim, policy, draws, judged, h, worlds=len(given), duration=steps * h,
        seed=checks.whole("seed", seed, 0), record=Recorded(tuple(range(sim.nx)), h),
    )  # fmt: skip
    told = steps_told(sim, len(given), steps) if wanted else None
    found = run.launch(0, len(given), told)
    begun = placed(sim, task.disturbances, draws.worlds(0, len(given))).numpy()
    states = begun.x0[:, None] + found["records"].astype(float)
    parameters = sim.params
    if given.params is not None:
        layout = sim.params.layout
        own = {
            name: given.params[:, start : start + int(np.prod(shape, dtype=int))].reshape(len(given), *shape)
            for name, start, shape in layout.columns
        }
        parameters = Parameters(sim.scene).replace(**own)
    shown: dict[str, Any] = {}
    if told is not None:
        numbers = np.arange(len(given)) if given.numbers is None else given.numbers
        found_again = recorded(sim, told.numpy(), found["unsolved_time"], h, parameters, wanted, numbers)
        shown = {name: found_again[name] for name in wanted}
    own_scene = Simulated.of(sim, parameters)
    made = None
    if task.failure is not None:
        ended = found["measures"][:, judged.index(first_time(task.failure))]
        made = np.where(np.isfinite(ended), np.minimum(np.round(ended / h) + 1, steps), steps).astype(int)
    return Trajectory(states, found["status"], simulated=own_scene, _measured=sim.gaps, _made=made, **shown)
