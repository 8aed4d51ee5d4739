"""References lead somewhere: equations, sections of the paper, names of the package, files, pages."""

import ast
import functools
import importlib
import importlib.util
import inspect
import re

import pytest
from test_docs import CODE, TEXTS, name
from test_layout import LAYERS, ROOT, source_files

import slcp_warp
from slcp_warp import ddp

MATHEMATICS = ROOT / "docs" / "understand" / "mathematics.md"
PAGES = sorted((ROOT / "docs").rglob("*.md"))
SECTIONS = {  # of the paper
    "I", "II", "III", "III.A", "III.B", "III.C", "III.C.1", "III.C.2", "III.D", "IV", "IV.A", "IV.B", "IV.C",
    "V", "V.A", "V.B", "V.C", "VI",
}  # fmt: skip
FOOTNOTES, SOURCES = {1, 2, 3, 4}, set(range(1, 23))
MADE = {"file.py", "report.md", "fuzz.md", "table.md"}  # files that commands write
NAME = re.compile(r"(slcp|ddp|slcp_warp|slcp_torch|slcp_jax)((?:\.[A-Za-z_]\w*)+)(?!\w)(?<!\.png)")


@functools.cache
def docstrings(path):
    """The docstrings and comments of a source, as one text."""
    text = path.read_text(encoding="utf-8")
    nodes = (ast.Module, ast.ClassDef, ast.FunctionDef)
    found = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(text)) if isinstance(node, nodes)]
    return "\n".join(found + re.findall(r"#.*", text))


def prose():
    """(file, text) of every page and of the docstrings of every source."""
    yield from ((name(path), path.read_text(encoding="utf-8")) for path in TEXTS)
    yield from ((name(path), docstrings(path)) for path in CODE)


def tags(text):
    return [int(number) for number in re.findall(r"\\tag\{M(\d+)\}", text)]


