"""Short sweeps of the finger, and what one would draw."""

import numpy as np
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp import sweep as public_sweep
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.ensembles.sweep import SceneSweep

FINGER = scene("flicking_finger")
OPTIONS = {"scaling": "none", "dtype": "float32"}


def idle(entries=3):
    """A policy without control: nearest neighbour over entries that ask for nothing."""
    rng = np.random.default_rng(2)
    zeros = np.zeros(entries)
    header = {"scene": FINGER.name, "digest": scene_digest(FINGER)}
    return ddp.Library(
        x=FINGER.x0 + rng.standard_normal((entries, 6)), u=np.zeros((entries, 2)),
        K=np.zeros((entries, 2, 6)), cost=zeros, gain=zeros, age=zeros, chain=zeros, plan=zeros,
        period=FINGER.state_period, header=header,
    ).policy()  # fmt: skip


def spec(**changes):
    values = {"worlds": 40, "duration": 2.0, "residuals": ("rem-logistic",), "velocity_sd": 2.0, "observe": 2,
              "window": 1.0, "sample_every": 0.1, "seed": 3}  # fmt: skip
    return slcp.SweepSpec(**{**values, **changes})


def run(device="cpu", chunk=None, progress=None, **changes):
    return public_sweep(
        FINGER, idle(), spec(**changes), device=device, chunk=chunk, progress=progress, **OPTIONS
    )


def sweep_of(device="cpu", **changes):
    """The work of `run`, before it runs."""
    return SceneSweep(FINGER, idle(), spec(**changes), device=device, integrator="euler", **OPTIONS)


def drawn(device, worlds, **changes):
    """Parameters by name (B, ...) and starts (B, nx) that a sweep would simulate."""
    sim = simulator("flicking_finger", device, wp.float32, "none")
    work = sweep_of(device, worlds=worlds, **changes)
    drawn = work.draws(work.chunks.parts[0]).worlds(0, worlds)
    table, x0 = drawn.params, drawn.x0
    columns = {
        n: table.numpy()[:, a : a + int(np.prod(s, dtype=int))] for n, a, s in sim.params.layout.columns
    }
    return columns, x0.numpy(), sim.params
