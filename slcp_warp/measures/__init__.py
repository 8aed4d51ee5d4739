"""Measures: a number of every world, computed while it runs: a reduction of a signal over the steps.

    measures.final("block.x")                       the last value
    measures.rate("ellipse.angle", start=10.0)      change per second from t = 10 s on
    measures.share_of_time(measures.contact() > 0)  share of the steps in which something touches
    measures.final("block.x").between(0.95, 1.05)   a success
    measures.excursion(measures.state("block.x", minus="cart.shift"))    how far it slid on the cart

    measures.integral(abs(measures.slip("left/box")))    how far they slid while they touched
    measures.mean("cart.vshift", where=measures.contact("cart/box") > 0)    of the steps in which they touch

A text or a whole number stands for a component of the state. `start` and `end` are times [s]: only what lies
between them counts, and of that the steps in which a condition `where` holds.
"""

from .reductions import (
    Measure,
    Success,
    change,
    contact_share,
    cost,
    count,
    excursion,
    final,
    first_time,
    impulse,
    initial,
    integral,
    largest,
    lowest_gap,
    mean,
    rate,
    rms,
    settled,
    share_of_time,
    smallest,
    total,
)
from .signals import (
    contact,
    control,
    cosine,
    distance,
    function,
    gap,
    normal_force,
    normal_impulse,
    point,
    since_start,
    slip,
    state,
    tangential_force,
    tangential_impulse,
    tendon_force,
    time,
)

__all__ = [
    "Measure",
    "Success",
    "change",
    "contact",
    "contact_share",
    "control",
    "cosine",
    "cost",
    "count",
    "distance",
    "excursion",
    "final",
    "first_time",
    "function",
    "gap",
    "impulse",
    "initial",
    "integral",
    "largest",
    "lowest_gap",
    "mean",
    "normal_force",
    "normal_impulse",
    "point",
    "rate",
    "rms",
    "settled",
    "share_of_time",
    "since_start",
    "slip",
    "smallest",
    "state",
    "tangential_force",
    "tangential_impulse",
    "tendon_force",
    "time",
    "total",
]
