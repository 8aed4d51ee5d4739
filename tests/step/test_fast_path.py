"""The fast kernel and the full one behind it: the same motion as by one kernel, whoever makes which step."""

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator, stack_of_planes
from sweeps import FINGER, idle, spec

import slcp_warp as slcp
from slcp_warp import Options, Status, ddp, policies
from slcp_warp.kernels.device import launch as launching
from slcp_warp.kernels.device import relay

WORLDS, STEPS = 60, 300
K = np.array([[-1.0, 0, 0, -0.3, 0, 0], [0, -1.0, 0, 0, -0.3, 0]])


@pytest.fixture
def left(monkeypatch):
    """How often each world was left to the full kernel, one array a run."""
    counts, run = [], relay.Run.__call__
    monkeypatch.setattr(relay.Run, "__call__", lambda self: counts.append(run(self)))
    return counts


def fast_finger(device):
    return slcp.Simulator(scene("flicking_finger"), Options(scaling="none"), device, fast_path=True)


def workload(worlds=WORLDS, steps=STEPS):
    rng = np.random.default_rng(3)
    x = FINGER.x0 + rng.standard_normal((worlds, 6)) * (0.3, 0.3, 3.0, 1.0, 1.0, 1.0)
    return x, rng.standard_normal((worlds, steps, 2))


def test_long_rollouts_in_which_most_worlds_need_the_full_kernel(device, left):
    x, us = workload()
    us[5, 170, 1] = np.nan
    base = simulator("flicking_finger", device, wp.float64, "none")
    lower = np.tile(base.params["lower"], (WORLDS, 1))
    lower[7] = np.where(base.scene.structure.lower, 3.0, lower[7])  # above the upper limits
    params = base.params.replace(lower=lower)
    record = ("controls", "impulse", "gap")
    one, two = (sim.rollout(x, us, params, record=record) for sim in (base, fast_finger(device)))
    np.testing.assert_array_equal(two.status, one.status)
    assert two.status[5] == Status.NONFINITE and two.status[7] == Status.INFEASIBLE
    assert (two.states[5, 171:] == two.states[5, 170]).all() and (two.states[7] == x[7]).all()
    assert (left[0].numpy() > 0).mean() > 0.6 and left[0].numpy().max() > 3
    np.testing.assert_allclose(two.states, one.states, rtol=0, atol=1e-7)  # 1e-15 that contacts amplify
    for name in record:
        given, expected = getattr(two, name), getattr(one, name)
        np.testing.assert_allclose(given[:, :30], expected[:, :30], rtol=0, atol=1e-9, err_msg=name)


def test_a_world_moves_as_it_does_alone(device, monkeypatch):
    sim, (x, us) = fast_finger(device), workload()
    together = sim.rollout(x, us).states
    order = np.random.default_rng(0).permutation(WORLDS)
    np.testing.assert_array_equal(sim.rollout(x[order], us[order]).states, together[order])
    np.testing.assert_array_equal(sim.rollout(x[9], us[9]).states, together[9])
    monkeypatch.setattr(launching, "_default_threads", 3)
    many = [np.tile(a, (8, *[1] * (a.ndim - 1))) for a in (x, us)]  # enough for several threads
    np.testing.assert_array_equal(sim.rollout(*many).states, np.tile(together, (8, 1, 1)))


def test_steps_with_all_their_outputs(device):
    x, us = workload(400, 1)
    x[3, 0] = np.nan
    base = simulator("flicking_finger", device, wp.float64, "none")
    one, two = (sim.step(x, us[:, 0]) for sim in (base, fast_finger(device)))
    assert two.status[3] == Status.NONFINITE
    for name in ("state", "impulse", "gap", "multiplier", "status"):
        np.testing.assert_allclose(
            getattr(two, name), getattr(one, name), rtol=1e-9, atol=1e-11, err_msg=name
        )


@pytest.mark.full
def test_linearisations_whose_step_is_left(device, left):
    x, us = workload(3000, 1)
    x[3, 0] = np.nan
    base = simulator("flicking_finger", device, wp.float64, "none")
    one, two = (sim.linearize(x, us[:, 0], second=True) for sim in (base, fast_finger(device)))
    assert left[0].numpy().sum() > 3 and two.status[3] == Status.NONFINITE
    np.testing.assert_array_equal(two.status, one.status)
    for name in ("A", "B", "second"):
        given, expected = getattr(two, name), getattr(one, name)
        scale = 1.0 + np.abs(expected).max(axis=tuple(range(1, expected.ndim)), keepdims=True)
        assert (np.abs(given - expected) / scale).max() < 1e-9, name


