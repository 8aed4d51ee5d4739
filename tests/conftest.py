"""Fixtures shared by all tests: every device that Warp sees, both precisions, and Warp without its banner."""

import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING  # before wp.init(); the older config.quiet does nothing in 1.19
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
