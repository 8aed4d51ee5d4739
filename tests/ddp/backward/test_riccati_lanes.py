"""The backward pass by the lanes of a warp, with a single lane, beside that of a thread."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from ddp_examples import cart_pole, fragile_problem, random_linear_problem
from simulators import scene

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.parts import passes
from slcp_warp.kernels.control.backward.riccati_steps import room_of

METHODS = ("second-order", "gauss-newton", "first-order")
FIELDS = ("us", "xs", "K", "k", "Vx", "Vxx", "cost", "gradient")


def by_one_lane(monkeypatch):
    monkeypatch.setattr(passes, "lanes_of", lambda device: 1)


def both(monkeypatch, solve):
    """What `solve` gives by a thread, and by a lane."""
    thread = solve()
    by_one_lane(monkeypatch)
    return thread, solve()


def assert_same(thread, lane, tolerance=1e-9):
    assert np.array_equal(thread.status, lane.status) and np.array_equal(thread.iterations, lane.iterations)
    pairs = {name: [np.asarray(getattr(each, name)) for each in (thread, lane)] for name in FIELDS}
    pairs["pivot"] = [np.asarray(each.trace.min_pivot) for each in (thread, lane)]
    for name, (a, b) in pairs.items():
        size = np.nanmax(np.abs(a), initial=1.0)
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=tolerance * size, err_msg=name)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("limits", [None, ([-3.0], [3.0])], ids=["free", "limited"])
@pytest.mark.parametrize(("count", "tolerance"), [(0, 1e-11), (5, 1e-5)])
def test_a_lane_passes_back_as_a_thread(monkeypatch, method, limits, count, tolerance):
    """From a start whose Q_uu is indefinite, so that mu is raised and passes begin again; roundings grow from
    pass to pass.
    """

    def solve():
        problem, x0, us = cart_pole(limits=limits)
        starts = x0 + 0.2 * np.random.default_rng(0).normal(size=(3, 4))
        options = ddp.Options(method=method, max_iterations=count)
        return ddp.Workspace(problem, 3, options).solve(starts, us)

    thread, lane = both(monkeypatch, solve)
    assert_same(thread, lane, tolerance)
    np.testing.assert_allclose(thread.trace.regularization, lane.trace.regularization, rtol=1e-9)
    np.testing.assert_array_equal(thread.trace.restarts, lane.trace.restarts)
    if method == "second-order" and limits is None:
        assert (thread.trace.restarts > 0).any()


@pytest.mark.parametrize(("state_weight", "control_weight"), [(0.5, 0.0), (0.5, 0.3)])
def test_a_lane_regularises_as_a_thread(monkeypatch, state_weight, control_weight):
    schedule = ddp.Regularization(initial=2.0, state_weight=state_weight, control_weight=control_weight)

    def solve():
        problem, data = random_linear_problem(4, horizon=15)
        us = np.random.default_rng(0).normal(size=(15, 2))
        return ddp.solve(problem, data["x0"], us, ddp.Options(max_iterations=0, regularization=schedule))

    assert_same(*both(monkeypatch, solve), tolerance=1e-12)


def test_a_lane_closes_gaps_as_a_thread(monkeypatch):
    def solve():
        problem, data = random_linear_problem(0, horizon=15)
        rng = np.random.default_rng(1)
        xs, us = rng.normal(size=(16, 4)), rng.normal(size=(15, 2))
        xs[0] = data["x0"]
        return ddp.solve(problem, data["x0"], us, ddp.Options(max_iterations=2), xs0=xs)

    assert_same(*both(monkeypatch, solve))


def test_a_problem_without_derivatives_ends_by_lanes(monkeypatch):
    def solve():
        starts = [[1.0, 0.0], [3.9, 5.0], [-2.0, 1.0]]
        return ddp.solve(fragile_problem("cpu"), starts, np.zeros((20, 1)))

    thread, lane = both(monkeypatch, solve)
    assert np.array_equal(thread.status, lane.status) and lane.status[1] == ddp.Status.DYNAMICS_FAILED
    np.testing.assert_allclose(thread.us[::2], lane.us[::2], atol=1e-9)
    assert not lane.K[1].any() and not lane.k[1].any()


def test_a_room_holds_everything_once():
    room = room_of(6, 2, 3)
    width = room.pop("width")
    places = list(room.values())
    assert places == sorted(set(places)) and places[0] == 0 and places[-1] == width - 1
    assert room["vxx"] == 6 and room["y"] == 42 and room["product"] == 45


def test_threads_on_a_cpu_lanes_on_a_gpu():
    assert passes.lanes_of(wp.get_device("cpu")) == 0
    assert passes.lanes_of(SimpleNamespace(is_cpu=False)) == 32


def test_a_lane_takes_second_derivatives_that_come_weighed(monkeypatch):
    """Of generic kernels."""
    sim = slcp.Simulator(scene("flicking_finger"), device="cpu", strategy="generic")
    problem = ddp.Problem(sim, ddp.costs.quadratic(np.eye(6), 0.1 * np.eye(2)), 12)
    us = 0.3 * np.random.default_rng(0).normal(size=(2, 12, 2))

    def solve():
        options = ddp.Options(max_iterations=3)
        return ddp.Workspace(problem, 2, options).solve(np.tile(scene("flicking_finger").x0, (2, 1)), us)

    assert_same(*both(monkeypatch, solve), 1e-7)
