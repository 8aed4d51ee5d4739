"""What is shortened in Warp changes nothing but the time it takes."""

import re

import pytest
import warp as wp
from warp._src import codegen, types
from warp._src.codegen import Adjoint, Var
from warp._src.context import Function, ModuleBuilder, ModuleHasher

import slcp_warp as slcp
from slcp_warp.kernels.device import digest, patches
from slcp_warp.kernels.device.compile import named_by_code, with_adjoint
from slcp_warp.kernels.method import Method
from slcp_warp.kernels.policies.tracking import TRACKING
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout


def code(kernel):
    """The C++ that Warp makes of a kernel."""
    options = kernel.module.resolve_options(wp.config, block_dim=1) | {"output_arch": None, "block_dim": 1}
    return ModuleBuilder(kernel.module, options, target="cpu").codegen("cpu")


def parts(text):
    """Structs and functions of C++, sorted."""
    return sorted(part.strip() for part in re.split(r"\n\n+(?=struct |//|static )", text))


def counted(monkeypatch):
    """A list that grows with every overload that Warp looks up."""
    calls = []
    resolve = Adjoint.resolve_func

    def count(adjoint, function, *rest):
        calls.append(function)
        return resolve(adjoint, function, *rest)

    monkeypatch.setattr(Adjoint, "resolve_func", count)
    return calls


def inner(function, name):
    """What a function of `patches` or `translated` calls by this name."""
    return dict(zip(function.__code__.co_freevars, function.__closure__))[name].cell_contents


@pytest.fixture
def unpatched(monkeypatch):
    """Warp as it comes."""
    for where, name, called in (
        (Adjoint, "build", "translate"),
        (Function, "build", "translate"),
        (codegen, "codegen_func", "write"),
        (ModuleBuilder, "build_struct_recursive", "build_struct"),
    ):
        monkeypatch.setattr(where, name, inner(getattr(where, name), called))
    (hash_adjoint,) = (c.cell_contents for c in ModuleHasher.hash_adjoint.__closure__)
    monkeypatch.setattr(ModuleHasher, "hash_adjoint", hash_adjoint)
    monkeypatch.setattr(Adjoint, "resolve_func", inner(Adjoint.resolve_func, "resolve"))
    monkeypatch.setattr(codegen, "get_arg_type", inner(codegen.get_arg_type, "of_any"))
    monkeypatch.setattr(codegen, "get_arg_value", inner(codegen.get_arg_value, "value_of_any"))
    stripped = inner(codegen.strip_reference, "strip_any")
    for where in (codegen, types):
        monkeypatch.setattr(where, "strip_reference", stripped)
    monkeypatch.setattr(Var, "type_to_ctype", staticmethod(inner(Var.type_to_ctype, "name_any")))
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
    assert parts(code(kernel)) == parts(after)  # all of it kept
    hashes = re.compile(rf"(?<={kernel.key}_)[0-9a-f]{{8}}")  # Warp's own, which one of the patches shortens
    own = [text.count("\nstatic CUDA_CALLABLE ") for text in (before, after)]
    assert own[1] - own[0] == 2 * after.count("\nstruct make_") > 0  # two of a struct's three functions
    before, after = (
        hashes.sub("", text).replace("static CUDA_CALLABLE", "CUDA_CALLABLE") for text in (before, after)
    )
    assert parts(before) == parts(after)  # structs of what is kept come in another order
    assert len(by_warp) - calls < calls / 2


def test_another_version_of_warp_is_left_as_it_is(monkeypatch, unpatched):
    monkeypatch.setattr(wp, "__version__", "1.20.0")
    before = ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template, Function.build
    patches.apply()
    after = ModuleHasher.hash_adjoint, Adjoint.resolve_func, codegen.struct_template, Function.build
    assert after == before


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


GAIN = wp.constant(2.0)


@wp.struct
class Pair:
    one: float
    other: float


@wp.func
def amplified(x: float):
    pair = Pair(x, x)
    return GAIN * pair.one


@wp.func
def handed_on(x: float):
    return amplified(x) + 1.0


def translated(monkeypatch, declare, number=0):
    """The C++ of a kernel, and how many functions were translated for it."""

    def kernel(x: wp.array(dtype=float)):
        x[wp.static(number)] = handed_on(x[0])

    translate, done = Adjoint.build, []

    def build(adjoint, *arguments, **named):
        done.append(adjoint.fun_name)
        translate(adjoint, *arguments, **named)

    made = declare(kernel)
    monkeypatch.setattr(Adjoint, "build", build)
    text = code(made)
    monkeypatch.setattr(Adjoint, "build", translate)
    return text, done[1:]  # without the kernel itself


@pytest.fixture
def ours(monkeypatch):
    """The functions of this file pass for the package's."""
    monkeypatch.setattr(digest, "OWN", __name__)
    yield
    for function in (amplified, handed_on):
        function.adj.kept, function.adj.code_digest = None, None


def test_a_function_is_translated_once(monkeypatch, ours):
    first, done = translated(monkeypatch, named_by_code())
    assert done == ["handed_on", "amplified"]
    again, done = translated(monkeypatch, named_by_code(), 1)
    assert done == []
    functions = [
        text[text.index("\nstruct Pair") : text.index("_cpu_kernel_forward")] for text in (first, again)
    ]
    body = [text[: text.rindex("struct wp_args")] for text in functions]
    assert body[0] == body[1] and "amplified" in body[0]


def test_a_function_whose_numbers_changed_is_translated_anew(monkeypatch, ours):
    translated(monkeypatch, named_by_code())
    monkeypatch.setitem(globals(), "GAIN", wp.constant(3.0))
    text, done = translated(monkeypatch, named_by_code())
    assert done == ["handed_on", "amplified"]
    assert re.search(r"var_\d+ = 3\.0", text) and not re.search(r"var_\d+ = 2\.0", text)


def test_a_users_function_is_translated_for_every_kernel(monkeypatch):
    for number in (0, 1):
        assert translated(monkeypatch, named_by_code(), number)[1] == ["handed_on", "amplified"]


def test_an_adjoint_is_that_of_what_was_kept(monkeypatch, ours):
    before, _ = translated(monkeypatch, with_adjoint)
    translated(monkeypatch, named_by_code())
    after, _ = translated(monkeypatch, with_adjoint)
    assert after == before and "reverse mode disabled" not in after


@wp.func
def squared(x: float):
    return x * x


@wp.func
def slope(x: float):
    return wp.grad(squared)(x)


def test_a_gradient_is_translated_for_every_kernel(monkeypatch, ours):
    """Warp does not list what it differentiates among what a function calls."""

    def kernel(x: wp.array(dtype=float)):
        x[0] = slope(x[0])

    def other(x: wp.array(dtype=float)):
        x[1] = slope(x[1])

    for each in (kernel, other):
        assert re.search(r"static void adj_squared\w*\(", code(named_by_code()(each)))
    squared.adj.kept, squared.adj.code_digest, slope.adj.code_digest = None, None, None