def test_every_equation_has_a_number_of_its_own_and_stands_once():
    numbers = tags(MATHEMATICS.read_text(encoding="utf-8"))
    assert numbers == list(range(1, len(numbers) + 1))
    others = {name(path): tags(path.read_text(encoding="utf-8")) for path in PAGES if path != MATHEMATICS}
    assert {page: found for page, found in others.items() if found} == {}
    displayed = {name(path): path.read_text(encoding="utf-8").count("$$") // 2 for path in PAGES}
    assert {page: count for page, count in displayed.items() if count} == {name(MATHEMATICS): len(numbers)}


def test_equations_that_are_referred_to_are_there():
    known = set(tags(MATHEMATICS.read_text(encoding="utf-8")))
    absent = {page: {int(n) for n in re.findall(r"\(M(\d+)\)", text)} - known for page, text in prose()}
    assert {page: numbers for page, numbers in absent.items() if numbers} == {}


def test_links_to_an_equation_lead_to_its_section():
    sections = {}
    for part in re.split(r"^## ", MATHEMATICS.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        head, _, body = part.partition("\n")
        sections[re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-")] = tags(body)
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        for number, anchor in re.findall(r"\[\(M(\d+)\)\]\([^)#]*mathematics\.md#([\w-]+)\)", text):
            assert int(number) in sections[anchor], f"{name(path)}: (M{number}) is not in #{anchor}"


def test_the_papers_equations_have_a_place():
    """Numbers after "eq." are the paper's, and the table says where each of them stands here."""
    text = MATHEMATICS.read_text(encoding="utf-8")
    table = text[text.index("## The paper's equations") :]
    left = [row.split("|")[1] for row in table.splitlines() if row.startswith("| (")]
    listed = {int(number) for cell in left for number in re.findall(r"\((\d+)[a-d]?\)", cell)}
    assert listed == set(range(1, 21))
    for page, text in prose():
        for numbers in re.findall(r"\b(?:[Ee]qs?\.|[Ee]quations?) ((?:\(\d+[a-d]?\)(?:, | and |-)?)+)", text):
            assert {int(n) for n in re.findall(r"\((\d+)", numbers)} <= listed, f"{page}: {numbers}"


def test_sections_footnotes_and_sources_of_the_paper_exist():
    for page, text in prose():
        for line in text.splitlines():
            if "2012" in line:  # another paper's
                continue
            for found in re.findall(r"\b[Ss]ections? ([IVX]+(?:[.-][A-D](?:\.\d)?)?)", line):
                assert found.replace("-", ".") in SECTIONS, f"{page}: section {found}"
            for found in re.findall(r"\bfootnote (\d+)", line):
                assert int(found) in FOOTNOTES, f"{page}: footnote {found}"
            for found in re.findall(r"[Pp]aper's \[(\d+)\]", line):
                assert int(found) in SOURCES, f"{page}: [{found}]"


def lookup(path):
    """Whether a dotted name below `slcp` or `ddp` exists: an attribute, a field, or set by __init__."""
    root, *parts = path.split(".")
    if root in ("slcp_torch", "slcp_jax"):
        root, parts = "slcp_warp", [root.removeprefix("slcp_"), *parts]
    found = ddp if root == "ddp" else slcp_warp
    for part in parts:
        if inspect.ismodule(found) and not hasattr(found, part):
            if importlib.util.find_spec(f"{found.__name__}.{part}") is None:
                return False
            if part in ("torch", "jax"):
                pytest.importorskip(part)
            importlib.import_module(f"{found.__name__}.{part}")
        if hasattr(found, part):
            found = getattr(found, part)
        elif inspect.isclass(found):
            return part in found.__annotations__ or f"self.{part}" in inspect.getsource(found)
        else:
            return False
    return True


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_names_in_texts_are_there(path):
    text = path.read_text(encoding="utf-8")
    quoted = re.findall(r"`([^`\n]+)`", text) + re.findall(
        r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL
    )
    named = {
        match[0] for part in quoted for match in NAME.finditer(part) if match.start() == 0 or "(" in part
    }
    if path.name == "CHANGELOG.md":  # speaks of what was
        named = set()
    assert [one for one in sorted(named) if not lookup(one)] == []


@pytest.mark.parametrize("path", source_files("slcp_warp", "ddp"), ids=name)
def test_names_in_docstrings_are_there(path):
    public = {n: f"slcp.{n}" for n in slcp_warp.__all__} | {f"ddp.{n}": f"ddp.{n}" for n in ddp.__all__}
    if path.is_relative_to(ROOT / "ddp"):
        public |= {n: f"ddp.{n}" for n in ddp.__all__}
    absent = []
    for part in re.findall(r"`([^`\n]+)`", docstrings(path)):
        match = re.match(r"((?:ddp\.)?[A-Z]\w*|(?:slcp|slcp_warp|ddp)\.\w+)((?:\.\w+)*)(?=$|\()", part)
        if match is None:
            continue
        known = public.get(match[1], match[1] if NAME.fullmatch(match[1]) else None)
        if known is not None and not lookup(known + match[2]):
            absent.append(part)
    assert absent == []


def test_modules_that_are_run_are_there():
    for page, text in prose():
        for module in re.findall(r"python -m (slcp_warp[\w.]*)", text):
            assert importlib.util.find_spec(module.rstrip(".")) is not None, f"{page}: {module}"


def test_files_that_are_called_by_their_bare_name_are_there():
    """`newton.py` in a docstring, or `house.md`, is a file of the tree."""
    here = {path.name for path in source_files(*LAYERS, "tests", "examples", "docs")} | MADE
    here |= {path.name for path in TEXTS} | {path.name for path in ROOT.glob("scripts/*.sh")}
    for page, text in prose():
        if page.startswith("tests/"):  # write files of their own
            continue
        for found in re.findall(r"(?<![\w/.*{-])([a-z]\w*\.(?:py|md|sh))\b", text):
            assert found in here, f"{page}: {found}"


def test_every_status_and_error_is_listed():
    page = (ROOT / "docs" / "reference" / "statuses.md").read_text(encoding="utf-8")
    steps, problems, errors = page.split("\n## ")[1:]
    codes = re.findall(r"^\| ([A-Z_]+) \| (\d+) \|", steps, re.MULTILINE)
    assert codes == [(status.name, str(status.value)) for status in slcp_warp.Status]
    listed = re.findall(r"^\| ([A-Z_]+) \|", problems, re.MULTILINE)
    assert listed == [status.name for status in ddp.Status]
    for module, prefix in ((slcp_warp, "slcp"), (ddp, "ddp")):
        for error in (n for n in module.__all__ if n.endswith("Error")):
            assert f"`{prefix}.{error}`" in errors, error


def test_the_reference_has_every_public_module():
    page = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    modules = {"slcp_warp", "slcp_warp.ddp"}
    for module, prefix in ((slcp_warp, "slcp_warp"), (ddp, "slcp_warp.ddp")):
        modules |= {f"{prefix}.{n}" for n in module.__all__ if inspect.ismodule(getattr(module, n))}
    assert set(re.findall(r"^   (slcp_warp[\w.]*)$", page, re.MULTILINE)) == modules


def test_the_index_leads_to_every_page():
    index = ROOT / "docs" / "index.md"
    text = index.read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\(([\w/]+\.md)\)", text))
    pages = {str(path.relative_to(index.parent)) for path in PAGES if path != index}
    assert listed == pages
    trees = "\n".join(re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    assert {f"{line}.md" for line in trees.split("\n") if line and line[0] != ":"} == pages
