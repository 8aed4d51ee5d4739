"""What a step must cost at least: its operations and bytes, counted, over the machine's measured peaks.

The counts follow the algorithms of `kernels/` for a general mechanism, one world per thread. An addition
or a multiplication is one operation, a long one (division, root, exponential, logarithm, sine) LONG of them.
Scenes whose structure the kernels use (the finger's M is 2 + 1) need less, so a fraction of the peak is an
estimate, good to a factor of about two.
"""

import functools
import time
from dataclasses import dataclass
from typing import Any, no_type_check

import numpy as np
import warp as wp

LONG = 20.0
ITERATIONS = 3.4  # of Newton's method a step with a row that acts (docs/performance.md, finger)
EVALUATIONS = 2.5  # of an ellipse pair's distance by the third-order search from the last normal
SCALAR = "-fno-slp-vectorize -fno-vectorize"
SCALAR_LANES, WIDE_LANES = 12, (32, 64)
COPY_BYTES = 1 << 26


@dataclass(frozen=True)
class Work:
    """Operations and bytes of main memory of one item (a step, a pass, a world)."""

    operations: float
    bytes: float

    def times(self, count: float) -> "Work":
        """So many of it."""
        return Work(count * self.operations, count * self.bytes)


def step_work(
    nv: int, acting: float, nu: int = 0, pairs: int = 0, ellipses: int = 0, near: float = 0.0, size: int = 4,
    iterations: float = ITERATIONS,
) -> Work:  # fmt: skip
    """A smoothed step of nv degrees of freedom with `acting` rows in the Newton system on average.

    Counted: a sine and cosine and 52 operations a body; 12 for an entry of M, nv^3 for its inverse, 14 nv^2
    for velocity terms and forces; 2 nv^2 + 16 nv for an acting row's J and diagonal; per acting row and
    iteration an exponential, a logarithm and two divisions with its terms (4 nv + 30), and its elimination
    (5 nv^2 + 10 nv and a division).

    Args:
        pairs: of simple shapes (a disc and a plane: 30 operations).
        ellipses: pairs of ellipses, each with a bound on its distance (70 operations, 4 long ones).
        near: how many are searched on average.
        size: bytes of a number. State in and out and controls are what memory sees.
    """
    motion = nv * (LONG + 52.0) + 12.0 * nv * (nv + 1) / 2.0 + nv**3 + nv * LONG + 14.0 * nv**2
    reach = 30.0 * pairs + ellipses * (70.0 + 4.0 * LONG) + near * EVALUATIONS * (70.0 + 5.0 * LONG)
    rows = acting * (12.0 * nv + 2.0 * nv**2 + 4.0 * nv + LONG)
    row = 4.0 * nv + 30.0 + 4.0 * LONG + 5.0 * nv**2 + 10.0 * nv + LONG
    newton = iterations * (acting * row + (2.0 * nv**2 if acting else 0.0))
    return Work(motion + reach + rows + newton, float(size * (4 * nv + nu)))


def pass_work(
    nv: int, nu: int, horizon: int, step_sizes: int, step: Work, rows: float, size: int = 4
) -> Work:
    """A pass of second-order DDP: every step size's rollout, derivatives to second order, backward pass.

    Counted: second derivatives of nv outputs, half of n^2 pairs of n = 2 nv + nu inputs, 2 (nv + rows) each;
    backward pass: V_xx through f_x and f_u (2 products of n x nx x n), and the second-order term.
    """
    nx = 2 * nv
    n = nx + nu
    second = nv * n**2 * (nv + rows)
    backward = 4.0 * nx * nx * n + 2.0 * nv * n**2 + 2.0 * nx * nx * nu + nu**3
    memory = size * (n * nx + nv * n**2 + 2 * nx * nx + nu * nx)
    one = step_sizes * step.operations + 2.0 * step.operations + second + backward
    return Work(horizon * one, float(horizon * (step_sizes * step.bytes + memory)))


@dataclass(frozen=True)
class Peak:
    """Of one thread of a CPU, or of a whole GPU.

    Attributes:
        scalar: independent multiplications and additions without vector instructions [1/s]: what a world per
            thread can use.
        serial: each waiting for the last.
        wide: with vector instructions.
        bandwidth: of a copy, read and written [bytes/s].
    """

    scalar: float
    serial: float
    wide: float
    bandwidth: float

    def roofline(self, work: Work, threads: int = 1) -> dict[str, float]:
        """Columns: counts, and least seconds of an item; bandwidth is shared by the threads."""
        arithmetic = work.operations / (threads * self.scalar)
        return {
            "operations": work.operations,
            "bytes": work.bytes,
            "roofline_seconds": max(arithmetic, work.bytes / self.bandwidth),
            "serial_seconds": work.operations / (threads * self.serial),
        }


def make_chains(lanes: int) -> wp.Kernel:
    """`lanes` recurrences x = x c + 1/2 side by side, in single precision."""
    V = wp.types.vector(lanes, wp.float32)

    @wp.kernel(module="unique", enable_backward=False)
    @no_type_check
    def chains(first: int, rounds: int, c: float, out: wp.array(dtype=wp.float32)):
        a = V()
        for i in range(wp.static(lanes)):
            a[i] = float(first + i)
        for _ in range(rounds):
            for i in range(wp.static(lanes)):
                a[i] = a[i] * c + 0.5
        total = wp.float32(0.0)
        for i in range(wp.static(lanes)):
            total += a[i]
        out[first + wp.tid()] = total

    return chains


def operations_a_second(lanes: int, device: Any, flags: str = "", rounds: int = 1_000_000) -> float:
    """Best of five: the rate of `make_chains` on one thread of a CPU, on all of a GPU."""
    device = wp.get_device(device)
    threads = 1 if device.is_cpu else 1 << 18
    rounds = rounds if device.is_cpu else 10_000
    out = wp.zeros(threads, dtype=wp.float32, device=device)
    before = wp.config.cpu_compiler_flags
    try:
        if flags:
            wp.config.cpu_compiler_flags = f"-march=native {flags}"
        kernel = make_chains(lanes)
        wp.load_module(kernel.module, device=device)
    finally:
        wp.config.cpu_compiler_flags = before
    best = np.inf
    for _ in range(5):
        wp.synchronize_device(device)
        begin = time.perf_counter()
        wp.launch(kernel, dim=threads, inputs=[0, rounds, 0.999, out], device=device)
        wp.synchronize_device(device)
        best = min(best, time.perf_counter() - begin)
    return 2.0 * lanes * threads * rounds / best


def copy_bandwidth(device: Any) -> float:
    """Bytes read and written a second by a copy within a device's memory, best of five."""
    source, target = (wp.zeros(COPY_BYTES // 4, dtype=wp.float32, device=device) for _ in range(2))
    best = np.inf
    for _ in range(5):
        wp.synchronize_device(device)
        begin = time.perf_counter()
        wp.copy(target, source)
        wp.synchronize_device(device)
        best = min(best, time.perf_counter() - begin)
    return 2.0 * COPY_BYTES / best


@functools.cache
def peak(device: str = "cpu") -> Peak:
    """The peaks of a device, measured once."""
    wide = max(operations_a_second(lanes, device) for lanes in WIDE_LANES)
    if not wp.get_device(device).is_cpu:
        return Peak(wide, operations_a_second(1, device), wide, copy_bandwidth(device))
    scalar = operations_a_second(SCALAR_LANES, device, SCALAR)
    return Peak(scalar, operations_a_second(1, device, SCALAR), max(wide, scalar), copy_bandwidth(device))
