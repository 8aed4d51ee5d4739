"""A contact problem by its groups of rows: those of bodies that neither touch nor hang together are apart.

Rows are coupled by A = J M^-1 J': where both move dofs that M couples (a tree, or trees tied by dampers), or
over other rows in the system. Every group is a problem of its own, solved to what *its* data set: beside a
body at 1 km/s the residual of one at rest would count for nothing, in float32 from some m/s on.
"""

import warp as wp

from ..contact.problem import make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..status import NONFINITE, NOT_CONVERGED, SOLVED
from ..structure import Structure


def blocks_of_rows(s: Structure) -> tuple[list[int], list[set[int]]]:
    """The block of M of every dof, named by its first dof, and the blocks that every row's J touches."""
    block = list(range(s.nv))
    for i in range(s.nv):
        for j in range(i):
            if s.coupled(i, j):
                block = [block[j] if b == block[i] else b for b in block]
    rows = []
    for row in s.rows:
        dofs = [row.index]
        if row.kind == "contact":
            pair = s.pairs[row.index]
            bodies = [s.shapes[shape].body for shape in (pair.shape_a, pair.shape_b)]
            dofs = [j for j in range(s.nv) if any(s.in_chain(body, j) for body in bodies)]
        rows.append({block[j] for j in dofs})
    return block, rows


@cached
def make_group_solver(spec: Specialisation) -> wp.Function:
    """As the law's `make_solver`. Where one block is in all rows, or the law takes the system as a whole, it
    is the law's own.
    """
    s, dtype, method = spec
    law = law_of(method, s.nr)
    solve = law.make_solver(spec)
    block, blocks = blocks_of_rows(s)
    if law.whole or set.intersection(*blocks):
        return solve
    Problem = make_problem(s, dtype)
    t = make_rows(spec).types
    VR, NR = t.VR, s.nr
    near = tuple(sum(1 << j for j in range(NR) if blocks[i] & blocks[j]) for i in range(NR))
    moves = tuple(sum(1 << i for i in range(NR) if block[j] in blocks[i]) for j in range(s.nv))

    @wp.func
    def group_of(rows: int):
        """The first of the rows, with all that they couple to it."""
        group = rows & (-rows)
        before = int(0)
        while before != group:
            before = group + 0
            for i in range(wp.static(NR)):
                if (before & wp.static(1 << i)) != 0:
                    group = group | (rows & wp.static(near[i]))
        return group

    @wp.func
    def solve_groups(world: t.World, problem: Problem, warm: VR):
        v = problem.vfree
        z = warm
        lam = VR()
        status = int(wp.static(SOLVED))
        iterations = int(0)
        left = int(problem.mask)
        while left != 0:
            part = problem
            part.mask = group_of(left)
            left = left - part.mask
            v_part, z_part, lam_part, ended, count = wp.static(solve)(world, part, warm)
            iterations += count
            for j in range(wp.static(s.nv)):
                if (part.mask & wp.static(moves[j])) != 0:
                    v[j] = v_part[j]
            for i in range(wp.static(NR)):
                if (part.mask & wp.static(1 << i)) != 0:
                    z[i] = z_part[i]
                    lam[i] = lam_part[i]
            if status <= wp.static(NOT_CONVERGED) and ended != wp.static(SOLVED):
                status = ended  # what is proved of a part holds of the whole
            if ended == wp.static(NONFINITE):
                status = ended
        return v, z, lam, status, iterations

    return solve_groups
