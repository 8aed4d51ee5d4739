"""Policies that a task cannot have: one error that names the policy and what is needed, before any world."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from test_disturbances import LOOSE, N, task

import slcp_warp as slcp
from slcp_warp import ddp, policies

SCENE = LOOSE
NX, NU = 8, 1
ZERO = policies.Linear(np.zeros((NU, NX)), SCENE.x0, [0.0])


def own():
    return task(scene=SCENE, disturbances=slcp.Disturbances())


def plan(nx=NX, nu=NU, steps=N, worlds=None):
    lead = () if worlds is None else (worlds,)
    shapes = {"us": (steps, nu), "xs": (steps + 1, nx), "K": (steps, nu, nx)}
    return ddp.TrackingPolicy(
        SimpleNamespace(**{name: np.zeros(lead + shape) for name, shape in shapes.items()}), np.zeros(nx)
    )


def network(sizes):
    nn = pytest.importorskip("torch").nn
    return policies.Network(nn.Sequential(*(nn.Linear(*pair) for pair in zip(sizes, sizes[1:]))))


def empty_data(dtype, VX, VU, Data):
    @wp.func
    def control(data: Data, world: int, step: int, x: VX):
        return VU(data.gain * x[0])

    return control


BAD = {
    "gains of another size": (
        lambda: policies.Linear(np.zeros((NU, 6)), np.zeros(6), [0.0]), r"K has shape \(1, 6\)"),
    "controls of another scene": (
        lambda: policies.Linear(np.zeros((2, NX)), SCENE.x0, [0.0, 0.0]), r"shape \(2, 8\); .*\(1, 8\)"),
    "a plan of another scene": (lambda: plan(nx=10), "the trajectory has 10 states, 1 controls"),
    "a plan of two controls": (lambda: plan(nu=2), "the trajectory has 8 states, 2 controls"),
    "a network of too many inputs": (lambda: network((9, 4, 1)), "9"),
    "a network of too many outputs": (lambda: network((8, 4, 2)), "2"),
    "limits for two": (lambda: policies.Around(ZERO, limits=(0, [1, 2])), "limit"),
    "a sensor of what is not there": (
        lambda: policies.Around(ZERO, noise={"block.z": 0.1}), "'block.z'"),
    "a state that is not there": (
        lambda: policies.Observed(policies.Linear([[0.0]], [0.0], [0.0]), ("block.z",)), "'block.z'"),
    "numbers that are not given": (lambda: policies.Function(empty_data), "gain"),
    "a function alone": (lambda: lambda x: x, "policy is a function; a policy is needed"),
    "the class": (lambda: policies.Linear, "policy is a type; a policy is needed"),
    "a plan itself": (
        lambda: SimpleNamespace(us=0, xs=0, K=0), "a policy is needed, one of .* ddp.TrackingPolicy"),
    "nothing": (lambda: None, "policy is None; scene 'push_block' has the controls pusher.shift"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_the_error_names_the_policy_before_a_world_runs(name):
    make, text = BAD[name]
    asked = []
    good = policies.Callback(lambda x, time: asked.append(time) or np.zeros((len(x), NU)))
    with pytest.raises(slcp.InputError, match=rf"^policies\['bad'\]: .*{text}") as told:
        slcp.sweep(own(), {"good": good, "bad": make()}, worlds=2, device="cpu")
    assert not asked and "\n" not in str(told.value) and len(str(told.value)) < 500


class Elsewhere:
    """A simulator on another device, as far as a policy's arrays are concerned."""

    device = "cuda:7"

    def __init__(self, sim):
        self._sim = sim

    def __getattr__(self, name):
        return getattr(self._sim, name)


def test_arrays_on_another_device_or_of_another_precision_are_named():
    sim = own().simulator(device="cpu")
    gain = wp.zeros(1, dtype=wp.float64, device="cpu")

    def with_array(dtype, VX, VU, Data):
        @wp.func
        def control(data: Data, world: int, step: int, x: VX):
            return VU(data.gain[0] * x[0])

        return control

    with pytest.raises(slcp.InputError, match="gain is a Warp array of float64 on cpu; .* on cuda:7"):
        policies.Function(with_array, gain=gain).kernel(Elsewhere(sim))
    arrays = {name: wp.zeros((1, *shape), dtype=wp.float64, device="cpu")
              for name, shape in (("us", (N, NU)), ("xs", (N + 1, NX)), ("K", (N, NU, NX)))}  # fmt: skip
    tracked = ddp.TrackingPolicy(SimpleNamespace(**arrays))
    with pytest.raises(
        slcp.InputError, match="us is a Warp array of float64 on cpu; a contiguous one of float64 on cuda:7"
    ):
        tracked.kernel(Elsewhere(sim))
    with pytest.raises(slcp.InputError, match=r"policies\['p'\]: us is .* float64 on cpu; .* float32"):
        slcp.sweep(own(), {"p": tracked}, worlds=2, device="cpu", dtype="float32")


def test_a_law_without_references_goes_to_zero():
    law = policies.Linear([[1.0, 2.0], [3.0, 4.0]])
    assert (
        law.x_ref.shape == (1, 2)
        and law.u_ref.shape == (1, 2)
        and not law.x_ref.any()
        and not law.u_ref.any()
    )