def test_a_world_whose_every_step_is_left_costs_few_rounds(device, left):
    """Five planes at once are more rows than the fast kernel takes: a particle that lies on them."""
    planes, steps = stack_of_planes(5), 50
    options = {"dtype": "float64", "device": device}
    one, two = (slcp.Simulator(planes, **options, fast_path=fast) for fast in (False, True))
    x = np.tile(planes.x0, (6, 1))
    x[:, 1] += np.linspace(0.0, 0.5, 6)  # the last ones fall first
    states = [sim.rollout(x, steps=steps).states for sim in (one, two)]
    np.testing.assert_allclose(states[1], states[0], rtol=0, atol=1e-9)
    spans = -(-steps // relay.SPAN)
    assert 1 <= left[0].numpy().min() and left[0].numpy().max() <= spans * len(relay.rounds(relay.SPAN))


def test_digits_that_are_lost_without_contact_are_found_by_the_full_kernel(device, left):
    """Links that swing freely, each ten thousand times as heavy as the one that carries it."""
    ratio = 1e4
    bodies = tuple(
        slcp.Body(f"link{i}", ratio**i, 0.02 * ratio**i, f"link{i - 1}" if i else None, com=(0.25, 0.0),
                  anchor=(0.5 if i else 0.0, 0.0))
        for i in range(3)
    )  # fmt: skip
    scene = slcp.Scene("growing", bodies, step_size=0.005)
    one, two = (
        slcp.Simulator(scene, device=device, dtype="float64", fast_path=fast) for fast in (False, True)
    )
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 6))
    found = [sim.rollout(x, steps=10) for sim in (one, two)]
    assert (found[0].status == Status.SOLVED).all() and (found[1].status == Status.SOLVED).all()
    np.testing.assert_allclose(found[1].states, found[0].states, rtol=0, atol=1e-7)
    assert 0.0 < (left[0].numpy() > 0).mean() < 1.0


def test_the_division_into_launches_changes_no_bit(device, left, monkeypatch):
    """Of worlds that the same kernel steps throughout: what a step starts from is handed on."""
    sim, (x, us) = fast_finger(device), workload(400, 40)
    states = []
    for span in (relay.SPAN, 7):
        monkeypatch.setattr(relay, "SPAN", span)
        states.append(sim.rollout(x, us).states)
    alone = (left[0].numpy() == 0) & (left[1].numpy() == 0)
    assert 0.1 < alone.mean() < 1.0
    np.testing.assert_array_equal(states[0][alone], states[1][alone])


@pytest.mark.slow
@pytest.mark.parametrize("apart", [True, False], ids=["asked apart", "in the kernel"])
def test_sweeps_with_a_policy_that_remembers(device, left, monkeypatch, apart):
    busy = spec(torque_sd=0.5, kick_times=(0.5, 1.0), parameter_sd={"mass": 0.2}, duration=6.0)
    policy = policies.Around(
        idle() if apart else policies.Linear(K, FINGER.x0, np.zeros(2)), delay=2, noise=0.01
    )
    found = []
    for fast in "01":
        monkeypatch.setenv("SLCP_FAST_PATH", fast)
        found.append(slcp.sweep(FINGER, policy, busy, device=device, scaling="none"))
    one, two = found
    assert (left[0].numpy() > 0).mean() > 0.5
    np.testing.assert_array_equal(two.table["status"], one.table["status"])
    for mine, other in zip(two.samples, one.samples, strict=True):
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-5)  # kept in single precision
    for name in ("contact_share", "lowest_gap", "rate"):
        np.testing.assert_allclose(two.table[name], one.table[name], atol=1e-5, err_msg=name)


@pytest.mark.parametrize("span", [1, 2, 16, 100])
def test_the_full_kernel_makes_a_whole_span_in_the_end(span):
    most = relay.rounds(span)
    assert most[0] == 1 and most[-1] == span and len(most) <= 2 + np.log(span) / np.log(relay.GROWTH)


def test_a_fast_path_that_does_not_exist_is_refused(device):
    with pytest.raises(slcp.StrategyError, match="fast_path.*erm-normal"):
        slcp.Simulator(FINGER, Options(residual="erm-normal"), device, fast_path=True)
    alone = slcp.Scene("alone", (slcp.Body("cart", 1.0, 0.1, joint="prismatic"),))
    with pytest.raises(slcp.StrategyError, match="fast_path.*neither rows nor couplings"):
        slcp.Simulator(alone, None, device, fast_path=True)
    with pytest.raises(slcp.StrategyError, match="fast_path.*generic"):
        slcp.Simulator(FINGER, None, device, strategy="generic", fast_path=True)
    with pytest.raises(slcp.StrategyError, match="fast_path.*generic"):
        slcp.Simulator(slcp.scenes.heap(12), None, device, fast_path=True)  # by its size


@pytest.mark.slow
def test_ddp_with_both_kernels(device, left, monkeypatch):
    task = slcp.tasks.flicking_finger()
    us = 0.3 * np.random.default_rng(0).standard_normal((4, 75, 2))
    found = []
    for fast in "01":
        monkeypatch.setenv("SLCP_FAST_PATH", fast)
        sim = slcp.Simulator(task.scene, task.options, device)
        problem = ddp.Problem(sim, task.cost, 75, None, task.control_limits)
        found.append(ddp.solve(problem, task.scene.x0, us, ddp.Options(max_iterations=8)))
    one, two = found
    assert sum(int(count.numpy().sum()) for count in left) > 100
    np.testing.assert_allclose(two.cost, one.cost, rtol=1e-7)
    np.testing.assert_allclose(two.xs, one.xs, rtol=0, atol=1e-5)
