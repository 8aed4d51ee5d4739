"""Sums and products of signals: against NumPy on the same runs, work against energy, files, and errors."""

from dataclasses import replace

import numpy as np
import pytest
from simulators import scene

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.tasks.notation import (
    NotationError,
    condition_content,
    condition_of,
    measure_content,
    measure_of,
)

H, STEPS = 0.02, 60
PUSH = replace(scene("push_on_ice"), step_size=H)
V, U, X = m.state("block.vx"), m.control(0), m.state("block.x")
FORCE = m.normal_force()
ASKED = {
    "power": m.integral(U * m.state("pusher.vshift")),
    "mixed": m.mean(2.0 * U * V - X / 4 + 3.0 - V * V),
    "most": m.largest(abs(U - 0.3 * m.state("pusher.vshift"))),
    "least": m.smallest(m.since_start(X) * 2.0 - abs(V)),
    "pushed": m.total(FORCE * V),
    "under": m.share_of_time(U < 1.5 - 2.0 * m.state("pusher.vshift")),
    "over": m.first_time(FORCE > 2.0 * U),
    "steps": m.rms(U - 1.0, where=V * V > 1e-4),
    "one": m.final(m.time() * 1.0 + 0.0),
}


def task_of(**changes) -> slcp.Task:
    drawn = slcp.Disturbances(velocity=0.1, torque=0.3, parameters={"mass": 0.2})
    fields = {"duration": STEPS * H, "measures": ASKED, "disturbances": drawn, "control_limits": (-4.0, 4.0)}
    return slcp.Task("push", PUSH, **{**fields, **changes})


def policy() -> slcp.policies.Linear:
    gain = np.zeros((1, 8))
    gain[0, PUSH.state_index("pusher.shift")], gain[0, PUSH.state_index("pusher.vshift")] = -6.0, -1.0
    return slcp.policies.Linear(gain, np.eye(8)[PUSH.state_index("pusher.shift")] * 0.5)


def by_hand(run, h) -> dict[str, np.ndarray]:
    """The same of states, controls and impulses that were recorded."""
    names = list(PUSH.state_names)
    x, v, w = (run.states[:, :, names.index(name)] for name in ("block.x", "block.vx", "pusher.vshift"))
    u, force = run.controls[:, :, 0], run.contact_impulse[..., 0].sum(axis=2) / h
    held = np.concatenate([u, u[:, -1:]], axis=1)
    late = np.concatenate([force, force[:, -1:]], axis=1)
    over = late > 2.0 * held
    moving = (v**2 > 1e-4)[:, :-1]
    return {
        "power": h * (u * w[:, :-1]).sum(axis=1),
        "mixed": (2.0 * u * v[:, :-1] - x[:, :-1] / 4.0 + 3.0 - v[:, :-1] ** 2).mean(axis=1),
        "most": np.abs(held - 0.3 * w).max(axis=1),
        "least": (2.0 * (x - x[:, :1]) - np.abs(v)).min(axis=1),
        "pushed": (force * v[:, :-1]).sum(axis=1),
        "under": (held < 1.5 - 2.0 * w)[:, :-1].mean(axis=1),
        "over": np.where(over.any(axis=1), h * over.argmax(axis=1), np.inf),
        "steps": np.sqrt(np.where(moving, (u - 1.0) ** 2, 0.0).sum(axis=1) / moving.sum(axis=1)),
        "one": np.full(len(u), h * u.shape[1]),
    }


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
def test_sweeps_measure_what_numpy_does_of_their_runs(strategy):
    task = task_of(options=slcp.Options(residual="hard"))
    given = {"dtype": "float64", "device": "cpu", "strategy": strategy}
    table = slcp.sweep(task, policy(), worlds=12, seed=4, **given).part("policy", arm="disturbed")
    worlds = slcp.draw_worlds(task, 12, seed=4, dtype="float64", device="cpu")
    run = slcp.replay(task, policy(), worlds, seed=4, record=("controls", "impulse"), **given)
    expected = by_hand(run, task.scene.step_size)
    assert np.isfinite(expected["over"]).any() and 0.0 < expected["under"].mean() < 1.0
    for name, values in expected.items():
        np.testing.assert_allclose(table[name], values, rtol=2e-5, atol=1e-5, err_msg=name)
        np.testing.assert_allclose(run.measure(ASKED[name]), values, rtol=1e-9, atol=1e-9, err_msg=name)


