"""Loops over an island's rows: those of Newton's method and of the interior-point method."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..work import V3, WORK
from .vectors import over_rows

Flags, Rows = wp.array(dtype=wp.int32), wp.array(dtype=WORK)
BEND = """
        const Row missed = a1 * w1 - s * r, steep = rises * r - falls * s;
        const Row up = larger(a1 + steep, positive * a1), down = larger(w1 - steep, positive * w1);
        const Row both = up + down, divided = 1.0 / both;
        put(excess, missed);
        put(cross, none);
        put(p, up * divided);
        put(slack, down * divided);
        put(total, both);
        mean += sum(only(size(missed)));
"""
CHORD = """
            const Row w1 = get(w);
            const Mask presses = on & (get(z) > 2.0 * get(sigma)) & (w1 > seen * unit1);
            if (any(presses)) {
                const Row x = larger(1.0 + r / w1, none);
                const Row mean = (4.0 * root(x) + 1.0 + x) * (1.0 / 6.0);
                const Row bounded = where(mean < 0.5, none + 0.5, where(mean > 2.0, none + 2.0, mean));
                put(slack, where(presses, get(slack) * bounded, get(slack)));
            }
"""


@wp.func_native(
    over_rows(
        "hard",
        "",
        """
        const Row slope = get(p), divided = 1.0 / (get(slack) + tau * get(diag) * get(inverse) * slope);
        put(divisor, divided);
        put(weight, slope * divided * get(inverse));
        """,
    )
)
def weigh(
    first: int, last: int, acting: Flags, tau: WORK, diag: Rows, inverse: Rows, p: Rows, slack: Rows,
    divisor: Rows, weight: Rows,
):  # fmt: skip
    """1/T and W of rows."""
    ...


@wp.func_native(over_rows("hard", "", "put(lam, get(a) * get(inverse)); put(z, get(a) - get(w));"))
def put_inside(first: int, last: int, acting: Flags, inverse: Rows, a: Rows, w: Rows, lam: Rows, z: Rows):
    """lambda and z of rows at a and w."""
    ...


@cached
def make_passes(law: str) -> SimpleNamespace:
    """Warp functions of a law: those of Newton's method, and of the interior-point method."""
    return SimpleNamespace(**vars(_of_newton(law)), **vars(_of_interior(law)))


def _of_newton(law: str) -> SimpleNamespace:
    @wp.func_native(
        over_rows(
            law,
            "bool changed = false;",
            """
            Row s, r, rises, falls;
            smooth(get(z), get(sigma), s, r, rises, falls);
            changed |= any((rises != get(p)) & on);
            put(lam, s * get(inverse));
            put(w, r);
            put(p, rises);
            put(slack, falls);
            """,
            "return changed ? 1 : 0;",
        )
    )
    def put(
        first: int, last: int, acting: Flags, z: Rows, sigma: Rows, inverse: Rows, lam: Rows, w: Rows,
        p: Rows, slack: Rows,
    ) -> int:  # fmt: skip
        """lambda, w and their slopes of rows at z; 1 if a slope changes."""
        ...

    @wp.func_native(
        over_rows(
            law,
            "double worst = 0.0, finite = 0.0, highest = 0.0;",
            f"""
            Row r = get(res);
            const Row unit1 = get(unit);
            if (inside) {{
                r += yielding * get(diag) * (get(lam) - get(least));
                put(res, r);
                const double high = largest(only(get(a)));
                highest = high > highest ? high : highest;
            }} else {{
                {"" if law == "hard" else CHORD}
            }}
            r = only(size(r));
            finite += sum(r);
            const double off = largest(where(r > worst * unit1, r / unit1, none));
            worst = off > worst ? off : worst;
            """,
            "return {worst, finite, highest};",
        )
    )
    def finish(
        first: int, last: int, acting: Flags, inside: int, yielding: WORK, seen: WORK, unit: Rows, res: Rows,
        diag: Rows, lam: Rows, least: Rows, a: Rows, z: Rows, sigma: Rows, w: Rows, slack: Rows,
    ) -> V3:  # fmt: skip
        """Residuals of rows that yield, or the slopes of their chords. The largest residual relative to its
        unit, the sum of all, and the largest a.
        """
        ...

    return SimpleNamespace(put=put, finish=finish)


def _of_interior(law: str) -> SimpleNamespace:
    @wp.func_native(
        over_rows(
            law,
            "double mean = 0.0;",
            f"""
            const Row a1 = get(a), w1 = get(w);
            Row s, r, rises, falls;
            smooth(a1 - w1, get(sigma), s, r, rises, falls);
            {BEND}
            """,
            "return mean;",
        )
    )
    def curve(
        first: int, last: int, acting: Flags, positive: WORK, sigma: Rows, a: Rows, w: Rows, excess: Rows,
        cross: Rows, p: Rows, slack: Rows, total: Rows,
    ) -> WORK:  # fmt: skip
        """Excess and weights of rows; the sum of |excess|."""
        ...

    @wp.func_native(
        over_rows(
            law,
            "double mean = 0.0;",
            f"""
            const Row e = get(aimed), d = get(dz);
            Row a1 = get(a) + step * (get(p) * d + e), w1 = get(w) + step * (e - get(slack) * d);
            Row s, r, rises, falls;
            smooth(a1 - w1, get(sigma), s, r, rises, falls);
            a1 = larger(a1, s);  // below the curve steps would get shorter and shorter
            w1 = larger(w1, r);
            put(a, a1);
            put(w, w1);
            {BEND}
            """,
            "return mean;",
        )
    )
    def advance(
        first: int, last: int, acting: Flags, step: WORK, positive: WORK, sigma: Rows, dz: Rows, aimed: Rows,
        a: Rows, w: Rows, excess: Rows, cross: Rows, p: Rows, slack: Rows, total: Rows,
    ) -> WORK:  # fmt: skip
        """Make a step, not below the curve; excess and weights there, and the sum of |excess|."""
        ...

    @wp.func_native(
        over_rows(
            law,
            "double mean = 0.0;",
            """
            const Row e = get(aimed), d = get(dz), da = get(p) * d + e, dw = e - get(slack) * d;
            const Row a1 = get(a) + step * da, w1 = get(w) + step * dw;
            Row s, r, rises, falls;
            smooth(a1 - w1, get(sigma), s, r, rises, falls);
            mean += sum(only(size(a1 * w1 - s * r)));
            if (kept > 0.0) put(cross, kept * da * dw);
            """,
            "return mean;",
        )
    )
    def look_ahead(
        first: int, last: int, acting: Flags, step: WORK, kept: WORK, sigma: Rows, dz: Rows, aimed: Rows,
        a: Rows, w: Rows, cross: Rows, p: Rows, slack: Rows,
    ) -> WORK:  # fmt: skip
        """The sum of |excess| after a step; into `cross`, if any is `kept`, so much of its second order."""
        ...

    return SimpleNamespace(curve=curve, advance=advance, look_ahead=look_ahead)
