"""The C++ in which loops over rows are written: eight rows at once in a CPU's vector registers, one on a GPU.

A row after the other would call the C library for exp and log, about which all registers are saved: a sixth
of a tumbling step of smoothed boxes. Here exp(-x) is 2^k e^r with |r| <= log(2)/2, and log(1 + e), e <= 1, is
2 atanh(e/(2 + e)), each with a polynomial whose error is below a tenth of a rounding; exp of less than -708
is 0. Arrays by row begin and end at multiples of `WIDTH` rows on a CPU (`work.py`).
"""

from ..work import WIDTH

# minimax: (e^r - 1 - r)/r^2 for |r| <= log(2)/2, and (2 atanh(t)/t - 2)/t^2 by t^2 <= 1/9
EXPONENTIAL = (
    0.5000000000000001, 0.16666666666666669, 0.04166666666662413, 0.008333333333330062,
    0.0013888888917213717, 0.00019841269863053618, 2.4801521295954376e-05, 2.7557268459997064e-06,
    2.7620088445409746e-07, 2.510038549551032e-08,
)  # fmt: skip
LOGARITHM = (
    0.6666666666666666, 0.40000000000014585, 0.2857142856710876, 0.22222222717427864, 0.18181789436132859,
    0.15385570064958623, 0.13314144209654935, 0.12001072809590713, 0.08800738486144674, 0.1616404561194353,
)  # fmt: skip


def polynomial(coefficients: tuple[float, ...], x: str) -> str:
    """C++ for a polynomial by pairs, pairs of pairs, ...; of x the powers x2, x4 and x8 are there."""
    terms, by = [repr(c) for c in coefficients], x
    while len(terms) > 1:
        pairs = [f"({a} + {by} * {b})" for a, b in zip(terms[::2], terms[1::2])]
        terms = pairs + terms[len(pairs) * 2 :]
        by = f"{x}{2 if by == x else 2 * int(by[len(x) :])}"
    return terms[0]


