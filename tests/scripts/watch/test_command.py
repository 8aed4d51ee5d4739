"""`slcp watch` on the command line: what it refuses, and that it serves."""

import os
import re
import signal
import subprocess
import sys
import urllib.request

import pytest
from typer.testing import CliRunner

from slcp_warp.scripts.app import app

pytest.importorskip("websockets", reason="the extra 'watch' is not installed")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "a TASK to watch, or --replay FILE"),
        (["flicking_finger", "--replay", "x.npz"], "a TASK to watch, or --replay FILE"),
        (["nothing_there"], "TASK is 'nothing_there'"),
        (["--replay", "missing.npz"], "missing.npz"),
        (["flicking_finger", "--policy", "missing.npz"], "missing.npz"),
        (["flicking_finger", "--policy", "mpc:missing.npz"], "missing.npz"),
        (["pendulum_chain", "--policy", "mpc"], "no task"),
    ],
)
def test_bad_input_is_one_line(arguments, said):
    result = CliRunner().invoke(app, ["watch", *arguments, "--no-browser"])
    assert result.exit_code == 2 and said in result.output and "Traceback" not in result.output


def test_it_serves_a_scene_until_it_is_interrupted(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "slcp_warp.scripts.main", "watch", "flicking_finger", "--no-browser"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env=os.environ | {"COLUMNS": "200", "PYTHONUNBUFFERED": "1"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in the background ignore it
    )  # fmt: skip
    try:
        address = re.search(r"http://127\.0\.0\.1:\d+/\S+/", process.stdout.readline())
        assert address, process.stderr.read()
        with urllib.request.urlopen(address[0], timeout=20) as answer:
            assert b"<canvas" in answer.read()
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
        assert "nothing was saved" not in process.stderr.read()  # the way it is to be ended
