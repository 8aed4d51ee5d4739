"""Random numbers and disturbed runs of sweeps in NumPy, from published formulas; no code of the package's."""

import math

import numpy as np

LOW = 0xFFFFFFFF


def philox(counter, key):
    """Philox4x32-10 (Salmon et al. 2011): four words."""
    (a, b, c, d), (k0, k1) = map(int, counter), map(int, key)
    for _ in range(10):
        p, q = 0xD2511F53 * a, 0xCD9E8D57 * c
        a, b, c, d = (q >> 32) ^ b ^ k0, q & LOW, (p >> 32) ^ d ^ k1, p & LOW
        k0, k1 = (k0 + 0x9E3779B9) & LOW, (k1 + 0xBB67AE85) & LOW
    return a, b, c, d


def even(seed, world, step, stream):
    """A number in (0, 1) from 53 bits."""
    a, b, _, _ = philox((world, step, stream, 0), (seed, 0))
    return ((((a << 32) | b) >> 11) + 0.5) * 2.0**-53


def normal(seed, world, step, stream):
    """A standard normal number, by Box and Muller."""
    _, _, c, d = philox((world, step, stream, 0), (seed, 0))
    angle = 2.0 * math.pi * ((((c << 32) | d) >> 11) + 0.5) * 2.0**-53
    return math.sqrt(-2.0 * math.log(even(seed, world, step, stream))) * math.cos(angle)


def normals(seed, worlds, step, streams):
    """(B, S) of worlds and streams."""
    return np.array([[normal(seed, world, step, stream) for stream in streams] for world in worlds])


def overlap(start, duration, time, h):
    """Share of the step from `time` on that lies in [start, start + duration)."""
    return np.clip(np.minimum(start + duration, time + h) - np.maximum(start, time), 0.0, None) / h
