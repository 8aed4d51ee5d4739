"""How fast the shapes of a pair slide along each other, J_t v', which rows have but with friction in it."""

import warp as wp

from ..contact.rows import make_pair_jacobian
from ..contact.shapes import make_pair
from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..specialisation import Specialisation
from .solution import make_solution


@cached
def make_slips(spec: Specialisation) -> wp.Function:
    """slips(world, q, v, normal, wanted) -> a vector over the pairs [m/s]: J_t v (M6) at q of those whose
    bits `wanted` has, 0 of the others.

    `normal` are normals to look for each pair's from, those of the step.
    """
    s, dtype, method = spec
    solution, mech = make_solution(s, dtype), make_mechanism(s, dtype)
    t, VN = solution.types, solution.VN
    V2, VP = wp.types.vector(2, dtype), wp.types.vector(max(len(s.pairs), 1), dtype)
    pairs = tuple(make_pair(s, k, dtype) for k in range(len(s.pairs)))
    geometries = tuple(pair.local_geometry if method.fast else pair.geometry for pair in pairs)
    jacobians = tuple(make_pair_jacobian(s, k, dtype) for k in range(len(s.pairs)))

    @wp.func
    def slips(world: t.World, q: t.VQ, v: t.VQ, normal: VN, wanted: int):
        out = VP()
        if wanted == 0:
            return out
        pose = wp.static(mech.pose)(world, q)
        for k in range(wp.static(len(s.pairs))):
            if (wanted & wp.static(1 << k)) != 0:
                warm = V2(normal[wp.static(2 * k)], normal[wp.static(2 * k + 1)])
                g = wp.static(geometries[k])(world, pose.frames, warm)
                jac = wp.static(jacobians[k])(world, pose.frames, g)
                for j in range(wp.static(s.nv)):
                    out[k] = out[k] + jac[1, j] * v[j]
        return out

    return slips
