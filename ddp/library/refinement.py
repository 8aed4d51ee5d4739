"""Growing a library where its own controller stands still.

A chain of plans visits its own limit cycle, not the states that the nearest-neighbour rule (20) leads to:
between entries there are states in which the controller waits for ever, and whether a chain happens to cover
them is luck. Here the library is rolled out from kicked states, the worlds that get nowhere are found, and
new chains start in them.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import Parameters, Simulator
from slcp_warp.inputs.checks import array, function, instance, number, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.runs.sequence import step_of
from slcp_warp.runs.store import Store

from ..problem import Problem
from .kept import kept_rounds
from .library import Library, concatenate
from .receding import build_library
from .receding_options import RecedingOptions

SHIFTS = 5  # plans of every new chain
FIRST_SHARE = 0.375  # of the plans, before the first round
WORLDS, SECONDS, WINDOW = 256, 15.0, 5.0  # of a test rollout; its last seconds are judged


def turning(component: int) -> Callable[[np.ndarray], np.ndarray]:
    """Score of trajectories (B, T, nx): how far a state component advances."""
    component = whole("component", component, 0)
    return lambda states: states[:, -1, component] - states[:, 0, component]


def stuck_states(
    library: Library,
    sim: Simulator,
    score: Callable[[np.ndarray], np.ndarray],
    count: int,
    seed: int,
    velocity_sd: float = 2.0,
    params: Any = None,
) -> np.ndarray:
    """States (count, nx) in which worlds under the library's policy get nowhere, the worst worlds first.

    Args:
        library: whose policy is tried.
        sim: what it is tried on.
        score: of the last WINDOW seconds, (B, T, nx) -> (B,); larger is better.
        count: of states.
        seed: of the kicks at the start.
        velocity_sd: their standard deviation.
        params: of the rollout.
    """
    instance("library", library, Library, "a ddp.Library")
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    function("score", score, 1)
    count, velocity_sd = whole("count", count), number("velocity_sd", velocity_sd, 0.0)
    rng = np.random.default_rng(whole("seed", seed, 0))
    params = sim.params if params is None else params
    sim.parameter_array(params, params.worlds if isinstance(params, Parameters) and params.worlds else 1)
    if params.worlds is not None:
        raise ArgumentError(f"params are given for {params.worlds} worlds; refinement needs one set for all")
    h = float(params["step_size"])
    worlds = max(WORLDS, 4 * count)
    x0 = library.x[rng.integers(len(library), size=worlds)].copy()
    x0[:, sim.nx // 2 :] += velocity_sd * rng.standard_normal((worlds, sim.nx // 2))
    steps, last = round(SECONDS / h), round(WINDOW / h)
    states = sim.rollout(x0, policy=library.policy(), steps=steps, params=params).states[:, -last - 1 :]
    scores = array("score: what it gave", score(states), (worlds,), finite=False)
    worst = np.argsort(scores, kind="stable")[:count]
    x = states[worst, rng.integers(last + 1, size=count)].astype(np.float64)
    period = library.period
    return np.where(period > 0.0, np.mod(x, np.where(period > 0.0, period, 1.0)), x)


def build_refined(
    problem: Problem,
    x0: Any,
    count: int,
    score: Callable[[np.ndarray], np.ndarray],
    rounds: int = 5,
    options: RecedingOptions | None = None,
    sim: Simulator | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
) -> Library:
    """A library of `count` entries: a part as `build_library` makes it, the rest in rounds from stuck states.

    With ``out`` every shift of every round is kept in that folder; the same call goes on from there.

    Args:
        problem, x0, count, progress: as for `build_library`.
        score: see `stuck_states`.
        rounds: 0 gives `build_library`.
        options: of the first part; the new chains differ in their starts and are not kicked.
        sim: what the library is tried on (another precision, say), default the problem's dynamics.
        out: as for `build_library`.

    A keyboard interrupt returns what there is if there are entries, else is raised.
    """
    instance("problem", problem, Problem, "a ddp.Problem")
    instance("options", options, RecedingOptions | None, "a ddp.RecedingOptions")
    instance("sim", sim, Simulator | None, "a slcp_warp.Simulator")
    function("score", score, 1)
    function("progress", progress, 2, optional=True)
    count, rounds = whole("count", count), whole("rounds", rounds, 0)
    options = RecedingOptions() if options is None else options
    plans = -(-count // options.entries)
    each = 0 if rounds == 0 else int(plans * (1.0 - FIRST_SHARE) / rounds)
    parts = [count - rounds * each * options.entries, *[each * options.entries] * rounds]
    tried = problem.dynamics if sim is None else sim
    kept = None
    if out is not None:
        kept = kept_rounds(out, problem, array("x0", x0), options, count, rounds, score, tried)
    done, library = 0, None
    for k, part in enumerate(parts):
        if part < 1:
            continue

        def report(stored: int, _: int, before: int = done) -> None:
            if progress is not None:
                progress(before + stored, count)

        below = None if kept is None else kept.folder / "rounds" / f"{k:03d}"
        try:
            if library is None:
                library = build_library(problem, x0, part, options, report, out=below)
            else:
                chains = max(1, each // SHIFTS)
                settings = replace(
                    options, chains=chains, seed=options.seed + 1000 * k, perturb_every=0, first_passes=60,
                    noisy=3, first=None,
                )  # fmt: skip
                x = _starts(kept, k, library, tried, score, settings, problem.params)
                library = concatenate([library, build_library(problem, x, part, settings, report, out=below)])
        except KeyboardInterrupt:
            if library is None:
                raise
            return library
        done += part
        if len(library) < done:  # interrupted inside build_library
            return library
    assert library is not None
    library.header["rounds"] = rounds
    return library


def _starts(
    kept: Store | None,
    k: int,
    library: Library,
    tried: Simulator,
    score: Callable[[np.ndarray], np.ndarray],
    settings: RecedingOptions,
    params: Any,
) -> np.ndarray:
    """The states (chains, nx) in which the chains of round k start."""

    def compute() -> dict[str, np.ndarray]:
        return {"x": stuck_states(library, tried, score, settings.chains, settings.seed, params=params)}

    return compute()["x"] if kept is None else step_of(kept, k - 1, compute)[0]["x"]
