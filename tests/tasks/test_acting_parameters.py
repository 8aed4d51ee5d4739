"""Numbers that would act on nothing are refused, or not drawn: limits, springs, friction."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.ensembles.questions.rare.numbers import Numbers
from slcp_warp.ensembles.questions.sensitivity import factors_of
from slcp_warp.tasks.disturbances.laws import parameter_laws

SCENE = slcp.Scene(
    "parts",
    (
        slcp.Body("rail", 1.0, 0.1, joint="prismatic", lower=0.0, upper=0.1, stiffness=10.0),
        slcp.Body("arm", 1.0, 0.1, parent="rail"),
        slcp.Body("ball", 1.0, 0.1, joint="free"),
    ),
    (
        slcp.Shape("tip", "arm", "capsule", (0.01, 0.1)),
        slcp.Shape("skin", "ball", "disc", 0.1, angle=0.3),
        slcp.Shape("ground", None, "halfplane", 0.0, (0.0, -0.1), np.pi / 2),
    ),
    (slcp.Contact("tip", "skin", 0.5), slcp.Contact("ground", "skin")),
)
REFUSED = {
    "lower": (1, "arm.angle", "without a lower limit"),
    "upper": (2, "ball.x", "without an upper limit"),
    "stiffness": (1, "arm.angle", "without a spring"),
    "rest": (4, "ball.angle", "without a spring"),
    "friction": (1, "ground/skin", "without friction"),
    "shape_angle": (0, "tip", "with the angle 0"),
}

ACT = {
    "lower": [1, 0, 0, 0, 0], "upper": [1, 0, 0, 0, 0], "stiffness": [1, 0, 0, 0, 0], "rest": [1, 0, 0, 0, 0],
    "friction": [1, 0],
}  # fmt: skip


def task(**parameters) -> slcp.Task:
    given = slcp.Disturbances(parameters=parameters)
    return slcp.Task("drawn", SCENE, duration=0.1, disturbances=given, success=m.final("ball.y") < 0.0)


@pytest.mark.parametrize("name", REFUSED)
def test_replaced_numbers_that_nothing_reads_are_refused(name):
    """One by one and for every world; what is there already is taken, as is one number for all."""
    row, part, why = REFUSED[name]
    params = slcp.Parameters(SCENE)
    value = params[name].copy()
    assert params.replace(**{name: value})[name].tobytes() == value.tobytes()
    value[row] += 0.5
    for given in (value, np.stack([params[name], value])):
        with pytest.raises(slcp.ParameterError, match=f"{name} of '{part}' is 0.5; it was built {why}"):
            params.replace(**{name: given})
    if name != "shape_angle":
        acts = np.array(ACT[name], bool)
        for one in (0.3, np.full(7, 0.3), np.full((4, 1), 0.3)):  # of all, of every world
            found = params.replace(**{name: one})[name]
            assert (found[..., acts] == 0.3).all() and (found[..., ~acts] == params[name][~acts]).all()


def test_numbers_that_are_read_are_taken():
    params = slcp.Parameters(SCENE)
    for name, row in {
        "lower": 0,
        "upper": 0,
        "stiffness": 0,
        "rest": 0,
        "friction": 0,
        "shape_angle": 1,
    }.items():
        value = np.stack([params[name]] * 3)
        value[1, row] += 0.05
        assert (params.replace(**{name: value})[name] == value).all()


@pytest.mark.parametrize("name", ["lower", "upper", "stiffness", "rest", "friction"])
def test_disturbances_of_what_is_not_there_are_refused(name):
    _, part, why = REFUSED[name]
    with pytest.raises(slcp.InputError, match=f"names '{part}.{name}'; it was built {why}"):
        task(**{f"{part}.{name}": slcp.Uniform(0.5, 0.6)})
    bare = slcp.Scene("bare", SCENE.bodies[2:], SCENE.shapes[1:], SCENE.contacts[1:])
    with pytest.raises(slcp.InputError, match=f"names '{name}'; (it was built {why}|.* has no {name})"):
        slcp.Disturbances(parameters={name: slcp.Uniform(0.5, 0.6)}).check(bare, 1.0)


def test_a_disturbance_of_all_draws_those_that_act():
    base = slcp.Parameters(SCENE).table()[0]
    drawn = {name: slcp.Uniform(0.5, 0.6) for name in ("lower", "stiffness", "friction")}
    laws = parameter_laws(SCENE, base, drawn)
    assert [laws.names[i] for i in laws.varied] == [
        "rail.shift.lower",
        "tip/skin.friction",
        "rail.shift.stiffness",
    ]


def test_kicks_need_their_times():
    for given in ({"kick": 0.5}, {"kicks": {"ball.vx": slcp.Normal(0.5)}}):
        with pytest.raises(slcp.InputError, match=f"Disturbances.{next(iter(given))} is .*no kick_times"):
            slcp.Disturbances(**given)
    assert slcp.Disturbances(kick=0.0).kick == 0.0 and slcp.Disturbances(kick=0.5, kick_times=(1.0,)).any()


def test_a_factor_on_a_number_that_is_zero_is_no_draw():
    """Damping of the rail alone: the zeros of others were searched by `falsify`, and had indices."""
    rail, *others = SCENE.bodies
    scene = replace(SCENE, bodies=(replace(rail, damping=0.2), *others))
    drawn = slcp.Disturbances(parameters={"damping": 0.3})
    own = slcp.Task("zeros", scene, duration=0.1, start={"ball.y": 1.0}, disturbances=drawn,
                    measures={"x": m.final("ball.x")})  # fmt: skip
    assert [factor.name for factor in factors_of(own)] == ["rail.shift.damping"]
    assert Numbers(own.simulator(device="cpu"), own, 0.02).dimension == 1
    report = slcp.sweep(own, worlds=4, cases=slcp.Options("hard"), device="cpu")
    assert [name for name in report.table if name.startswith("drawn_")] == ["drawn_rail.shift.damping"]
