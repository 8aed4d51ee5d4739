"""Options of the steps as commands share them; what commands say where nobody sees a terminal."""

import inspect
import re
import time

import numpy as np
import pytest

pytest.importorskip("typer")

from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp.scripts.stages import task_sweep
from slcp_warp.scripts.support import screen
from slcp_warp.scripts.support.asking import steps_of_sweep
from slcp_warp.scripts.support.rules import NO_RULE, HardRule, OneRule, Rules, told, with_rules
from slcp_warp.scripts.support.screen import span

COMMANDS = "simulate optimise library sweep compile watch compare sensitivity map tune rare falsify".split()
THROW = """
import slcp_warp as slcp
from slcp_warp import measures
task = slcp.Task("throw", slcp.scenes.ball_drop(), duration=0.6, options=slcp.Options(residual="hard"),
                 disturbances=slcp.Disturbances(start={"ball.vx": 0.5}),
                 success=measures.final("ball.x") > 0.0)
"""


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_steps_has_them(command):
    said = call(command, "--help").output
    for name in ("scaling", "friction", "integrator", "gap", "noise", "deviation", "tolerance"):
        assert f"--{name}" in said, name
    assert ("--residual" in said) != (command == "watch")


def test_a_sweep_takes_residual_for_residuals(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for option in ("--residual", "--residuals"):
        assert f"{option[:10]}s is 'soft'" in fails("sweep", "catch", "--policy", "zero", option, "soft")


def test_cases_have_what_their_residual_offers():
    rules = Rules(friction="coulomb", integrator="trapezoidal", noise="state")
    found = rules.cases(slcp.Options(scaling="none"), "smoothed, hard")
    assert found == {
        "smoothed, trapezoidal": slcp.Options(scaling="none", integrator="trapezoidal", noise="state"),
        "hard, coulomb, trapezoidal": slcp.Options("hard", "none", "coulomb", "trapezoidal"),
    }
    leap = Rules(integrator="leapfrog").cases(slcp.Options(), "hard, erm-logistic")
    assert leap == {
        "hard, leapfrog": slcp.Options("hard", integrator="leapfrog"),
        "erm-logistic": slcp.Options("erm-logistic"),
    }
    assert list(found.values()) == rules.variants(slcp.Options(scaling="none"))
    own = slcp.Options("hard", friction="coulomb", gap="end")
    assert Rules().cases(own, "smoothed,hard") == {"smoothed": slcp.Options(), "hard, coulomb, gap end": own}
    for given, residuals, text in (
        ({"friction": "coulomb"}, "smoothed", "--friction is 'coulomb', which is of the hard"),
        ({"noise": "state"}, "hard", "--noise is 'state', which is of the smoothed"),
    ):
        with pytest.raises(ValueError, match=text):
            Rules(**given).cases(slcp.Options(), residuals)
    assert OneRule(residual="hard", gap="end").of(slcp.Options()) == slcp.Options("hard", gap="end")
    assert HardRule(residual="smoothed").of(own) == slcp.Options() and NO_RULE.of(own) == own
    assert told(own) == ["hard", "coulomb", "gap end"]
    with pytest.raises(slcp.InputError, match="use residual='hard'"):
        OneRule(friction="coulomb").of(slcp.Options())


def test_a_group_becomes_options_in_its_place():
    @with_rules
    def command(first: int, rules: HardRule = HardRule(), last: float = 1.0) -> None:  # noqa: B008
        made.append((first, rules, last))

    made = []
    names = list(inspect.signature(command).parameters)
    assert names[:3] == ["first", "residual", "scaling"] and names[-1] == "last" and "rules" not in names
    values = {name: None for name in names} | {
        "first": 1,
        "last": 2.0,
        "friction": "coulomb",
        "residual": "hard",
    }
    command(**values)
    assert made == [(1, HardRule(friction="coulomb", residual="hard"), 2.0)]


def test_a_task_without_controls_by_commands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "throw.py").write_text(THROW)
    cpu = ("--dtype", "float64", "--device", "cpu")
    said = call("sweep", "throw.py:task", "--worlds", 50, "--residuals", "hard", *cpu).output
    assert "none" in said and "h = 0.01" in said
    said = call("map", "throw.py:task", "--x", "ball.x=-9:9:2", "--y", "ball.vx=0:1:1", *cpu).output
    assert "0  100" in said
    assert "has no controls and no cost and no horizon" in fails(
        "optimise", "throw.py:task", "--device", "cpu"
    )
    assert "--policy is missing" in fails("sweep", "catch", "--device", "cpu")
    assert "--friction is of a task" in fails("sweep", "--policy", "x.npz", "--friction", "coulomb")


SLOW = """
import time
import numpy as np
import slcp_warp as slcp
def slowly(x, t):
    time.sleep(0.02)
    return np.zeros((len(x), 1))
policy = slcp.policies.Callback(slowly)
"""


def test_how_long_a_policy_on_the_host_takes_is_said_before_it_has(tmp_path, monkeypatch, capfd):
    """... to run a task, and to sweep it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(screen, "TELL_AT", tuple(0.1 * k for k in range(1, 600)))
    (tmp_path / "slow.py").write_text(SLOW)
    task = slcp.tasks.cart_pole_walls()
    short = task.replace(duration=50 * task.scene.step_size, disturbances=slcp.Disturbances())
    slcp.save_task(short, "short.json")
    said = call("simulate", "short.json", "--policy", "slow.py:policy", "--device", "cpu").stderr
    takes = r"policy takes ([\d.]+) ms a step and world, \d+ s to go"
    found = re.findall(f"slcp: {takes}", said)
    assert found and all(20.0 <= float(each) for each in found), said

    def asked(task, policies, progress, **choices):
        for k in range(20):
            policies["policy"].act(np.zeros((4, 4)), k * 0.02, np.arange(4))
            progress(k, 20)

    monkeypatch.setattr(task_sweep.slcp, "sweep", asked)
    monkeypatch.setattr(task_sweep.slcp, "Report", object)
    with screen.progress_bar("worlds") as progress, pytest.raises(AttributeError):
        task_sweep.sweep_task(
            short, ["slow.py:policy"], worlds=4, cases=None, step_sizes=None, progress=progress
        )
    found = re.findall(rf"slcp: \d+ of 20 worlds; {takes}", capfd.readouterr().err)
    assert found and all(5.0 <= float(each) for each in found)


def test_steps_of_a_sweep_are_all_that_are_asked_for():
    task = slcp.tasks.catch()
    assert steps_of_sweep(task, 7, task.options, None) == 8 * task.steps
    both = steps_of_sweep(task, 7, None, (task.scene.step_size, 2 * task.scene.step_size))
    assert both == 2 * 8 * (task.steps + task.steps // 2)
    assert [span(s) for s in (3.2, 750.0, 7300.0)] == ["3 s", "12 min", "2.0 h"]


def test_progress_without_a_terminal_is_lines(monkeypatch, capfd):
    monkeypatch.setattr(screen, "TELL_AT", (0.0, 0.05))
    with screen.progress_bar("worlds") as update:
        update(128, 4096)
        time.sleep(0.3)
    with screen.waiting("planning"):
        time.sleep(0.1)
    written = capfd.readouterr()
    lines = written.err.splitlines()
    assert "slcp: 128 of 4,096 worlds, 0.05 s" in lines and "slcp: planning, 0.05 s" in lines
    assert written.out == ""