NUMBERS = f"""
#if defined(__CUDA_ARCH__)
    const int width = 1;
    typedef double Row;
    typedef bool Mask;
    auto where = [](Mask m, Row a, Row b) {{ return m ? a : b; }};
    auto load = [](const double* p) {{ return *p; }};
    auto store = [](double* p, Row x) {{ *p = x; }};
    auto flags = [](const int* p, int, int) {{ return *p > 0; }};
    auto any = [](Mask m) {{ return m; }};
    auto size = [](Row x) {{ return ::fabs(x); }};
    auto root = [](Row x) {{ return ::sqrt(x); }};
    auto sum = [](Row x) {{ return x; }};
    auto largest = [](Row x) {{ return x; }};
    auto decay = [](Row x) {{ return ::exp(x); }};
    auto tail_of = [](Row x) {{ return ::erfc(x); }};
#else
    const int width = {WIDTH};
    typedef double Row __attribute__((vector_size({8 * WIDTH})));
    typedef long long Mask __attribute__((vector_size({8 * WIDTH})));
    typedef int Flags __attribute__((vector_size({4 * WIDTH})));
    auto where = [](Mask m, Row a, Row b) {{ return (Row)(((Mask)a & m) | ((Mask)b & ~m)); }};
    auto load = [](const double* p) {{ return *(const Row*)p; }};
    auto store = [](double* p, Row x) {{ *(Row*)p = x; }};
    auto flags = [](const int* p, int begin, int end) {{
        const Mask i = {{{", ".join(str(i) for i in range(WIDTH))}}};
        return __builtin_convertvector(*(const Flags*)p > 0, Mask) & (i >= begin) & (i < end);
    }};
    auto any = [](Mask m) {{
        long long all = 0;
        for (int i = 0; i < width; ++i) all |= m[i];
        return all != 0;
    }};
    auto size = [](Row x) {{ return (Row)((Mask)x & 0x7fffffffffffffffLL); }};
    auto root = [](Row x) {{ return __builtin_elementwise_sqrt(x); }};
    auto sum = [](Row x) {{
        double all = 0.0;
        for (int i = 0; i < width; ++i) all += x[i];
        return all;
    }};
    auto largest = [](Row x) {{
        double all = x[0];
        for (int i = 1; i < width; ++i) all = x[i] > all ? x[i] : all;
        return all;
    }};
    auto decay = [&](Row y) {{
        const Mask seen = y > -708.0;
        const Row x = where(seen, y, Row{{}} - 708.0);
        const Row t = x * 1.4426950408889634 + 6755399441055744.0;
        const Row k = t - 6755399441055744.0;
        const Row r = (x - k * 6.93145751953125e-1) - k * 1.42860682030941723212e-6;
        const Row r2 = r * r, r4 = r2 * r2, r8 = r4 * r4;
        const Row e = 1.0 + (r + r2 * {polynomial(EXPONENTIAL, "r")});
        return (Row)(((Mask)e + ((Mask)t << 52)) & seen);
    }};
    auto tail_of = [](Row x) {{
        Row out;
        for (int i = 0; i < width; ++i) out[i] = ::erfc(x[i]);
        return out;
    }};
#endif
    const Row none = Row{{}};
    auto larger = [&](Row a, Row b) {{ return where(a < b, b, a); }};
"""
LAWS = {  # smooth(z, sigma, s(z), s(-z), s'(z), s'(-z)), as of `residual/smoothing.py`
    "logistic": f"""
    auto smooth = [&](Row z, Row sigma, Row& on, Row& off, Row& p, Row& q) {{
        const Mask up = z > 0.0;
        const Row e = decay(where(up, -z, z) / sigma);
        const Row a = e / (2.0 + e);
        const Row u = a * a, u2 = u * u, u4 = u2 * u2, u8 = u4 * u4;
        const Row tail = sigma * (2.0 * a + a * u * {polynomial(LOGARITHM, "u")});
        const Row big = 1.0 / (1.0 + e), small = e * big;
        on = where(up, z + tail, tail);
        off = where(up, tail, tail - z);
        p = where(up, big, small);
        q = where(up, small, big);
    }};
""",
    "normal": """
    auto smooth = [&](Row z, Row sigma, Row& on, Row& off, Row& p, Row& q) {
        const Mask up = z > 0.0;
        const Row x = where(up, z, -z) / sigma;
        const Row small = 0.5 * tail_of(0.7071067811865476 * x), big = 1.0 - small;
        const Row tail = sigma * larger(0.3989422804014327 * decay(-0.5 * x * x) - x * small, none);
        on = where(up, z + tail, tail);
        off = where(up, tail, tail - z);
        p = where(up, big, small);
        q = where(up, small, big);
    };
""",
    "hard": """
    auto smooth = [&](Row z, Row, Row& on, Row& off, Row& p, Row& q) {
        on = larger(z, none);
        off = larger(-z, none);
        p = where(z > 0.0, none + 1.0, where(z < 0.0, none, none + 0.5));
        q = 1.0 - p;
    };
""",
}


def over_rows(law: str, before: str, body: str, after: str = "") -> str:
    """C++ of a loop over the rows from `first` to `last`.

    Args:
        law: of `LAWS`, whose `smooth` is at hand.
        before: what the loop begins from.
        body: `get` and `put` of arrays are of the rows from i on that act, `on` says which these are.
        after: the end, with what is given back.
    """
    return f"""
    {NUMBERS}
    {LAWS[law]}
    {before}
    for (int i = first - first % width; i < last; i += width) {{
        const Mask on = flags(&wp::index(acting, i), first - i, last - i);
        if (!any(on)) continue;
        auto get = [&](wp::array_t<double>& x) {{ return load(&wp::index(x, i)); }};
        auto put = [&](wp::array_t<double>& x, Row value) {{
            double* at = &wp::index(x, i);
            store(at, where(on, value, load(at)));
        }};
        auto only = [&](Row x) {{ return where(on, x, none); }};
        {body}
    }}
    {after}
"""
