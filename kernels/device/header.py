"""The part of Warp's header that a CPU's kernel needs, in place of all of it.

Warp 1.19 begins every kernel with 1.5 MB of C++, which takes clang .6 s: functions of thirteen types of
scalars and their adjoints, quaternions, meshes, volumes, tiles. What a kernel's code cannot reach by any name
is left out here, and all of `ELSEWHERE`. A function is reached where its name is, and where every type of
its signature is; a type or a macro where its name is; what is reached reaches the words of its text. Code is
not read further, so that more is kept than is needed. An overload that is left out takes a type that the
kernel names nowhere: no call can have meant it. A kernel that names what is not here, or that the compiler
refuses, gets Warp's header.
"""

import functools
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import warp as wp

INCLUDED = '#include "builtin.h"\n#include "deterministic.h"\n'
ELSEWHERE = frozenset(
    "bvh cuda_crt fabric hashgrid intersect intersect_tri matnn mesh noise svd texture tile tile_cholesky"
    " tile_fft tile_matmul tile_radix_sort tile_reduce tile_scan tile_solve volume".split()
)
AS_IT_IS: Any = {"encoding": "utf-8", "errors": "surrogateescape"}  # Warp writes as the locale says
# every kernel's frame has room for tiles, of which these kernels have none
NO_TILES = """
namespace wp {
struct tile_shared_storage_t { };
static tile_shared_storage_t* shared_tile_storage;
}
"""

_COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|//[^\n]*|/\*.*?\*/', re.S)
_INCLUDE = re.compile(r'^#include "([\w/]+)\.h".*$', re.M)
_WORD = re.compile(r"[A-Za-z_]\w*")
_OF_WARP = re.compile(r"\bwp::(\w+)")
_NAMESPACE = re.compile(r'(inline )?namespace \w+ \{$|extern "C" \{$|\}$')
_CALL = re.compile(r"([A-Z][A-Z_0-9]*)\((\w*)\);?$")
_MACRO = re.compile(r"#\s*define (\w+)(?:\((\w+)\)((?:.*\\\n)*.*))?")
_TEMPLATE = re.compile(r"(?:template <(?:[^<>]|<[^<>]*>)*>\s*)+")
_TYPE = re.compile(
    r"(?:struct|class|union|enum) (?:class )?(?:alignas\(\w+\) )?(\w+)[^;=()]*(?:[{;]|$)"
    r"|typedef\b[^;]*?(\w+);$|using (\w+) ="
)
_FUNCTION = re.compile(r"[^({=;]*?(operator\s*[^\w\s(]+(?:\(\))?|operator \w+|\w+)\s*(?:<[^<>()]*>)?\(")

# of a piece; STRUCTURE: a directive or a namespace's ends, whose text always stays
STRUCTURE, TYPE, FUNCTION = range(3)


class Piece:
    """A declaration or directive of the header.

    Attributes:
        name: by which it is reached; None: always.
        needs: types that must be reached, too.
    """

    def __init__(self, text: str, kind: int, name: str | None = None) -> None:
        self.text, self.kind, self.name = text, kind, name
        self.needs: frozenset[str] = frozenset()

    @functools.cached_property
    def words(self) -> frozenset[str]:
        """All that it may reach."""
        return frozenset(_WORD.findall(self.text))


def with_needed_header(build_cpu: Any) -> Any:
    """Warp's `build_cpu(object, source, ..)` that replaces the header of a source, in place, before."""

    @functools.wraps(build_cpu)
    def build(object_path: str, source_path: str, *args: Any, **kwargs: Any) -> Any:
        file = pathlib.Path(source_path)
        whole = file.read_text(**AS_IT_IS)
        source = shortened(whole)
        if source is None:
            return build_cpu(object_path, source_path, *args, **kwargs)
        try:
            file.write_text(source, **AS_IT_IS)
            short = {"use_precompiled_headers": False, "pch_dir": None}
            return build_cpu(object_path, source_path, *args, **kwargs | short)
        except Exception:  # what the compiler refuses it may take with the whole header, or say why not
            file.write_text(whole, **AS_IT_IS)
            return build_cpu(object_path, source_path, *args, **kwargs)

    return build


