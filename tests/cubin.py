"""Registers and stack frame of the kernels in a CUDA cubin (ELF64), read without CUDA tools."""

import struct

SECTION = struct.Struct(
    "<IIQQQQIIQQ"
)  # name, type, flags, address, offset, size, link, info, align, entry size
FRAME, REGISTERS = 0x11, 0x2F  # attributes of .nv.info: bytes of local memory, registers per thread
SIZED_VALUE = 4  # format of an attribute that carries its size


def kernel_resources(cubin: bytes) -> dict[str, dict[str, int]]:
    """{kernel: {"registers": .., "frame": ..}}; a frame is local memory (spills and indexed arrays)."""
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
