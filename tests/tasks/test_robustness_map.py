"""Maps of where a policy holds, and what their axes name: parts and components of parameters."""

from dataclasses import replace

import numpy as np
import pytest
from test_task_sweep import SCENE, plan, task

import slcp_warp as slcp
from slcp_warp.ensembles.questions.axes import changed
from slcp_warp.kernels.structure import layout
from slcp_warp.scripts.charts.questions import read_map


def _column(name: str, body: str, place: int) -> int:
    start, shape = next(
        (start, shape) for which, start, shape in layout(SCENE.structure).columns if which == name
    )
    return start + [each.name for each in SCENE.bodies].index(body) * shape[1] + place


def test_a_component_of_a_place_is_drawn_alone():
    drawn = {
        "com": slcp.Uniform(-0.1, 0.1),
        "block.com_y": slcp.Uniform(0.3, 0.3),
        "com_x": slcp.Normal(0.0, 0.2),
    }
    found = (
        slcp.draw_worlds(task(disturbances=slcp.Disturbances(parameters=drawn)), 50, dtype="float64")
        .numpy()
        .params
    )
    assert (found[:, _column("com", "block", 1)] == 0.3).all()
    np.testing.assert_allclose(found[:, _column("com", "block", 0)], 0.2 + SCENE.bodies[-1].com[0])
    assert np.ptp(found[:, _column("com", "pusher", 1)]) > 0.1
    with pytest.raises(
        slcp.InputError,
        match="names 'block.mass_x'; block.mass is like it; choose from .*, com, com_x, com_y, ",
    ):
        slcp.Disturbances(parameters={"block.mass_x": 0.1})


def test_a_factor_is_on_values_of_the_other_axis(device):
    """Whichever of them is x; the values were put in place of what the factors had changed."""
    axes = ("block.mass", (0.25, 1.0, 4.0)), ("mass=", (0.5, 2.0))
    options = {"worlds": 60, "seed": 3, "device": device, "case": slcp.Options()}
    one, other = (slcp.robustness_map(task(), plan(0.6), *pair, **options) for pair in (axes, axes[::-1]))
    np.testing.assert_array_equal(one.successes, other.successes.T)
    assert np.ptp(one.successes, axis=1).max() > 0
    with pytest.raises(slcp.ArgumentError, match="'block.mass=' and 'mass=', are both values of the same"):
        slcp.robustness_map(task(), plan(0.6), ("block.mass=", (1.0,)), axes[1], **options)


def test_a_map_has_the_sweep_in_its_middle(device):
    """The cell without a change is the sweep; what is heavier is pushed less far."""
    options = {"worlds": 100, "seed": 3, "device": device}
    x, y = ("block.mass", (0.25, 1.0, 4.0)), ("pusher.shift", (-0.1, 0.0))
    found = slcp.robustness_map(task(), {"push": plan(0.6)}, x, y, case=slcp.Options(), **options)
    sweep = slcp.sweep(task(), plan(0.6), cases=slcp.Options(), **options)
    assert found.successes[1, 1] == sweep.part("policy")["success"].sum()
    assert found.successes.shape == (2, 3) and found.successes[1, 0] > found.successes[1, 2]
    share = found.share
    assert (share[1] <= share[0]).all() and (share[0] <= share[2]).all()
    assert "factor on block.mass x added to pusher.shift, 3 x 2 cells of 100 worlds" in repr(found)
    assert "success [%]" in str(found)
    place = ("block.com_x", (-0.02, 0.0))
    moved = slcp.robustness_map(task(), {"push": plan(0.6)}, place, y, case=slcp.Options(), **options)
    assert moved.successes[1, 1] == found.successes[1, 1]
    worlds = slcp.draw_worlds(task(), 100, 3, dtype="float32", device=device)
    beside = changed(task(), worlds, place[0], np.full(100, -0.02)).params - np.array(worlds.params)
    assert np.unique(np.flatnonzero(beside.any(axis=0))).tolist() == [_column("com", "block", 0)]


