"""Robustness sweeps of tasks: several policies in the same worlds, judged by the task's measures."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slcp_warp.kernels.device.cache import load_all
from slcp_warp.kernels.device.launch import thread_count

from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.times import nearest_steps
from ..measures.reductions import Measure, first_time
from ..measures.tables import priced
from ..options import Options, Status
from ..policies.linear import Linear
from ..simulator import Simulator
from ..stepping.arguments import at_step_size, checked_kernel
from ..stepping.host import acts_on_host
from ..tasks.disturbances import Disturbances
from ..tasks.task import Task
from .chunks import ARMS, Chunks, Part
from .launch import Case, Recorded, worlds_at_once
from .statistics.source import NOTED
from .worlds import Worlds
from .worlds.between import between, observed, steps_of
from .worlds.clocks import warn_of_steps
from .worlds.draws import Draws, Given, draws_of_task
from .worlds.loud import warn_of_noise

ALONE = "policy"  # name of a policy that has none


class TaskSweep:
    """A task in many disturbed worlds, the same under every policy, and from every start undisturbed.

    Attributes:
        task: what is run, disturbed and measured.
        policies: by name.
        seed: of all that is drawn; a world's numbers follow from it and the world's index.
        cases: options of the steps, by label.
        simulators: of the cases, by label.
        strategy: that was asked for.
        chunks: of the sweep; `run` makes the rows of one.
    """

    def __init__(
        self,
        task: Task,
        policies: Any,
        *,
        worlds: int | Worlds = 4096,
        seed: int = 0,
        cases: Any = None,
        step_sizes: Sequence[float] | None = None,
        dtype: str = "float32",
        device: Any = None,
        strategy: str = "auto",
        chunk: int | None = None,
        record: Sequence[str | int] = (),
        record_every: float = 0.5,
    ) -> None:
        """Args:
        policies: a policy, or policies by name; None: none, of a scene without controls.
        worlds: disturbed ones, a case and a policy; or the numbers of given ones.
        cases: options of the steps, one, several, or by name; None: the task's, and the hard problem.
        step_sizes: [s]; None: the scene's, or the one that all of the given worlds have.
        dtype, device, strategy: as of a `Simulator`.
        chunk: worlds a launch, default by memory; results do not depend on it.
        record: states whose way from the start is kept over time, in columns of their own.
        record_every: time between two records [s].

        A policy with numbers of every world's own (gains (B, nu, nx)) is for `worlds` of them; undisturbed
        each runs once, from the starts in turn.
        """
        self.task, self.policies, self.cases = (
            task,
            policies_by_name(policies, task),
            cases_by_name(task, cases),
        )
        self.given = worlds.numpy() if isinstance(worlds, Worlds) else None
        _check_numbers(self.given, self.policies)
        worlds, self.seed = _count(worlds), checks.whole("seed", seed, 0)
        chunk = None if chunk is None else checks.whole("chunk", chunk)
        sizes, self.strategy = _step_sizes(task, step_sizes, self.given), strategy
        assert task.duration is not None
        for size in sizes:
            steps_of(task.disturbances, size)
            task.disturbances.check_kicks(size, task.duration)
        self._judged = judged_of(task)
        for size in sizes if priced(self._judged) else ():  # before the first world runs
            task.cost.in_steps_of(size)  # times that steps of it do not have
            if size != task.scene.step_size:
                why = f"step_sizes asks for {size:g} s, and measures.cost() is of a plan of other steps"
                task.cost.check_moves(2 * task.scene.nv, task.scene.nu, why)
        self.simulators = {
            label: Simulator(task.scene, options, device=device, dtype=dtype, strategy=strategy)
            for label, options in self.cases.items()
        }
        if isinstance(policies, Mapping):
            _check_kernels(task, self.policies, next(iter(self.simulators.values())), sizes[0])
        for name, policy in self.policies.items():
            warn_of_noise(name, policy_of(task, policy), task)
            warn_of_steps(name, policy_of(task, policy), task, sizes, next(iter(self.simulators.values())))
        self.record = Recorded.of(task.scene, record, record_every, task.duration)
        records = self.record.count(task.duration), len(self.record.states)
        parts = []
        for label, size, name in itertools.product(self.cases, sizes, self.policies):
            kept = records, len(self._judged), task.disturbances.numbers(task.scene.nv)
            checks.memory(
                "record_every: a world's records", records[0] * records[1], 4, self.simulators[label].device
            )
            at_once = chunk or worlds_at_once(self.simulators[label], *kept)
            for arm, count in zip(ARMS, (worlds, _undisturbed(task, self.policies[name]))):
                parts.append(Part(name, label, size, arm, count, min(at_once, count)))
        self.chunks = Chunks(parts)
        self._case: tuple[Part | None, Any] = None, None
        self._compiled = False

    def cut(self, at_once: Sequence[int]) -> None:
        """Cut every part into chunks of so many worlds instead."""
        parts = zip(self.chunks.parts, at_once, strict=True)
        self.chunks = Chunks([part._replace(at_once=n) for part, n in parts])

    def run(self, index: int) -> dict[str, np.ndarray]:
        """The rows of chunk `index`: world, what was drawn, measures, success, status, records.

        A world that was not solved has NaN for its measures, and is no success.
        """
        return self.rows(*self.chunks[index])

    def rows(self, part: Part, world0: int, count: int) -> dict[str, np.ndarray]:
        """The rows of worlds world0, world0 + 1, ... of a part, as `run` gives them."""
        found = self.found(part, world0, count)
        recorded = self.record.columns(self.task.scene, found["records"])
        numbers = np.arange(world0, world0 + len(found["status"]))
        return columns_of(self.task, self._judged, found, numbers) | recorded

    def found(self, part: Part, world0: int, count: int) -> dict[str, np.ndarray]:
        """What `Case.launch` leaves of worlds world0, world0 + 1, ... of a part."""
        self._compile()
        if self._case[0] != part:
            self._case = part, self._case_of(part)
        found: dict[str, np.ndarray] = self._case[1].launch(world0, count)
        return found

    def _compile(self) -> None:
        """Compile the kernels of all policies and cases before the first chunk, several at once."""
        parts = {(part.policy, part.case, part.arm): part for part in reversed(self.chunks.parts)}
        if self._compiled or len(parts) <= len(ARMS):  # of one policy and case: whoever launches them does it
            return
        self._compiled = True
        kernels = [self._case_of(part).kernel for part in parts.values()]
        device = next(iter(self.simulators.values())).device
        load_all([kernel for kernel in kernels if kernel is not None], device, thread_count())

    def draws(self, part: Part) -> Draws | Given:
        """What the worlds of a part are drawn from."""
        sim, disturbed = self.simulators[part.case], part.arm == ARMS[0]
        if self.given is not None and disturbed:
            return Given(sim, self.task, self.given.at_step_size(part.step_size), part.step_size)
        d = self.task.disturbances if disturbed else Disturbances()
        return draws_of_task(sim, self.task, d, self.seed, part.step_size)

    def _case_of(self, part: Part) -> Case:
        return case_of(
            self.task, self.simulators[part.case], self.policies[part.policy], self.draws(part), self._judged,
            part.step_size, worlds=part.worlds, chunk=part.at_once, seed=self.seed,
            quiet=part.arm != ARMS[0], record=self.record,
        )  # fmt: skip


def judged_of(task: Task) -> list[Measure]:
    """What worlds are measured by: the task's measures, those of its success, and when a failure comes."""
    judged: list[Measure] = list(task.measures.values())
    judged += [] if task.success is None else task.success.parts()
    return judged + ([] if task.failure is None else [first_time(task.failure)])


