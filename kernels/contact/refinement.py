"""When refinement of a change of v' ends, and whether what it found is the derivative.

A proximal term tau diag(A), which keeps factors of rows that repeat others, takes its share of the change in
directions in which rows nearly oppose each other, too. Where a pivot is so small that this counts, the error
is taken out by refinement against the equations without that term, each time with the same factor, so
corrections fall at a rate: what is to come follows from the last two. Rows that only repeat others leave
corrections of the size of rounding from the first one on.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..specialisation import Specialisation
from .rows import make_rows

SMALL = {wp.float64: 1e-7, wp.float32: 1e-3}  # the proximal term's share of a pivot that needs no refinement
REFINED = {wp.float64: 1e-6, wp.float32: 1e-3}  # an error relative to the change of v', where refinement ends
WRONG = {wp.float64: 1e-4, wp.float32: 1e-2}  # what may be left of it after the last one
NONE = {wp.float64: 1e-10, wp.float32: 1e-5}  # corrections that are rounding; squares must not vanish
DIGITS = {wp.float64: 1e-13, wp.float32: 1e-6}  # of the change without rows: rounding, whichever way it goes
REFINEMENTS = 100
CARRIED = 1e-2  # of a gradient by v': the last correction's work on the impulses
GO_ON, SETTLED, LOST = 0, 1, 2


@cached
def make_refinement(spec: Specialisation) -> SimpleNamespace:
    """inner(minv, x, y): x' y, in units of 1/M^-1_jj. judge(minv, dv0, dv, change, before, count) -> GO_ON,
    SETTLED or LOST after the correction `change` of number `count`, from 1 on, that came after `before`.
    carries(jac, lambda, target, change) -> whether the impulses, by which J's slopes are multiplied, leave a
    change of the weights small. none() -> v' and rows that are not numbers.
    """
    s, dtype, _ = spec
    t = make_rows(spec).types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR
    ONE, HALF, ZERO = dtype(1.0), dtype(0.5), dtype(0.0)
    FINE, ROUGH, ROUNDING, LAST = (dtype(x[dtype] ** 2) for x in (REFINED, WRONG, NONE, DIGITS))
    LEAST = dtype(1e-30)

    @wp.func
    def inner(minv: MQ, x: VQ, y: VQ):
        total = ZERO
        for j in range(wp.static(s.nv)):
            total += x[j] * y[j] / wp.max(minv[j, j], LEAST)
        return total

    @wp.func
    def judge(minv: MQ, dv0: VQ, dv: VQ, change: VQ, before: VQ, count: int):
        size = inner(minv, dv, dv)
        free = inner(minv, dv0, dv0)
        moved = inner(minv, change, change)
        if moved <= ROUNDING * size or moved <= LAST * free:
            return int(wp.static(SETTLED))
        if count == 1:
            return int(wp.static(GO_ON))
        last = inner(minv, before, before)
        rate = inner(minv, change, before) / last
        error = moved
        if rate > HALF:  # the same way again, which no rounding goes
            if not (rate < ONE):
                return int(wp.static(LOST))
            error = moved * rate * rate / ((ONE - rate) * (ONE - rate))
        if error <= FINE * size:
            return int(wp.static(SETTLED))
        if moved < last and count < wp.static(REFINEMENTS):
            return int(wp.static(GO_ON))
        good = error <= ROUGH * size or error <= ROUNDING * free
        return wp.where(good, wp.static(SETTLED), wp.static(LOST))

    @wp.func
    def carries(jac: JR, lam: VR, target: VQ, change: VQ):
        size = ZERO
        moved = ZERO
        for j in range(wp.static(s.nv)):
            size = wp.max(size, wp.abs(target[j]))
            for i in range(wp.static(s.nr)):
                moved = wp.max(moved, wp.abs(lam[i] * jac[i, j] * change[j]))
        return moved <= dtype(CARRIED) * size

    @wp.func
    def none():
        """Of no derivative."""
        motion = VQ()
        rows = VR()
        for j in range(wp.static(s.nv)):
            motion[j] = dtype(wp.NAN)
        for i in range(wp.static(s.nr)):
            rows[i] = dtype(wp.NAN)
        return motion, rows

    return SimpleNamespace(judge=judge, carries=carries, none=none)
