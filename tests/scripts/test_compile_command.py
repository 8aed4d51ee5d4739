"""`slcp compile`: what it makes is what its users need."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("typer")

import warp as wp
from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp.kernels.device import cache
from slcp_warp.kernels.device.progress import recorded
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP
from slcp_warp.kernels.step.relayed import make_rollout_relay
from slcp_warp.kernels.step.rollout import make_rollout_kernel, make_step_kernel
from slcp_warp.scripts.stages import ahead


@pytest.fixture
def unloaded(monkeypatch):
    """As in a new process: no kernel is loaded."""
    monkeypatch.setattr(cache, "_loaded", {})


def uses(sim, name):
    """What a user of a kernel does, other than the command did it."""
    x, us = np.tile(sim.scene.x0, (3, 1)), np.zeros((3, 5, sim.nu))
    if name == "step":
        sim.step(x, us[:, 0])
    elif name == "rollout":
        sim.rollout(x, us, record="impulse")
    else:
        sim.linearize(x, us[:, 0], second=name == "second")


@pytest.mark.slow
def test_nothing_is_left_to_compile(unloaded):
    """Kernels of the finger that other tests compile, too."""
    names = ("step", "rollout", "linearize", "second")
    result = call("compile", "flicking_finger", "--what", ", ".join(names), "--device", "cpu")
    for kernel in ("step of flicking_finger", "rollout of", "linearize of"):
        assert kernel in result.output
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), slcp.Options(scaling="none"), device="cpu")
    with recorded() as kernels:
        for name in names:
            uses(sim, name)
    assert kernels == []
    cache._loaded.clear()
    result = call("compile", "flicking_finger", "--what", "step,rollout", "--device", "cpu")
    assert "0 compiled, 2 found in the cache" in result.output


@pytest.mark.slow
def test_what_it_says_is_so(unloaded, tmp_path, monkeypatch):
    """An empty cache: two kernels are compiled into it, and found by the next process."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    scene = slcp.scenes.particle()
    sim = slcp.Simulator(scene, device="cpu", dtype="float32")
    for kernel in (make_step_kernel(sim.spec), make_rollout_kernel(sim.spec, OPEN_LOOP, False)):
        kernel.module.unload()
    command = ("compile", "particle", "--dtype", "float32", "--device", "cpu")
    assert "2 compiled, 0 found in the cache" in call(*command).output
    assert len(list(tmp_path.rglob("*.o"))) == 2
    cache._loaded.clear()
    assert "0 compiled, 2 found in the cache" in call(*command).output


@pytest.mark.slow
def test_a_gpu_that_is_not_here_finds_its_kernels(unloaded, tmp_path, monkeypatch):
    """Whole cubins in the folders where Warp looks for a GPU's; the kernels are those of a GPU."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    command = ("compile", "particle", "--what", "rollout", "--dtype", "float32", "--device", "cpu", "--arch")
    found = call(*command, "90").output
    assert "rollout relay of particle" in found and "sm_90" in found
    with cache.compiling_for(90):
        sim = slcp.Simulator(slcp.scenes.particle(), device="cpu", dtype="float32")
    assert sim.kernels.fast_path
    for part in ("fast", "rest"):
        spec = sim.spec._replace(method=replace(sim.spec.method, part=part))
        folder = cache._folder(make_rollout_relay(spec, OPEN_LOOP, False).module, cache.BLOCK)
        assert [path.name for path in folder.glob("*.cubin")] == [f"{folder.name}.sm90.cubin"]
        assert cache._unlisted(folder, cache._listed(folder)) == []
    cache._loaded.clear()
    assert "0 compiled" in call(*command, "90").output
    assert not slcp.Simulator(slcp.scenes.particle(), device="cpu", dtype="float32").kernels.fast_path
    assert "arch is 4; Warp compiles for " in fails(*command, "4")


def test_what_a_scene_has_not_got_is_left_out_and_said(monkeypatch):
    """Nothing is compiled here: what would be is told by its precision and options."""
    asked = []

    def refused(sim):
        raise slcp.StrategyError("it needs specialised kernels")

    small = {"step": lambda sim: asked.append(("step", sim)), "linearize": refused}
    monkeypatch.setattr(ahead, "WHAT", small)
    scene = slcp.scenes.stack(count=10)
    assert scene.structure.nr > 31
    found = ahead.compile_ahead(
        lambda dtype: slcp.Simulator(scene, device="cpu", dtype=dtype), ["linearize", "step"]
    )
    assert list(found.impossible) == ["linearize"] and "specialised kernels" in found.impossible["linearize"]
    assert [sim.dtype for _, sim in asked] == [wp.float64]


def test_a_task_keeps_its_friction_and_a_sweep_its_precision(monkeypatch):
    seen = []
    of_tasks = {
        "sweep": lambda task, sim: seen.append((task, sim)),
        "plan": lambda task, sim: seen.append((task, sim)),
    }
    monkeypatch.setattr(ahead, "OF_TASKS", of_tasks)
    own = slcp.tasks.push_to_mark()
    own = own.replace(options=slcp.Options(residual="hard", friction="coulomb"))
    monkeypatch.setattr("slcp_warp.scripts.commands.compile.found_task", lambda name: own)
    call("compile", "mine", "--what", "sweep,plan", "--device", "cpu")
    assert [sim.options.friction for _, sim in seen] == ["coulomb"] * 2
    assert [sim.dtype for _, sim in seen] == [wp.float32, wp.float64]
    call(
        "compile",
        "mine",
        "--what",
        "sweep",
        "--device",
        "cpu",
        "--friction",
        "anitescu",
        "--dtype",
        "float64",
    )
    assert seen[-1][1].options.friction == "anitescu" and seen[-1][1].dtype is wp.float64


def test_bad_input_is_one_line():
    line = fails("compile", "particle", "--what", "step,nope")
    assert "--what is 'step,nope'; choose from step,rollout" in line
    assert "SCENE is 'nowhere'" in fails("compile", "nowhere")
    assert "friction is 'coulomb'" in fails("compile", "particle", "--friction", "coulomb")