def case_of(
    task: Task, sim: Simulator, policy: Any, draws: Draws | Given, judged: Sequence[Measure],
    step_size: float, *, seed: int = 0, quiet: bool = False, duration: float | None = None, **choices: Any,
) -> Case:  # fmt: skip
    """The worlds of `draws` under a policy, with all that a task has around it.

    Args:
        judged: measures, with those of the task's success, and of its failure the first time.
        step_size: [s].
        quiet: without what the task's disturbances put between the policy and its world.
        duration: of the run [s]; None: the task's.
        choices: of a `Case`: worlds, chunk, record.
    """
    policy = policy_of(task, policy)
    policy = between(at_step_size(policy, step_size), task, seed, step_size, quiet)
    failure = None if task.failure is None else first_time(task.failure)
    span = task.duration if duration is None else duration
    assert span is not None
    return Case(
        sim, policy, draws, step_size, span, seed=seed, measures=judged, limits=task.control_limits,
        failure=failure, cost=task.cost, **choices,
    )  # fmt: skip


def _count(worlds: Any) -> int:
    return len(worlds) if isinstance(worlds, Worlds) else checks.whole("worlds", worlds)


def _check_numbers(given: Worlds | None, policies: Mapping[str, Any]) -> None:
    """Raise ArgumentError where a policy has nothing for a given world's number."""
    if given is None or given.numbers is None:
        return
    last = int(np.max(given.numbers, initial=0))
    for name, policy in policies.items():
        own = checks.attribute(policy, "worlds")
        if isinstance(own, int) and 1 < own <= last:
            raise ArgumentError(
                f"policy {name!r} is for worlds 0 to {own - 1}; Worlds.numbers holds {last} "
                "(a policy of every world's own is asked by number)"
            )


def _check_kernels(task: Task, policies: Mapping[str, Any], sim: Simulator, step_size: float) -> None:
    """Raise an error with a policy's name for one that the scene cannot have, before the first world runs."""
    for name, policy in policies.items():
        try:
            policy = observed(at_step_size(policy_of(task, policy), step_size), task)
            if not acts_on_host(policy):
                checked_kernel(policy, sim)
        except (ArgumentError, ArgumentTypeError) as error:
            alone = list(policies) == [ALONE]
            raise type(error)(str(error) if alone else f"policies[{name!r}]: {error}") from error


