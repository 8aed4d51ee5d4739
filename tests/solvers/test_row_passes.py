"""Loops over an island's rows, eight at once on a CPU: each against mpmath or NumPy, row by row."""

from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import warp as wp
from scipy.special import erfc

from slcp_warp import scenes
from slcp_warp.kernels.generic.rows.passes import make_passes, put_inside, weigh
from slcp_warp.kernels.generic.work import WORK, Work, allocate_work, view

LAWS = ("hard", "logistic", "normal")
PUT, FINISH, CURVE, ADVANCE, AHEAD, INSIDE, WEIGH = range(7)
FIRST, LAST = 13, 102  # an island's rows: neither begins nor ends where eight rows do
ROUNDING = 2.0**-53
POSITIVE, SEEN = 0.01, 2e-14


def kernel_of(law):
    rows = make_passes(law)

    @wp.kernel(module="unique", enable_backward=False)
    def passes(
        work: Work, what: int, first: int, last: int, inside: int, step: WORK, out: wp.array(dtype=WORK)
    ):
        k = view(work, 0)
        if what == wp.static(PUT):
            out[0] = WORK(
                wp.static(rows.put)(first, last, k.acting, k.z, k.sigma, k.inverse, k.lam, k.w, k.p, k.slack)
            )
        elif what == wp.static(FINISH):
            found = wp.static(rows.finish)(
                first, last, k.acting, inside, step, WORK(wp.static(SEEN)), k.unit, k.res, k.diag, k.lam,
                k.least, k.a, k.z, k.sigma, k.w, k.slack,
            )  # fmt: skip
            for i in range(3):
                out[i] = found[i]
        elif what == wp.static(CURVE):
            out[0] = wp.static(rows.curve)(
                first, last, k.acting, WORK(wp.static(POSITIVE)), k.sigma, k.a, k.w, k.excess, k.cross, k.p,
                k.slack, k.total,
            )  # fmt: skip
        elif what == wp.static(ADVANCE):
            out[0] = wp.static(rows.advance)(
                first, last, k.acting, step, WORK(wp.static(POSITIVE)), k.sigma, k.dz, k.aimed, k.a, k.w,
                k.excess, k.cross, k.p, k.slack, k.total,
            )  # fmt: skip
        elif what == wp.static(AHEAD):
            out[0] = wp.static(rows.look_ahead)(
                first,
                last,
                k.acting,
                step,
                WORK(0.5),
                k.sigma,
                k.dz,
                k.aimed,
                k.a,
                k.w,
                k.cross,
                k.p,
                k.slack,
            )
        elif what == wp.static(INSIDE):
            put_inside(first, last, k.acting, k.inverse, k.a, k.w, k.lam, k.z)
        else:
            weigh(first, last, k.acting, step, k.diag, k.inverse, k.p, k.slack, k.divisor, k.weight)

    return passes


KERNELS = {law: kernel_of(law) for law in LAWS}
NAMES = ("z", "sigma", "inverse", "lam", "w", "p", "slack", "unit", "res", "diag", "least", "a", "excess",
         "cross", "total", "dz", "aimed", "divisor", "weight")  # fmt: skip


def run(law, what, inside=0, step=0.3, change=None):
    """Rows before and after a pass as namespaces of arrays, which of them are the pass's, and its answer."""
    rng = np.random.default_rng(8)
    structure = scenes.stack(30).structure
    work = allocate_work(structure, 1, "cpu")
    count = work.z.shape[1]
    for name in NAMES:
        value = 10.0 ** rng.uniform(-4.0, 1.0, count)
        if name in ("z", "res", "dz", "aimed", "lam", "least", "excess"):
            value *= rng.choice((-1.0, 1.0), count)
        getattr(work, name).numpy()[0] = value
    work.sigma.numpy()[0] = 10.0 ** rng.uniform(-3.0, 0.0, count)
    work.acting.numpy()[0] = rng.choice((0, 1, 2), count)
    if change is not None:
        change(SimpleNamespace(**{name: getattr(work, name).numpy()[0] for name in (*NAMES, "acting")}))
    before = SimpleNamespace(**{name: getattr(work, name).numpy()[0].copy() for name in NAMES})
    out = wp.zeros(3, dtype=WORK, device="cpu")
    wp.launch(KERNELS[law], 1, [work, what, FIRST, LAST, inside, step, out], device="cpu")
    after = SimpleNamespace(**{name: getattr(work, name).numpy()[0].copy() for name in NAMES})
    own = (work.acting.numpy()[0] > 0) & (np.arange(count) >= FIRST) & (np.arange(count) < LAST)
    for name in NAMES:  # of other rows nothing is touched
        np.testing.assert_array_equal(getattr(after, name)[~own], getattr(before, name)[~own], name)
    return before, after, own, out.numpy()


