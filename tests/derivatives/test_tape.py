"""Gradients of rollouts recorded on a `wp.Tape` against differences of the rollouts, in float64."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from simulators import scene
from taped import STEPS, finger, loss_of, on_device, start, tape_gradient

from slcp_warp import ddp
from slcp_warp.kernels.policies.nearest import nearest_kernel

SHIFTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference (Richardson, twice)


def directional(x0, us, weight, dx, du, device, step=2e-4):
    """Derivative of the loss along (dx, du) for every world, by one batch of rollouts."""
    factors = [s * k * step for k in SHIFTS for s in (-1, 1)]
    moved_x = np.concatenate([x0 + f * dx for f in factors])
    moved_u = np.concatenate([us + f * du for f in factors])
    states = finger(device).rollout(moved_x, moved_u).states.reshape(len(factors), *weight.shape)
    # the loss is linear in the states: differences of states lose fewer digits than differences of losses
    value = np.einsum("fbkj,bkj->fb", states - states[:1], weight)
    return sum(w * (value[2 * i + 1] - value[2 * i]) for i, w in enumerate(SHIFTS.values())) / step


def test_gradient_of_a_rollout_through_contact(device):
    x0, us, weight = start()
    traj = finger(device).rollout(x0, us, record=("impulse",))
    touching = (traj.impulse[..., 4:] > 1e-2).any(axis=(1, 2))
    assert touching.all() and (traj.status == 0).all()
    gx, gu, _ = tape_gradient(x0, us, weight, device)
    rng, errors = np.random.default_rng(8), []
    for j in range(12):
        dx = np.zeros_like(x0) if j >= 6 else np.eye(6)[j] + np.zeros_like(x0)
        du = np.zeros_like(us) if j < 6 else rng.standard_normal(us.shape) / np.sqrt(us[0].size)
        got = (gx * dx).sum(axis=1) + (gu * du).sum(axis=(1, 2))
        exact = directional(x0, us, weight, dx, du, device)
        errors.append(np.abs(got - exact) / np.linalg.norm(gx if j < 6 else gu.reshape(len(gu), -1), axis=1))
    assert np.max(errors) < 1e-6, np.max(errors, axis=1)


def test_gradient_by_single_controls(device):
    x0, us, weight = (a[:1] for a in start())
    _, gu, _ = tape_gradient(x0, us, weight, device)
    for k, j in ((0, 0), (20, 1), (STEPS - 1, 0)):
        du = np.zeros_like(us)
        du[0, k, j] = 1.0
        exact = directional(x0, us, weight, np.zeros_like(x0), du, device)
        assert abs(gu[0, k, j] - exact[0]) < 1e-6 * np.abs(gu).max()


def test_chained_rollouts_on_one_tape_are_one_rollout(device):
    x0, us, weight = start()
    gx, gu, _ = tape_gradient(x0, us, weight, device)
    half = 30
    x, first, second = on_device(x0, device), on_device(us[:, :half], device), on_device(us[:, half:], device)
    with wp.Tape() as tape:
        one = finger(device).rollout(x, first)
        two = finger(device).rollout(one.states[:, half], second)
        early, late = weight[:, : half + 1].copy(), weight[:, half:].copy()
        late[:, 0] = 0.0  # the state in the middle counts once
        loss = loss_of(one.states, early, device)
        rest = loss_of(two.states, late, device)
    tape.backward(grads={loss: on_device([1.0], device, False), rest: on_device([1.0], device, False)})
    scale = np.abs(gx).max()
    np.testing.assert_allclose(x.grad.numpy(), gx, atol=1e-9 * scale)
    np.testing.assert_allclose(
        np.concatenate([first.grad.numpy(), second.grad.numpy()], 1), gu, atol=1e-9 * scale
    )


def test_steps_on_a_tape_are_a_rollout(device):
    sim = finger(device)
    x0, us, weight = start()
    count = 12
    gx, gu, _ = tape_gradient(x0, us[:, :count], weight[:, : count + 1], device)
    x, controls = on_device(x0, device), [on_device(us[:, k], device) for k in range(count)]
    losses = []
    with wp.Tape() as tape:
        state = x
        for k in range(count):
            state = sim.step(state, controls[k]).state
            losses.append(loss_of(state.reshape((len(x0), 1, 6)), weight[:, k + 1 : k + 2], device))
    tape.backward(grads={loss: on_device([1.0], device, False) for loss in losses})
    np.testing.assert_allclose(x.grad.numpy() + weight[:, 0], gx, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(np.stack([u.grad.numpy() for u in controls], 1), gu, rtol=1e-8, atol=1e-8)


def test_gradients_accumulate_until_zeroed(device):
    x0, us, weight = start()
    x, u = on_device(x0, device), on_device(us, device)
    with wp.Tape() as tape:
        traj = finger(device).rollout(x, u)
        loss = loss_of(traj.states, weight, device)
    tape.backward(loss)
    once = x.grad.numpy().copy(), u.grad.numpy().copy()
    tape.backward(loss)
    np.testing.assert_allclose(x.grad.numpy(), 2.0 * once[0], rtol=1e-12)
    np.testing.assert_allclose(u.grad.numpy(), 2.0 * once[1], rtol=1e-12)
    tape.zero()
    assert not x.grad.numpy().any() and not u.grad.numpy().any()
    tape.backward(loss)
    np.testing.assert_array_equal(x.grad.numpy(), once[0])


def test_a_failed_world_has_a_nan_gradient_and_its_neighbours_their_own(device):
    x0, us, weight = start()
    clean = tape_gradient(x0, us, weight, device)
    broken = us.copy()
    broken[1, 40, 0] = np.nan
    gx, gu, status = tape_gradient(x0, broken, weight, device)
    assert status[1] == 3 and status[0] == status[2] == 0
    assert np.isnan(gx[1]).all() and np.isnan(gu[1]).all()
    for got, exact in ((gx, clean[0]), (gu, clean[1])):
        np.testing.assert_array_equal(np.delete(got, 1, 0), np.delete(exact, 1, 0))


def test_only_what_requires_a_gradient_gets_one(device):
    x0, us, weight = start()
    gx, _, _ = tape_gradient(x0, us, weight, device)
    x, u = on_device(x0, device), on_device(us, device, grad=False)
    with wp.Tape() as tape:
        traj = finger(device).rollout(x, u)
        loss = loss_of(traj.states, weight, device)
    tape.backward(loss)
    assert u.grad is None
    np.testing.assert_array_equal(x.grad.numpy(), gx)


def test_torch_in_torch_out(device):
    torch = pytest.importorskip("torch")
    sim = finger(device)
    x0, us, _ = start()
    where = wp.device_to_torch(sim.device)
    traj = sim.rollout(torch.tensor(x0, device=where), torch.tensor(us, device=where))
    assert isinstance(traj.states, torch.Tensor) and traj.states.dtype == torch.float64
    np.testing.assert_array_equal(traj.states.cpu().numpy(), sim.rollout(x0, us).states)
    step = sim.step(torch.tensor(x0[0], device=where), torch.tensor(us[0, 0], device=where))
    assert step.state.shape == (6,)
    np.testing.assert_array_equal(step.state.cpu().numpy(), sim.step(x0[0], us[0, 0]).state)


@pytest.mark.parametrize(
    "rows, held, limit", [(3, 0, None), (1, 25, None), (3, 0, 0.9), (1, 25, (-0.9, 0.4))]
)
def test_gradient_through_a_tracking_policy(device, rows, held, limit):
    """Also where limits hold some of the controls: their derivative is 0 there."""
    sim = finger(device)
    x0, us, weight = start()
    rng = np.random.default_rng(11)
    nominal = sim.rollout(x0, us).states[:rows]
    plan = {
        "us": us[:rows, : STEPS - held],
        "xs": nominal[:, : STEPS - held + 1] + 0.02 * rng.standard_normal((rows, STEPS - held + 1, 6)),
        "K": 0.3 * rng.standard_normal((rows, STEPS - held, 2, 6)),
    }
    period = scene("flicking_finger").state_period

    def roll(x, arrays):
        limits = None if limit is None else limit if isinstance(limit, tuple) else (-limit, limit)
        policy = ddp.TrackingPolicy(SimpleNamespace(**arrays), period, limits)
        return sim.rollout(x, policy=policy, steps=STEPS, record="controls")

    x = on_device(x0, device)
    arrays = {name: on_device(value, device) for name, value in plan.items()}
    by_control = rng.standard_normal(us.shape)  # the loss contains the controls, too
    with wp.Tape() as tape:
        traj = roll(x, arrays)
    assert not traj.status.numpy().any()
    if limit is not None:
        at_limit = np.abs(traj.controls.numpy()) == 0.9
        assert 0.1 < at_limit.mean() < 0.9
    tape.backward(
        grads={
            traj.states: on_device(weight, device, False),
            traj.controls: on_device(by_control, device, False),
        }
    )
    got = {name: array.grad.numpy() for name, array in arrays.items()}
    assert not got["xs"][:, STEPS - held :].any()  # what the policy never looks at
    got["x0"] = x.grad.numpy()
    moved = plan | {"x0": x0}
    for name, gradient in got.items():
        direction = rng.standard_normal(gradient.shape) / np.sqrt(gradient.size)
        value = {}
        for k in SHIFTS:
            for sign in (-1, 1):
                shifted = moved | {name: moved[name] + sign * k * 2e-4 * direction}
                traj = roll(shifted.pop("x0"), shifted)
                value[sign * k] = (weight * traj.states).sum() + (by_control * traj.controls).sum()
        exact = sum(w * (value[k] - value[-k]) for k, w in SHIFTS.items()) / 2e-4
        assert abs((gradient * direction).sum() - exact) < 1e-6 * np.linalg.norm(gradient), name


def test_a_loss_of_recorded_controls_reaches_the_controls(device):
    x0, us, weight = start()
    _, gu, _ = tape_gradient(x0, us, weight, device)
    x, u = on_device(x0, device), on_device(us, device)
    with wp.Tape() as tape:
        traj = finger(device).rollout(x, u, record="controls")
    ones = wp.full_like(traj.controls, 1.0)
    tape.backward(grads={traj.states: on_device(weight, device, False), traj.controls: ones})
    np.testing.assert_allclose(u.grad.numpy(), gu + 1.0, rtol=1e-9, atol=1e-9)


def test_gradients_that_do_not_exist_are_refused(device):
    sim = finger(device)
    x0, us, _ = start()
    force = on_device(np.zeros((len(x0), 3, 3)), device)
    with wp.Tape():
        with pytest.raises(ValueError, match="external_force requires a gradient"):
            sim.rollout(x0, us, external_force=force)
        with pytest.raises(ValueError, match="linearize is not recorded"):
            sim.linearize(on_device(x0, device), on_device(us[:, 0], device))


def test_policies_without_a_gradient_say_so(device):
    sim = finger(device)
    x0, us, _ = start()
    kernel = nearest_kernel(1)
    nearest = kernel.functions(sim.nx, sim.nu, sim.dtype).Struct()
    library = SimpleNamespace(kernel=lambda sim: (kernel, nearest))
    with wp.Tape(), pytest.raises(ValueError, match="'nearest' policy; only open-loop rollouts and those"):
        sim.rollout(on_device(x0, device), policy=library, steps=3)
    short = SimpleNamespace(us=us, xs=np.zeros((3, 5, 6)), K=np.zeros((3, 70, 2, 6)))
    with pytest.raises(ValueError, match=r"K has shape \(3, 70, 2, 6\) .* must be \(3, 75, 2, 6\)"):
        sim.rollout(x0, policy=ddp.TrackingPolicy(short), steps=3)


@pytest.mark.parametrize("every", [1, 20, 75, 100])
def test_checkpoints_give_the_same_gradient(device, every):
    sim = finger(device)
    x0, us, weight = start()
    bounds = [*range(0, STEPS, every), STEPS]
    sparse = np.zeros_like(weight)
    sparse[:, bounds] = weight[:, bounds]  # only kept states can be part of a loss
    gx, gu, _ = tape_gradient(x0, us, sparse, device)
    params = sim.params.track()
    x, u = on_device(x0, device), on_device(us, device)
    with wp.Tape() as tape:
        traj = sim.rollout(x, u, params, checkpoint=every)
    assert traj.states.shape == (len(x0), len(bounds), 6)
    np.testing.assert_allclose(traj.states.numpy(), sim.rollout(x0, us).states[:, bounds], atol=1e-9)
    tape.backward(grads={traj.states: on_device(weight[:, bounds], device, False)})
    np.testing.assert_allclose(x.grad.numpy(), gx, atol=1e-9 * np.abs(gx).max())
    np.testing.assert_allclose(u.grad.numpy(), gu, atol=1e-9 * np.abs(gu).max())
    plain = sim.params.track()
    with wp.Tape() as tape:
        traj = sim.rollout(on_device(x0, device), on_device(us, device), plain)
    tape.backward(grads={traj.states: on_device(sparse, device, False)})
    for name in ("mass", "friction", "step_size"):
        expected = plain.gradient(name)
        np.testing.assert_allclose(params.gradient(name), expected, atol=1e-8 * np.abs(expected).max())


def test_checkpoints_of_a_failed_world(device):
    sim = finger(device)
    x0, us, weight = (a.copy() for a in start())
    us[1, 30, 0] = np.nan
    x, u = on_device(x0, device), on_device(us, device)
    with wp.Tape() as tape:
        traj = sim.rollout(x, u, checkpoint=20)
    plain = sim.rollout(x0, us)
    np.testing.assert_array_equal(traj.status.numpy(), plain.status)
    assert plain.status[1] != 0
    np.testing.assert_allclose(traj.states.numpy()[1], plain.states[1, [0, 20, 40, 60, 75]], atol=1e-9)
    tape.backward(grads={traj.states: on_device(weight[:, [0, 20, 40, 60, 75]], device, False)})
    assert np.isnan(x.grad.numpy()[1]).all() and np.isnan(u.grad.numpy()[1]).all()
    assert np.isfinite(x.grad.numpy()[[0, 2]]).all()


def test_bad_checkpoints_are_refused(device):
    sim = finger(device)
    x0, us, _ = start()
    for bad in (0, -3, 2.5):
        with pytest.raises(ValueError, match="checkpoint is"):
            sim.rollout(x0, us, checkpoint=bad)
    with pytest.raises(ValueError, match="checkpoint is 5; .* no record"):
        sim.rollout(x0, us, checkpoint=5, record="impulse")


def test_a_loss_of_impulses_or_gaps_is_refused(device):
    sim = finger(device)
    x0, us, weight = start()
    with wp.Tape() as tape:
        traj = sim.rollout(on_device(x0, device), on_device(us, device), record=("impulse",))
    weights = on_device(np.ones(traj.impulse.shape), device, False)
    with pytest.raises(ValueError, match="the loss depends on impulse, through which no gradient flows"):
        tape.backward(grads={traj.impulse: weights})
    with wp.Tape() as tape:
        step = sim.step(on_device(x0, device), on_device(us[:, 0], device))
    with pytest.raises(ValueError, match="the loss depends on gap"):
        tape.backward(grads={step.gap: on_device(np.ones(step.gap.shape), device, False)})
    x = on_device(x0, device)
    with wp.Tape() as tape:  # recording them is no loss of them
        traj = sim.rollout(x, on_device(us, device), record=("impulse", "gap"))
    tape.backward(grads={traj.states: on_device(weight, device, False)})
    np.testing.assert_allclose(x.grad.numpy(), tape_gradient(x0, us, weight, device)[0], rtol=1e-9)
