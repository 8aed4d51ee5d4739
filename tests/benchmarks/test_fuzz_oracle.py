"""What `slcp bench fuzz` decides beside its judge: openings, differences, the trapezoidal prediction."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.fuzz.differences import STEPS, compare
from slcp_warp.scripts.benchmarks.fuzz.judged import judged, predicted
from slcp_warp.scripts.benchmarks.fuzz.proofs import opens
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import SILENT


def test_openings_are_decided_without_rounding():
    """Against SciPy where rows open or not by much, and where limits cross by one unit in the last place."""
    linprog, rng = pytest.importorskip("scipy.optimize").linprog, np.random.default_rng(0)
    found = []
    for k in range(120):
        n, m = int(rng.integers(1, 7)), int(rng.integers(1, 12))
        jac, rate = rng.standard_normal((m, n)), rng.standard_normal(m) - 0.5
        if k % 3 == 0 and m > 1:
            jac[1] = -jac[0]
        best = linprog(np.r_[np.zeros(n), -1.0], np.c_[-jac, np.ones(m)], rate,
                       bounds=[(None, None)] * n + [(None, 1.0)], method="highs")  # fmt: skip
        found.append(opens(SimpleNamespace(jac=[jac], rate=[rate]), 0))
        assert found[-1] == (best.fun <= 0.0)
    assert 20 < sum(found) < 100
    both = np.array([[1.0], [-1.0]])
    for upper, expected in ((-0.3, True), (np.nextafter(-0.3, 0.0), True), (np.nextafter(-0.3, -1.0), False)):
        assert opens(SimpleNamespace(jac=[both], rate=[np.array([0.3, upper])]), 0) == expected


def test_differences_do_not_judge_across_a_kink():
    """|x - x0| at a distance of 1e-9: central differences of all lengths agree on 0."""
    steps = np.array(STEPS)[:, None, None]

    def slopes(f, x):
        return (f(x + steps) - f(x)) / steps, (f(x - steps) - f(x)) / -steps

    for f, slope, sure in ((np.abs, 1.0, False), (lambda x: x + 0.5 * x * x, 1.0 + 1e-9, True)):
        error, trusted = compare(np.full((1, 1), slope), *slopes(f, np.full((1, 1), 1e-9)))
        assert trusted[0] == sure and (not sure or error[0] < 1e-6)


@pytest.mark.slow
def test_the_predicted_push_knows_no_stiff_springs():
    """Impulses act through M in the trapezoidal method, in Euler's beside h^2 K/2: predicted by Euler's, the
    oracle called 79 of 500 worlds of this scene silent.
    """
    task = Task(21, 45, "specialised")
    ((options, dtype),) = task.methods()
    scene = dataclasses.replace(task.make_scene(), implicit_stiffness=True)
    worlds = task.worlds(0, scene)
    push, known = predicted(scene, worlds, options, dtype)
    sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy="specialised")
    found, _ = judged(worlds, sim, push)
    assert options.integrator == "trapezoidal" and known.mean() > 0.2
    assert not (found.verdict[known] == SILENT).any()