def shortened(source: str) -> str | None:
    """A kernel's source with the part of the header that it needs, without comments; None if it needs what is
    not here.
    """
    if source.count(INCLUDED) != 1:
        return None
    code = _without_comments(source)
    header = needed(code)
    known = set(_WORD.findall(header))
    if not known.issuperset(_OF_WARP.findall(code)):
        return None
    return code.replace(INCLUDED, header)


def needed(code: str) -> str:
    """The part of Warp's header that some C++ needs."""
    reached = set(_WORD.findall(code))
    kept: set[Piece] = set()
    left = list(_header())
    before = -1
    while before != len(kept):
        before = len(kept)
        more = []
        for piece in left:
            if (piece.name is None or piece.name in reached) and piece.needs <= reached:
                reached |= piece.words
                kept.add(piece)
            else:
                more.append(piece)
        left = more
    return "\n".join(piece.text for piece in _header() if piece.kind == STRUCTURE or piece in kept) + NO_TILES


@functools.cache
def _header() -> tuple[Piece, ...]:
    """Warp's header in pieces, in its order."""
    seen = set(ELSEWHERE)
    text = "".join(_joined(name, seen) for name in ("builtin", "deterministic"))
    pieces: list[Piece] = []
    _read(_without_comments(text), pieces, {})
    types = frozenset(piece.name for piece in pieces if piece.kind == TYPE and piece.name)
    for piece in pieces:
        if piece.kind == FUNCTION:
            piece.needs = types.intersection(_WORD.findall(piece.text.split("{", 1)[0]))
    return tuple(pieces)


def _joined(name: str, seen: set[str]) -> str:
    """A file of Warp's header with those that it includes."""
    if name in seen:
        return ""
    seen.add(name)
    text = pathlib.Path(wp.__file__).parent.joinpath("native", f"{name}.h").read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda found: _joined(found[1], seen), text.replace("#pragma once", ""))


def _without_comments(text: str) -> str:
    return _COMMENT.sub(lambda found: found[0] if found[0][0] == '"' else "", text)


def _read(text: str, pieces: list[Piece], macros: dict[str, tuple[str, str]]) -> None:
    """Append the pieces of a text; macros that declare functions of a type are written out."""
    for statement in _statements(text):
        macro = _MACRO.match(statement)
        call = _CALL.match(statement)
        if macro and macro[1].startswith("DECLARE_"):
            macros[macro[1]] = macro[2], macro[3].replace("\\\n", "\n")
        elif call and call[1] in macros:
            of, body = macros[call[1]]
            _read(re.sub(rf"\b{of}\b", call[2], body), pieces, macros)
        elif statement.startswith("#") or _NAMESPACE.match(statement):
            pieces.append(Piece(statement, STRUCTURE, macro[1] if macro else None))
        else:
            pieces.append(_declaration(statement))


def _declaration(text: str) -> Piece:
    head = _TEMPLATE.sub("", text, count=1) if text.startswith("template") else text
    kind = _TYPE.match(head)
    if kind:
        return Piece(text, TYPE, kind[1] or kind[2] or kind[3])
    if text.startswith("static_assert"):
        return Piece(text, FUNCTION)
    found = None if text.startswith("using") else _FUNCTION.match(head.removeprefix('extern "C"'))
    if not found:
        return Piece(text, TYPE)
    return Piece(text, FUNCTION, None if found[1].startswith("operator") else found[1])


def _statements(text: str) -> Iterator[str]:
    """Directives and declarations, those inside of others with them; namespaces begin and end apart."""
    part: list[str] = []
    depth = 0
    lines = iter(text.split("\n"))
    for line in lines:
        plain = line.strip()
        if plain.startswith("#"):
            while line.endswith("\\"):
                line += "\n" + next(lines)
            if not part:
                yield line.strip()
                continue
        elif not part and (not plain or _NAMESPACE.match(plain)):
            if plain:
                yield plain
            continue
        part.append(line)
        if not plain.startswith("#"):
            depth += sum(map(line.count, "{(")) - sum(map(line.count, "})"))
            if depth == 0 and (plain.endswith(("}", ";")) or (len(part) == 1 and _CALL.match(plain))):
                yield "\n".join(part).strip()
                part = []
