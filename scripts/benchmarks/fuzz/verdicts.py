"""A verdict for every judged world: holds, ambiguous, a status with or without its proof, or silent.

`silent`: SOLVED, and an equation does not hold. `wrong status`: a status that a proof refutes (INFEASIBLE
where a velocity opens the rows, JAMMED where a solution exists, NONFINITE from finite numbers), or a failed
world whose state moved. `ambiguous`: two normals are equally right, so the oracle cannot say which rows there
are. `unproven`: there was no proof to be had, or too many to make.

Why worlds are NOT_CONVERGED is told by solutions of hard contact at the start of the step (`proofs.py`), also
where the residual is smoothed: the first of `REASONS` that holds.
"""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array
from slcp_warp.options import Status

from ..mechanics.bounces import given_up
from ..mechanics.overlaps import left
from .draws import CLASSES
from .judge import Errors, Outcome, ended, judge
from .problem import EPSILON, FLOOR, LEVER, LOST_ROWS, Problem
from .proofs import coulomb_solution, least_motion, least_push, opens, widest_opening

HOLDS, AMBIGUOUS, STATUS, UNPROVEN, WRONG, SILENT = (
    "holds", "ambiguous", "status", "unproven", "wrong status", "silent"
)  # fmt: skip
VERDICTS = (HOLDS, AMBIGUOUS, STATUS, UNPROVEN, WRONG, SILENT)
PROOFS = 500  # of one kind for a batch at most: the rest is counted as unproven
TRIALS = 15  # of all modes: the same
SLACK = 10.0  # by which an answer may be larger than an independent solution
NO_NUMBER = "NONFINITE from finite numbers"
BEYOND = 1e6  # of the data's speeds: INFEASIBLE says that no velocity below opens the rows
DIGITS, NONE, MANY, LARGE, END, SOLVABLE = REASONS = (
    "few digits",  # rows keep less of J v' + d/h than is promised, by the condition of the mass matrix
    "no solution",  # nothing opens the rows, or no modes of Coulomb's law solve them
    "too many modes",  # of Coulomb's law, to try
    "large impulses",  # the least are more than MUCH times what the data suggest
    "gap at the end",  # solved at the start of the step; how its rows bend was not followed
    "solvable",
)
MUCH = 30.0
LOOKED_AT = 6  # worlds of a class in a chunk
CLEAR = 1e-5  # an opening this wide, in units of the world's speeds, refutes INFEASIBLE


