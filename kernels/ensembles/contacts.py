"""Contacts of a step as measures read them: as vectors over the pairs, or in memory."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached

TOUCH = 1e-6  # impulse above which a contact counts as one [N s]
FAR = 1e300  # distance where there is none [m]


@cached
def make_contacts(pairs: int) -> SimpleNamespace:
    """Contacts of a step as vectors over the pairs."""
    VP = wp.types.vector(max(pairs, 1), wp.float64)

    @wp.struct
    class Contacts:
        impulse: VP  # normal [N s]
        distance: VP  # [m], with `Users.gaps`

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

    return SimpleNamespace(Contacts=Contacts, none=none, push=push, impulse=impulse, gap=gap)


@cached
def make_listed_contacts() -> SimpleNamespace:
    """Contacts of a step in memory, of any number of pairs."""

    @wp.struct
    class Contacts:
        impulse: wp.array(dtype=wp.float64)  # (pairs,) normal [N s]
        distance: wp.array(dtype=wp.float64)  # (pairs,) [m], with `Users.gaps`
        on: int  # 0: nothing touches

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

    return SimpleNamespace(Contacts=Contacts, push=push, impulse=impulse, gap=gap)
