"""Contacts of a step as measures read them: as vectors over the pairs, or in memory."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached

TOUCH = 1e-6  # impulse above which a contact counts as one [N s]
FAR = 1e300  # distance where there is none [m]


@cached
def make_contacts(pairs: int, slips: bool, rubs: bool, tendons: int = 0) -> SimpleNamespace:
    """Contacts of a step as vectors over the pairs; `slips`: how fast they slide is among them; `rubs`: their
    tangential impulses are; beside them the forces of so many tendons.
    """
    VP = wp.types.vector(max(pairs, 1), wp.float64)
    VS = wp.types.vector(max(pairs if slips else 0, 1), wp.float64)
    VT = wp.types.vector(max(pairs if rubs else 0, 1), wp.float64)
    VF = wp.types.vector(max(tendons, 1), wp.float64)

    @wp.struct
    class Contacts:
        impulse: VP  # normal [N s]
        distance: VP  # [m], with `Users.gaps`
        slip: VS  # [m/s] of what pushes, with `Users.slips`
        rub: VT  # tangential impulse [N s], with `Users.rubs`
        pull: VF  # of tendons [N, N m], with `Users.pulls`

    @wp.func
    def none():
        """Nothing touches."""
        c = Contacts()
        for p in range(pairs):
            c.distance[p] = wp.float64(FAR)
        return c

    @wp.func
    def push(c: Contacts, first: int, end: int):
        most = wp.float64(0.0)
        for p in range(pairs):
            if p >= first and p < end:
                most = wp.max(most, c.impulse[p])
        return most

    @wp.func
    def impulse(c: Contacts, first: int, end: int):
        total = wp.float64(0.0)
        for p in range(pairs):
            if p >= first and p < end:
                total += c.impulse[p]
        return total

    @wp.func
    def gap(c: Contacts, first: int, end: int):
        least = wp.float64(FAR)
        for p in range(pairs):
            if p >= first and p < end:
                least = wp.min(least, c.distance[p])
        return least

    @wp.func
    def slip(c: Contacts, first: int, end: int):
        fastest = wp.float64(0.0)
        for p in range(wp.static(pairs if slips else 0)):
            if p >= first and p < end:
                fastest = wp.where(wp.abs(c.slip[p]) > wp.abs(fastest), c.slip[p], fastest)
        return fastest

    @wp.func
    def rub(c: Contacts, first: int, end: int):
        total = wp.float64(0.0)
        for p in range(wp.static(pairs if rubs else 0)):
            if p >= first and p < end:
                total += c.rub[p]
        return total

    @wp.func
    def pull(c: Contacts, tendon: int):
        return c.pull[tendon]

    return SimpleNamespace(
        Contacts=Contacts, none=none, push=push, impulse=impulse, gap=gap, slip=slip, rub=rub, pull=pull
    )


@cached
def make_listed_contacts() -> SimpleNamespace:
    """Contacts of a step in memory, of any number of pairs."""

    @wp.struct
    class Contacts:
        impulse: wp.array(dtype=wp.float64)  # (pairs,) normal [N s]
        distance: wp.array(dtype=wp.float64)  # (pairs,) [m], with `Users.gaps`
        slip: wp.array(dtype=wp.float64)  # (pairs,) [m/s] of what pushes, with `Users.slips`
        rub: wp.array(dtype=wp.float64)  # (pairs,) tangential impulse [N s], with `Users.rubs`
        pull: wp.array(dtype=wp.float64)  # (tendons,) [N, N m], with `Users.pulls`
        on: int  # 0: nothing touches or pulls

    @wp.func
    def push(c: Contacts, first: int, end: int):
        most = wp.float64(0.0)
        for p in range(first, end * c.on):
            most = wp.max(most, c.impulse[p])
        return most

    @wp.func
    def impulse(c: Contacts, first: int, end: int):
        total = wp.float64(0.0)
        for p in range(first, end * c.on):
            total += c.impulse[p]
        return total

    @wp.func
    def gap(c: Contacts, first: int, end: int):
        least = wp.float64(FAR)
        for p in range(first, end * c.on):
            least = wp.min(least, c.distance[p])
        return least

    @wp.func
    def slip(c: Contacts, first: int, end: int):
        fastest = wp.float64(0.0)
        for p in range(first, end * c.on):
            fastest = wp.where(wp.abs(c.slip[p]) > wp.abs(fastest), c.slip[p], fastest)
        return fastest

    @wp.func
    def rub(c: Contacts, first: int, end: int):
        total = wp.float64(0.0)
        for p in range(first, end * c.on):
            total += c.rub[p]
        return total

    @wp.func
    def pull(c: Contacts, tendon: int):
        if c.on == 0:
            return wp.float64(0.0)
        return c.pull[tendon]

    return SimpleNamespace(
        Contacts=Contacts, push=push, impulse=impulse, gap=gap, slip=slip, rub=rub, pull=pull
    )