def _undisturbed(task: Task, policy: Any) -> int:
    """Undisturbed worlds: one for every start, or for all that a policy has of every world's own."""
    own = checks.attribute(policy, "worlds")
    return own if isinstance(own, int) and own > 1 else len(task.start)


def _step_sizes(task: Task, given: Any, worlds: Worlds | None) -> tuple[float, ...]:
    """Step sizes of a sweep; of given worlds those that they have, if they have one."""
    own = (task.scene.step_size,) if worlds is None else worlds.step_sizes(task.scene.step_size)
    if given is None:
        return own if len(own) == 1 else (task.scene.step_size,)
    if len(own) > 1:
        raise ArgumentError(
            f"step_sizes is {shown(given)}; the given worlds make steps of their own, of {min(own):g} to "
            f"{max(own):g} s"
        )
    if not isinstance(given, list | tuple | np.ndarray) or not len(given):
        raise ArgumentError(f"step_sizes is {shown(given)}; at least one, in a tuple, is needed")
    assert task.duration is not None
    sizes = tuple(checks.number("step_sizes", h, 0.0, above=True) for h in given)
    for size in sizes:
        nearest_steps("Task.duration", task.duration, size, "step_sizes")
    if len(set(sizes)) < len(sizes):
        raise ArgumentError(f"step_sizes is {shown(given)}; each of them once is needed")
    return sizes


def columns_of(
    task: Task, judged: list[Measure], found: dict[str, np.ndarray], numbers: np.ndarray
) -> dict[str, np.ndarray]:
    """Number (B,), what was drawn, measures, success and status of worlds, from what `Case.launch` found."""
    values = found["measures"]
    own = {measure: values[:, j] for j, measure in enumerate(judged)}
    solved = found["status"] == Status.SOLVED
    success = succeeded(task, own, found["status"])
    ended = {}
    if task.failure is not None:
        ended["failure_time"] = np.where(solved, own[first_time(task.failure)], np.nan)
    columns = {name: array for name, array in found.items() if name.startswith("drawn_")}
    columns |= {name: np.where(solved, values[:, j], np.nan) for j, name in enumerate(task.measures)}
    return {
        "world": numbers,
        **columns,
        **ended,
        **{name: found[name] for name in NOTED},
        "success": success,
        "status": found["status"],
    }


def succeeded(task: Task, values: Mapping[Measure, np.ndarray], status: np.ndarray) -> np.ndarray:
    """Which worlds (B,) were solved, succeeded and met no failure, by their measures' values and statuses."""
    success = status == Status.SOLVED
    if task.success is not None:
        success = success & task.success.holds(dict(values))
    if task.failure is not None:
        success = success & ~np.isfinite(values[first_time(task.failure)])
    return success


def policy_of(task: Task, policy: Any) -> Any:
    """A policy; where None is given, that of a scene without controls.

    Raises:
        ArgumentError: None is given, and the scene has controls.
    """
    if policy is not None:
        return policy
    scene = task.scene
    if scene.nu:
        raise ArgumentError(
            f"policy is None; scene {scene.name!r} has the controls {', '.join(scene.control_names)}: give a "
            "policy"
        )
    return Linear(np.zeros((0, 2 * scene.nv)), scene.x0, [])


def policies_by_name(policies: Any, task: Task) -> dict[str, Any]:
    """Policies by name; one alone is named `ALONE`, none "none"."""
    if isinstance(policies, Mapping):
        if not policies or not all(isinstance(name, str) and name for name in policies):
            raise ArgumentError(f"policies is {shown(policies)}; at least one, by name, is needed")
        return dict(policies)
    return {ALONE if policies is not None else "none": policy_of(task, policies)}


def cases_by_name(task: Task, cases: Any) -> dict[str, Options]:
    """Options by name: what differs from the task's, or their residual."""
    if cases is None:
        hard = task.options.with_residual("hard")
        cases = [task.options] if task.options.hard else [task.options, hard]
    if isinstance(cases, Mapping):
        found = dict(cases)
    else:
        given = [cases] if isinstance(cases, Options) else cases
        if not isinstance(given, list | tuple) or not all(isinstance(each, Options) for each in given):
            raise ArgumentTypeError(f"cases is {shown(cases)}; slcp_warp.Options, one or several, are needed")
        if any(each in given[:i] for i, each in enumerate(given)):
            raise ArgumentError(f"cases is {shown(cases)}; each of them once is needed")
        found = {}
        for each in given:
            label = each.residual + ("" if each.friction == "anitescu" else f", {each.friction}")
            label += "" if each.gap == "start" else f", gap {each.gap}"
            label += "" if each.integrator == "euler" else f", {each.integrator}"
            found[label if label not in found else f"{label} {len(found) + 1}"] = each
    named = all(isinstance(name, str) and name for name in found)
    if not found or not named or not all(isinstance(each, Options) for each in found.values()):
        raise ArgumentTypeError(f"cases is {shown(cases)}; slcp_warp.Options by name are needed")
    return found
