"""Counter-based random numbers: Philox4x32-10 (Salmon et al. 2011), addressed by (seed, world, step, stream).

A number depends on its address only, so results do not change with the batch split or the number of threads.
On every device the words and the evenly distributed numbers have the same bits. Normal ones go through log,
cos and sin in double precision, which the devices' libraries round differently in the last places: they agree
to a few units in the last place of double precision, and in single precision all but about one in 1e7 are the
same.
"""

import math
from types import SimpleNamespace

import warp as wp

from ..factories import cached

ROUNDS = 10
M0, M1 = wp.constant(wp.uint64(0xD2511F53)), wp.constant(wp.uint64(0xCD9E8D57))
W0, W1 = wp.constant(wp.uint64(0x9E3779B9)), wp.constant(wp.uint64(0xBB67AE85))
LOW = wp.constant(wp.uint64(0xFFFFFFFF))
SHIFT = wp.constant(wp.uint64(32))
V4 = wp.types.vector(4, wp.uint64)


@wp.func
def philox(c0: wp.uint64, c1: wp.uint64, c2: wp.uint64, c3: wp.uint64, k0: wp.uint64, k1: wp.uint64):
    """Four 32-bit words (in 64-bit variables) of the counter (c0..c3) under the key (k0, k1)."""
    a = c0
    b = c1
    c = c2
    d = c3
    key0 = k0
    key1 = k1
    for _round in range(ROUNDS):
        p0 = M0 * a
        p1 = M1 * c
        a = ((p1 >> SHIFT) ^ b) ^ key0
        b = p1 & LOW
        c = ((p0 >> SHIFT) ^ d) ^ key1
        d = p0 & LOW
        key0 = (key0 + W0) & LOW
        key1 = (key1 + W1) & LOW
    return V4(a, b, c, d)


@cached
def make_normal(dtype: type) -> SimpleNamespace:
    """Standard normal numbers of a dtype, by Box-Muller from 53-bit uniforms (24-bit in float32)."""
    V2 = wp.types.vector(2, dtype)
    TWO_PI, TWO = wp.float64(2.0 * math.pi), wp.float64(2.0)
    SCALE = wp.float64(2.0**-53)
    HALF = wp.float64(0.5)
    SHIFT_11 = wp.uint64(11)

    @wp.func
    def uniform(high: wp.uint64, low: wp.uint64):
        # in (0, 1): 53 bits and a half
        return (wp.float64(((high << SHIFT) | low) >> SHIFT_11) + HALF) * SCALE

    @wp.func
    def words(seed: int, world: int, step: int, stream: int):
        """The four words of an address."""
        key = wp.uint64(seed) & LOW
        zero = wp.uint64(0)
        return philox(wp.uint64(world), wp.uint64(step), wp.uint64(stream), zero, key, zero)

    @wp.func
    def normals(seed: int, world: int, step: int, stream: int):
        """Two independent standard normal numbers at an address."""
        r = words(seed, world, step, stream)
        radius = wp.sqrt(-TWO * wp.log(uniform(r[0], r[1])))
        angle = TWO_PI * uniform(r[2], r[3])
        return V2(dtype(radius * wp.cos(angle)), dtype(radius * wp.sin(angle)))

    @wp.func
    def normal(seed: int, world: int, step: int, stream: int):
        """The first of the `normals` at an address."""
        r = words(seed, world, step, stream)
        radius = wp.sqrt(-TWO * wp.log(uniform(r[0], r[1])))
        return dtype(radius * wp.cos(TWO_PI * uniform(r[2], r[3])))

    @wp.func
    def share(seed: int, world: int, step: int, stream: int):
        """A number evenly distributed in (0, 1) at an address."""
        r = words(seed, world, step, stream)
        return uniform(r[0], r[1])

    return SimpleNamespace(uniform=uniform, normals=normals, normal=normal, share=share)
