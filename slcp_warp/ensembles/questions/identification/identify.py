"""A mechanism's numbers from recorded runs, with what is known of them before and after."""

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp

from ....inputs import checks
from ....inputs.errors import ArgumentError, ArgumentTypeError
from ....policies import KalmanFilter
from ....storage.printed import cell
from ...worlds.seeds import seed_apart
from .fit import fit_of, judged
from .halving import moved_by_halving
from .identified import TWO_SIDED, Identified
from .likelihood import Likelihood
from .logs import logs_of
from .oddities import oddities
from .scoring import Minimum, Search, apart
from .softening import softenings
from .unknowns import Unknowns
from .weighing import weighed

SPREAD, STIRRED, WEIGHED = 0x70726F72, 0x73746972, 0x77656967  # with the seed: uses of it
MOST = 2**20  # candidates, starts, draws
QUIETER, LESS = 2, (0.0, -2.0)  # minima that are tried with less noise, and its z
AS_GOOD = 3.0  # of a cost: a twentieth of the likelihood
DISTANCE = 3.0  # standard deviations between two minima that are told


def identify(
    filter: KalmanFilter,
    measured: Any,
    controls: Any,
    parameters: Mapping[str, Any] | None = None,
    *,
    bias: Mapping[str, float] | None = None,
    sensor_noise: float = 0.0,
    process_noise: float = 0.0,
    x0: Any = None,
    tied: bool = True,
    halve: bool = True,
    candidates: int = 64,
    starts: int = 4,
    rounds: int = 30,
    draws: int = 128,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Identified:
    """Find a mechanism's numbers from recorded runs: the most likely, and how well they are known.

    What is known before is said as in `Disturbances.parameters`, what is known after can stand there. An
    extended Kalman filter of the mechanism goes through the logs; numbers are likely where what it foretells
    of the sensors is near what these showed, in deviations that it foretells, too (M70). Fisher's scoring
    (M71) goes down from the likeliest of many candidates; all candidates, differences and logs run side by
    side as worlds. Numbers stand in for what a model gets wrong: give it Coulomb's friction for what slides,
    and steps so short that halving them changes little.

    Args:
        filter: model (in float64), sensors, noise, and what is believed of the first states. With `process=0`
            the model is taken to be exact.
        measured: (R, N + 1, sensors) of R runs at the model's steps, the start first; (N + 1, sensors) of
            one; a list of such of several lengths; NaN where a sensor was not read.
        controls: (R, N, nu) that acted, (N, nu), or a list, likewise.
        parameters: by name how numbers are distributed that nobody knows exactly, as of
            `Disturbances.parameters`: {"block.mass": 0.5, "friction": slcp.Uniform(0.1, 1.0, shared=True)}.
        bias: by sensor the standard deviation of what it shows beside its state [its unit].
        sensor_noise, process_noise: standard deviation of the logarithm of a factor on every sensor's
            noise, and of one on the process's, where they are not known either.
        x0: (R, nx) means of the first states, or one (nx,); None: the filter's.
        tied: whether mass and inertia of a body are one number where both are looked for, as they are where
            worlds are drawn; False: each by itself.
        halve: whether it is looked how far numbers move in steps half as long (`Identified.halved`).
        candidates: drawn from what is known before; the likeliest `starts` of them go down.
        rounds: at most, of each.
        draws: weighed a pass, where what is known is not normal about the minimum.
        seed: of candidates and draws.
        progress: called with (rounds done, rounds at most).

    Raises:
        ArgumentError, ArgumentTypeError: nothing to look for, names that there are not, logs that do not fit
            together, a model in float32, a filter of one's own predictions.
    """
    filter = checks.instance("filter", filter, KalmanFilter, "a policies.KalmanFilter")
    _check_filter(filter)
    unknowns = Unknowns(filter, parameters, bias, sensor_noise, process_noise, checks.flag("tied", tied))
    likelihood = Likelihood(unknowns, logs_of(filter, measured, controls, x0))
    starts = checks.whole("starts", starts, 1, MOST)
    candidates = checks.whole("candidates", candidates, starts, MOST)
    rounds, draws = checks.whole("rounds", rounds, 0), checks.whole("draws", draws, 1, MOST)
    seed = checks.whole("seed", seed, 0)
    told = checks.function("progress", progress, 2, optional=True)
    rng = np.random.default_rng(seed_apart(seed, SPREAD))
    tried = rng.normal(size=(candidates, len(unknowns)))
    tried[0] = 0.0
    stages, places = softenings(filter, likelihood.logs), likelihood.places(tried)
    likelihood.softening = stages[0]
    costs = likelihood.cost(places)
    if not np.isfinite(costs).any():
        raise ArgumentError(
            f"measured, up to {np.nanmax(np.abs(likelihood.logs.measured)):g}, is foretold by none of "
            f"{candidates} candidates: no cost is finite"
        )
    first = np.argsort(costs, kind="stable")[:starts]
    search = Search(likelihood, places[first], seed_apart(seed, STIRRED))
    done = itertools.count(1)
    for i, stage in enumerate(stages):
        likelihood.softening = stage
        if i + 1 == len(stages):
            search.minima += quieter(search.minima, unknowns)
        search.run(
            rounds,
            lambda: None if told is None else told(next(done), (rounds + 1) * len(stages)),
            roughly=i + 1 < len(stages),
        )
    return _identified(likelihood, search.minima, draws, seed, checks.flag("halve", halve))


def quieter(minima: list[Minimum], unknowns: Unknowns) -> list[Minimum]:
    """The best minima with less noise of the process, where that is looked for: softened filters take what
    numbers would explain for noise, and do not come back from there.
    """
    if "process" not in unknowns.names:
        return []
    place, out = unknowns.names.index("process"), []
    for each in minima[:QUIETER]:
        for z in LESS:
            if each.place[place] > z:
                out.append(Minimum(each.place.copy()))
                out[-1].place[place] = z
    return out


def _check_filter(filter: KalmanFilter) -> None:
    if filter.model.dtype is not wp.float64:
        raise ArgumentError("filter.model is of float32; differences need Simulator(..., dtype='float64')")
    for name in ("predict", "correct", "estimate"):
        if getattr(type(filter), name) is not getattr(KalmanFilter, name):
            raise ArgumentTypeError(
                f"filter is a {type(filter).__name__} with a {name} of its own; a policies.KalmanFilter "
                "itself is needed"
            )


def _identified(
    likelihood: Likelihood, minima: list[Minimum], draws: int, seed: int, halve: bool
) -> Identified:
    """What was found, judged."""
    unknowns, best, count = likelihood.unknowns, minima[0], likelihood.count
    if best.information is None:
        raise ArgumentError(
            f"measured has a cost of {best.cost:g} at best, without derivatives: what is foretold beside it "
            "is not finite"
        )
    rng = np.random.default_rng(seed_apart(seed, WEIGHED))
    z, covariance, share = weighed(likelihood, best, draws, rng)
    place = np.concatenate([z, best.place[count:] + best.known.follows(z - best.place[:count]).ravel()])
    sd = np.sqrt(np.diag(covariance))
    ends = unknowns.values(z + np.stack([0.0 * sd, TWO_SIDED * sd, -TWO_SIDED * sd]))
    table = {"cost": np.array([each.cost for each in minima])}
    table |= {f"z {name}": np.array([each.place[i] for each in minima])
              for i, name in enumerate(unknowns.names)}  # fmt: skip
    table["ended"] = np.array([each.ended for each in minima])
    fit = fit_of(likelihood, place)
    moved = moved_by_halving(likelihood, best) / sd if halve else np.full(count, np.nan)
    return Identified(
        values={name: (float(each[0]), float(each.min()), float(each.max())) for name, each in ends.items()},
        learned={name: float(sd[i]) for name, i in unknowns.told.items()},
        names=unknowns.names,
        z=z,
        covariance=covariance,
        params=unknowns.parameters_at(z),
        filter=unknowns.filter_at(z),
        x0=likelihood.first_states(place[None])[0],
        before=judged(unknowns, likelihood.logs, np.zeros(count)),
        fit=fit,
        minima=table,
        counted=share,
        seed=seed,
        others=_others(unknowns, minima, count),
        halved={name: float(moved[i]) for name, i in unknowns.told.items()},
        odd=oddities(likelihood, place, fit.rms),
        _unknowns=unknowns,
    )


def _others(unknowns: Unknowns, minima: list[Minimum], count: int) -> tuple[str, ...]:
    """Other minima that explain the logs nearly as well."""
    out = []
    for each in minima[1:]:
        more = each.cost - minima[0].cost
        if more <= AS_GOOD and apart(minima[0], each, count) >= DISTANCE:
            found = unknowns.values(each.place[None, :count])
            values = ", ".join(f"{name} = {cell(float(value[0]))}" for name, value in found.items())
            out.append(f"nearly as likely, by a cost that is {more:.2g} more: {values}")
    return tuple(out)
