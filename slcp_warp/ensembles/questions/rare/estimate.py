"""What independent islands say of the share of failures, by the particles of all their levels.

An island's share of what is below the level before, times the share of a level's particles that fail, has the
share of failures as its mean: every level has an estimate, the first by counting plain worlds. That of the
lowest level that met a failure scatters least, and is the one that is reported.

Chains come only to what the margin leads to, but a plain world fails with just the probability that is
wanted, wherever failing lies: a count of the islands' plain worlds bounds it whatever the margin says. That
bound is the upper end where levels did not lead to failing: where no world failed, and where half of the
islands or more came down without meeting one, so that the others met theirs by chance. A level above whose
own interval lies wholly beyond that of the estimate has met failures that its chains lost again; then its
upper end holds.
"""

from dataclasses import dataclass

import numpy as np

from ...statistics.intervals import share_interval
from .interval import island_interval
from .splitting import Islands

LED = 0.5  # share of the islands that meet failing worlds, below which the levels do not lead there


@dataclass(frozen=True)
class Estimate:
    """A share with its 95 % interval.

    Attributes:
        share, low, high: the estimate and its interval.
        islands: (islands,) their own estimates.
        plain: upper end by the plain worlds alone.
        led: upper end by the lowest level that was reached, right if the margin leads to all that fails.
        jumps: whether worlds failed that the levels did not lead to.
    """

    share: float
    low: float
    high: float
    islands: np.ndarray
    plain: float
    led: float
    jumps: bool


def estimate(found: Islands, alone: bool = False) -> Estimate:
    """Of islands; `alone`: failures may lie where no level leads, so that plain worlds alone bound them."""
    last = len(found.totals) - 1
    islands = found.failing.shape[1]
    own = [found.failed(k) for k in range(last + 1)]
    share, low, plain = share_interval(int(found.failing[0].sum()), islands * int(found.totals[0]))
    met = [k for k in range(last + 1) if own[k].any()]
    deepest, high = met[-1] if met else 0, plain
    if met and last > 0:  # else plain worlds are counted: islands that are all alike would say nothing
        share, low, high = island_interval(own[deepest])
    ends = [island_interval(own[k]) for k in met[:-1]]
    beyond = [above for _, below, above in ends if below > high]
    chance = float((own[deepest] > 0.0).mean()) <= LED
    high = max([high, *beyond, *([plain] if alone or chance else [])])
    jumps = bool(met) and (chance or bool(beyond) or deepest < last)
    reached = [found.reached(k) for k in range(last + 1) if found.reached(k).any()]
    led = island_interval(reached[-1])[2] if reached else 1.0
    return Estimate(share, low, high, own[deepest], plain, led, jumps)
