"""The package as it is installed has its kernels in it; the sources' folder, found first, says so."""

import shutil
import subprocess
import sys
from pathlib import Path

import slcp_warp


def test_importing_the_folder_of_the_sources_says_how_to_start(tmp_path):
    alone = tmp_path / "slcp_warp"
    (alone / "storage").mkdir(parents=True)
    here = Path(slcp_warp.__file__).parent
    for name in ("__init__.py", "storage/__init__.py", "storage/installed.py"):
        shutil.copy(here / name, alone / name)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import slcp_warp"
    child = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    last = child.stderr.strip().splitlines()[-1]
    assert child.returncode == 1 and last.startswith(f"ImportError: slcp_warp was found in {alone}")
    assert "start Python with -P" in last
