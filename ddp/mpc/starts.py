"""What a cycle of model predictive control may start from: policies over the horizon, one a world each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import numeric, shown
from slcp_warp.inputs.errors import ArgumentError

from ..library.nearest import wrap
from ..policies import TrackingPolicy, in_steps_of
from ..problem import Problem
from ..results.result import Result
from ..sampling.options import Sampling
from ..sampling.sampler import Sampler


def read_only(a: np.ndarray) -> np.ndarray:
    """A view that cannot be written to."""
    view = a.view()
    view.flags.writeable = False
    return view


@dataclass
class Policy:
    """Policies of B worlds over the horizon N: u = us + k + K (x - xs).

    Attributes:
        us: (B, N, nu).
        xs: (B, N+1, nx).
        K: (B, N, nu, nx).
        k: (B, N, nu).
    """

    us: np.ndarray
    xs: np.ndarray
    K: np.ndarray
    k: np.ndarray

    @classmethod
    def open_loop(cls, x: np.ndarray, us: np.ndarray) -> "Policy":
        """Controls without feedback, about states that are not used."""
        (B, N, nu), nx = us.shape, x.shape[1]
        xs = np.repeat(x[:, None], N + 1, axis=1)
        return cls(us, xs, np.zeros((B, N, nu, nx)), np.zeros_like(us))

    @property
    def finite(self) -> np.ndarray:
        """(B,) worlds whose numbers all are."""
        parts = [np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in (self.us, self.xs, self.K, self.k)]
        return np.logical_and.reduce(parts)

    def read_only(self) -> "Policy":
        """The same numbers in arrays that cannot be written to."""
        return Policy(*(read_only(a) for a in (self.us, self.xs, self.K, self.k)))

    def shifted(self, steps: int, horizon: int) -> "Policy":
        """The same policies that many steps later (19), over another horizon.

        After their last step its control is held, without feedback.
        """
        N = self.us.shape[1]
        at = np.minimum(np.arange(horizon) + steps, N - 1)
        K, k = self.K[:, at].copy(), self.k[:, at].copy()
        after = max(N - steps, 0)
        K[:, after:], k[:, after:] = 0.0, 0.0
        states = np.minimum(np.arange(horizon + 1) + steps, N)
        return Policy(self.us[:, at], self.xs[:, states], K, k)

    def near(self, x: np.ndarray, period: np.ndarray) -> "Policy":
        """The same with periodic states moved by whole periods to where x (B, nx) is."""
        turn = x - self.xs[:, 0]
        turn = turn - wrap(turn, period)
        return Policy(self.us, self.xs + turn[:, None], self.K, self.k)

    def select(self, index: Any) -> "Policy":
        """Those of some worlds."""
        return Policy(self.us[index], self.xs[index], self.K[index], self.k[index])

    @classmethod
    def join(cls, parts: list["Policy"]) -> "Policy":
        """All policies of several, one after another."""
        return cls(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("us", "xs", "K", "k")))


@dataclass
class Situation:
    """What a start is made from; its arrays are read-only, since other starts are made from them, too.

    Attributes:
        problem: of the plans; near the end of a run its horizon is what is left, and times of its cost count
            from the plan's beginning.
        x: (B, nx) states.
        time: [s].
        worlds: (B,) their numbers.
        last: the last policies, shifted to now; None in the first cycle.
        cycle: (seed, step), the same for all worlds; see `rngs`.
        noise: (nu,) standard deviation of noise.
        library: a library's policy, rolled out on the model; None: none was given.
    """

    problem: Problem
    x: np.ndarray
    time: float
    worlds: np.ndarray
    last: Policy | None
    cycle: tuple[int, int]
    noise: np.ndarray
    library: Callable[[np.ndarray], np.ndarray] | None

    @property
    def rngs(self) -> list[np.random.Generator]:
        """Random numbers of this cycle, a generator a world: what is drawn follows from seed, step and
        the world's number, however worlds are split into blocks and launches.
        """
        return [np.random.default_rng((*self.cycle, int(n))) for n in self.worlds]


Start = Callable[[Situation], Any]  # -> Policy, controls (B, N, nu) or (N, nu), or None: not this time
NOISE_TIME = 8.0  # correlation time of noise [steps]


def shift(s: Situation) -> Policy | None:
    """The last policy with its feedback."""
    return s.last


def keep(s: Situation) -> Policy | None:
    """The last policy with its feedback, without the step that real-time iteration has open."""
    return None if s.last is None else Policy(s.last.us, s.last.xs, s.last.K, np.zeros_like(s.last.k))


def zero(s: Situation) -> np.ndarray:
    """No control."""
    return np.zeros((len(s.x), s.problem.horizon, s.problem.nu))


def noise(s: Situation) -> Policy | np.ndarray:
    """Smoothed noise over the last policy's controls."""
    size = s.problem.horizon, s.problem.nu
    drawn = [rng.standard_normal(size) for rng in s.rngs]
    white = np.array(drawn).reshape(len(s.x), *size)
    keep = np.exp(-1.0 / NOISE_TIME)
    for k in range(1, white.shape[1]):
        white[:, k] = keep * white[:, k - 1] + np.sqrt(1.0 - keep**2) * white[:, k]
    if s.last is None:
        return s.noise * white
    return Policy(s.last.us + s.noise * white, s.last.xs, s.last.K, s.last.k)


