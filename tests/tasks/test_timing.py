"""Delays and holds of every world's own, around policies that act on the host, and where they may not be."""

import numpy as np
import pytest
from test_disturbances import FORCE, GOAL, LIMITS, B, H, K, swept, task
from test_task_sweep import PAIR, plan
from test_task_sweep import task as measured

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies
from slcp_warp.ensembles.questions.rare.numbers import Numbers
from slcp_warp.ensembles.questions.rare.scenario import scenario_of
from slcp_warp.ensembles.questions.rare.space import searched
from slcp_warp.ensembles.worlds.between import steps_of

DRAWN = {"delay": slcp.Uniform(0.0, 0.08), "hold": slcp.Uniform(0.02, 0.1), "sensor": 0.01}


@pytest.mark.parametrize(
    ("delay", "hold", "steps"), [(0.034, 0.055, (2, 3)), (0.026, 0.045, (1, 2)), (0, 0, (0, 1))]
)
def test_spans_are_the_nearest_steps(delay, hold, steps):
    """Of .02 s; of drawn ones the most."""
    assert steps_of(slcp.Disturbances(delay=delay, hold=hold), 0.02) == steps
    if delay:
        drawn = slcp.Disturbances(delay=slcp.Uniform(0.0, delay), hold=slcp.Uniform(0.02, hold))
        assert steps_of(drawn, 0.02) == steps


def test_what_acts_on_the_host_is_held_alike(device):
    """A callback of the linear law, which every world hears with its own delay and hold."""
    own = task(disturbances=slcp.Disturbances(velocity=0.02, **DRAWN))
    law = policies.Callback(lambda x, time: FORCE + (x - GOAL) @ K.T)
    kernel, host = (swept(device, "specialised", own, policy).part("policy") for policy in (None, law))
    for name in ("block.x", "pusher.vshift", "force", "drawn_delay", "drawn_hold"):
        np.testing.assert_allclose(host[name], kernel[name], rtol=0, atol=1e-9, err_msg=name)
    assert np.ptp(kernel["drawn_delay"]) > 0.03 and np.ptp(kernel["force"]) > 1e-3


def test_a_search_keeps_the_mean_and_a_found_world_its_own():
    own = task(disturbances=slcp.Disturbances(kick_times=(0.3,), kick=0.1, **DRAWN))
    assert searched(own, "kick", None, None, None).delay == pytest.approx(0.04)
    assert searched(own, "all", None, None, None).delay == DRAWN["delay"]
    numbers = Numbers(own.simulator(device="cpu"), own, H)
    assert {"delay", "hold"} < set(numbers.names)
    world = numbers.worlds(np.full((1, numbers.dimension), -9.0))
    np.testing.assert_allclose(world.timing, [[[0.0, 0.02]]], atol=1e-9)
    once = scenario_of(own, numbers, world)
    assert (once.disturbances.delay, round(once.disturbances.hold, 9)) == (0.0, 0.02)


@pytest.mark.parametrize("wrong", [slcp.LogNormal(0.1, median=0.02), slcp.Uniform(-0.1, 0.1), -0.1, "late"])
def test_only_what_has_an_end_is_taken(wrong):
    with pytest.raises(slcp.InputError, match="Disturbances.delay"):
        slcp.Disturbances(delay=wrong)


def test_a_world_has_its_own_in_every_chunk(device):
    own = task(disturbances=slcp.Disturbances(**DRAWN), control_limits=LIMITS)
    whole, cut = (swept(device, "specialised", own, chunk=chunk).part("policy") for chunk in (None, 4))
    assert len(whole["world"]) == B and all(np.array_equal(whole[name], cut[name]) for name in whole)


def test_windows_and_dropouts_are_met_in_single_precision(device):
    """Fifty of its steps of .02 s are not 1 s, yet no step more or less is counted."""
    window = {"start": 1.0, "end": 1.1}
    found = {
        "begins": m.initial(m.time(), start=1.0), "ends": m.final(m.time(), end=1.0),
        "moved": m.change("block.x"), "since": m.settled(m.time() > 0.99),
        "steps": m.total(m.time(), **window), "dropped": m.largest(abs(m.control(0)), **window),
        "before": m.final(m.control(0), end=1.0), "after": m.initial(m.control(0), start=1.1),
        "far": m.mean(m.gap(PAIR)), "long": m.integral(m.gap(PAIR)),
    }  # fmt: skip
    still = slcp.Disturbances(dropouts=(slcp.Dropout(1.0, 0.1),))
    report = slcp.sweep(measured(measures=found, disturbances=still), plan(), worlds=3, device=device)
    rows = report.part("policy")
    expected = {"begins": 1.0, "since": 1.0, "ends": 0.98, "steps": 5.2, "dropped": 0.0}
    for name, value in expected.items():
        np.testing.assert_allclose(rows[name], value, rtol=1e-14, atol=0.0, err_msg=name)
    assert rows["before"].all() and rows["after"].all()
    steps = round(measured().duration / 0.02)
    np.testing.assert_allclose(rows["long"], rows["far"] * steps * 0.02, rtol=1e-12)
    assert np.isfinite(rows["far"]).all()  # though the pair does not act in some steps