class Verdicts:
    """Verdicts (B,) as texts, what is wrong (B,), and the worst error that holds."""

    def __init__(self, problem: Problem, out: Outcome, part: Callable[[Array], Problem]) -> None:
        self.problem, self.out, self.part = problem, out, part
        self.trials = TRIALS
        worlds = len(out.status)
        self.verdict = np.full(worlds, HOLDS, dtype=object)
        self.reason = np.full(worlds, "", dtype=object)
        solved = out.status == Status.SOLVED
        finite = np.isfinite(out.x).all(1) & np.isfinite(out.impulse).all(1)
        with np.errstate(all="ignore"):
            self.errors = judge(problem, out)
        self.held: dict[int, Problem] = {}
        if problem.method.depenetration_speed is not None:
            for i in np.flatnonzero(solved & ~(self.errors.worst() <= 1.0)).tolist():
                self._hold(i)
        self.worst = np.where(solved, np.minimum(self.errors.worst(), self.errors.worst("lenient")), 0.0)
        for i in np.flatnonzero(solved & problem.bounces.any(1) & ~(self.errors.worst() <= 1.0)).tolist():
            solved[i] = not self._gave_up(i)
        bad = solved & ((self.errors.worst("lenient") > 1.0) | ~finite)
        for i in np.flatnonzero(bad).tolist():
            self._set(i, SILENT, "not finite" if not finite[i] else self.errors.name(i))
        for count, i in enumerate(np.flatnonzero(solved & ~bad & (self.errors.worst() > 1.0)).tolist()):
            self._earn(i, count < PROOFS)
        for i in self.held:
            self._could_leave(i)
        for count, i in enumerate(np.flatnonzero(out.status != Status.SOLVED).tolist()):
            self._status(i, count < PROOFS)
        if len(problem.tangent):
            unclear = (problem.unclear & ~(problem.free > 1e3 * problem.terms(np.abs(problem.truth.v)))).any(
                1
            )
            self.verdict[unclear & (self.verdict != HOLDS)] = AMBIGUOUS

    def _gave_up(self, i: int) -> bool:
        """Whether world i holds where fewer of its pairs bounce: only where not all of them can, it may."""
        p, out = self.part(np.array([i])), self.out.part(i)
        found = next((q for q in given_up(p) if judge(q, out).worst()[0] <= 1.0), None)
        if found is None:
            return False
        if widest_opening(p, 0) > CLEAR:
            solution: Any = self._tried(p, None) if p.method.coulomb else True
            if solution is not None:
                self._set(i, UNPROVEN if solution is False else SILENT, "bounces less than it can")
        self.worst[i] = float(judge(found, out).worst()[0])
        return True

    def _hold(self, i: int) -> None:
        """Judge world i by the problem whose overlaps stay, if there are such."""
        p, out = self.part(np.array([i])), self.out.part(i)
        v = out.x[:, p.truth.s.nv :]
        tried = list(left(p, v, p.tolerance * p.terms(np.abs(v) + np.abs(p.drive.free))))
        if not tried:
            return
        with np.errstate(all="ignore"):
            judged = [(judge(held, out), held) for held in tried]
        errors, self.held[i] = min(judged, key=lambda one: float(one[0].worst("lenient")[0]))
        for own, other in ((self.errors.strict, errors.strict), (self.errors.lenient, errors.lenient)):
            for name in own:
                own[name][i] = other[name][0]

    def _could_leave(self, i: int) -> None:
        """Overlaps of world i stay: only where not all of them can leave, they may."""
        p = self.part(np.array([i]))
        if self.verdict[i] == HOLDS and widest_opening(p, 0) > CLEAR:
            solution: Any = self._tried(p, None) if p.method.coulomb else True
            if solution is not None:
                self._set(i, UNPROVEN if solution is False else SILENT, "stays where it could leave")

    def _alone(self, i: int) -> Problem:
        """The problem of world i that its answer solves, by itself."""
        return copy.copy(self.held[i]) if i in self.held else self.part(np.array([i]))

    def doubt(self, known: Array) -> None:
        """Call unproven what hangs on an equation of motion that the oracle cannot write down (B,)."""
        unknown = ["motion", "update", "no solution", "runaway"]
        unknown += ["contact"] if self.problem.method.end_gap else []
        for i in np.flatnonzero((self.verdict == SILENT) & ~known).tolist():
            if any(part in self.reason[i] for part in unknown):
                self._set(i, UNPROVEN, self.reason[i])
        for i in np.flatnonzero((self.verdict == WRONG) & ~known).tolist():
            if self.problem.method.trapezoidal and self.reason[i] == NO_NUMBER:  # by the predicted forces
                self._set(i, UNPROVEN, self.reason[i])
        for i in np.flatnonzero((self.verdict == SILENT) & (self.reason == "motion")).tolist():
            if self.errors.worst("lenient")[i] <= 1.0 + predicted_within(self.part(np.array([i]))):
                self._set(i, UNPROVEN, "motion, by predicted forces that the tolerance of rows decides")

    def _set(self, i: int, verdict: str, reason: str) -> None:
        self.verdict[i], self.reason[i] = verdict, reason

    def _tried(self, p: Problem, acting: Array | None, like: Array | None = None, exact: bool = False) -> Any:
        """`coulomb_solution`, while there are trials left."""
        self.trials -= 1
        return coulomb_solution(p, 0, acting, like=like, exact=exact) if self.trials >= 0 else False

    def _earn(self, i: int, prove: bool) -> None:
        """Judge a large answer by overlaps that are less by a rounding, as its gaps say, or by the size of an
        independent solution, the least; with Coulomb's friction, which may have several, by that of the
        nearest as well.
        """
        if not prove:
            return self._set(i, UNPROVEN, "a large answer")
        if self._holds_eased(i):
            return None
        p = self._alone(i)
        if p.method.end_gap:  # the answer solves the problem with the gaps that it ends at
            x, nv = self.out.x[i : i + 1], p.truth.s.nv
            p.start_from(ended(p, x[:, :nv], x[:, nv:]))
        w = p.rate[0] + p.jac[0] @ self.out.x[i, p.truth.s.nv :]
        near = (self.out.impulse[i] > 0.0) | (w < 1e-2 * p.terms(np.abs(p.truth.v))[0])
        found: Any = self._tried(p, near) if p.method.coulomb else least_motion(p, 0)
        if found is None and p.method.coulomb:  # rows may all but depend on each other
            found = self._tried(p, near, exact=True)
        if found is False:
            return self._set(i, UNPROVEN, "too many modes")
        if found is None:
            found = _eased(p, near)
        if found is None and not p.method.coulomb and not self._is_runaway(p, i) and opens(p, 0):
            return self._set(i, UNPROVEN, "a solution beyond rounding")
        if found is None:
            return self._set(i, SILENT, "no solution exists")
        again = self._judged_by(p, i, found)
        if again.worst("lenient")[0] > 1.0 and p.method.coulomb:
            found = self._tried(p, near, self.out.impulse[i])
            again = again if found is None or found is False else self._judged_by(p, i, found)
        if again.worst("lenient")[0] > 1.0:
            self._set(i, SILENT, f"runaway {again.name(0)}")
        return None

    def _holds_eased(self, i: int) -> bool:
        """Whether world i holds on the scale of the data with overlaps eased as its gaps say: a rounding may
        be much of a lever that all but vanishes, which opposed impulses press by.
        """
        p = self._alone(i)
        p.ease(self.out.gap[i : i + 1])
        with np.errstate(all="ignore"):
            return bool(judge(p, self.out.part(i)).worst()[0] <= 1.0)

    def _solvable(self, p: Problem) -> list[Problem]:
        """The only world's problem, also without bouncing: alone, where friction jams what bounces."""
        either = _either(p)
        jams = len(either) > 1 and p.method.coulomb and not isinstance(self._tried(p, None), tuple)
        return either[:1] if jams else either

    def _is_runaway(self, p: Problem, i: int) -> bool:
        """Whether the answer is faster than what may still be called an opening, by what acts at v_free."""
        v = np.abs(self.out.x[i, p.truth.s.nv :])
        data = p.terms(np.abs(p.drive.free) + np.abs(p.truth.v))[0].max()
        return bool(v.max() > BEYOND * data)

    def _judged_by(self, p: Problem, i: int, found: tuple[Array, Array]) -> Errors:
        """Errors of world i where the answer may be as large as that found."""
        noise = p.sigma / np.maximum(p.diag, FLOOR)  # what smoothing alone may push
        v = SLACK * (
            np.abs(found[0][None]) + np.abs(np.linalg.solve(p.drive.h_mass[0], p.jac[0].T @ noise[0]))
        )
        lam = SLACK * (np.abs(found[1][None]) + noise)
        with np.errstate(all="ignore"):
            return judge(self._alone(i), self.out.part(i), (v, lam))

    def _status(self, i: int, prove: bool) -> None:
        """Judge a status that is not SOLVED."""
        status = Status(int(self.out.status[i]))
        self._set(i, STATUS, status.name)
        truth = self.problem.truth
        before = truth.worlds.x[i]
        if not (np.array_equal(self.out.x[i], before) and not self.out.impulse[i].any()):
            return self._set(i, WRONG, f"{status.name}, and the state moved")
        if status == Status.NONFINITE:
            return None if self.problem.digitless[i] else self._set(i, WRONG, NO_NUMBER)
        if status == Status.NOT_CONVERGED:
            return None
        method = self.problem.method
        other = (
            method.trapezoidal and status == Status.JAMMED
        )  # one of three problems, which the oracle lacks
        if not prove or method.end_gap or other:
            return self._set(i, UNPROVEN, status.name)
        p = self.part(np.array([i]))
        if method.depenetration_speed is not None:
            return self._set(i, WRONG, f"{status.name}, but overlaps may stay")
        cache = truth.openings.setdefault((p.method.coulomb, p.dtype), {})
        if i not in cache:
            cache[i] = max(widest_opening(q, 0) for q in self._solvable(p))
        opening = cache[i]
        if status == Status.INFEASIBLE and opening > CLEAR:
            self._set(i, WRONG, f"INFEASIBLE, but rows open by {opening:.1e}")
        if status == Status.JAMMED:
            tried = [self._tried(q, None) for q in _either(p)]
            found = next((one for one in tried if one is not None), None)
            if isinstance(found, tuple):  # a far limit's d/h is no measure of a contact that enters by less
                v, lam = found
                near = (lam != 0.0) | (p.rate[0] + p.jac[0] @ v < 1e-2 * p.terms(np.abs(p.truth.v))[0])
                found = coulomb_solution(p, 0, near, exact=True)
            if found is False or (isinstance(found, tuple) and _hangs_on_rounding(p, found[1])):
                self._set(i, UNPROVEN, status.name)
            elif found is not None:
                self._set(i, WRONG, "JAMMED, but a solution exists")
        return None


