"""Names of kernels that call a user's code: told apart by what it does, or left to Warp's translation."""

import importlib
import linecache
import sys
from typing import Any

import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp.kernels.device.compile import code_digest
from slcp_warp.kernels.device.digest import content_digest

HEAD = "import dataclasses, warp as wp\nfrom typing import Any, NamedTuple\n"
KERNEL = "\ndef k(x: wp.array(dtype=float)):\n    x[0] = float(wp.static({}))\n"
USES = {  # what a user writes, with a number that is edited, and what the kernel takes of it
    "a method by another": (
        "@dataclasses.dataclass(frozen=True)\nclass G:\n    n: float\n"
        "    def inner(self): return {} * self.n\n"
        "    def total(self): return 1.0 + self.inner()\nG0 = G(2.0)\n", "G0.total()"),
    "a method by a helper": (
        "@dataclasses.dataclass(frozen=True)\nclass G:\n    n: float\n"
        "    def total(self): return {} * self.n\n"
        "def helper(g): return g.total()\nG0 = G(2.0)\n", "helper(G0)"),
    "an inherited method": (
        "class E:\n    def total(self): return {}\n@dataclasses.dataclass\nclass F(E):\n    n: float = 1.0\n"
        "def helper(g): return g.total()\nG0 = F()\n", "helper(G0)"),
    "a tuple's method": (
        "class T(NamedTuple):\n    n: float\n    def total(self): return {} * self.n\n"
        "def helper(g): return g.total()\nG0 = T(2.0)\n", "helper(G0)"),
    "a class that reads a global": (
        "SCALE = {}\nclass C:\n    def total(self): return SCALE\ndef helper(c): return c().total()\n",
        "helper(C)"),
    "globals": ("SCALE = {}\ndef helper(): return globals()['SCALE']\n", "helper()"),
}  # fmt: skip


def digest_of(folder, name: str, text: str) -> str:
    """Digest of the kernel `k` of a module with this text."""
    (folder / f"{name}.py").write_text(HEAD + text)
    linecache.clearcache()
    importlib.invalidate_caches()
    sys.modules.pop(name, None)
    return code_digest(importlib.import_module(name).k)


@pytest.mark.parametrize("use", USES)
def test_an_edit_of_what_a_users_object_does_changes_the_name(use, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    text, taken = USES[use]
    name = f"users_{use.replace(' ', '_')}"
    texts = [text.format(n) + KERNEL.format(taken) for n in (1.0, 3.0, 1.0)]
    one, two, again = (digest_of(tmp_path, name, each) for each in texts)
    assert one != two and one == again


def test_a_file_named_as_a_module_of_the_library_is_a_users(tmp_path, monkeypatch):
    """`sched`, which nothing here imports, beside a user's own."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "sched", raising=False)
    found = []
    for factor in (1.0, 10.0):
        (tmp_path / "sched.py").write_text(f"def weigh(x): return {factor} * x\n")
        monkeypatch.delitem(sys.modules, "sched", raising=False)
        linecache.clearcache()
        importlib.invalidate_caches()
        text = "import sched as shared\n" + KERNEL.format("shared.weigh(2.0)")
        found.append(digest_of(tmp_path, f"weighs_{int(factor)}", text))
    monkeypatch.delitem(sys.modules, "sched", raising=False)
    assert found[0] != found[1]


def test_what_was_asked_of_a_structure_before_does_not_enter():
    fresh, asked = (slcp.scenes.sliding_block().structure for _ in range(2))
    assert asked.rows and asked.dof_body and asked.dof_kind

    def kernel(s):
        def k(x: wp.array(dtype=float)):
            x[0] = float(wp.static(len(s.rows)))
            x[1] = float(wp.static(str(s)))

        return k

    assert content_digest(kernel(fresh)) == content_digest(kernel(asked))


def test_what_a_generic_function_was_made_into_does_not_enter():
    @wp.func
    def squared(x: Any):
        return x * x

    def k(x: wp.array(dtype=float)):
        x[0] = squared(x[0])

    before = content_digest(k)
    squared.get_overload([wp.float32], {})
    squared.get_overload([wp.float64], {})
    assert squared.user_overloads and content_digest(k) == before
