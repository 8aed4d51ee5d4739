"""A kernel's name changes with its code, and with nothing else."""

import ast
import functools
import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from slcp_warp.kernels.device.digest import OpaqueError, content_digest

FOLDERS = {"": "slcp_warp", "kernels": "slcp_warp.kernels"}
NAMES = """
import json, sys, warp as wp
wp.config.log_level = wp.LOG_ERROR
wp.init()
import slcp_warp as slcp
from slcp_warp.kernels.ensembles.draws import make_draw_kernel
from slcp_warp.kernels.generic.step import make_step_kernel
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.residual.residuals import make_residual_kernel
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout
assert slcp.__file__.startswith(sys.argv[1]), slcp.__file__
f64, scene = wp.float64, slcp.scenes.sliding_block().structure
spec = Specialisation(scene, f64, Method())
hard = Specialisation(scene, f64, Method("hard", friction="coulomb"))
made = {
    "step": rollout.make_step_kernel(spec),
    "rollout": rollout.make_rollout_kernel(spec, OPEN_LOOP, False),
    "coulomb": rollout.make_step_kernel(hard),
    "generic": make_step_kernel(f64, "hard"),
    "draw": make_draw_kernel(f64),
    "residual": make_residual_kernel(f64, "min"),
}
print(json.dumps({what: kernel.module.get_module_identifier(1) for what, kernel in made.items()}))
"""
ALL = {"step", "rollout", "coulomb", "generic", "draw", "residual"}


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """A function that edits a copy of the package and gives the names of its kernels in Warp's cache."""
    tree = tmp_path_factory.mktemp("tree")
    for folder, module in FOLDERS.items():
        home = Path(importlib.import_module(module).__file__).parent
        shutil.copytree(home, tree / "slcp_warp" / folder, dirs_exist_ok=True)

    def find(edit=lambda files: {}):
        home = tree / "slcp_warp" / "kernels"
        files = {str(path.relative_to(home)): path for path in home.rglob("*.py")}
        before = {path: path.read_text() for path in files.values()}
        try:
            for path, text in edit(files).items():
                assert text != before[path]
                path.write_text(text)
            environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONSAFEPATH": "1"}
            run = [sys.executable, "-c", NAMES, str(tree)]
            out = subprocess.run(run, env=environment, capture_output=True, text=True, cwd=tree)
            assert out.returncode == 0, out.stderr
            return json.loads(out.stdout)
        finally:
            for path, text in before.items():
                path.write_text(text)

    return SimpleNamespace(after=find, before=find())


def changed(names, edit):
    """The kernels that an edit compiles again."""
    after = names.after(edit)
    assert after.keys() == ALL
    return {what for what in ALL if after[what] != names.before[what]}


def edited(name, what, line):
    """An edit: one more line, before the last statement of a function or after the setting of a constant."""

    def edit(files):
        lines = files[name].read_text().splitlines(keepends=True)
        for node in ast.walk(ast.parse("".join(lines))):
            if isinstance(node, ast.FunctionDef) and node.name == what:
                last = node.body[-1]
                lines.insert(last.lineno - 1, " " * last.col_offset + line + "\n")
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == what:
                lines.insert(node.end_lineno, line + "\n")
        return {files[name]: "".join(lines)}

    return edit


def reworded(files):
    """All docstrings and comments written anew, every file further down, one function more in each."""

    def edit(text):
        lines, tree = text.splitlines(), ast.parse(text)
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                continue
            if ast.get_docstring(node) is None:
                continue
            quoted = node.body[0]
            lines[quoted.lineno - 1] = " " * quoted.col_offset + '"""Another sentence.'
            for k in range(quoted.lineno, quoted.end_lineno):
                lines[k] = " " * quoted.col_offset + "another line"
            lines[quoted.end_lineno - 1] += '"""'
        return "\n".join(["# a comment", *lines, "", "def unused():", "    return 1", ""])

    return {path: edit(path.read_text()) for path in files.values()}


def test_names_do_not_depend_on_the_process(names):
    assert changed(names, lambda files: {}) == set()


@pytest.mark.slow
def test_comments_docstrings_and_places_are_no_code(names):
    assert changed(names, reworded) == set()