def _either(p: Problem) -> list[Problem]:
    """The only world's problem, and without bouncing where it does."""
    return [p.with_bounces(()), p] if p.bounces.any() else [p]


def _eased(p: Problem, near: Array) -> Any:
    """A solution of the only world, its overlaps eased by what rounding may have made of them."""
    p.ease()
    if not p.method.coulomb:
        return least_motion(p, 0)
    return coulomb_solution(p, 0, near) or coulomb_solution(p, 0, near, exact=True)


def predicted_within(p: Problem) -> float:
    """By how much the trapezoidal rule's predicted forces, whose rows hold to the tolerance, may move the
    equations of motion of the only world, in units of what is allowed: infinite where nothing opens the rows.
    """
    if not p.method.trapezoidal or p.method.coulomb:
        return 0.0
    truth, moved = p.truth, []
    first = Problem(truth, truth.drive(np.zeros(p.drive.free.shape)), p.method, p.dtype)
    missed = first.tolerance * first.terms(np.abs(truth.v) + np.abs(first.drive.free))  # as in `judge`
    for rate in (first.rate, first.rate - missed, first.rate + missed):
        first.start_from(rate)
        found = least_motion(first, 0)
        if found is None:
            return np.inf
        moved.append(truth.drive(least_push(first, 0, found[1])[None]).rhs)
    changes = [np.abs(rhs - moved[0]) / (p.tolerance * p.drive.size) for rhs in moved[1:]]
    return float(np.max(changes))


