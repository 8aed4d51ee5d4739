"""The judge: which of a step's equations do not hold, in units of what its precision may miss.

An error counts relative to the size of the terms that the DATA set. Where it is larger, but small beside the
terms that the ANSWER sets (large impulses between opposed rows, say), the answer must be earned: the size of
an independent solution (`proofs.py`) takes the answer's place. A runaway answer has none beside it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array

from ..mechanics.complementarity import (
    complementarity,
    expected_square_slopes,
    normal_tail,
    partner,
    rubbed,
)
from ..mechanics.contact import gaps
from .problem import EPSILON, FLOOR, LEVER, LOST_ROWS, MOST_LOSS, TOLERANCE, Problem

STEADY = {"float64": (4e-8, 4e-15), "float32": (1e-4, 2e-6)}  # gap="end": [m/s], and of positions [m]
TINY = 1e-300
NORMAL = {"float64": 2.3e-308, "float32": 1.2e-38}  # below, a number's rounding is relative to this
NOTHING = 1e-24  # of a world's largest speed at the start: eight orders below its rounding
SMALL = 64  # rows of a product that BLAS makes in one thread
BENT = 1e-3  # of sigma: where phi is no straight line


@dataclass(frozen=True)
class Outcome:
    """What the package gave for a step: next state (B, 2 nv), impulses and gaps (B, nr), status (B,)."""

    x: Array
    impulse: Array
    gap: Array
    status: Array

    @staticmethod
    def of(step: Any) -> "Outcome":
        """From a `slcp_warp.Step`."""
        x, impulse, gap = (np.asarray(a, float) for a in (step.state, step.impulse, step.gap))
        return Outcome(x, impulse, gap, np.asarray(step.status))

    def part(self, keep: Any) -> "Outcome":
        """Some of the worlds."""
        keep = np.atleast_1d(keep)
        return Outcome(self.x[keep], self.impulse[keep], self.gap[keep], self.status[keep])


@dataclass(frozen=True)
class Errors:
    """By check, (B,): errors over what the data allow (`strict`) and over what data and answer allow."""

    strict: dict[str, Array]
    lenient: dict[str, Array]

    def worst(self, which: str = "strict") -> Array:
        """The largest of a world's errors; a NaN is infinite."""
        parts = np.stack(list(getattr(self, which).values()))
        return np.where(np.isfinite(parts), parts, np.inf).max(0)

    def name(self, world: int, which: str = "lenient") -> str:
        """The check that a world misses by most."""
        parts = {k: v[world] for k, v in getattr(self, which).items()}
        return max(parts, key=lambda k: parts[k] if np.isfinite(parts[k]) else np.inf)


def judge(problem: Problem, out: Outcome, answer: tuple[Array, Array] | None = None) -> Errors:
    """Errors of the worlds' steps. `answer`: velocities and impulses whose sizes count as the answer's, in
    place of the judged ones.
    """
    truth, method, tol = problem.truth, problem.method, problem.tolerance
    nv = truth.s.nv
    q1, v1, lam = out.x[:, :nv], out.x[:, nv:], out.impulse
    like_v, like_lam = answer if answer is not None else (v1, lam)
    strict, lenient = {}, {}
    strict["motion"], lenient["motion"] = _motion(problem, v1, lam, like_v, like_lam)
    rate, extra = _rates(problem, q1, v1)
    free = np.abs(truth.v) + np.abs(problem.drive.free)
    acts = (lam != 0.0) | (problem.free < 0.0) | (rate + np.einsum("bij,bj->bi", problem.jac, v1) < 0.0)
    joined = _joined(problem, acts)
    moved = truth.h[:, None] * v1
    if not method.trapezoidal:
        size = np.abs(q1) + np.abs(truth.q) + np.abs(moved) + NORMAL[problem.dtype]
        strict["update"] = (np.abs(q1 - truth.q - moved) / size).max(1) / (8.0 * EPSILON[problem.dtype])
    elif not method.erm:  # positions move with a velocity of their own, which opens the rows, too
        moved = (q1 - truth.q) / truth.h[:, None]
        w = problem.rate + np.einsum("bij,bj->bi", problem.jac, moved)
        size = problem.terms(np.abs(moved) + free) + problem.sigma
        size = np.maximum(size, _shared(problem.terms(free) + problem.sigma, joined))
        size = size + np.abs(truth.q).max(1)[:, None] * problem.loose / truth.h[:, None]
        strict["update"] = _highest(np.where(problem.tangent, 0.0, -w) / (tol * size))
    data = problem.terms(free) + problem.sigma + TINY
    data = np.maximum(data, _shared(data, joined))
    if method.erm:
        extra = extra + _weighed_rounding(problem, data)
    data = data * problem.loss[:, None]
    swing = problem.terms(np.abs(like_v)) + problem.diag * np.abs(like_lam)
    swing = data + np.maximum(swing, _shared(swing, joined))
    error = _contact(problem, rate, v1, lam, data)
    strict["contact"] = _highest(error / (tol * data + extra))
    lenient["contact"] = _highest(error / (tol * swing + extra))
    size = np.maximum(problem.size * truth.h[:, None], 1e-30)
    wide = np.where(problem.unclear | problem.tangent, np.inf, 40.0 * EPSILON[problem.dtype] * size)
    known = problem.near * truth.h[:, None]
    strict["gap"] = _highest(np.abs(np.where(problem.tangent, 0.0, out.gap - known)) / wide)
    strict["energy"], lenient["energy"] = _energy(problem, v1, like_v)
    for name in ("update", "gap"):
        if name in strict:
            lenient[name] = strict[name]
    return Errors(strict, lenient)


