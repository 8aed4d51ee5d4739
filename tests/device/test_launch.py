"""Launches split over threads: every item once, the same numbers, errors not swallowed."""

import ast

import numpy as np
import pytest
import warp as wp
from plan import source_files

from slcp_warp.kernels.device import launch as launching
from slcp_warp.kernels.device.cache import BLOCK


@wp.kernel(module="unique", enable_backward=False)
def count_visits(first: int, scale: float, visits: wp.array(dtype=wp.float32)):
    item = first + wp.tid()
    visits[item] = visits[item] + scale * float(item + 1)


@wp.kernel(module="unique", enable_backward=False)
def count_twice(first: int, visits: wp.array(dtype=wp.float32)):
    item = first + wp.tid()
    visits[item] = visits[item] + float(2 * (item + 1))


@pytest.mark.parametrize(
    ("dim", "threads", "grain"), [(1, 4, 1), (11, 2, 1), (1000, 3, 16), (129, 2, 64), (5, 8, 1)]
)
def test_split_covers_the_range_in_order(dim, threads, grain):
    chunks = launching.split(dim, threads, grain)
    assert [i for first, count in chunks for i in range(first, first + count)] == list(range(dim))
    assert len(chunks) == 1 or min(count for _, count in chunks) >= grain


def test_split_of_nothing_is_nothing():
    assert launching.split(0, 4, 1) == []


@pytest.mark.parametrize("dim", [1, 37, 4096])
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_item_is_visited_once(device, dim, threads):
    visits = wp.zeros(dim, dtype=wp.float32, device=device)
    launching.launch(count_visits, dim, [2.0, visits], device, threads=threads, grain=1)
    np.testing.assert_array_equal(visits.numpy(), 2.0 * np.arange(1, dim + 1, dtype=np.float32))


def test_prepared_launch_repeats_and_takes_other_inputs(device):
    visits = wp.zeros(100, dtype=wp.float32, device=device)
    prepared = launching.Prepared(count_visits, 100, [1.0, visits], device, threads=3, grain=1)
    assert not visits.numpy().any()  # preparing runs nothing
    prepared()
    prepared.set_input(0, 10.0)
    prepared()
    np.testing.assert_array_equal(visits.numpy(), 11.0 * np.arange(1, 101, dtype=np.float32))


@pytest.fixture
def loads(monkeypatch):
    """Kernels that were asked for, call by call."""
    asked, load_all = [], launching.load_all

    def load(kernels, *more):
        asked.append(list(kernels))
        load_all(kernels, *more)

    monkeypatch.setattr(launching, "load_all", load)
    monkeypatch.setattr(launching, "load", lambda kernel, device: load((kernel,), device))
    return asked


def test_launches_prepared_together_are_compiled_together(device, loads):
    visits = wp.zeros(100, dtype=wp.float32, device=device)
    with launching.together():
        first = launching.Prepared(count_visits, 100, [1.0, visits], device, threads=3, grain=1)
        with launching.together():
            second = launching.Prepared(count_twice, 100, [visits], device)
        first.set_input(0, 10.0)
        assert loads == []
    assert loads[0] == [count_visits, count_twice] and not visits.numpy().any()
    first()
    second()
    first.set_input(0, 1.0)
    first()
    np.testing.assert_array_equal(visits.numpy(), 13.0 * np.arange(1, 101, dtype=np.float32))


def test_a_launch_that_is_made_at_once_does_not_wait_for_the_others(device, loads):
    visits = wp.zeros(5, dtype=wp.float32, device=device)
    with launching.together():
        launching.Prepared(count_visits, 5, [1.0, visits], device)()
        np.testing.assert_array_equal(visits.numpy(), np.arange(1, 6))
        assert loads == [[count_visits]]


def test_an_error_in_between_leaves_nothing_waiting(device, loads):
    visits = wp.zeros(5, dtype=wp.float32, device=device)
    with pytest.raises(RuntimeError, match="in between"):
        with launching.together():
            left = launching.Prepared(count_visits, 5, [1.0, visits], device)
            raise RuntimeError("in between")
    assert loads == []
    launching.Prepared(count_twice, 5, [visits], device)()  # prepared alone again
    left()
    np.testing.assert_array_equal(visits.numpy(), 3.0 * np.arange(1, 6))


def test_errors_of_helper_threads_reach_the_caller():
    def run(item):
        if item == 7:
            raise RuntimeError("item 7")

    with pytest.raises(RuntimeError, match="item 7"):
        launching._drain(run, range(20), 4)


def test_thread_count_from_the_environment(monkeypatch):
    monkeypatch.setenv("SLCP_WARP_THREADS", "3")
    assert launching.thread_count() == 3
    monkeypatch.setenv("SLCP_WARP_THREADS", "none")
    with pytest.raises(ValueError, match="'none'"):
        launching.thread_count()


def warps(registers, block):
    """Warps that a multiprocessor of an H100 holds: four parts of 16,384 registers, given to warps by 256."""
    each, size = 16_384 // (-(-32 * registers // 256) * 256), block // 32
    return min(min(4 * each, 64) // size, 32) * size


def test_blocks_on_a_gpu_waste_no_room_for_warps():
    for registers in range(24, 256):
        most = max(warps(registers, 32 * n) for n in range(1, 33))
        assert warps(registers, BLOCK) == most, registers
    assert warps(168, 256) == 8 and warps(168, BLOCK) == 12


def test_every_launch_of_the_package_says_its_block():
    """One of another size would compile the kernel again."""
    for path in source_files("kernels", "slcp_warp", "ddp"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.launch":
                words = [keyword.arg for keyword in node.keywords]
                assert "block_dim" in words or None in words, f"{path}:{node.lineno}"