def test_an_edit_recompiles_what_contains_it(names):
    assert changed(names, edited("solvers/lemke.py", "measure", "unused = int(7)")) == {"coulomb"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, what, line, kernels",
    [
        ("device/random.py", "philox", "unused = int(7)", {"draw"}),
        ("contact/problem.py", "COLD", "COLD = 2.0 * COLD", {"step", "rollout", "coulomb", "generic"}),
        ("device/random.py", "ROUNDS", "import slcp_warp  # noqa", set()),
        ("step/rollout.py", "step_kernel", "unused = int(7)", {"step", "coulomb"}),
    ],
    ids=["a function", "a constant", "a new import", "one kernel of two in a file"],
)
def test_edits(names, name, what, line, kernels):
    assert changed(names, edited(name, what, line)) == kernels


def kernel(value):
    """A kernel that names a value in all ways that there are."""

    @wp.func
    def inner(x: wp.float64):
        return x * wp.static(value.numbers[1])

    functions = (inner,)

    def outer(x: wp.array(dtype=wp.float64)):
        for k in range(1):
            x[k] = wp.static(functions[k])(x[k]) + value.shift

    return outer


def value(**changes):
    base = {"numbers": (wp.float64(1.0), wp.float64(2.0)), "shift": wp.float64(0.0), "unused": 0}
    return SimpleNamespace(**base | changes)


@pytest.mark.parametrize(
    "changes, same",
    [
        ({}, True),
        ({"unused": 1}, True),
        ({"shift": wp.float64(-0.0)}, False),
        ({"shift": wp.float32(0.0)}, False),
        ({"shift": 0.0}, False),
        ({"numbers": (wp.float64(1.0), wp.float64(3.0))}, False),
        ({"numbers": np.array([1.0, 2.0])}, False),
        ({"shift": wp.vec2d(0.0, 0.0)}, False),
        ({"shift": wp.vec2d(0.0, 1.0)}, False),
    ],
)
def test_values(changes, same):
    assert (content_digest(kernel(value(**changes))) == content_digest(kernel(value()))) == same


def test_arrays_and_options_count():
    def digest(numbers, *more):
        return content_digest(kernel(value(numbers=numbers)), *more)

    assert digest(np.array([1.0, 2.0])) == digest(np.array([1.0, 2.0]))
    assert digest(np.array([1.0, 2.0])) != digest(np.array([1.0, 3.0]))
    assert digest((1.0, 2.0), {"max_unroll": 1}) != digest((1.0, 2.0), {"max_unroll": 2})


def test_types_of_arguments_and_structs_count():
    def digest(kind):
        @wp.struct
        class Pair:
            first: kind

        @wp.func
        def take(x: kind):
            p = Pair()
            p.first = x
            return p.first

        def run(x: wp.array(dtype=kind)):
            x[0] = take(x[0])

        return content_digest(run)

    kinds = (wp.float32, wp.float64, wp.types.vector(2, wp.float64), wp.types.vector(3, wp.float64))
    assert len({digest(kind) for kind in kinds}) == len(kinds)
    assert digest(wp.types.vector(2, wp.float64)) == digest(wp.types.vector(2, wp.float64))


def test_a_quaternion_is_no_vector():
    def digest(kind):
        @wp.func
        def turn(x: float):
            out = kind()
            return (out * out)[0] + x

        def run(x: wp.array(dtype=float)):
            x[0] = turn(x[0])

        return content_digest(run)

    vectors = [wp.types.vector(n, wp.float64) for n in (4, 7)]
    assert len({digest(kind) for kind in (*vectors, wp.quatd, wp.transformd)}) == 4


def test_what_cannot_be_told_is_said():
    with pytest.raises(OpaqueError, match="object"):
        content_digest(kernel(value(shift=object())))


def test_python_functions_count():
    """Helpers that `wp.static` calls, with what they name; partial ones, lambdas, and ones that recur."""

    def digest(helper):
        def run(x: wp.array(dtype=wp.float64)):
            x[0] = wp.float64(wp.static(helper(2)))

        return content_digest(run)

    def scaled(factor):
        return lambda n: factor * n

    def power(n, base=2.0):
        return 1.0 if n == 0 else base * power(n - 1, base)

    found = [digest(f) for f in (scaled(1.0), scaled(2.0), power, functools.partial(power, base=3.0), abs)]
    assert len(set(found)) == len(found)
    assert digest(scaled(2.0)) == found[1]
