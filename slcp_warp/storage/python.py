"""Names in users' Python files, as `file.py:name` says them."""

import hashlib
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any


def python_name(path: Path, name: str) -> tuple[Any, dict[str, Any]]:
    """What has a name in a Python file, which is run as a module of its own, and all names of it.

    None where nothing has it. Errors of the file go through.

    Raises:
        FileNotFoundError: no such file.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    place = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:16]  # the same in every process
    module_name = f"slcp_file_{path.stem}_{place}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # Warp looks its functions' modules up
    spec.loader.exec_module(module)
    return getattr(module, name, None), vars(module)
