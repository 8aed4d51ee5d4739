"""Shifts of the receding horizon, eq. (19): which numbers of the last plan start the next one."""

from types import SimpleNamespace

import numpy as np
import pytest

from slcp_warp.ddp.library import receding

N, NX, NU = 8, 4, 2


def chains(offset, count=2):
    """Chains with plans whose every control, state and gain is another number."""
    out = object.__new__(receding._Chains)
    out.options = receding.RecedingOptions(offset=offset, entries=1, recalled=0, noisy=0, perturb_every=0)
    out.problem = SimpleNamespace(horizon=N, nx=NX, nu=NU)
    out.starts, out.steps, out.period, out.plans = 1, 0, np.zeros(NX), receding.Plans()
    numbers = np.arange(float(count * N * NU * NX))
    out.us = 1000.0 + numbers[: count * N * NU].reshape(count, N, NU)
    out.xs = 2000.0 + np.arange(float(count * (N + 1) * NX)).reshape(count, N + 1, NX)
    out.K = 3000.0 + numbers.reshape(count, N, NU, NX)
    out.x = out.xs[:, 0].copy()
    return out


@pytest.mark.parametrize("offset", [1, 3, 5])
def test_a_shift_starts_from_the_rest_of_the_last_plan(offset):
    before, seen = chains(offset), {}
    plan = before.us.copy(), before.xs.copy(), before.K.copy()

    class Shifting:
        def solve(self, x, us, xs, K):
            seen.update(x=x, us=us, xs=xs, K=K)

    before.shifting, before._keep_best = Shifting(), lambda workspace, result: None
    before.shift()
    us, xs, K = plan
    rest = N - offset
    np.testing.assert_array_equal(seen["x"], xs[:, offset])
    np.testing.assert_array_equal(seen["us"][:, :rest], us[:, offset:])
    np.testing.assert_array_equal(seen["us"][:, rest:], np.repeat(us[:, -1:], offset, axis=1))
    np.testing.assert_array_equal(seen["xs"][:, : rest + 1], xs[:, offset:])
    np.testing.assert_array_equal(seen["xs"][:, rest + 1 :], np.repeat(xs[:, -1:], offset, axis=1))
    np.testing.assert_array_equal(seen["K"][:, :rest], K[:, offset:])
    assert not seen["K"][:, rest:].any()  # no plan reaches there: the repeated control is not corrected
    assert before.steps == offset


def test_recall_takes_the_nearest_of_the_plans_that_gain_more():
    made = chains(3)
    made.options = receding.RecedingOptions(offset=3, entries=1, recalled=2)
    made.period = np.array([0.0, np.pi, 0.0, 0.0])
    starts = np.array(
        [[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.2, 0.0, 0.0, 0.0], [0.1, 3.0, 0.0, 0.0]]
    )
    for start, gain in zip(starts, (10.0, 30.0, 25.0, 40.0)):  # the median is 27.5
        made.plans.add(np.zeros((N, NU)), np.tile(start, (N + 1, 1)), np.zeros((N, NU, NX)), gain)
    assert made._recall(np.zeros(4)).tolist() == [3, 1]  # half a turn away is near; the others gain less


def test_an_entry_is_the_plan_at_its_age():
    """x, u and K of an entry belong to the same step, and to the chain and plan that it names."""
    made = chains(3)
    made.options = receding.RecedingOptions(offset=3, entries=3)
    made.entries, made.stored, made.index = [], 0, 7
    made.cost, made.gain = np.array([10.0, 20.0]), np.array([1.0, 2.0])
    made.lower, made.upper = -np.arange(1.0, 5.0).reshape(2, NU), np.arange(1.0, 5.0).reshape(2, NU)
    made.store()
    assert made.stored == len(made.entries) == 6 and made.index == 8
    for entry in made.entries:
        chain, age = entry["chain"], entry["age"]
        np.testing.assert_array_equal(entry["x"], made.xs[chain, age])
        np.testing.assert_array_equal(entry["u"], made.us[chain, age])
        np.testing.assert_array_equal(entry["K"], made.K[chain, age])
        np.testing.assert_array_equal(
            (entry["lower"], entry["upper"]), (made.lower[chain], made.upper[chain])
        )
        assert (entry["cost"], entry["gain"], entry["plan"]) == (10.0 + 10.0 * chain, 1.0 + chain, 7)
    assert [(e["chain"], e["age"]) for e in made.entries] == [(c, k) for c in (0, 1) for k in (0, 1, 2)]
