"""What is shortened in Warp changes nothing but the time it takes."""

import re

import pytest
import warp as wp
from warp._src import codegen
from warp._src.codegen import Adjoint
from warp._src.context import ModuleBuilder, ModuleHasher

import slcp_warp as slcp
from slcp_warp.kernels.device import patches
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.tracking import TRACKING
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout


def code(kernel):
    """The C++ that Warp makes of a kernel."""
    options = kernel.module.resolve_options(wp.config, block_dim=1) | {"output_arch": None, "block_dim": 1}
    return ModuleBuilder(kernel.module, options, target="cpu").codegen("cpu")


def counted(monkeypatch):
    """A list that grows with every overload that Warp looks up."""
    calls = []
    resolve = Adjoint.resolve_func

    def count(adjoint, function, *rest):
        calls.append(function)
        return resolve(adjoint, function, *rest)

    monkeypatch.setattr(Adjoint, "resolve_func", count)
    return calls


@pytest.fixture
def unpatched(monkeypatch):
    """Warp as it comes."""
    (hash_adjoint,) = (c.cell_contents for c in ModuleHasher.hash_adjoint.__closure__)
    monkeypatch.setattr(ModuleHasher, "hash_adjoint", hash_adjoint)
    found = dict(zip(Adjoint.resolve_func.__code__.co_freevars, Adjoint.resolve_func.__closure__))
    monkeypatch.setattr(Adjoint, "resolve_func", found["resolve"].cell_contents)
    shared = codegen.struct_template.replace(
        "\nstatic CUDA_CALLABLE {name} add", "\nCUDA_CALLABLE {name} add"
    )
    shared = shared.replace("\nstatic CUDA_CALLABLE void adj_atomic", "\nCUDA_CALLABLE void adj_atomic")
    assert shared != codegen.struct_template
    monkeypatch.setattr(codegen, "struct_template", shared)


def test_the_code_is_the_same(monkeypatch, unpatched):
    spec = Specialisation(slcp.scenes.particle(friction=0.5).structure, wp.float64, Method())
    kernel = rollout.make_rollout_kernel(spec, TRACKING, True)
    by_warp = counted(monkeypatch)
    before = code(kernel)
    calls = len(by_warp)
    patches.apply()
    after = code(kernel)
    hashes = re.compile(rf"(?<={kernel.key}_)[0-9a-f]{{8}}")  # Warp's own, which one of the patches shortens
    assert (
        after.count("\nstatic CUDA_CALLABLE ")
        == 3 * after.count("\nstruct make_")
        > before.count("\nstatic CUDA_CALLABLE ")
    )
    before, after = (
        hashes.sub("", text).replace("static CUDA_CALLABLE", "CUDA_CALLABLE") for text in (before, after)
    )
    assert before == after
    assert len(by_warp) - calls < calls / 2


def test_another_version_of_warp_is_left_as_it_is(monkeypatch, unpatched):
    monkeypatch.setattr(wp, "__version__", "1.20.0")
    before = ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template
    patches.apply()
    assert (ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template) == before


def test_they_are_applied_once():
    before = ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template
    assert before[0].shortened
    patches.apply()
    assert (ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template) == before


def test_a_call_that_no_overload_takes_is_still_an_error():
    def bad(x: wp.array(dtype=wp.float64)):
        x[0] = wp.sin(wp.int32(1), wp.int32(2))

    kernel = wp.kernel(bad, module=type(wp.get_module(__name__))("bad", None), enable_backward=False)
    for _ in range(2):
        with pytest.raises(Exception, match="Couldn't find function overload"):
            code(kernel)
