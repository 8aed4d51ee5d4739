"""Sphinx's configuration: `bash scripts/docs.sh` builds these pages into out/docs, warnings are errors.

Pages are Markdown (MyST) that a plain git view shows as well. The API is generated from the docstrings of
what the public modules name in `__all__`, the command line from the commands' own help.
"""

import importlib
import importlib.util
import inspect
import pathlib
import re
import subprocess
import sys
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

import slcp_warp

project = "slcp-warp"
author = "The slcp-warp authors"
copyright = author
version = release = slcp_warp.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
exclude_patterns = ["templates"]
templates_path = ["templates"]
nitpicky = True
html_theme = "furo"
html_title = f"slcp-warp {release}"
html_copy_source = False

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3  # the anchors that git views make, too
html_math_renderer = "mathml"  # formulas are shown without a network

API = pathlib.Path(__file__).parent / "reference" / "api.md"
PUBLIC = re.findall(r"^   (slcp_warp[\w.]*)$", API.read_text(encoding="utf-8"), re.MULTILINE)
autosummary_generate = ["reference/api.md"]
PAGES = {"reference/api_torch": ("torch", "PyTorch"), "reference/api_jax": ("jax", "JAX")}  # of libraries
for page, (library, _) in PAGES.items():
    if importlib.util.find_spec(library) is not None:
        PUBLIC.append(f"slcp_warp.{library}")
        autosummary_generate.append(f"{page}.md")
COMMANDS = "slcp_warp.scripts.app"

default_role = "py:obj"  # `name` in a docstring: a link where it is public, else code
autosummary_ignore_module_all = False
autosummary_imported_members = True
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
napoleon_use_ivar = True
napoleon_numpy_docstring = False
napoleon_custom_sections = ["Returns"]  # text, not "type: text"

nitpick_ignore_regex = [
    ("py:obj", r".*"),  # backticks hold code of every kind; tests/test_docs.py looks up the names among it
    ("py:.*", r"(numpy|np|warp|wp|torch|jax|os|pathlib|collections|typing|enum)\..*"),
    ("py:.*", r"slcp_warp\..*"),  # a type that is not public
]


def _public_names() -> tuple[dict[str, str], dict[str, str]]:
    """Where a public object was defined -> the name that it is documented by; other names -> that name."""
    names: dict[str, str] = {}
    aliases: dict[str, str] = {}
    for module in map(importlib.import_module, PUBLIC):
        for name in module.__all__:
            found, here = getattr(module, name), f"{module.__name__}.{name}"
            home = f"{getattr(found, '__module__', module.__name__)}.{getattr(found, '__qualname__', name)}"
            if names.setdefault(home, here) != here and not inspect.ismodule(found):
                aliases[here] = names[home]
    return names, aliases


PUBLIC_NAMES, ALIASES = _public_names()
autosummary_context = {"aliases": ALIASES}


def resolve(app: Sphinx, env: Any, node: Any, text: Any) -> Any:
    """A reference to where an object was defined leads to its public name."""
    target = node.get("reftarget", "")
    public = PUBLIC_NAMES.get(target)
    if node.get("refdomain") != "py" or public is None or public == target:
        return None
    domain = env.get_domain("py")
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", public, node, text)


_kept: dict[str, list[str]] = {}


def plain_text(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with code in backticks: what else reStructuredText would read is escaped."""
    lines[:] = [line for entry in _entries(lines) for line in _one_name_each(entry)]
    for i, line in enumerate(lines):
        parts = re.split(r"(``.+?``|`[^`]+`)", line)
        parts[::2] = [re.sub(r"(?<=\w)_(?!\w)|[*|]", r"\\\g<0>", part) for part in parts[::2]]
        lines[i] = "".join(parts)
    if what in ("property", "attribute"):  # napoleon would take what stands before a colon for a type
        _kept[name] = lines[:]
        lines.clear()


def restore(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """What `plain_text` kept from napoleon."""
    lines.extend(_kept.pop(name, ()))


def _entries(lines: list[str]) -> list[list[str]]:
    """The lines of a docstring, those of an entry of a section together."""
    entries: list[list[str]] = []
    for line in lines:
        if entries and line.startswith(" " * 8) and entries[-1][0].startswith(" " * 4):
            entries[-1].append(line)
        else:
            entries.append([line])
    return entries


def _one_name_each(entry: list[str]) -> list[str]:
    """An entry of a section, "lower, upper: limits", once for each of its names."""
    found = re.match(r" {4}(\w+(?:, \w+)+): ", entry[0])
    if found is None:
        return entry
    rest = entry[0][found.end() :]
    return [line for name in found[1].split(", ") for line in (f"    {name}: {rest}", *entry[1:])]


def signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, given: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """A default that a factory makes stands as "...", which is Python."""
    return (given or "").replace("<factory>", "...") or None, returns


def complete(app: Sphinx, docname: str, source: list[str]) -> None:
    """Append what the commands say of themselves to their page; a page that needs a library says so."""
    if docname in PAGES and f"{docname}.md" not in autosummary_generate:
        name = PAGES[docname][1]
        source[0] = f"# {name}\n\n{name} was not installed where these pages were built."
    if docname == "reference/commands":
        call = [sys.executable, "-m", "typer", COMMANDS, "utils", "docs", "--name", "slcp"]
        said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
        source[0] += "\n#" + said.replace("\n#", "\n##")


def inline_math(self: Any, node: Any) -> None:
    """A formula in a line of text as MathML, by Docutils."""
    self.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def displayed_math(self: Any, node: Any) -> None:
    """A formula of its own as MathML, with its number beside it."""
    formula, number = re.fullmatch(r"(.*?)(?:\\tag\{(\w+)\})?\s*", node.astext(), re.DOTALL).groups()
    beside = f'<span class="eqno">({number})</span>' if number else ""
    self.body.append(f'<div class="math">{beside}{tex2mathml(formula, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the hooks."""
    app.add_html_math_renderer("mathml", (inline_math, None), (displayed_math, None))
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", plain_text, priority=400)
    app.connect("autodoc-process-docstring", restore, priority=600)
    app.connect("autodoc-process-signature", signature)
    app.connect("source-read", complete)
