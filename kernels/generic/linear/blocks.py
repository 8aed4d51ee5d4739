"""Sums of products of 3 x 3 blocks, in which the factors of wide envelopes spend their time.

A CPU's compiler leaves loops over three to scalar operations. Here what is added up of a row times a row is a
vector register, whose parts are added at the end. A GPU makes scalar sums.
"""

import warp as wp

from ..work import M33


def _each(pattern: str) -> str:
    """C++ for all i, j < 3."""
    return " ".join(pattern.format(i=i, j=j) for i in range(3) for j in range(3))


REDUCED = f"""
    auto s = value;
#if !defined(__CUDA_ARCH__)
    typedef double Row __attribute__((vector_size(32), aligned(8)));
    const double* p = &wp::index(a, row).data[0][0];
    const double* q = &wp::index(b, other).data[0][0];
    Row {", ".join(f"s{i}{j} = {{}}" for i in range(3) for j in range(3))};
    for (int k = 0; k < n; ++k, p += 9, q += 9) {{  // a row's fourth part is not read at the end
        const Row x0 = *(const Row*)p, x1 = *(const Row*)(p + 3), x2 = {{p[6], p[7], p[8], 0.0}};
        const Row y0 = *(const Row*)q, y1 = *(const Row*)(q + 3), y2 = {{q[6], q[7], q[8], 0.0}};
        {_each("s{i}{j} += x{i} * y{j};")}
    }}
    {_each("s.data[{i}][{j}] -= s{i}{j}[0] + s{i}{j}[1] + s{i}{j}[2];")}
#endif
    return s;
"""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    return n > 1;
#endif
""")
def pays(n: int) -> bool:
    """Whether `reduced` is to sum up n products."""
    ...


@wp.func_native(REDUCED)
def reduced(value: M33, a: wp.array(dtype=M33), row: int, b: wp.array(dtype=M33), other: int, n: int) -> M33:
    """`value` less the sum of a[row + k] b[other + k]', k < n; of a world's own, contiguous arrays."""
    ...
