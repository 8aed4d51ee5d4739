"""Rules to stop a comparison of successes: `python -m slcp_warp.scripts.studies.stopping_rules`.

Worlds in which the first of two policies succeeds alone, or the second does, are drawn with known shares.
Printed are, of rules that promise 5 % of errors at all looks together, the median of the worlds that a
decision takes and, of equals, the share decided wrongly; and the worlds that a fixed design of 80 % power
would need.
"""

import math
from collections.abc import Callable

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from slcp_warp.ensembles.statistics.moments import Z95
from slcp_warp.ensembles.statistics.sequential import EXPECTED

from ..support.screen import console

Rule = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
REPETITIONS, BATCH, MOST, ERROR = 2000, 256, 65536, 0.05
PAIRS = ((0.08, 0.02), (0.05, 0.03), (0.01, 0.001), (0.015, 0.01), (0.02, 0.02), (0.002, 0.002))
POWER = 0.8416  # normal quantile of 80 %
STAKES = np.geomspace(1e-3, 0.9, 24)


def beta_rule(a: float) -> Rule:
    """Robbins's mixture of the sign of pairs that differ, under Beta(a, a); a = 1: even bets."""
    from scipy.special import betaln

    def rule(gained: np.ndarray, lost: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        log = betaln(a + gained, a + lost) - betaln(a, a) + (gained + lost) * math.log(2.0)
        return np.asarray(log >= math.log(1.0 / ERROR))

    return rule


def stakes_rule(gained: np.ndarray, lost: np.ndarray, worlds: np.ndarray) -> np.ndarray:
    """Bets whose sizes are spaced evenly by their logarithm."""
    stakes = np.concatenate([-STAKES, STAKES])
    log = gained[..., None] * np.log1p(stakes) + lost[..., None] * np.log1p(-stakes)
    most = log.max(axis=-1)
    return most + np.log(np.exp(log - most[..., None]).mean(axis=-1)) >= math.log(1.0 / ERROR)


def asymptotic_rule(gained: np.ndarray, lost: np.ndarray, worlds: np.ndarray) -> np.ndarray:
    """The asymptotic confidence sequence of the mean difference."""
    mean = (gained - lost) / worlds
    variance = (gained + lost) / worlds - mean**2
    log = -2.0 * math.log(ERROR)
    rho = (log + math.log(log + 1.0)) / EXPECTED
    inside = (worlds * rho + 1.0) / (worlds**2 * rho) * (np.log(worlds * rho + 1.0) + log)
    return (np.abs(mean) > np.sqrt(variance * inside)) & (gained + lost > 0)


def rules() -> dict[str, Rule]:
    """Those that are compared, by name."""
    return {
        "even bets": beta_rule(1.0), "Beta(5, 5)": beta_rule(5.0), "Beta(20, 20)": beta_rule(20.0),
        "bets by logarithm": stakes_rule, "asymptotic": asymptotic_rule,
    }  # fmt: skip


def fixed(gain: float, loss: float) -> float:
    """Worlds of a fixed design that finds the difference with a probability of 80 %."""
    apart = gain - loss
    return ((Z95 + POWER) / apart) ** 2 * (gain + loss - apart**2)


def row(gain: float, loss: float, rng: np.random.Generator) -> list[str]:
    """What the rules come to, of pairs with these shares."""
    size = (REPETITIONS, MOST // BATCH)
    counts = rng.multinomial(BATCH, [gain, loss, 1.0 - gain - loss], size=size).cumsum(axis=1)
    worlds = BATCH * np.arange(1, size[1] + 1)
    out = [f"{100 * gain:g} %, {100 * loss:g} %", "" if gain == loss else f"{fixed(gain, loss):,.0f}"]
    for rule in rules().values():
        stops = rule(counts[..., 0], counts[..., 1], worlds)
        ever = stops.any(axis=1)
        took = np.where(ever, worlds[stops.argmax(axis=1)], MOST)
        out.append(f"{100 * ever.mean():.1f} % wrong" if gain == loss else f"{np.median(took):,.0f}")
    return out


def main() -> None:
    """Draw, print the table."""
    rng = np.random.default_rng(0)
    table = Table(title="worlds that a decision takes (median)", box=SIMPLE_HEAD)
    for heading in ("first alone, second alone", "fixed, 80 %", *rules()):
        table.add_column(heading, justify="left" if heading.startswith("first") else "right")
    for gain, loss in PAIRS:
        table.add_row(*row(gain, loss, rng))
    console.print(table)


if __name__ == "__main__":
    main()