def test_a_map_of_values_puts_them_in_place_of_what_was_drawn(device, tmp_path):
    """Against sweeps of worlds with these very masses and starts, by the columns of the table."""
    options = {"seed": 3, "device": device}
    masses, shifts = (0.3, 2.5), (-0.6, -0.5)
    found = slcp.robustness_map(
        task(), {"push": plan(0.6)}, ("block.mass=", masses), ("pusher.shift=", shifts), worlds=50,
        case=slcp.Options(), **options,
    )  # fmt: skip
    drawn = slcp.draw_worlds(task(), 50, 3, dtype="float32", device=device)
    block = [each.name for each in SCENE.bodies].index("block")
    for i, mass in enumerate(masses):
        for j, shift in enumerate(shifts):
            params, x0 = np.array(drawn.params), np.array(drawn.x0)
            params[:, layout(SCENE.structure).offset("mass") + block] = mass
            x0[:, SCENE.state_index("pusher.shift")] = shift
            own = replace(drawn, params=params, x0=x0)
            sweep = slcp.sweep(task(), plan(0.6), worlds=own, cases=slcp.Options(), **options)
            assert found.successes[j, i] == sweep.part("policy")["success"].sum()
    assert 0 < found.successes.sum() < 200
    assert "of push: block.mass x pusher.shift, 2 x 2 cells" in repr(found)
    _, across, down, _ = read_map(found.save(tmp_path / "map.csv"))
    np.testing.assert_allclose(across, masses)
    np.testing.assert_allclose(down, shifts)


@pytest.mark.parametrize(
    "x, y, text",
    [
        (("mass=", (1.0,)), ("mass", (1.0,)), "x and y are both 'mass='"),
        (("mass=", (-1.0, 1.0)), ("block.x", (0.0,)), "the values of x is -1.0; it must be positive"),
        (("kicks=", (1.0,)), ("block.x", (0.0,)), "x is 'kicks='; kicks have factors alone"),
        (("weight=", (1.0,)), ("mass", (1.0,)), "x is 'weight'; a state .* or a parameter"),
        (("mass", (1.0,)), ("mass", (1.0,)), "x and y are both 'mass'"),
        (("weight", (1.0,)), ("mass", (1.0,)), "x is 'weight'; a state .* or a parameter"),
        (("mass", (0.0, 1.0)), ("block.x", (0.0,)), "hold 0; 'mass' takes positive factors"),
        (("ledge.height", (0.0, 1.0)), ("block.x", (0.0,)), "x is 'ledge.height'; a state .* or a parameter"),
        (("mass", ()), ("block.x", (0.0,)), "the values of x"),
        (("mass", (1.0, 2.0, 1.0)), ("block.x", (0.0,)), "the values of x are .* each of them once"),
        ("mass", ("block.x", (0.0,)), "x is 'mass'"),
        (("kicks", (1.0,)), ("block.x", (0.0,)), "has none"),
    ],
)
def test_what_is_no_axis_is_refused(x, y, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.robustness_map(task(), plan(), x, y)


def test_numbers_of_a_policy_are_an_axis(device):
    """Each cell is a sweep under the policy of its number; the other is of the task or its own."""
    options = {"worlds": 40, "seed": 3, "device": device, "case": slcp.Options()}
    mass = ("block.mass=", (0.5, 2.0))
    for axes in ((("scale", (0.4, 0.6, 0.9)), mass), (mass, ("scale", (0.4, 0.6, 0.9)))):
        found = slcp.robustness_map(task(), plan, *axes, numbers="scale", **options)
        successes = found.successes if axes[1] is mass else found.successes.T
        assert {found.x, found.y} == {"scale=", "block.mass="} and np.ptp(successes) > 10
        for i, scale in enumerate((0.4, 0.6, 0.9)):
            one = slcp.robustness_map(task(), plan(scale), mass, ("block.x", (0.0,)), **options)
            np.testing.assert_array_equal(successes[:, i], one.successes[0], str(scale))
    assert "scale of" not in str(found) and "of plan: block.mass x scale, 2 x 3 cells" in repr(found)


def test_two_numbers_of_a_policy(device):
    def both(scale, more):
        return plan(scale + more)

    x, y = ("scale", (0.1, 0.25)), ("more", (0.1, 0.25))
    options = {"worlds": 40, "seed": 3, "device": device, "case": slcp.Options()}
    found = slcp.robustness_map(task(), both, x, y, numbers=("scale", "more"), **options)
    sums = slcp.robustness_map(
        task(), plan, ("scale", (0.2, 0.35, 0.5)), ("block.x", (0.0,)), numbers="scale", **options
    ).successes[0]
    assert sums[0] < sums[1] < sums[2]
    np.testing.assert_array_equal(found.successes, [[sums[0], sums[1]], [sums[1], sums[2]]])
    with pytest.raises(slcp.InputError, match=r"a function of \(scale, more\) that gives a policy"):
        slcp.robustness_map(task(), plan(0.6), x, y, numbers=("scale", "more"), **options)
    with pytest.raises(slcp.ArgumentError, match="numbers names"):
        slcp.robustness_map(task(), plan, x, y, numbers="speed", **options)
    with pytest.raises(slcp.ArgumentError, match="x is 'scale'; a state"):
        slcp.robustness_map(task(), plan, x, y, **options)
