"""Workspaces of the generic kernels in a CPU's memory."""

from slcp_warp import scenes
from slcp_warp.kernels.generic.work import Slot, allocate_work, bytes_per_world, lengths

LINE = 64


def test_worlds_share_no_cache_line():
    """Threads that step neighbours would take it from each other; nor do arrays overlap."""
    structure = scenes.stack(3).structure
    work, slots = allocate_work(structure, 5, "cpu"), 5
    size = bytes_per_world(structure)
    for name, length in lengths(structure).items():
        array = getattr(work, name)
        assert array.shape == (slots, length) and not array.numpy().any()
        array.fill_(1)
    begins = sorted((getattr(work, name).ptr, name) for name in Slot.cls.__annotations__)
    first = begins[0][0]
    assert first % LINE == 0 and size % LINE == 0
    for (begin, name), (end, _) in zip(begins, [*begins[1:], (first + size, "")], strict=True):
        array = getattr(work, name)
        assert begin + array.shape[1] * array.strides[1] <= end
        assert array.strides[0] == size