def _highest(values: Array, where: Array | None = None) -> Array:
    """The largest of a world's rows (B,), 0 without rows."""
    values = values if where is None else np.where(where, values, 0.0)
    return values.max(1, initial=0.0)


def _joined(p: Problem, acts: Array) -> Array:
    """Which acting rows j (B, nr, nr) lend row i their scale: those of bodies that hang together (in a tree,
    or by springs and tendons) or touch, directly or over other acting rows. What is fast elsewhere is no
    measure of it.
    """
    s, moves = p.truth.s, np.abs(p.jac) > 0.0
    hang = np.eye(len(s.bodies), dtype=bool)[None]
    tied = [(s.dof_body[dofs[0]], s.dof_body[j]) for dofs in s.tendons for j in dofs[1:]]
    for a, b in [*enumerate(body.parent for body in s.bodies), *s.springs, *tied]:
        if a >= 0 and b >= 0:
            hang[0, a, b] = hang[0, b, a] = True
    bodies = np.array(s.dof_body)
    hang = _closure(hang)[:, bodies[:, None], bodies]
    near = _product(_product(moves, hang), np.swapaxes(moves, 1, 2))
    over = near & acts[:, None]
    some = np.flatnonzero(acts.any(0))  # a way leads over acting rows alone
    over[:, :, some] |= _product(over[:, :, some], _closure(over[:, some[:, None], some]))
    out: Array = over
    return out


def _product(a: Array, b: Array) -> Array:
    """Of relations (B, n, m) and (B, m, k). Large ones without BLAS, whose threads are slow."""
    out: Array = a @ b if a.shape[1] > SMALL else a.astype(np.float32) @ b.astype(np.float32) > 0.0
    return out


def _closure(over: Array) -> Array:
    """The transitive closure of a relation (B, n, n)."""
    while True:
        wider = over | _product(over, over)
        if np.array_equal(wider, over):
            return over
        over = wider


def _shared(values: Array, joined: Array) -> Array:
    """The largest of the rows that a row is joined to (B, nr), 0 without any."""
    return np.where(joined, values[:, None], 0.0).max(2, initial=0.0)


