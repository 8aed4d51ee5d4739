"""Random numbers of a sweep: every one of its own stream, so that nothing that is drawn goes with another."""

import math
from types import SimpleNamespace

import numpy as np
from sweeps import FINGER, drawn

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Scene, ddp

WORLDS = 20_000
VARIED = ("step_size", "sigma", "gravity", "mass", "friction", "damping", "gear", "radius")


def correlations(*columns):
    """The largest correlation of two different columns (B,), or of their squares, in units of its error."""
    worst = 0.0
    for power in (1, 2):
        table = np.corrcoef([(c - c.mean()) ** power for c in columns]) - np.eye(len(columns))
        worst = max(worst, np.abs(table).max())
    return worst * math.sqrt(len(columns[0]))


def test_parameters_and_starts_go_with_nothing_else(device):
    starts = np.stack([FINGER.x0, FINGER.x0 + [0, 0, 50.0, 0, 0, 0]])
    columns, x0, base = drawn(
        device, WORLDS, start=starts, position_sd=0.3, velocity_sd=0.3,
        parameter_sd=dict.fromkeys(VARIED, 0.1),
    )  # fmt: skip
    second = x0[:, 2] > 25.0
    numbers = [second.astype(float), *(x0 - starts[second.astype(int)]).T]
    for name in VARIED:
        values, middle = columns[name], np.ravel(base[name])
        used = np.flatnonzero(middle)[:: 2 if name == "radius" else 1]  # both radii of a shape vary together
        used = used[:1] if name in ("sigma", "gravity") else used
        numbers += list(np.log(values[:, used] / middle[used]).T)
    assert len(numbers) == 1 + 6 + 3 + 3 + 1 + 3 + 2 + 3
    assert correlations(*numbers) < 6.0


def test_start_kicks_torques_and_parameters_go_with_nothing_else(device):
    """A slider without friction: each disturbance adds its own variance to where it is.

    With v the start's velocity, a and b kicks before steps 0 and 2 and t0 .. t3 what the torque adds in a
    step (all of variance 1), x moves by h (2 v + 2 a + 2 t0 + t1) in steps 0 and 1, and by
    h (t1 + 2 b + 2 t2 + t3) more than that in steps 2 and 3.
    """
    h, push = 0.25, 4.0
    slider = Scene("slider", (Body("cart", 1.0, 0.1, joint="prismatic", lower=-1e3),),
                   actuators=(Actuator("cart"),), gravity=(0.0, 0.0), step_size=h)  # fmt: skip
    idle = SimpleNamespace(xs=np.zeros((2, 2)), us=np.zeros((1, 1)), K=np.zeros((1, 1, 2)))
    spec = slcp.SweepSpec(
        worlds=WORLDS, duration=4 * h, residuals=("rem-logistic",), step_sizes=(h,), velocity_sd=1.0,
        torque_sd=push, kick_times=(0.0, 2 * h), kick_sd=1.0, observe=0, window=2 * h, sample_every=2 * h,
        parameter_sd={"step_size": 1e-3, "sigma": 0.1, "mass": 1e-3}, seed=5,
    )  # fmt: skip
    report = slcp.sweep(slider, ddp.TrackingPolicy(idle), spec, device=device, dtype="float64")
    assert not report.table["status"].any()
    moved = np.diff(report.samples[0], axis=1).T / h
    more = moved[1] - moved[0]
    error = math.sqrt(2.0 / WORLDS)  # relative, of a variance
    assert abs(moved[0].var() / 13.0 - 1.0) < 6.0 * error
    assert abs(more.var() / 10.0 - 1.0) < 6.0 * error
    assert abs(np.cov(moved[0], more)[0, 1] - 1.0) < 6.0 * math.sqrt(13.0 * 10.0 / WORLDS)
    varied = [
        report.table[name] for name in ("drawn_step_size", "drawn_cart.shift lower.sigma", "drawn_cart.mass")
    ]
    assert correlations(moved[0], *varied) < 6.0 and correlations(more, *varied) < 6.0
