"""How many times less a program costs than another at equal step and at equal error, from results alone."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.storage.files import write_text

Rows = list[dict[str, Any]]
OURS = "slcp-warp"
LEAST = 1e-15  # error that counts as none
GOALS = (15.0, 10.0)  # times less CPU than MuJoCo: at equal step, at equal error
SAME_STEP = ("Coulomb", "Coulomb, float32", "Anitescu")  # our curves that stand beside peers at equal step
ABOUT = """Equal step: over all step sizes, beside our curves "Coulomb" (exact friction; float64 and float32)
and "Anitescu" (relaxed, convex; float64), all hard and Euler. Equal error: over the points of the
peer's curve that none of its own betters, beside our cheapest curve that misses no contact, its cost
interpolated between our step sizes. One thread where a program allows it. "Other model": the peer's
distances or normals of two ellipses are not the scene's. Our penetration: "Coulomb"."""
SKIPPED = ("scaling", "sweep", "bias")  # studies without peers or errors against cost


@dataclass(frozen=True)
class Comparison:
    """Ours beside a curve of a peer.

    Attributes:
        study, problem, program, curve: whose they are.
        equal_step: for each of SAME_STEP, the peer's cost over ours at every step size that both have.
        equal_error: for every point of the peer that no other of its curve betters, (its error, its cost, its
            cost over our least cost at that error, 0 where we do not reach it).
    """

    study: str
    problem: str
    program: str
    curve: str
    equal_step: dict[str, list[float]]
    equal_error: list[tuple[float, float, float]]

    @property
    def worst(self) -> tuple[float, float, float]:
        """The point of `equal_error` where we are least ahead."""
        return min(self.equal_error, key=lambda point: point[2])

    @property
    def finest(self) -> tuple[float, float, float]:
        """The point of `equal_error` with the peer's least error."""
        return min(self.equal_error)


def points(rows: Rows) -> list[tuple[float, float]]:
    """(error, seconds) in the order of the knob; errors that are not finite left out."""
    found = [
        (float(r["value"]), float(r["error"]), float(r["seconds"])) for r in rows if r.get("error", "") != ""
    ]
    return [(max(error, LEAST), seconds) for _, error, seconds in sorted(found) if math.isfinite(error)]