def _motion(p: Problem, v1: Array, lam: Array, like_v: Array, like_lam: Array) -> tuple[Array, Array]:
    """Errors of H v' = H v_free + J' lambda, a body's coordinates weighed by energy."""
    drive, truth = p.drive, p.truth
    left = np.einsum("bij,bj->bi", drive.h_mass, v1)
    error = np.abs(left - drive.rhs - np.einsum("bri,br->bi", p.jac, lam))
    root = np.sqrt(np.einsum("bjj->bj", drive.h_mass))
    mine = np.array(truth.s.dof_body)
    alone = (np.maximum(-p.free, 0.0) + p.sigma) / np.maximum(p.diag, FLOOR)  # a row's impulse by itself
    free = np.abs(drive.free) + _least(p) + _nothing(p)
    data = drive.size + np.einsum("bij,bj->bi", np.abs(drive.h_mass), free)
    hang = _closure((np.abs(drive.h_mass) > 0.0).any(0, keepdims=True))  # what one factor of H is of
    speed = _shared(root * (np.abs(truth.v) + np.abs(drive.free)), hang)
    lost = p.loose * drive.doubt + drive.guess
    if p.method.trapezoidal:  # at rest beside a stiff spring at right angles Euler's is all of the motion
        lost = lost + LEVER * p.shaken[:, None] / p.tolerance * root * speed
        lost = np.minimum(lost, MOST_LOSS / p.tolerance * root * speed)
    data = data + lost
    data = data + np.einsum("bri,br->bi", p.bound, np.where(lam != 0.0, alone, 0.0))
    answer = np.einsum("bij,bj->bi", np.abs(drive.h_mass), np.abs(like_v))
    answer = data + answer + np.einsum("bri,br->bi", p.bound, np.abs(like_lam))
    factor = (LEVER + 0.5 * root.shape[1]) * p.loose * root  # rounding of H and of its factor

    def swift(v: Array) -> Array:
        return np.einsum("bij,bj->bi", hang + np.zeros((len(v), 1, 1)), root * v)

    data = data + factor * swift(np.abs(drive.free))
    answer = answer + factor * swift(np.abs(drive.free) + np.abs(like_v))
    loss = p.loss if p.method.trapezoidal else np.ones(len(p.loss))
    out = []
    for size in (data, answer):
        ratio = size / root * loss[:, None]
        body = np.stack([ratio[:, mine == b].max(1) for b in mine], 1)
        out.append((error / (root * np.maximum(body, TINY))).max(1) / p.tolerance)
    return out[0], out[1]


def _least(p: Problem) -> float:
    """A velocity whose rounding is that of numbers too small to be normal, which keep no digits."""
    return NORMAL[p.dtype] / TOLERANCE[p.dtype]


def _nothing(p: Problem) -> Array:
    """A velocity (B, 1) whose share is NOTHING beside what the data say is fastest in a world: what is left
    of a body's speed after many steps at a stop.
    """
    fastest = (np.abs(p.truth.v) + np.abs(p.drive.free)).max(1, initial=0.0)
    out: Array = NOTHING * fastest[:, None] / TOLERANCE[p.dtype]
    return out


def _rates(p: Problem, q1: Array, v1: Array) -> tuple[Array, Any]:
    """d/h of the rows, and what gap="end" allows beside: there the gap is that of q', less J_n v'."""
    if not (p.method.end_gap and p.truth.s.pairs):
        return p.rate, 0.0
    speed, place = STEADY[p.dtype]
    extra = speed + place * np.maximum(1.0, np.abs(p.truth.q).max(1)) / p.truth.h
    return ended(p, q1, v1), extra[:, None]


def ended(p: Problem, q1: Array, v1: Array) -> Array:
    """d/h of the rows such that J v' + d/h has the gap at the end of the step (B, nr)."""
    truth = p.truth
    after = gaps(p.mech, q1)
    rate = p.rate.copy()
    for i, row in enumerate(truth.s.rows):
        if row.kind == "contact" and not p.tangent[i]:
            approach = np.einsum("bj,bj->b", p.touches.normal[:, row.index], v1)
            rate[:, i] = after[:, row.index] / truth.h - approach
    return rate


def _contact(p: Problem, rate: Array, v1: Array, lam: Array, data: Array) -> Array:
    """Errors (B, nr) of the complementarity problem, as velocities."""
    b = rate + np.einsum("bij,bj->bi", p.jac, v1)
    a, method = p.scale * lam, p.method
    if not lam.size:
        return np.zeros(lam.shape)
    if method.erm:
        by_a, by_b = expected_square_slopes(a, b, p.sigma, method)
        slope = p.scale * by_a + np.einsum("bij,bj->bi", p.a, by_b)
        out: Array = np.abs(slope) / np.maximum(p.diag, p.scale)
        return out
    if method.hard:
        error = np.where(b < p.diag * lam, b, p.diag * lam)
        for i in np.flatnonzero(p.tangent):
            bound = p.mu[:, i] * np.maximum(lam[:, i - 1], 0.0)
            size = np.maximum(p.diag[:, i], FLOOR)
            error[:, i] = size * (lam[:, i] - rubbed(lam[:, i], b[:, i], size, bound))
        return np.abs(error)
    error = np.abs(complementarity(a, b, p.sigma, method))
    x = np.clip((b - a) / p.sigma, -700.0, 700.0)
    if method.residual == "rem-logistic":
        by_a = 1.0 / (1.0 + np.exp(-x))
    else:
        tail = normal_tail(np.abs(x))
        by_a = np.where(x > 0.0, 1.0 - tail, tail)
    gain: Array = np.maximum(1.0 - by_a, by_a * p.scale / np.maximum(p.diag, FLOOR))
    error = error / np.maximum(gain, TINY)
    bent = error > BENT * p.sigma  # slopes tell no more how far a root is: it is looked for
    sigma, weight = p.sigma[bent], (p.diag / p.scale)[bent]
    by_b = np.abs(b[bent] - partner(a[bent], sigma, method))
    by_a = weight * np.abs(a[bent] - partner(b[bent], sigma, method))
    both = np.maximum(np.abs(b[bent] - partner(sigma, sigma, method)), weight * np.abs(a[bent] - sigma))
    error[bent] = np.minimum(np.minimum(by_a, by_b), both)  # neither alone has a root where both are <= 0
    return error


