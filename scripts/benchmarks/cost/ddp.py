"""`slcp bench ddp`: a pass of DDP on the flicking finger."""

import functools
import time

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.device import launch

from ..shared.ours import DTYPES, PAPER
from ..shared.timing import Case, Rows, finish, time_interleaved


def bench_ddp(repeats: int = 9, horizon: int = 75, passes: int = 30) -> Rows:
    """A pass of DDP from the canonical start: derivatives, backward pass, all step sizes, choice."""
    scene = slcp.scenes.flicking_finger()
    cases = []
    notes = [f"per problem and pass, from u = 0, N = {horizon}, {len(ddp.Options().step_sizes)} step sizes"]
    for dtype in DTYPES:
        sim = slcp.Simulator(scene, PAPER, device="cpu", dtype=dtype)
        problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=horizon, params=sim.params)
        for method in ("second-order", "gauss-newton"):
            options = ddp.Options(max_iterations=passes, method=method, gradient_tolerance=0.0)
            for batch in (1, 32):
                workspace = ddp.Workspace(problem, batch, options)
                run = functools.partial(workspace.run, scene.x0, np.zeros((horizon, sim.nu)))
                done = run()
                accepted = float((workspace.result(done).trace.step_size[0, :done] > 0.0).mean())
                facts = {"dtype": dtype, "method": method, "batch": batch, "horizon": horizon,
                         "step_sizes": len(options.step_sizes), "threads": launch.thread_count(),
                         "passes": done, "accepted_share": accepted}  # fmt: skip
                label = f"{dtype} {method}, batch of {batch}"
                cases.append(Case(label, run, done * batch, facts=facts))
                notes.append(f"{label}: {done} passes, {accepted:.0%} of them with an accepted step")
    results = time_interleaved(cases, repeats, clock=time.perf_counter)
    return finish("ddp", "ms per pass", results, notes, f"wall time, {launch.thread_count()} threads")
