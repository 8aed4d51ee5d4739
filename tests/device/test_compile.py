"""Kernels in Warp's cache: found whatever ran before; functions of a user told apart by their code."""

import os
import subprocess
import sys

import pytest
import warp as wp

from slcp_warp.kernels.device.compile import (
    CPU_ARITHMETIC,
    code_digest,
    cpu_compiler_flags,
    fitted,
    large,
    large_options,
    named_by_code,
    of_any_scene,
    whole,
)
from slcp_warp.kernels.device.digest import OpaqueError, content_digest

RUN = """
import sys, numpy as np, warp as wp
wp.config.log_level = wp.LOG_WARNING
wp.config.optimization_level = 0
import slcp_warp as slcp
sim = slcp.Simulator(slcp.scenes.particle(), device="cpu", dtype="float32")
x = sim.scene.x0[None]
for name in sys.argv[1:]:
    sim.step(x) if name == "step" else sim.rollout(x, np.zeros((1, 2, sim.nu), np.float32))
"""


@pytest.mark.slow
def test_kernels_are_found_whatever_ran_before(tmp_path):
    """One process compiles a step and a rollout, others need them alone or the other way round."""
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path), "PYTHONSAFEPATH": "1"}

    def binaries(*names):
        subprocess.run([sys.executable, "-c", RUN, *names], env=environment, check=True, cwd=tmp_path)
        return sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.o"))

    first = binaries("step", "rollout")
    assert len(first) == 2
    assert binaries("rollout", "step") == first
    assert binaries("rollout") == first


@pytest.mark.slow
def test_kernels_of_other_compiler_flags_are_others(tmp_path):
    """SLCP_CPU_FLAGS replaces all flags, and caches do not mix."""
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path), "PYTHONSAFEPATH": "1"}

    def binaries(flags):
        own = environment | ({} if flags is None else {"SLCP_CPU_FLAGS": flags})
        if flags is None:
            own.pop("SLCP_CPU_FLAGS", None)
        subprocess.run([sys.executable, "-c", RUN, "step"], env=own, check=True, cwd=tmp_path)
        return {path.relative_to(tmp_path) for path in tmp_path.rglob("*.o")}

    plain = binaries(None)
    both = binaries("-ffp-contract=off")
    assert len(plain) == 1 and len(both) == 2 and plain < both
    assert binaries("-ffp-contract=off") == binaries(None) == both


def test_flags_of_the_environment_replace_all_others(monkeypatch):
    monkeypatch.setenv("SLCP_CPU_FLAGS", "-ffp-contract=off")
    assert cpu_compiler_flags() == "-ffp-contract=off"
    monkeypatch.delenv("SLCP_CPU_FLAGS")
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", "-march=native")
    assert cpu_compiler_flags().endswith(CPU_ARITHMETIC) and "-march=native" in cpu_compiler_flags()
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", "-mllvm=-inline-threshold=9000 -mllvm=-slp-x=4")
    assert cpu_compiler_flags().startswith("-mllvm=-inline-threshold=20000 -mllvm=-slp-x=4 ")


def test_large_programs_are_compiled_sooner_for_a_gpu(monkeypatch):
    """At level 2 unless the environment says otherwise; whoever tells Warp a level has it everywhere."""
    monkeypatch.setattr(wp.config, "optimization_level", None)
    monkeypatch.delenv("SLCP_CUDA_LEVEL", raising=False)

    def level(declare):
        def kernel(x: wp.array(dtype=float)):
            x[wp.tid()] = 1.0

        return declare(kernel).module.options["optimization_level"]

    kinds = (large, fitted(False, 2), whole(2), of_any_scene(True))
    assert [level(declare) for declare in kinds] == [2, 2, 2, 2]
    others = (fitted(True, 2), fitted(False), whole(1), of_any_scene(False))  # small, or worth it
    assert [level(declare) for declare in others] == [None] * 4
    monkeypatch.setenv("SLCP_CUDA_LEVEL", "3")
    assert level(large) == 3
    monkeypatch.setenv("SLCP_CUDA_LEVEL", "0")
    with pytest.raises(ValueError, match="SLCP_CUDA_LEVEL is '0'; one of 1, 2, 3 is needed"):
        large_options()
    monkeypatch.setenv("SLCP_CUDA_LEVEL", "2")
    monkeypatch.setattr(wp.config, "optimization_level", 0)
    assert level(large) is None


def test_a_users_functions_are_told_apart_by_values_in_loops():
    """Values of `wp.static` with a loop's index, which Warp leaves out of a module's hash."""

    def digest(weights, again=1):
        @wp.func
        def cost(x: wp.vec2d):
            total = wp.float64(0.0)
            for i in range(2):
                total += wp.static(weights[i]) * x[i]
            return total

        def kernel(x: wp.array(dtype=wp.vec2d), out: wp.array(dtype=wp.float64)):
            out[0] = cost(x[0])

        return [code_digest(kernel) for _ in range(again)]

    one, other = (wp.float64(1.0), wp.float64(2.0)), (wp.float64(1.0), wp.float64(3.0))
    assert digest(one) == digest(one)
    assert digest(one) != digest(other)
    assert len(set(digest(one, again=2))) == 1


class Weights:
    """An object whose content cannot be told: it gives its numbers away one by one."""

    __slots__ = ("numbers",)

    def __init__(self, *numbers):
        self.numbers = numbers

    def __getitem__(self, i):
        return wp.float64(self.numbers[i])


def test_what_a_digest_cannot_tell_is_told_by_the_translation():
    def declared(weights):
        @wp.func
        def cost(x: wp.vec2d):
            total = wp.float64(0.0)
            for i in range(2):
                total += wp.static(weights[i]) * x[i]
            return total

        def kernel(x: wp.array(dtype=wp.vec2d), out: wp.array(dtype=wp.float64)):
            out[0] = cost(x[0])

        with pytest.raises(OpaqueError, match="Weights"):
            content_digest(kernel)
        return named_by_code()(kernel)

    names = [declared(Weights(*numbers)).key for numbers in ((1.0, 2.0), (1.0, 3.0), (1.0, 2.0))]
    assert names[0] != names[1] and names[0] == names[2]