def smooth(law, z, sigma):
    """s(z), s(-z), s'(z), s'(-z) in NumPy (M12)."""
    if law == "hard":
        p = np.where(z > 0.0, 1.0, np.where(z < 0.0, 0.0, 0.5))
        return np.maximum(z, 0.0), np.maximum(-z, 0.0), p, 1.0 - p
    x = np.abs(z) / sigma
    if law == "logistic":
        tail, small = sigma * np.log1p(np.exp(-x)), np.exp(-x) / (1.0 + np.exp(-x))
    else:
        small = 0.5 * erfc(x / np.sqrt(2.0))
        density = np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi)
        tail = sigma * np.maximum(density - x * small, 0.0)
    up, big = z > 0.0, 1.0 - small
    return (np.where(up, z + tail, tail), np.where(up, tail, tail - z), np.where(up, big, small),
            np.where(up, small, big))  # fmt: skip


def agree(found, expected, own, scale=None, most=1e-13):
    scale = np.abs(expected) if scale is None else scale
    assert own.sum() > 40
    assert (np.abs(found - expected) <= most * scale + 1e-300)[own].all()


def test_logistic_rows_are_right_to_rounding():
    """Also far out in the tail, where the slope is 1e-300, and beyond, where it is 0."""

    def far(rows):
        rows.z[:60] = np.linspace(-720.0, 720.0, 60) * rows.sigma[:60]
        rows.z[60:64], rows.z[64] = (-1e9, 1e9, -1e-9, 1e-9), 0.0
        rows.acting[:65] = 1

    before, after, own, changed = run("logistic", PUT, change=far)
    assert changed[0] == 1.0
    for i in np.flatnonzero(own):
        z, sigma = mpmath.mpf(before.z[i]), mpmath.mpf(before.sigma[i])
        e = mpmath.exp(-abs(z) / sigma)
        tail, big = sigma * mpmath.log1p(e), 1 / (1 + e)
        wanted = [z + tail, tail, big, e * big] if z > 0 else [tail, tail - z, e * big, big]
        wanted[0] *= mpmath.mpf(before.inverse[i])
        argument = float(abs(z) / sigma)  # whose rounding the exponential multiplies
        for name, value in zip(("lam", "w", "p", "slack"), wanted, strict=True):
            miss = abs(getattr(after, name)[i] - value)
            assert miss <= (8.0 + 2.0 * argument) * ROUNDING * abs(value) + 1e-307, (name, i)
    assert after.slack[61] == 0.0 and after.p[60] == 0.0  # 1e9 smoothings away


@pytest.mark.parametrize("law", LAWS)
def test_put(law):
    before, after, own, changed = run(law, PUT)
    on, off, p, q = smooth(law, before.z, before.sigma)
    scale = np.abs(before.z) + before.sigma
    agree(after.lam, on * before.inverse, own, scale * before.inverse)
    agree(after.w, off, own, scale)
    agree(after.p, p, own, 1.0)
    agree(after.slack, q, own, 1.0)
    assert changed[0] == 1.0

    def put_before(rows):
        rows.p[own] = after.p[own]

    assert run(law, PUT, change=put_before)[3][0] == 0.0  # nothing changes


def test_not_a_number_stays():
    def lost(rows):
        rows.z[20], rows.acting[20] = np.nan, 1

    for law in LAWS[1:]:
        _, after, _, _ = run(law, PUT, change=lost)
        assert not np.isfinite(after.lam[20] + after.w[20])

    def unknown(rows):
        rows.res[20], rows.acting[20] = np.nan, 1

    assert np.isnan(run("logistic", FINISH, change=unknown)[3][1])


@pytest.mark.parametrize("law", LAWS)
def test_finish_of_newtons_method(law):
    """The largest residual relative to its unit, and of rows that press the slope of the chord."""
    before, after, own, (worst, finite, _) = run(law, FINISH)
    size = np.abs(before.res)
    assert worst == pytest.approx((size / before.unit)[own].max(), rel=1e-14)
    assert finite == pytest.approx(size[own].sum(), rel=1e-13)
    slack, (chords,) = (
        before.slack.copy(),
        np.nonzero(own & (before.z > 2.0 * before.sigma) & (before.w > SEEN * before.unit)),
    )
    assert len(chords) > 10
    if law != "hard":
        x = np.maximum(1.0 + before.res / before.w, 0.0)[chords]
        slack[chords] *= np.clip((4.0 * np.sqrt(x) + 1.0 + x) / 6.0, 0.5, 2.0)
    agree(after.slack, slack, own)
    np.testing.assert_array_equal(after.res, before.res)