def library(s: Situation) -> np.ndarray | None:
    """What the library's policy does on the model."""
    return None if s.library is None else s.library(s.x)[:, : s.problem.horizon]


def plan(s: Situation) -> None:
    """The place of a `Planned` start, made from the plan that is given."""


class Planned:
    """A plan that was made ahead, followed in time with its feedback; none after its end.

    Args:
        plan: of `ddp.solve` or `ddp.plan`, for one problem.
        problem: that it is a start for.
    """

    def __init__(self, plan: Result, problem: Problem) -> None:
        us, xs, K = (np.asarray(getattr(plan, name), np.float64) for name in ("us", "xs", "K"))
        need = {"us": (problem.nu,), "xs": (problem.nx,), "K": (problem.nu, problem.nx)}
        for (name, row), given in zip(need.items(), (us, xs, K), strict=True):
            if given.shape[1:] != row:
                raise ArgumentError(
                    f"plan.{name} has shape {given.shape}; (steps, {str(row)[1:]} of one plan is needed"
                )
        TrackingPolicy(plan).check_names(problem.dynamics.scene)
        if plan.simulated is not None:
            rate = float(np.ravel(problem.params["step_size"])[0]) / plan.simulated.step_size
            us, xs, K = (a[0] for a in in_steps_of(rate, us[None], xs[None], K[None]))
        self._policy = Policy(us[None], xs[None], K[None], np.zeros_like(us)[None])
        self._period = problem.dynamics.scene.state_period

    def __call__(self, s: Situation) -> Policy | None:
        """What is left of it, about the states nearest to those met."""
        _, step = s.cycle
        if step >= self._policy.us.shape[1]:
            return None
        left = self._policy.shifted(step, s.problem.horizon)
        return left.select(np.zeros(len(s.x), dtype=int)).near(s.x, self._period)


class Search:
    """Sampled controls about the last policy's, or about none: the best of `Sampling`.

    Args:
        options: how many samples, by which method.
    """

    __name__ = "sample"

    def __init__(self, options: Sampling) -> None:
        self.options = options
        self._samplers: dict[int, Sampler] = {}  # by worlds

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_samplers": {}}

    def __call__(self, s: Situation) -> np.ndarray:
        """Controls (B, N, nu)."""
        sampler = self._sampler(s.problem, len(s.x))
        sampler.run(
            s.x,
            None if s.last is None else s.last.us,
            seed=int(np.random.default_rng(s.cycle).integers(2**31)),
        )
        return np.asarray(sampler.us.numpy(), np.float64)

    def _sampler(self, problem: Problem, worlds: int) -> Sampler:
        """Of a problem; one that differs by numbers of its cost alone takes those."""
        kept = {n: each for n, each in self._samplers.items() if each.problem.differs_by_weights(problem)}
        if worlds not in kept:
            kept[worlds] = Sampler(problem, worlds, self.options)
        self._samplers, sampler = kept, kept[worlds]
        if sampler.problem is not problem:
            sampler.set_cost(problem)
        return sampler


STARTS: dict[str, Start] = {
    "shift": shift,
    "keep": keep,
    "plan": plan,
    "library": library,
    "zero": zero,
    "noise": noise,
}


def chosen_starts(given: Any) -> dict[str, Start]:
    """Starts by name; users' functions by theirs."""
    if not isinstance(given, list | tuple) or not given:
        raise ArgumentError(
            f"starts is {shown(given)}; some of {', '.join(STARTS)}, a ddp.Sampling or functions are needed"
        )
    found: dict[str, Start] = {}
    for each in given:
        if isinstance(each, Sampling):
            found[_free("sample", found)] = Search(each)
        elif isinstance(each, str) and each in STARTS:
            if each in found:
                raise ArgumentError(f"starts names {each!r} twice")
            found[each] = STARTS[each]
        elif callable(each) and not isinstance(each, type):
            found[_free(getattr(each, "__name__", "start"), found)] = each
        else:
            raise ArgumentError(
                f"starts holds {shown(each)}; one of {', '.join(STARTS)}, or a function of a ddp.Situation"
            )
    return found


def _free(name: str, taken: dict[str, Start]) -> str:
    """The name, with a number where a start or another of them has it."""
    found, count = name, 1
    while found in taken or found in STARTS:
        found, count = f"{name} {count + 1}", count + 1
    return found


def policies_of(name: str, made: Any, s: Situation) -> Policy | None:
    """What a start gave, as policies of all worlds; controls are open loop."""
    if made is None:
        return None
    need = B, N, nu = len(s.x), s.problem.horizon, s.problem.nu
    if isinstance(made, Policy):
        nx = s.x.shape[1]
        shapes = {"us": need, "xs": (B, N + 1, nx), "K": (B, N, nu, nx), "k": need}
        for field, shape in shapes.items():
            if np.shape(getattr(made, field)) != shape:
                came = np.shape(getattr(made, field))
                raise ArgumentError(f"start {name!r} gave {field} of shape {came}; {shape} is needed")
        return made
    us = numeric(made)
    if us is None or us.shape not in (need, need[1:]):
        raise ArgumentError(f"start {name!r} gave {shown(made)}; controls {need} or {need[1:]} are needed")
    return Policy.open_loop(s.x, np.broadcast_to(us, need).astype(np.float64))
