"""Corrections of the rows to the gap at the end of the step (`contact/end_gap.py`), one after the other.

Where a correction is larger than the one before, half of it is made from then on; after REFINEMENTS of them
the world fails. When the rows stay, pairs that only the end of the step brings within reach get their rows.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.end_gap import REFINEMENTS, make_end_gap, make_unsteady
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .reach import make_reach
from .solution import make_solution


@cached
def make_correction(spec: Specialisation, exact_gap: int) -> SimpleNamespace:
    """The struct `Ending`; begin() -> Ending; correct(world, q, v, reach, ending) -> Reach, Ending;
    `needed`: whether the method asks for it.
    """
    s, dtype, method = spec
    t = make_solution(s, dtype).types
    Reach = make_reach(spec, exact_gap).Reach
    needed = method.end_gap and len(s.pairs) > 0
    end_gap = make_end_gap(spec) if needed else None
    unsteady = make_unsteady(s, dtype)
    HALF, ONE, HUGE = dtype(0.5), dtype(1.0), dtype(1e30)
    H = layout(s).offset("step_size")

    @wp.struct
    class Ending:
        last: dtype  # size of the correction before
        part: dtype  # of a correction that is made
        refined: int  # corrections made
        open: int  # 1: the gaps at the end have not been seen, or call for another solution
        stale: int  # 1: rows were corrected
        failed: int  # 1: corrections do not settle

    @wp.func
    def begin():
        out = Ending()
        out.last = HUGE
        out.part = ONE
        out.open = 1
        return out

    @wp.func
    def correct(world: t.World, q: t.VQ, v: t.VQ, start: Reach, before: Ending):
        reach = start
        out = before
        out.open = 0
        out.stale = 0
        now = t.VR()
        if reach.known != 0:
            now = end_gap.bend(world, q, v, reach.normal, reach.jac, reach.rate, reach.known)
        change = now - reach.bent
        if unsteady(q, change, world.params[wp.static(H)]):
            size = wp.max(wp.abs(change))
            if out.refined == wp.static(REFINEMENTS):
                out.failed = 1
            else:
                if size > out.last:  # past the solution by more than before
                    out.part = HALF * out.part
                out.last = size
                reach.bent = reach.bent + out.part * change
                out.refined += 1
                out.stale = 1
                out.open = 1
        else:
            reach.wanted = end_gap.reached(world, q, v, reach.known)
            if reach.wanted != 0:
                out.open = 1
        return reach, out

    return SimpleNamespace(needed=needed, Ending=Ending, begin=begin, correct=correct)
