"""Fixtures shared by all tests: every device that Warp sees, both precisions, and Warp without its banner.

Every (scene, options, precision, kind of kernel) compiles for seconds the first time. `QUICK` says which
tests of the files that compile much stay in the quick run (`scripts/test.sh --fast`); others are marked slow.
"""

import functools
import gc
import os
import pathlib
import re
import zlib

import hypothesis
import pytest
import warp as wp
from warp._src import build

os.environ.setdefault("SLCP_PROGRESS", "0")  # tests that look at stderr see what they ask for
wp.config.log_level = wp.LOG_WARNING  # before wp.init(); the older config.quiet does nothing in 1.19
# LLVM's own limit of inlining: clang takes 20 to 30 % less. SLCP_CPU_FLAGS: slcp_warp.kernels.device.compile
wp.config.cpu_compiler_flags = os.environ.get("SLCP_CPU_FLAGS", "-march=native")
wp.init()

try:
    from slcp_warp.kernels.device.compile import cpu_compiler_flags
except ModuleNotFoundError as error:
    message = f"{error}: tests need the installed package and PYTHONSAFEPATH=1 (see scripts/test.sh)"
    raise pytest.UsageError(message) from error

os.environ["SLCP_CPU_FLAGS"] = cpu_compiler_flags()  # processes that tests begin take the same kernels


# The same examples on every run; `HYPOTHESIS_PROFILE=full` (.ci/full) tries many, new ones every time.
QUIET = {"deadline": None, "database": None, "suppress_health_check": list(hypothesis.HealthCheck)}
hypothesis.settings.register_profile("quick", derandomize=True, max_examples=40, **QUIET)
hypothesis.settings.register_profile("full", max_examples=500, print_blob=True, **QUIET)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))


@pytest.fixture(scope="session")
def monkeypatch_session():
    """A monkeypatch for tests whose examples undo it themselves."""
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(params=[device.alias for device in wp.get_devices()])
def device(request) -> str:
    """The name of a Warp device; the test runs once for each one present."""
    return request.param


@pytest.fixture(params=[wp.float32, wp.float64], ids=["float32", "float64"])
def dtype(request) -> type:
    """The scalar type of a simulation, as a Warp type."""
    return request.param


QUICK = {  # file: pattern of the quick tests' names; files that are not here mark their slow tests themselves
    "test_bad_input.py": r"test_error|docs|file|no_worlds|memory",
    "test_bad_worlds.py": r"(?!)",
    "test_cli.py": r"isosurface|last_turn|bad_input_is_one_line|starts_without",
    "test_complementarity.py": r"random_problems.*4-4|rem_agrees|bad_input",
    "test_contact_formulas.py": r"frictionless_body_rests|a_gram_and_a_tonne",
    "test_coulomb.py": r"sliding_stop|refused",
    "test_ddp.py": r"linear_quadratic|illegal|options",
    "test_distance.py": r"(?!)",
    "test_dynamics.py": r"test_free_step.*tree0|test_energy",
    "test_erm.py": r"one_row",
    "test_grip.py": r"edge_of_the_cone",
    "test_large.py": r"envelope|strategy|chain_has_its_size",
    "test_library.py": r"file|saved|save|concatenation|another_scenes",
    "test_linearize.py": r"test_derivatives.*flicking_finger-none",
    "test_noise.py": r"bad|needs|belong",
    "test_products.py": r"(?!)",
    "test_refinement.py": r"negative|unknown|refused",
    "test_rem_normal.py": r"(?!)",
    "test_riccati.py": r"one_pass.*second-order|box_constrained",
    "test_run_executors.py": r"-threads|threads\]|cannot_travel|wrong_executors|its_gpu",
    "test_step.py": r"float64-flicking_finger-none",
    "test_sweep.py": r"interval|recovery_of",
    "test_tape.py": r"(?!)",
    "test_torch.py": r"options_without|one_radius",
    "test_trapezoidal.py": r"what_rests",
}


FULL = {  # file: pattern of tests that are marked full: long cases of what its others say of shorter ones
    "test_capacity.py": r"library_is_built|minima\[pairs-multistart|differences\[rows-linearize",
    "test_compile.py": r"other_compiler_flags",
    "test_complementarity.py": r"float32_torch.*erm-normal",
    "test_damping.py": r"dampers_are_stiff.*euler",
    "test_erm.py": r"tape.*erm-normal|first_derivatives.*flicking_finger-erm-normal",
    "test_fast_path.py": r"ddp_with_both|asked apart|long_rollouts",
    "test_finger_ddp.py": r"second_order_against",
    "test_generic_derivatives.py": r"options[4789]\]|stacks_are_differences\[30",
    "test_gpu_check.py": r"compiled_by_processes",
    "test_jam.py": r"gantry-float32|vice-float64|a_jam_so\[(gantry|vice)",
    "test_linearize.py": r"moving_plane|finger-inertia-True-True|touching_tree-inertia-False|free.*sprung",
    "test_parameter_gradient.py": r"sprung_plane-inertia-hard",
    "test_planning.py": r"best_plan_keeps_its_limits|problem_of_ones_own_is_planned_from",
    "test_run_executors.py": r"an_error_in_a_chunk|has_its_gpu",
}


