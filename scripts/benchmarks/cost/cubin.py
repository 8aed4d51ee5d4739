"""Registers and stack frame of the kernels in a CUDA cubin (ELF64), read without CUDA tools."""

import struct
from pathlib import Path

import warp as wp

SECTION = struct.Struct(
    "<IIQQQQIIQQ"
)  # name, type, flags, address, offset, size, link, info, align, entry size
FRAME, REGISTERS = 0x11, 0x2F  # attributes of .nv.info: bytes of local memory, registers per thread
SIZED_VALUE = 4  # format of an attribute that carries its size


def kernel_resources(cubin: bytes) -> dict[str, dict[str, int]]:
    """{kernel: {"registers": .., "frame": .., "code": bytes}}.

    A frame is local memory (spills and indexed arrays).
    """
    start = struct.unpack_from("<Q", cubin, 0x28)[0]
    _size, count, names = struct.unpack_from("<HHH", cubin, 0x3A)
    sections = [SECTION.unpack_from(cubin, start + i * SECTION.size) for i in range(count)]

    def text(table: int, offset: int) -> str:
        begin = sections[table][4] + offset
        return cubin[begin : cubin.index(b"\0", begin)].decode()

    label = [text(names, section[0]) for section in sections]
    symbols = sections[label.index(".symtab")]
    out: dict[str, dict[str, int]] = {}
    for section, name in zip(sections, label, strict=True):
        if name.startswith(".text."):
            out.setdefault(name.removeprefix(".text."), {})["code"] = section[5]
        if name != ".nv.info":
            continue
        at, end = section[4], section[4] + section[5]
        while at < end:
            form, attribute, size = struct.unpack_from("<BBH", cubin, at)
            at += 4
            if form != SIZED_VALUE:
                continue
            if attribute in (FRAME, REGISTERS) and size == 8:
                index, value = struct.unpack_from("<II", cubin, at)
                symbol = text(symbols[6], struct.unpack_from("<I", cubin, symbols[4] + 24 * index)[0])
                key = "frame" if attribute == FRAME else "registers"
                out.setdefault(symbol, {})[key] = value
            at += size
    return out


def sm90_resources(kernel: wp.Kernel, folder: Path) -> dict[str, int]:
    """Registers, frame and bytes of code of a kernel compiled for sm_90, which needs no GPU."""
    wp.compile_aot_module(kernel.module, arch=90, module_dir=str(folder), use_ptx=False)
    files = list(folder.rglob("*.cubin"))
    if len(files) != 1:
        raise RuntimeError(f"one cubin was expected in {folder}, {files} were written")
    cubin = files[0].read_bytes()
    forward = {
        name: used for name, used in kernel_resources(cubin).items() if name.endswith("kernel_forward")
    }
    if len(forward) != 1:
        raise RuntimeError(f"one forward kernel was expected, there are {sorted(forward)}")
    return {"frame": 0, "registers": 0} | next(iter(forward.values()))
