"""`slcp bench methods`: what a step costs with every residual, friction model, integrator and noise."""

import functools
from typing import Any

import slcp_warp as slcp
from slcp_warp.options import CHOICES

from ..shared.ours import Ours, cpu_threads
from ..shared.timing import Case, print_table, tidy_rows, time_interleaved
from ..shared.workload import make_workload

DEFAULT = "rem-logistic"


def methods() -> dict[str, dict[str, str]]:
    """The options of every case by its label: one choice differs from the paper's at a time."""
    cases = {name: {"residual": name} for name in CHOICES["residual"]}
    cases["rem-logistic, inertia scaling"] = {"scaling": "inertia"}
    cases["rem-logistic, trapezoidal"] = {"integrator": "trapezoidal"}
    cases["hard, coulomb"] = {"residual": "hard", "friction": "coulomb"}
    cases["hard, coulomb, trapezoidal"] = {**cases["hard, coulomb"], "integrator": "trapezoidal"}
    return cases


def bench_methods(worlds: int, steps: int, repeats: int, seed: int) -> list[dict[str, Any]]:
    """Rollouts of the finger on one core, the cases taking turns; ratios to the default residual."""
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    cases: list[Case] = []
    notes: list[str] = []
    with cpu_threads(1):
        for dtype in ("float32", "float64"):
            for name, choices in methods().items():
                ours = Ours(work, dtype, **choices)
                label, reference = f"{name} {dtype}", f"{DEFAULT} {dtype}"
                facts = {"dtype": dtype, "failed_share": ours.failed, **choices}
                cases.append(
                    Case(
                        label,
                        functools.partial(ours.rollout, ours.work),
                        ours.work.steps,
                        None if label == reference else reference,
                        facts=facts,
                    )
                )
                if ours.failed:
                    notes.append(f"{label}: worlds not solved and left out {ours.failed:.2%}")
        results = time_interleaved(cases, repeats)
    clock = "process CPU time, one thread"
    print_table(f"methods: {clock}", "us per step", results, notes)
    return tidy_rows("methods", results, clock)