# Kernels are compiled without optimisation, in less than half the time, and run ten times slower; but not
# for these files, which make many steps, or compare to the bit what two processes make, or look at what the
# compiler makes. They come first: what they have compiled the others take as it is.
# SLCP_TESTS_OPTIMISED=1 (.ci/full): all as users have them.
OPTIMISED = """
test_task_commands test_published test_planning test_gpu_code test_cli test_finger_ddp test_robust test_jam
test_mpc test_bench test_car test_diagram_studies test_tumbling test_stationary test_kept_libraries
test_rare test_cancelling_impulses test_opposed_impulses test_modes test_task_sweep test_multistart_chunks
test_library test_gradients test_many test_refinement test_sampling test_auto test_stored_sweep
test_trajectory test_stored_commands test_aligned test_passed_on test_docs
""".split()


# Of the rest, what takes the longest comes first, so that no worker is left with a long file at the end.
LONGEST = """
test_capacity test_generic_gradient test_fast_path test_linearize test_generic_derivatives test_fuzz
test_damping test_parameter_gradient test_gpu_check test_large test_step test_complementarity test_grip
test_protocol test_coulomb test_trapezoidal test_erm test_torch test_compile test_cache test_digest
test_stability
""".split()


def _unlike(build_cpu):
    """Warp's `build_cpu` that fuses no a b + c in every second kernel, by the kernel's name."""

    @functools.wraps(build_cpu)
    def build(object_path, *args, extra_flags=None, **options):
        if zlib.crc32(f"{UNLIKE} {pathlib.Path(object_path).stem}".encode()) % 2:
            extra_flags = f"{extra_flags or ''} -ffp-contract=off"
        return build_cpu(object_path, *args, extra_flags=extra_flags, **options)

    return build


# Set (.ci/full rounding): every second kernel rounds otherwise, other halves with other values. What holds to
# the bit between two kernels holds by luck, of the compiler and the processor.
UNLIKE = os.environ.get("SLCP_TESTS_UNLIKE", "")
if UNLIKE:
    build.build_cpu = _unlike(build.build_cpu)


def pytest_runtest_setup(item) -> None:
    """The compiler's level for the kernels that a test is the first to ask for."""
    users = os.environ.get("SLCP_TESTS_OPTIMISED") or wp.is_cuda_available()
    optimised = users or item.path.stem in OPTIMISED
    wp.config.optimization_level = None if optimised else 0


def pytest_runtest_teardown(item, nextitem) -> None:
    """What a file leaves behind, kernels above all, is not looked through for garbage in those after it."""
    if nextitem is not None and nextitem.path != item.path:
        gc.collect()
        gc.freeze()


def pytest_addoption(parser) -> None:
    parser.addoption("--full", action="store_true", help="also the tests marked full (.ci/full long)")
    parser.addoption("--docs", action="store_true", help="also the code in the texts (.ci/run)")
    parser.addoption("--compiled", metavar="FILE", help="write which kernels each test compiled, as CSV")


def pytest_configure(config) -> None:
    if config.getoption("--compiled"):
        from compiled import Compiled

        config.pluginmanager.register(Compiled(config.getoption("--compiled")))


def pytest_collection_finish() -> None:
    """What thousands of collected tests are made of is not looked through for garbage time and again."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config, items) -> None:
    """Mark as slow what QUICK does not name, as full what FULL does; leave out what is not asked for."""
    for item in items:
        pattern = QUICK.get(item.path.name)
        if pattern is not None and not re.search(pattern, item.name):
            item.add_marker(pytest.mark.slow)
        pattern = FULL.get(item.path.name)
        if pattern is not None and re.search(pattern, item.name):
            item.add_marker(pytest.mark.full)
    for mark in ("full", "docs"):
        if not config.getoption(f"--{mark}"):
            left_out = [item for item in items if item.get_closest_marker(mark) is not None]
            config.hook.pytest_deselected(items=left_out)
            items[:] = [item for item in items if item.get_closest_marker(mark) is None]
    place = {name: i for i, name in enumerate([*OPTIMISED, *LONGEST])}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


# Files that take the optimised kernels of another, or leave plain ones that others would take: one worker has
# all of them, in the order of the lists above.
AFTER = dict.fromkeys(
    ("test_jam", "test_tumbling", "test_modes", "test_capacity", "test_generic_gradient"), "test_planning"
)
AFTER |= dict.fromkeys(("test_fuzz", "test_fuzz_oracle"), "test_opposed_impulses")
AFTER["test_passed_on"] = "test_aligned"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """As `--dist loadfile`, with the files of AFTER in one worker."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            stem = file.rpartition("/")[2].removesuffix(".py")
            return AFTER.get(stem, stem)

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None