def test_work_is_energy():
    """Of a cart that is pushed the work at the middle of a step is what its energy grows by."""
    mass, h = 2.0, 0.05
    cart = slcp.Scene("cart", (slcp.Body("cart", mass, 0.01, joint="prismatic"),),
                      actuators=(slcp.Actuator("cart"),), step_size=h)  # fmt: skip
    u, v = m.control("cart.shift"), m.state("cart.vshift")
    task = slcp.Task(
        "cart", cart, duration=40 * h,
        measures={
            "work": m.integral(u * v + h / (2.0 * mass) * u * u), "energy": m.final(0.5 * mass * v * v)
        },
        disturbances=slcp.Disturbances(torque=1.0),
    )  # fmt: skip
    still = slcp.policies.Linear(np.zeros((1, 2)), np.zeros(2), [0.5])
    report = slcp.sweep(task, still, worlds=20, seed=2, dtype="float64", device="cpu")
    found = report.part("policy", arm="disturbed")
    assert np.ptp(found["energy"]) > 0.1
    np.testing.assert_allclose(found["work"], found["energy"], rtol=0, atol=1e-12)


TOLD = [
    (U * V, "control(0) * state('block.vx')"),
    (2 * U - V, "2 * control(0) - state('block.vx')"),
    (-U, "-control(0)"),
    (abs(U - V / 2) , "abs(control(0) - 0.5 * state('block.vx'))"),
    ((1.0 - U) * (V + 2), "state('block.vx') + 2 - control(0) * state('block.vx') - 2 * control(0)"),
    (U - U, "0"),
    (U + U, "2 * control(0)"),
    ((U + V - V) * 1.0, "control(0)"),
    (V * U, "control(0) * state('block.vx')"),
]  # fmt: skip


@pytest.mark.parametrize(("signal", "text"), TOLD)
def test_what_is_printed_makes_it_again(signal, text):
    assert repr(signal) == text
    if text != "0":
        assert eval(text, vars(m)) == signal


def test_comparisons_print_as_they_are_written():
    assert repr(U < 3 - V) == "control(0) - 3 + state('block.vx') < 0"
    assert repr((U * V).between(0, 2)) == "(control(0) * state('block.vx')).between(0, 2)"
    assert eval(repr((U * V).between(0, 2)), vars(m)) == (U * V).between(0, 2)


@pytest.mark.parametrize("name", ASKED)
def test_files_hold_them(name):
    measure = ASKED[name]
    assert measure_of(measure_content(measure), "measure") == measure
    condition = U * V > 0.5
    assert condition_of(condition_content(condition), "where") == condition


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: U * V * X, ArgumentError, r"\* of .* has products of more than 2 signals"),
        (lambda: U + "block.x", ArgumentTypeError, r"\+ joins a signal and 'block.x'; a signal or a number"),
        (lambda: U * True, ArgumentTypeError, r"\* joins a signal and True"),
        (lambda: U - float("nan"), ArgumentError, "the number of - is nan"),
        (lambda: 1.0 / U, TypeError, ""),
        (lambda: U / V, ArgumentTypeError, "/ is by .*; a number is needed"),
        (lambda: U / 0, ArgumentError, "the number after / is 0"),
        (lambda: abs(U + V) + 1, ArgumentError, "an absolute value of a sum stands alone"),
        (lambda: m.since_start(U + V), ArgumentError, "since_start is of a sum"),
        (lambda: sum((m.state(i) for i in range(300)), 0.0), ArgumentError, "at most 256 are possible"),
        (lambda: of_terms({"kind": "sum"}), NotationError, "terms of a sum"),
        (lambda: of_terms({"kind": "state", "which": "a", "terms": [{"of": ["a"]}]}), NotationError,
         "terms of a state"),
        (lambda: of_terms([{"of": ["a", "b", "c"]}]), NotationError, "at most 2 signals"),
        (lambda: of_terms([{"of": [{"kind": "sum", "terms": [{}]}]}]), NotationError, "a sum in a sum"),
        (lambda: of_terms([{"weight": "1"}]), NotationError, r"terms\[0\], weight is '1'"),
        (lambda: of_terms([{"wight": 1}]), NotationError, "did you mean 'weight'"),
    ],
)  # fmt: skip
def test_errors_say_what_is_needed(make, error, text):
    with pytest.raises(error, match=text):
        make()


def of_terms(terms):
    of = terms if isinstance(terms, dict) else {"kind": "sum", "terms": terms}
    return measure_of({"reduction": "final", "of": of}, "m")