def _weighed_rounding(p: Problem, data: Array) -> Array:
    """What the digits that H^-1 costs of all rows' velocities, of this size, make of a row's slope of ERM's
    objective (B, nr), whose second derivatives by w are at most 2.
    """
    most = LOST_ROWS[p.dtype] * TOLERANCE[p.dtype]
    lost = np.minimum(LEVER * p.condition * EPSILON[p.inner], most)[:, None] * data
    out: Array = 2.0 * np.einsum("bij,bj->bi", np.abs(p.a), lost) / np.maximum(p.diag, p.scale)
    return out


def _miss(p: Problem) -> Array:
    """What rounding makes of d/h (B, nr)."""
    return p.tolerance * p.loose * p.size


def _pushed_by_rounding(p: Problem, free: Array) -> Array:
    """What rows whose gap may be a rounding below 0 add to the energy at velocities of this size, in units of
    what the energy may miss.
    """
    away = np.where(p.rate < _miss(p), _miss(p), 0.0) / np.maximum(p.diag, FLOOR)
    push = np.einsum("bri,br->bi", np.abs(p.jac), away)
    dv = np.einsum("bij,bj->bi", np.abs(np.linalg.inv(p.drive.h_mass)), push)
    mass, kinetic = np.abs(p.drive.h_mass), p.truth.mech.kinetic
    out: Array = (kinetic(mass, free + dv) - kinetic(mass, free)) / (20.0 * p.tolerance)
    return out


def _energy(p: Problem, v1: Array, like: Array) -> tuple[Array, Array]:
    """By how much a step adds kinetic energy where it must not. Hard contact whose rows are all open, or
    closed without overlap: v' is a projection of v_free (Anitescu), or friction and normal both oppose it
    (Coulomb). Dampers, where nothing touches: against the velocity without them, unless the scene wants
    them explicit, or the leapfrog's Coriolis forces hang on them. Energy is v' M v/2, with implicit
    stiffness of M + h^2/2 K.
    """
    truth, none = p.truth, np.zeros(len(v1))
    if p.method.trapezoidal:
        return none, none
    kinetic, h_mass, free = truth.mech.kinetic, p.drive.h_mass, np.abs(p.drive.free) + _least(p)
    undamped = truth.undamped()
    alone = none > 0.0
    if p.method.hard and not p.method.end_gap and not p.method.leapfrog:
        alone = (p.free > _miss(p)).all(1) & truth.damped
    gain = np.where(alone, kinetic(truth.inertia, v1) - kinetic(truth.inertia, undamped), 0.0)
    doubt = p.loose * np.sum(p.drive.doubt * (np.abs(undamped) + np.abs(truth.v)), 1)
    size = kinetic(np.abs(truth.inertia), np.abs(undamped) + np.abs(truth.v) + _least(p)) + doubt + TINY
    strict = lenient = gain / (20.0 * TOLERANCE[p.dtype] * p.loss) / size
    if p.method.hard and not p.method.end_gap:
        legal = (p.rate >= 0.0).all(1)
        gain = np.where(legal, kinetic(h_mass, v1) - kinetic(h_mass, p.drive.free), 0.0)
        gain = gain / (20.0 * TOLERANCE[p.dtype] * p.loss)
        size = kinetic(np.abs(h_mass), free + np.abs(truth.v)) + doubt + TINY + _pushed_by_rounding(p, free)
        strict = np.maximum(strict, gain / size)
        lenient = np.maximum(lenient, gain / (size + kinetic(np.abs(h_mass), np.abs(like))))
    return strict, lenient
