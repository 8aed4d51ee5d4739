"""Contact laws have one contract, and one place chooses between them (`kernels/solvers/law.py`)."""

import ast

import pytest
import warp as wp
from plan import ROOT

import slcp_warp as slcp
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.solvers.law import CONVEX, COULOMB, ERM, law_of
from slcp_warp.kernels.specialisation import Specialisation

METHODS = {
    "rem": (Method(), CONVEX),
    "hard": (Method("hard"), CONVEX),
    "coulomb": (Method("hard", friction="coulomb"), COULOMB),
    "erm": (Method("erm-normal"), ERM),
}
LAWS = {"coulomb", "erm", "rem"}  # properties of `Method` that name a law
MAY_ASK = ("method.py", "solvers/", "contact/rows.py", "plain/")  # which rows friction has; plain problems


def laws_named(source: str) -> set[str]:
    """What a source asks a method about its law."""
    named = (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Attribute) and n.attr in LAWS)
    return {ast.unparse(n) for n in named if ast.unparse(n.value).endswith("method")}


def test_no_room_asks_which_law_it_has():
    kernels = ROOT / "kernels"
    files = {str(path.relative_to(kernels)): path for path in kernels.rglob("*.py")}
    asked = {name: laws_named(path.read_text(encoding="utf-8")) for name, path in files.items()}
    assert {name: found for name, found in asked.items() if found and not name.startswith(MAY_ASK)} == {}


def test_the_rule_itself():
    assert laws_named("if method.coulomb and spec.method.erm: pass") == {"method.coulomb", "spec.method.erm"}
    assert laws_named("if method.hard: rem = law.coulomb") == set()


@pytest.mark.parametrize(("method", "law"), METHODS.values(), ids=METHODS)
def test_a_law_keeps_the_contract(method, law):
    assert law_of(method) is law
    spec = Specialisation(slcp.scenes.sliding_block().structure, wp.float64, method)
    response = vars(law.make_response(spec))
    shared = {"Factor", "factor", "yielding", "solve", "refined", "dual", "complete", "roots", "scaled"}
    assert shared <= response.keys() <= shared | {"transposed"}
    assert ("transposed" in response) == law.second == response["roots"]


def test_without_rows_there_is_one_law():
    assert {law_of(method, rows=0) for method, _ in METHODS.values()} == {CONVEX}
