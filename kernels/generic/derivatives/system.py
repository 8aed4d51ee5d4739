"""The linear system of the implicit function theorem at a solved step, and eight right-hand sides at once.

(dv', dz) solves M dv' - J' (p/D) dz = -F1, C dv' + q dz = -F2 with p = s'(z), q = s'(-z), where -F1 holds D's
own change and C = J but for contacts that slide under Coulomb's friction, whose row of C is J_n at fixed
modes (stick, slide, separate). dz is eliminated with a proximal term as in `newton.py`, larger because
rounding counts here, whose error is taken out by iterative refinement.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..envelope import make_envelope
from ..newton import PROXIMAL, make_newton
from ..topology import CONTACT, Topology
from ..work import WORK, Work
from .tables import Lanes, Slopes

YIELDING = 1e-10  # diag(A) dlambda by which a row yields
REFINED = 1e-6  # a correction relative to what it corrects, after which the next one is rounding
REFINEMENTS = 4


@cached
def make_system(given: type, residual: str) -> SimpleNamespace:
    """factor(t, k, d, params, row, b, n) of the n acting rows, and solve(t, k, d, b, n): d.found = dv' from
    -F1 in d.known and -F2 in d.given, which is overwritten. response(t, k, d, b, i): d.answer = M^-1 J_i' of
    the group of places that row i moves. add(t, k, b, i, x, c): x += J_i' c.
    """
    dtype = WORK
    env = make_envelope(dtype)
    contacts = residual != "none"
    nt = make_newton(given, residual) if contacts else None
    ONE, ZERO, HALF, YIELDS = dtype(1.0), dtype(0.0), dtype(0.5), dtype(YIELDING)
    TAU, SMALL = dtype(YIELDING + PROXIMAL), dtype(REFINED)
    SMALLEST = dtype(1e-300)

    @wp.func
    def partner(t: Topology, i: int):
        """The first row of a contact's two."""
        return t.pair_row[t.row_index[i]]

    @wp.func
    def add(t: Topology, k: Work, b: int, i: int, x: wp.array(dtype=Lanes), c: Lanes):
        for at in range(t.row_start[i], t.row_start[i + 1]):
            p = t.row_place[at]
            x[p] = x[p] + k.jac[at, b] * c

    @wp.func
    def rate(t: Topology, k: Work, d: Slopes, b: int, r: int, i: int, x: wp.array(dtype=Lanes)):
        """C_i x"""
        out = Lanes()
        if wp.static(residual == "hard"):
            if d.slides[b, r] == 1:
                start = t.row_start[partner(t, i)]
                width = t.row_start[i + 1] - t.row_start[i]
                for e in range(width):
                    normal = HALF * (k.jac[start + e, b] + k.jac[start + width + e, b])
                    out += normal * x[t.row_place[start + e]]
                return out
        for at in range(t.row_start[i], t.row_start[i + 1]):
            out += k.jac[at, b] * x[t.row_place[at]]
        return out

    @wp.func
    def weigh(t: Topology, k: Work, d: Slopes, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        """p and q of the acting rows, and which of them slide."""
        for r in range(n):
            i = k.active[r, b]
            e = nt.smooth(t, params, row, i, k.z[i, b])
            k.p[i, b] = e[2]
            k.slack[i, b] = e[3]
            d.slides[b, r] = 0
        if wp.static(residual == "hard"):
            if t.coulomb == 1:
                for r in range(n):
                    i = k.active[r, b]
                    if t.row_kind[i] == CONTACT and t.row_sign[i] != 0:
                        first = partner(t, i)
                        if k.lam[first, b] * k.lam[first + 1, b] == ZERO:
                            d.slides[b, r] = 1

    @wp.func
    def assemble(t: Topology, k: Work, d: Slopes, b: int, n: int):
        """M + J' W C of the acting rows: the lower envelope in k.factor, the upper one in d.upper."""
        for i in range(t.nv):
            at = t.at[i]
            for j in range(t.first[i], i + 1):
                m = dtype(0.0)
                if j >= t.mass_first[i]:
                    m = k.mass[t.mass_at[i] + j, b]
                k.factor[at + j, b] = m
                d.upper[b, at + j] = m
        for r in range(n):
            i = k.active[r, b]
            p = k.p[i, b]
            weight = p / (k.slack[i, b] * k.scale[i, b] + TAU * k.diag[i, b] * p)
            start = t.row_start[i]
            count = t.row_start[i + 1] - start
            other = start
            if d.slides[b, r] == 1:
                other = t.row_start[partner(t, i)]
            for one in range(count):
                left = weight * k.jac[start + one, b]
                place = t.row_place[start + one]
                for two in range(count):
                    right = k.jac[start + two, b]
                    if d.slides[b, r] == 1:
                        right = HALF * (k.jac[other + two, b] + k.jac[other + count + two, b])
                    where = t.row_place[start + two]
                    if where <= place:
                        slot = t.at[place] + where
                        k.factor[slot, b] = k.factor[slot, b] + left * right
                    if where >= place:
                        slot = t.at[where] + place
                        d.upper[b, slot] = d.upper[b, slot] + left * right

    @wp.func
    def eliminate(t: Topology, k: Work, d: Slopes, b: int):
        """L U without pivoting: L below the diagonal of k.factor, U with 1/U_ii on its own in d.upper."""
        for i in range(t.nv):
            at = t.at[i]
            begin = t.first[i]
            pivot = d.upper[b, at + i]
            for j in range(begin, i):
                other = t.at[j]
                low = k.factor[at + j, b]
                up = d.upper[b, at + j]
                for e in range(wp.max(begin, t.first[j]), j):
                    low -= k.factor[at + e, b] * d.upper[b, other + e]
                    up -= k.factor[other + e, b] * d.upper[b, at + e]
                low = low * d.upper[b, other + j]
                k.factor[at + j, b] = low
                d.upper[b, at + j] = up
                pivot -= low * up
            if wp.abs(pivot) < SMALLEST:
                pivot = ZERO + SMALLEST
            d.upper[b, at + i] = ONE / pivot

    @wp.func
    def factor(t: Topology, k: Work, d: Slopes, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        if wp.static(contacts):
            weigh(t, k, d, params, row, b, n)
            if wp.static(residual == "hard"):
                if t.coulomb == 1:
                    assemble(t, k, d, b, n)
                    eliminate(t, k, d, b)
                    return
            nt.factor(t, k, b, n, YIELDS)

    @wp.func
    def lower_upper(t: Topology, k: Work, d: Slopes, b: int, x: wp.array(dtype=Lanes)):
        for i in range(t.nv):
            at = t.at[i]
            value = x[i]
            for e in range(t.first[i], i):
                value -= k.factor[at + e, b] * x[e]
            x[i] = value
        for back in range(t.nv):
            i = t.nv - 1 - back
            at = t.at[i]
            value = d.upper[b, at + i] * x[i]
            x[i] = value
            for e in range(t.first[i], i):
                x[e] = x[e] - d.upper[b, at + e] * value

    @wp.func
    def symmetric(
        m: wp.array2d(dtype=dtype), first: wp.array(dtype=int), at: wp.array(dtype=int), n: int, b: int,
        x: wp.array(dtype=Lanes),
    ):  # fmt: skip
        """(L L')^-1 x in place, L of `envelope.py`."""
        for i in range(n):
            row = at[i]
            value = x[i]
            for e in range(first[i], i):
                value -= m[row + e, b] * x[e]
            x[i] = m[row + i, b] * value
        for back in range(n):
            i = n - 1 - back
            row = at[i]
            value = m[row + i, b] * x[i]
            x[i] = value
            for e in range(first[i], i):
                x[e] = x[e] - m[row + e, b] * value

    @wp.func
    def substitute(t: Topology, k: Work, d: Slopes, b: int, x: wp.array(dtype=Lanes)):
        """The factor's inverse times x, in place."""
        if wp.static(residual == "hard"):
            if t.coulomb == 1:
                lower_upper(t, k, d, b, x)
                return
        if wp.static(contacts):
            symmetric(k.factor, t.first, t.at, t.nv, b, x)
        else:
            symmetric(k.mass_factor, t.mass_first, t.mass_at, t.nv, b, x)

    @wp.func
    def take_momentum(t: Topology, k: Work, b: int, x: wp.array(dtype=Lanes), out: wp.array(dtype=Lanes)):
        """out -= M x"""
        for i in range(t.nv):
            at = t.mass_at[i]
            xi = x[i]
            value = k.mass[at + i, b] * xi
            for j in range(t.mass_first[i], i):
                m = k.mass[at + j, b]
                value += m * x[j]
                out[j] = out[j] - m * xi
            out[i] = out[i] - value

    @wp.func
    def settled(t: Topology, x: wp.array(dtype=Lanes), change: wp.array(dtype=Lanes)):
        """x += change; 1 if that was little of every column."""
        size = Lanes()
        moved = Lanes()
        for i in range(t.nv):
            value = x[i] + change[i]
            x[i] = value
            size = wp.max(size, wp.abs(value))
            moved = wp.max(moved, wp.abs(change[i]))
        good = int(1)
        for lane in range(wp.static(len(Lanes()))):
            if not (moved[lane] <= SMALL * size[lane]):
                good = 0
        return good

    @wp.func
    def solve(t: Topology, k: Work, d: Slopes, b: int, n: int):
        known = d.known[b]
        side = d.side[b]
        found = d.found[b]
        for i in range(t.nv):
            side[i] = known[i]
            found[i] = Lanes()
        for r in range(n):
            i = k.active[r, b]
            p = k.p[i, b]
            total = k.slack[i, b] + TAU * p * k.diag[i, b] / k.scale[i, b]
            add(t, k, b, i, side, (p / (total * k.scale[i, b])) * d.given[b, r])
            d.root[b, r] = Lanes()
        more = int(1)
        while more <= REFINEMENTS:
            substitute(t, k, d, b, side)
            done = settled(t, found, side)
            if done == 1 or more == REFINEMENTS or n == 0:
                return
            for r in range(n):  # what is left of F2 once dz follows is the proximal term's
                i = k.active[r, b]
                own = TAU * k.p[i, b] * k.diag[i, b] / k.scale[i, b]
                change = (d.given[b, r] - rate(t, k, d, b, r, i, side)) / (k.slack[i, b] + own)
                d.root[b, r] = d.root[b, r] + change
                d.given[b, r] = own * change
            for i in range(t.nv):
                side[i] = known[i]
            take_momentum(t, k, b, found, side)
            for r in range(n):
                i = k.active[r, b]
                p = k.p[i, b]
                total = k.slack[i, b] + TAU * p * k.diag[i, b] / k.scale[i, b]
                add(t, k, b, i, side, (p / k.scale[i, b]) * (d.root[b, r] + d.given[b, r] / total))
            more += 1

    @wp.func
    def response(t: Topology, k: Work, b: int, i: int):
        """k.move = M^-1 J_i' in the places of the groups that row i moves."""
        for side in range(2):
            start = t.row_trees[4 * i + 2 * side]
            end = t.row_trees[4 * i + 2 * side + 1]
            for j in range(start, end):
                k.move[j, b] = ZERO
            for at in range(t.row_start[i], t.row_start[i + 1]):
                p = t.row_place[at]
                if p >= start and p < end:
                    k.move[p, b] = k.jac[at, b]
            env.forward(k.mass_factor, t.mass_first, t.mass_at, k.move, start, end, b)
            for back in range(end - start):
                j = end - 1 - back
                at = t.mass_at[j]
                value = k.move[j, b] * k.mass_factor[at + j, b]
                k.move[j, b] = value
                for e in range(t.mass_first[j], j):
                    k.move[e, b] = k.move[e, b] - k.mass_factor[at + e, b] * value

    @wp.func
    def inverse(t: Topology, k: Work, b: int, p: int):
        """(M^-1)_pp"""
        for i in range(t.nv):
            k.move[i, b] = wp.where(i == p, ONE, ZERO)
        env.solve(k.mass_factor, t.mass_first, t.mass_at, k.move, t.nv, b)
        return k.move[p, b]

    return SimpleNamespace(factor=factor, solve=solve, response=response, add=add, rate=rate, inverse=inverse)
