"""What a step takes over from the last one, and what it leaves: the structs of its stages."""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD, make_problem
from ..factories import cached
from ..mechanism.kinematics import make_types
from ..status import SOLVED
from ..structure import Structure


@cached
def make_solution(s: Structure, dtype: type) -> SimpleNamespace:
    """The structs `Carry` and `Solution`, and functions on them: split(x) -> q, v; cold_carry();
    unsolved(start, vfree, z, normal) -> the contact problem of another free velocity; posed(solution) -> the
    `Problem` that it solves.
    """
    t = make_types(s, dtype)
    VQ, VX, VR, MQ, JR = t.VQ, t.VX, t.VR, t.MQ, t.JR
    VN = wp.types.vector(2 * max(len(s.pairs), 1), dtype)
    Problem = make_problem(s, dtype)
    UNUSED = dtype(COLD)

    @wp.struct
    class Carry:
        z: VR  # multipliers of the last step, COLD where a row did not act
        normal: VN  # normals of the last step, (2 pair, 2 pair + 1)

    @wp.struct
    class Solution:
        v: VQ  # v' [rad/s, m/s]
        drift: VQ  # v*, where positions move with another velocity than v'
        lam: VR  # impulses
        z: VR
        rate: VR  # d/h
        scale: VR  # D
        sigma: VR  # noise levels, where they depend on the state
        jac: JR
        minv: MQ
        vfree: VQ
        acceleration: VQ  # at the start of the step, with the predicted contact forces
        push: VQ  # M^-1 J' lambda of the predictor
        unpushed: VQ  # v_free without contact forces
        mask: int  # bit i: row i is in the system
        normal: VN
        status: int

    @wp.func
    def split(x: VX):
        q = VQ()
        v = VQ()
        for j in range(wp.static(s.nv)):
            q[j] = x[j]
            v[j] = x[wp.static(s.nv + j)]
        return q, v

    @wp.func
    def cold_carry():
        out = Carry()
        for i in range(wp.static(s.nr)):
            out.z[i] = UNUSED
        return out

    @wp.func
    def unsolved(start: Solution, vfree: VQ, z: VR, normal: VN):
        out = Solution()
        out.minv = start.minv
        out.vfree = vfree
        out.acceleration = start.acceleration
        out.v = vfree
        out.z = z
        out.normal = normal
        out.status = wp.static(SOLVED)
        return out

    @wp.func
    def posed(sol: Solution):
        out = Problem()
        out.minv = sol.minv
        out.vfree = sol.vfree
        out.jac = sol.jac
        out.rate = sol.rate
        out.scale = sol.scale
        out.sigma = sol.sigma
        out.mask = sol.mask
        return out

    return SimpleNamespace(
        types=t,
        VN=VN,
        Carry=Carry,
        Solution=Solution,
        Problem=Problem,
        split=split,
        cold_carry=cold_carry,
        unsolved=unsolved,
        posed=posed,
    )
