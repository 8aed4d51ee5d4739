"""Table of study "many": targets beside MuJoCo, what is missed first, and every cost and error."""

import math
from pathlib import Path
from typing import Any

from slcp_warp.storage.files import write_text

from ...contacts.targets import table
from ...contacts.worlds import STEP
from .lines import Rows, choose, different, need
from .many_error import least, said
from .ratios import figure

ABOUT = """CPU time of one thread, all programs in turn in one run, medians. "Same pairs": MuJoCo's model of
the very contacts of the scene; "boxes", "spheres": its own shapes and its own search for what touches. The
quotient is our time over MuJoCo's in the same run, the faster model of the two."""
COSTS = ("scene", "motion", "law", "float64, us", "float32, us", "MuJoCo, us", "float64 / MuJoCo",
         "unsolved, float64", "float32")  # fmt: skip
ERRORS = ("problem", "MuJoCo / ours at equal error", "against own limits",
          f"deepest at h = {STEP:g}: Coulomb", "MuJoCo, default", "stiff", "energy gained: ours", "MuJoCo",
          "")  # fmt: skip


def draw(rows: Rows, out: Path) -> Path:
    """Write targets, costs and equal errors as Markdown."""
    rows = need(rows, "many")
    steps = [row for row in rows if row["cost_of"] == "step" and row["knob"] == "size"]
    motions = [row for row in rows if row["cost_of"] != "step"]
    parts = {"Targets": table(steps), "Costs": costs(steps), "Errors": errors(motions)}
    text = ["# Many contacts", "", ABOUT, ""]
    for title, lines in parts.items():
        text += [f"## {title}", "", *lines, ""]
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, "\n".join(text))
    return out


def heading(names: tuple[str, ...]) -> list[str]:
    """The first two lines of a table."""
    return [line(*names), "|---" * len(names) + "|"]


def line(*cells: str) -> str:
    """A line of a table."""
    return f"| {' | '.join(cells)} |"


def costs(rows: Rows) -> list[str]:
    """A line for every scene, motion and law of ours: us in both precisions, over MuJoCo's, unsolved."""
    lines = heading(COSTS)
    for scene in different(rows, "scene"):
        for motion in different(rows, "motion"):
            here = choose(rows, scene=scene, motion=motion)
            peers = ", ".join(f"{row['model']} {_us(row)}" for row in choose(here, program="MuJoCo"))
            for law in different(choose(here, program="slcp-warp"), "law"):
                ours = {row["dtype"]: row for row in choose(here, law=law, program="slcp-warp")}
                both = [ours.get(dtype, {}) for dtype in ("float64", "float32")]
                ratio = figure(1.0 / float(both[0]["ratio"]), 2) if both[0] else ""
                unsolved = [f"{row['unsolved']} of {row['seen']}" if row else "" for row in both]
                lines.append(line(scene, motion, law, *map(_us, both), peers, ratio, *unsolved))
    return lines


def _us(row: dict[str, Any]) -> str:
    return figure(1e6 * float(row["seconds"])) if row else ""


def errors(rows: Rows) -> list[str]:
    """A line for every problem: MuJoCo's cost over ours at equal error, penetration, energy, the truth."""
    lines = heading(ERRORS)
    for problem in sorted(different(rows, "problem"), key=lambda p: least(choose(rows, problem=p))):
        part = choose(rows, problem=problem)
        ours, peers = (choose(part, program=name) for name in ("slcp-warp", "MuJoCo"))
        ratios = [said(part, y) for y in ("error", "error_self")]
        deep = [_deepest(choose(part, curve=c)) for c in ("Coulomb", "MuJoCo, default", "MuJoCo, stiff")]
        note = next((str(row["note"]) for row in ours if row.get("note")), "")
        lines.append(line(problem, *ratios, *deep, *map(_gained, (ours, peers)), note))
    return lines


def _deepest(rows: Rows) -> str:
    found = [float(row["penetration"]) for row in rows if float(row["h"]) == STEP]
    return f"{1e3 * found[0]:.2g} mm" if found else "-"


def _gained(rows: Rows) -> str:
    values = [float(row["energy_gained"]) for row in rows if row.get("energy_gained") not in (None, "")]
    found = [value for value in values if not math.isnan(value)]
    return f"{max(found):.2g}" if found else "-"