@pytest.mark.parametrize("law", LAWS)
def test_finish_inside(law):
    """Rows that yield by .3 diag(A) (lambda - least)."""
    before, after, own, (worst, finite, highest) = run(law, FINISH, inside=1)
    res = before.res + 0.3 * before.diag * (before.lam - before.least)
    agree(after.res, res, own, np.abs(before.res) + before.diag * (np.abs(before.lam) + np.abs(before.least)))
    assert worst == pytest.approx((np.abs(res) / before.unit)[own].max(), rel=1e-12)
    assert finite == pytest.approx(np.abs(res)[own].sum(), rel=1e-12)
    assert highest == before.a[own].max()
    np.testing.assert_array_equal(after.slack, before.slack)


def check_bent(law, before, after, own, a, w, mean):
    on, off, p, q = smooth(law, a - w, before.sigma)
    excess, slope = a * w - on * off, p * off - q * on
    scale = a * w + on * off
    agree(after.excess, excess, own, scale)
    up, down = np.maximum(a + slope, POSITIVE * a), np.maximum(w - slope, POSITIVE * w)
    agree(after.total, up + down, own, a + w + on + off)
    agree(after.p, up / (up + down), own, (a + w + on + off) / (up + down))
    agree(after.slack, down / (up + down), own, (a + w + on + off) / (up + down))
    assert not after.cross[own].any()
    assert mean == pytest.approx(np.abs(excess)[own].sum(), rel=1e-11)


@pytest.mark.parametrize("law", LAWS)
def test_curve(law):
    before, after, own, (mean, *_) = run(law, CURVE)
    check_bent(law, before, after, own, before.a, before.w, mean)
    np.testing.assert_array_equal(after.a, before.a)


@pytest.mark.parametrize("law", LAWS)
def test_advance(law):
    """A step of .3 of the way, and not below the curve of the law."""

    def small(rows):
        rows.aimed[:] *= 0.1 * np.minimum(rows.a, rows.w) / np.abs(rows.aimed)
        rows.p[:], rows.slack[:] = 0.4, 0.6
        rows.dz[:] *= np.minimum(rows.a, rows.w) / np.abs(rows.dz)

    before, after, own, (mean, *_) = run(law, ADVANCE, change=small)
    a = before.a + 0.3 * (before.p * before.dz + before.aimed)
    w = before.w + 0.3 * (before.aimed - before.slack * before.dz)
    on, off, *_ = smooth(law, a - w, before.sigma)
    a, w = np.maximum(a, on), np.maximum(w, off)
    agree(after.a, a, own)
    agree(after.w, w, own)
    check_bent(law, before, after, own, a, w, mean)


@pytest.mark.parametrize("law", LAWS)
def test_look_ahead(law):
    """|excess| after a step, and half of its second order."""
    before, after, own, (mean, *_) = run(law, AHEAD)
    da = before.p * before.dz + before.aimed
    dw = before.aimed - before.slack * before.dz
    a, w = before.a + 0.3 * da, before.w + 0.3 * dw
    on, off, *_ = smooth(law, a - w, before.sigma)
    sizes = np.abs(a * w) + on * off
    assert abs(mean - np.abs(a * w - on * off)[own].sum()) <= 1e-12 * sizes[own].sum()
    agree(after.cross, 0.5 * da * dw, own, (before.p * np.abs(before.dz) + np.abs(before.aimed))
          * (np.abs(before.aimed) + before.slack * np.abs(before.dz)))  # fmt: skip
    np.testing.assert_array_equal(after.a, before.a)


def test_inside_and_weights():
    before, after, own, _ = run("hard", INSIDE)
    agree(after.lam, before.a * before.inverse, own)
    agree(after.z, before.a - before.w, own, before.a + before.w)
    before, after, own, _ = run("hard", WEIGH)
    divisor = 1.0 / (before.slack + 0.3 * before.diag * before.inverse * before.p)
    agree(after.divisor, divisor, own)
    agree(after.weight, before.p * divisor * before.inverse, own)


def test_a_cpu_finds_rows_at_whole_vectors():
    work = allocate_work(scenes.stack(3).structure, 2, "cpu")
    for name in NAMES:
        array = getattr(work, name)
        assert array.ptr % 64 == 0 and array.strides[0] % 64 == 0, name
    assert work.acting.ptr % 32 == 0
