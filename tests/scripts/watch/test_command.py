"""`slcp watch` on the command line: what it refuses, and that it serves."""

import asyncio
import os
import re
import signal
import subprocess
import sys
import urllib.request
import webbrowser

import numpy as np
import pytest
from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.scripts.app import app
from slcp_warp.scripts.commands.watch import _serve

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
        (["examples/tasks/toss.toml", "--policy", "mpc"], "'toss' has no controls"),
        (["flicking_finger", "--scenario", "push_to_mark"], "of another mechanism than flicking_finger"),
    ],
)
def test_bad_input_is_one_line(arguments, said):
    result = CliRunner().invoke(app, ["watch", *arguments, "--no-browser"])
    assert result.exit_code == 2 and said in result.output and "Traceback" not in result.output


def test_a_policy_of_another_scene_is_one_line(tmp_path):
    """A library of the push, for the finger."""
    push = slcp.tasks.push_to_mark()
    plan = ddp.solve(ddp.problem_of(push), push.start[0], np.zeros((80, 1)), ddp.Options(max_iterations=0))
    path = plan.save(tmp_path / "plan.npz")
    for policy in (path, f"mpc:{path}"):
        result = CliRunner().invoke(
            app, ["watch", "flicking_finger", "--policy", str(policy), "--no-browser"]
        )
        lines = result.stderr.strip().splitlines()
        assert result.exit_code == 2 and len(lines) == 1 and "push_block" in lines[0], result.output


@pytest.mark.parametrize("there", [False, True])
def test_where_no_browser_opens_the_address_is_enough(monkeypatch, capsys, there):
    class Page:
        address = "http://127.0.0.1:1/token/"

        async def run(self, started):
            started.set()
            await asyncio.sleep(0.1)

    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or there)
    asyncio.run(_serve(Page(), True))
    said = capsys.readouterr()
    assert opened == [Page.address] and Page.address in said.out + said.err
    assert ("no browser could be opened" in said.out + said.err) is not there


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
