"""Launches of one-dimensional kernels that use all cores of a CPU.

Warp runs a CPU launch on one core, but releases the interpreter lock meanwhile. Every kernel of this package
therefore takes ``first: int`` as its first argument and works on item ``first + wp.tid()``, so that a range
of items can be split into chunks that run on a pool of threads. Items must not depend on each other. On a
GPU, and where a graph is captured, the whole range is one launch with ``first = 0``.
"""

import collections
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import warp as wp
from warp._src.codegen import StructInstance

from .cache import block_of, load, load_all

CHUNKS_PER_THREAD = 4  # more chunks than threads: worlds take unequal numbers of iterations
DEFAULT_GRAIN = 128  # items of about a microsecond that are worth waking another thread for

_pool: ThreadPoolExecutor | None = None
_pool_size = 0
_pool_pid = 0
_pool_lock = threading.Lock()
_gathered = threading.local()  # .launches: those that wait for the end of a block


def thread_count():
    """Threads a CPU launch may use: ``SLCP_WARP_THREADS`` where set, else the cores this process has."""
    text = os.environ.get("SLCP_WARP_THREADS", "").strip()
    if text:
        if not text.isdigit() or int(text) < 1:
            raise ValueError(f"SLCP_WARP_THREADS must be a whole number of at least 1, got {text!r}")
        return int(text)
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


_default_threads = thread_count()


def split(dim, threads, grain):
    """Chunks ``[(first, count), ...]`` of ``range(dim)``: one if the work is small, else several a thread."""
    if threads <= 1 or dim < 2 * grain:
        return [(0, dim)] if dim > 0 else []
    chunks = min(threads * CHUNKS_PER_THREAD, dim // grain)
    bounds = [i * dim // chunks for i in range(chunks + 1)]
    return [(a, b - a) for a, b in zip(bounds[:-1], bounds[1:])]


def launch(kernel, dim, inputs, device, threads=None, grain=DEFAULT_GRAIN):
    """Run ``kernel`` on items ``0 .. dim-1``; its arguments are ``first`` and then ``inputs``.

    Args:
        kernel: a Warp kernel whose first argument is ``first: int``, with ``enable_backward=False``.
        dim: number of items.
        inputs: the arguments after ``first``.
        device: a Warp device or its name.
        threads: at most this many CPU threads; default :func:`thread_count` at import.
        grain: smallest number of items worth a thread of its own (1 for whole trajectories).
    """
    device = wp.get_device(device)
    block = block_of(device)
    no_gaps(kernel, inputs)
    if not device.is_cpu or device.is_capturing:
        load(kernel, device)
        wp.launch(kernel, dim=dim, inputs=[0, *inputs], device=device, block_dim=block, record_tape=False)
        return
    chunks = split(dim, _default_threads if threads is None else threads, grain)
    if not chunks:
        return
    load(kernel, device)

    def run(chunk):
        wp.launch(
            kernel,
            dim=chunk[1],
            inputs=[chunk[0], *inputs],
            device=device,
            block_dim=block,
            record_tape=False,
        )

    _drain(run, chunks, _default_threads if threads is None else threads)


def no_gaps(kernel, inputs):
    """Refuse arrays with gaps along their last axis where a kernel reads them without strides."""
    if not getattr(kernel, "packed", False):
        return
    for number, value in enumerate(inputs):
        for array in _arrays(value):
            if array.device.is_cpu and array.size > 0 and array.shape[-1] > 1:
                if array.strides[-1] != wp.types.type_size_in_bytes(array.dtype):
                    raise ValueError(
                        f"argument {number + 1} of {kernel.key} has strides {array.strides} bytes; "
                        "no gaps along the last axis are needed"
                    )


def _arrays(value):
    """The arrays of an argument: itself, or those of a struct and of the structs in it."""
    if isinstance(value, wp.array):
        return [value]
    if isinstance(value, StructInstance):
        return [array for name in value._cls.vars for array in _arrays(getattr(value, name))]
    return []


@contextmanager
def together():
    """Kernels of the launches that are prepared in the block are compiled at its end, several at once.

    Until then such a launch may be made, too, and compiles its own.
    """
    if getattr(_gathered, "launches", None) is not None:  # within such a block: at the end of that one
        yield
        return
    _gathered.launches = found = []
    try:
        yield
    finally:
        _gathered.launches = None
    for device in {launch.device.alias: launch.device for launch in found}.values():
        load_all([each.kernel for each in found if each.device == device], device, thread_count())
    for each in found:
        each.pack()


class Prepared:
    """A launch with its arguments packed once; calling it repeats the launch at a fraction of the overhead.

    The arrays are kept alive and must stay the ones given. ``set_input(index, value)`` replaces one of
    ``inputs``. The items are ``offset .. offset + dim - 1``.
    """

    def __init__(self, kernel, dim, inputs, device, threads=None, grain=DEFAULT_GRAIN, offset=0):
        self.kernel, self.device = kernel, wp.get_device(device)
        no_gaps(kernel, inputs)
        self.inputs, self.offset = list(inputs), offset
        self.threads = _default_threads if threads is None else threads
        self.chunks = split(dim, self.threads if self.device.is_cpu else 1, grain)
        self.commands = None
        waiting = getattr(_gathered, "launches", None)
        if waiting is None:
            self.pack()
        else:
            waiting.append(self)

    def pack(self):
        """Compile the kernel and pack the arguments, unless that is done."""
        if self.commands is not None:
            return
        load(self.kernel, self.device)
        self.commands = [
            wp.launch(
                self.kernel,
                dim=count,
                inputs=[self.offset + first, *self.inputs],
                device=self.device,
                block_dim=block_of(self.device),
                record_cmd=True,
                record_tape=False,
            )
            for first, count in self.chunks
        ]

    def __call__(self):
        self.pack()
        # a graph of a CPU records one launch at a time
        _drain(_launch_command, self.commands, 1 if self.device.is_capturing else self.threads)

    def set_input(self, index, value):
        """Replace ``inputs[index]`` (counted without ``first``)."""
        no_gaps(self.kernel, [value])
        self.inputs[index] = value
        for command in self.commands or ():
            command.set_param_at_index(index + 1, value)


def _launch_command(command):
    command.launch()


def _drain(run, items, threads):
    """Call ``run`` on every item, the caller and ``threads - 1`` others taking the next one whenever free."""
    if len(items) == 1:
        run(items[0])
        return
    queue = collections.deque(items)

    def work():
        while True:
            try:
                item = queue.popleft()
            except IndexError:
                return
            run(item)

    helpers = [_executor(threads).submit(work) for _ in range(min(threads, len(items)) - 1)]
    try:
        work()
    finally:
        for helper in helpers:
            helper.result()


def _executor(threads):
    """The process's pool, made on first use, grown for more threads, made anew after a fork."""
    global _pool, _pool_size, _pool_pid
    if _pool is None or _pool_size < threads - 1 or _pool_pid != os.getpid():
        with _pool_lock:
            if _pool is None or _pool_size < threads - 1 or _pool_pid != os.getpid():
                _pool = ThreadPoolExecutor(max_workers=threads - 1, thread_name_prefix="slcp-warp")
                _pool_size, _pool_pid = threads - 1, os.getpid()
    return _pool
