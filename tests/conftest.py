"""Fixtures shared by all tests: every device that Warp sees, both precisions, and Warp without its banner.

Every (scene, options, precision, kind of kernel) compiles for seconds the first time. `QUICK` says which
tests of the files that compile much stay in the quick run (`scripts/test.sh --fast`); others are marked slow.
"""

import re

import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING  # before wp.init(); the older config.quiet does nothing in 1.19
wp.config.cpu_compiler_flags = "-march=native"  # LLVM's own inlining limit: a fifth to a third less compilation
wp.init()

try:
    import slcp_warp.kernels  # noqa: F401
except ModuleNotFoundError as error:
    message = f"{error}: tests need the installed package and PYTHONSAFEPATH=1 (see scripts/test.sh)"
    raise pytest.UsageError(message) from error


@pytest.fixture(params=[device.alias for device in wp.get_devices()])
def device(request) -> str:
    """The name of a Warp device; the test runs once for each one present."""
    return request.param


@pytest.fixture(params=[wp.float32, wp.float64], ids=["float32", "float64"])
def dtype(request) -> type:
    """The scalar type of a simulation, as a Warp type."""
    return request.param


QUICK = {  # file: pattern of the quick tests' names; files that are not here mark their slow tests themselves
    "test_bad_input.py": r"test_error|docs|file",
    "test_cli.py": r"isosurface|last_turn|bad_input_is_one_line|starts_without",
    "test_contact_formulas.py": r"frictionless_body_rests|a_gram_and_a_tonne",
    "test_ddp.py": r"linear_quadratic|illegal|options",
    "test_distance.py": r"(?!)",
    "test_dynamics.py": r"test_free_step.*tree0|test_energy",
    "test_library.py": r"file|saved|save|concatenation|another_scenes",
    "test_linearize.py": r"first_derivatives.*flicking_finger-none|position_rows",
    "test_refinement.py": r"negative|unknown|refused",
    "test_riccati.py": r"one_pass.*second-order|box_constrained",
    "test_step.py": r"float64-flicking_finger-none",
    "test_sweep.py": r"interval|spin_statistics",
    "test_tape.py": r"(?!)",
}


def pytest_collection_modifyitems(items) -> None:
    """Mark as slow what QUICK does not name."""
    for item in items:
        pattern = QUICK.get(item.path.name)
        if pattern is not None and not re.search(pattern, item.name):
            item.add_marker(pytest.mark.slow)