def _hangs_on_rounding(p: Problem, lam: Array) -> bool:
    """Whether impulses (nr,) of the only world are so large that rounding of a row's entries counts as much
    as the largest of what the data set of any: such a solution is there or not by rounding.
    """
    moved = np.abs(p.a[0]) @ np.abs(lam)
    told = p.terms(np.abs(p.truth.v) + np.abs(p.drive.free))[0]
    return bool(EPSILON[p.dtype] * np.max(moved) > np.max(told))


def reason_of(p: Problem) -> str:
    """The reason of one world's problem."""
    lost = LEVER * p.condition[0] * EPSILON[p.inner] / p.tolerance
    if np.max(lost) >= LOST_ROWS[p.dtype]:
        return DIGITS
    found = coulomb_solution(p, 0) if p.method.coulomb else least_motion(p, 0)
    if found is False:
        return MANY
    if not isinstance(found, tuple):
        return NONE
    data = p.terms(np.abs(p.truth.v) + np.abs(p.drive.free))[0]
    if (p.diag[0] * np.abs(found[1])).max(initial=0.0) > MUCH * data.max(initial=0.0):
        return LARGE
    return END if p.method.end_gap else SOLVABLE


def reasons(status: Array, kind: Array, part: Callable[[Array], Problem]) -> list[tuple[str, str]]:
    """Class and reason of the first LOOKED_AT worlds of each class that are NOT_CONVERGED; `part` as of
    `Verdicts`.
    """
    out = []
    for number, name in enumerate(CLASSES):
        found = np.flatnonzero((status == Status.NOT_CONVERGED) & (kind == number))[:LOOKED_AT]
        with np.errstate(all="ignore"):
            out += [(name, reason_of(part(np.array([i])))) for i in found.tolist()]
    return out