def undominated(curve: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points than which no other of the curve is both cheaper and at least as accurate."""
    return [(e, s) for e, s in curve if not any(other <= e and less < s for other, less in curve)]


def cost_of_error(curve: list[tuple[float, float]], error: float) -> float:
    """Least cost at which a curve of (error, seconds) reaches an error; infinite if it never does.

    Between neighbours the cost is interpolated, logarithm over logarithm; nothing is extrapolated.
    """
    least = min((seconds for e, seconds in curve if e <= error), default=math.inf)
    for (e0, s0), (e1, s1) in zip(curve[:-1], curve[1:]):
        if min(e0, e1) <= error <= max(e0, e1) and e0 != e1:
            share = math.log(error / e0) / math.log(e1 / e0)
            least = min(least, s0 * (s1 / s0) ** share)
    return least


def groups(rows: Rows, *names: str) -> dict[tuple[Any, ...], Rows]:
    """Rows by their values in the columns, in the order they come."""
    found: dict[tuple[Any, ...], Rows] = {}
    for row in rows:
        found.setdefault(tuple(row.get(name, "") for name in names), []).append(row)
    return found


def sound(row: dict[str, Any]) -> bool:
    """Whether nothing passed through anything, and every world was solved."""
    return (row.get("missed") or 0) == 0 and row.get("solved_share", "") in ("", 1, 1.0)


def compare(rows: Rows) -> list[Comparison]:
    """Every curve of a peer beside ours, by study and problem.

    Of ours only points that are `sound` reach an error.
    """
    out = []
    for (study, problem), part in groups(rows, "study", "problem").items():
        own = [row for row in part if row["program"] == OURS]
        if study in SKIPPED or not own:
            continue
        ours = [points([row for row in curve if sound(row)]) for curve in
                groups(own, "curve", "sigma" if study == "derivatives" else "curve").values()]  # fmt: skip
        at_step = {(row["curve"], row["value"]): float(row["seconds"]) for row in own}
        peers = groups([row for row in part if row["program"] != OURS], "program", "curve")
        for (program, curve), theirs in peers.items():
            step = {name: [float(row["seconds"]) / at_step[name, row["value"]] for row in theirs
                           if (name, row["value"]) in at_step] for name in SAME_STEP}  # fmt: skip
            error = [(e, s, s / min((cost_of_error(o, e) for o in ours), default=math.inf))
                     for e, s in undominated(points(theirs))]  # fmt: skip
            out.append(Comparison(study, problem, program, curve, step, error))
    return out


# -------------------------------------------------------------------- the table


def figure(value: float, digits: int = 3) -> str:
    """A number without an exponent where it is large."""
    return f"{value:.0f}" if value >= 10.0**digits else f"{value:.{digits}g}"


def span(values: Iterable[float]) -> str:
    """Least and largest of some ratios, or a dash."""
    found = list(values)
    if not found:
        return "-"
    low, high = figure(min(found)), figure(max(found))
    return low if low == high else f"{low} - {high}"


def extremes(rows: Rows) -> str:
    """Deepest penetration [mm] and contacts passed through."""
    depth = max((float(row["penetration"]) for row in rows if row.get("penetration", "") != ""), default=0.0)
    missed = sum(int(row.get("missed") or 0) for row in rows)
    return (f"{figure(1e3 * depth, 2)} mm" if depth > 1e-9 else "none") + (
        f", {missed} missed" if missed else ""
    )


def table(rows: Rows) -> list[str]:
    """Lines of the contact study's table: a line per problem and curve of a peer."""
    part = [row for row in rows if row["study"] == "contact"]
    lines = [
        "| problem | peer | equal step, Coulomb | float32 | Anitescu | equal error | peer's least error | "
        "there | deepest: peer | ours |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for c in compare(part):
        here = [row for row in part if row["problem"] == c.problem]
        theirs = [row for row in here if row["curve"] == c.curve]
        own = [row for row in here if row["program"] == OURS and row["curve"] == "Coulomb"]
        steps = " | ".join(span(c.equal_step[name]) for name in SAME_STEP)
        if c.equal_error:
            error, _, ratio = c.finest
            ahead = " (behind)" if c.worst[2] < 1.0 else ""
            errors = f"{span(r for *_, r in c.equal_error)}{ahead} | {error:.2g} | "
            errors += figure(ratio) if ratio > 0.0 else "not reached"
        else:
            errors = "- | none finite | -"
        other = any(str(row.get("note", "")).startswith("MODEL DIFFERS") for row in theirs)
        cells = (
            c.problem,
            c.curve + " (other model)" * other,
            steps,
            errors,
            extremes(theirs),
            extremes(own),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def behind(rows: Rows) -> list[str]:
    """A line for every curve of a peer that reaches some error at less cost than all of ours."""
    lines = []
    for c in compare(rows):
        if c.equal_error and c.worst[2] < 1.0:
            error, seconds, ratio = c.worst
            where = f"{c.curve} on {c.problem}: error {error:.2g} at {1e6 * seconds:.3g} us"
            lines.append(
                f"{where}; ours does not reach it"
                if ratio == 0.0
                else f"{where}; ours costs {1 / ratio:.2g} times that"
            )
    return lines


def short(rows: Rows, program: str = "MuJoCo") -> list[str]:
    """A line for every problem on which a goal beside a program is not reached at every step or error."""
    lines = []
    found: dict[str, list[Comparison]] = {}
    for c in compare([row for row in rows if row["study"] == "contact"]):
        if c.program == program:
            found.setdefault(c.problem, []).append(c)
    for problem, curves in found.items():
        cases = {f"step, {name}": [r for c in curves for r in c.equal_step[name]] for name in SAME_STEP}
        cases["error"] = [ratio for c in curves for *_, ratio in c.equal_error]
        for what, ratios in cases.items():
            goal = GOALS[what == "error"]
            if ratios and min(ratios) < goal:
                least, middle = min(ratios), float(np.median(ratios))
                lines.append(
                    f"{problem}: {least:.3g} at equal {what} (median {middle:.3g}); the goal is {goal:g}"
                )
    return lines


def draw(rows: Rows, out: Path) -> Path:
    """Write the table as Markdown, with what is behind and what falls short of the goals."""
    text = ["# Times less CPU than each peer", "", ABOUT, "", *table(rows), ""]
    for title, lines in (
        ("Where a peer is ahead", behind(rows)),
        ("Short of the goals beside MuJoCo", short(rows)),
    ):
        text += [f"## {title}", "", *([f"- {line}" for line in lines] or ["Nowhere."]), ""]
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, "\n".join(text))
    return out
