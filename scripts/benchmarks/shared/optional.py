"""Modules that only some benchmarks need: imported when asked for, with what installs them."""

import importlib
from typing import Any


def load(module: str, program: str, extra: str) -> Any:
    """A module of another program, or an error that says what installs it."""
    needs = f"this comparison runs {program}: pip install 'slcp-warp[{extra}]' (Python 3.11 or newer)"
    return _imported(module, needs)


def scipy_module(name: str) -> Any:
    """The module scipy.`name`, or an error that says what installs it."""
    return _imported(f"scipy.{name}", "the exact solutions need scipy: pip install 'slcp-warp[bench]'")


def _imported(module: str, needs: str) -> Any:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(needs, name=error.name) from error
