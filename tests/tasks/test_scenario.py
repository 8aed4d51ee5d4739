"""A world's parameters as a task of that one world, what names of one parameter draw, given worlds."""

from dataclasses import replace

import numpy as np
import pytest
from test_task_sweep import plan
from test_task_sweep import task as push

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.description import columns
from slcp_warp.ensembles.questions.rare.numbers import Numbers
from slcp_warp.ensembles.questions.rare.scenario import scenario_of
from slcp_warp.tasks.disturbances import laws


def drawn(scene, parameters):
    """A task, what its worlds are numbers of, and a world of it."""
    sim = slcp.Simulator(scene, slcp.Options("hard"), dtype="float64", device="cpu", strategy="generic")
    task = slcp.Task("t", scene, duration=1.0, disturbances=slcp.Disturbances(parameters=parameters))
    numbers = Numbers(sim, task, scene.step_size)
    z = np.random.default_rng(1).standard_normal((1, numbers.dimension + numbers.fresh))
    return task, numbers, numbers.worlds(z)


def table(task, count=1):
    """Parameters (count, P) of a task's worlds."""
    return np.asarray(slcp.draw_worlds(task, count, seed=3).numpy().params)


def ways(name):
    """Distributions of a parameter."""
    kind = columns.parameter_of(name)[1]
    for shared in (False, True, "bodies"):
        if shared == "bodies" and kind in laws.OF_NO_BODY:
            continue
        if kind not in laws.SHARES:
            yield slcp.Normal(0.05, 0.1, shared) if kind in laws.SIGNED else slcp.LogNormal(0.1, 2.0, shared)
        if kind != "gravity":
            yield slcp.Uniform(0.3, 0.7, shared)


@pytest.mark.parametrize("name", ["push_block", "hopper"])
def test_every_parameter_is_the_worlds(name, tmp_path):
    """Gravity across and radii of points are zero; both ends of a capsule have the same pair of names."""
    scene = slcp.scenes.NAMED[name]()
    for parameter in (*laws.NAMES, *(name for name in columns.COMPONENTS if "radius" not in name)):
        for way in ways(parameter):
            try:
                task, numbers, world = drawn(scene, {parameter: way})
            except slcp.InputError as error:
                known = ("has no", "was built without", "size is not one number", "is a point")
                assert any(words in str(error) for words in known)
                continue
            slcp.save_task(scenario_of(task, numbers, world), tmp_path / "once.json")
            np.testing.assert_allclose(
                table(slcp.load_task(tmp_path / "once.json")),
                world.numpy().params,
                rtol=1e-6,
                err_msg=f"{parameter} {way}",
            )


def test_what_is_moved_and_not_drawn_is_the_worlds_too():
    scene = slcp.scenes.push_block()
    fixed = {"mass": slcp.LogNormal(0.0, median=2.0), "block.com_x": slcp.Normal(0.0, mean=0.1)}
    fixed |= {"damping": slcp.Uniform(0.4, 0.4), "friction": 0.1}
    task, numbers, world = drawn(scene, fixed)
    own = slcp.Parameters(scene)
    own = own.replace(mass=2.0 * own["mass"], com=own["com"] + [[0.0, 0.0], [0.1, 0.0]], damping=0.4)
    own, row = own.table()[0], world.numpy().params[0]
    friction = [c for c in range(len(own)) if columns.column_of(scene, c)[0] == "friction"]
    assert (row[friction] != own[friction]).all()
    own[friction] = row[friction]
    np.testing.assert_allclose(row, own, rtol=1e-12)
    for each in (task, scenario_of(task, numbers, world)):
        rows = table(each)[0]
        rows[friction] = own[friction]
        np.testing.assert_allclose(rows, own, rtol=1e-6)


def test_springs_that_differ_are_said_by_their_names():
    springs = (
        slcp.Spring(None, "block", (0.0, 1.0), stiffness=1.0),
        slcp.Spring(None, "block", stiffness=2.0),
    )
    scene = replace(slcp.scenes.push_block(), springs=springs)
    for law in (0.1, slcp.LogNormal(0.1, shared=True)):
        task, numbers, world = drawn(scene, {"spring_stiffness": law})
        found = scenario_of(task, numbers, world)
        names = [f"{name}.spring_stiffness" for name in scene.spring_names]
        assert list(found.disturbances.parameters) == names
        np.testing.assert_allclose(table(found)[0], world.numpy().params[0], rtol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_what_is_said_of_a_part_is_around_its_own_number(turned):
    scene = slcp.scenes.push_block()
    given = {"mass": slcp.LogNormal(0.0, median=2.0), "block.mass": slcp.LogNormal(0.0, median=3.0)}
    given |= {"friction": slcp.Uniform(0.9, 0.9), "face/pusher.friction": slcp.LogNormal(0.0, median=2.0)}
    given = dict(reversed(given.items())) if turned else given
    task, _, world = drawn(scene, given)
    own = slcp.Parameters(scene)
    want = own.replace(mass=own["mass"] * [2.0, 3.0], friction=[0.9, 0.9, 2.0 * own["friction"][2]]).table()[
        0
    ]
    for found in (table(task)[0], world.numpy().params[0]):
        np.testing.assert_allclose(found, want, rtol=1e-6)


def test_all_parts_share_a_draw_of_each_component():
    scene = slcp.scenes.push_block()
    task, _, _ = drawn(scene, {"com": slcp.Normal(0.1, shared=True)})
    moved = table(task, 8) - slcp.Parameters(scene).table()
    places = [c for c in range(moved.shape[1]) if columns.column_of(scene, c)[0] == "com"]
    x, y = moved[:, places[::2]], moved[:, places[1::2]]
    np.testing.assert_allclose(x, x[:, :1] + 0.0 * x, atol=1e-6)
    np.testing.assert_allclose(y, y[:, :1] + 0.0 * y, atol=1e-6)
    assert (np.abs(x - y) > 1e-4).all()


def test_what_never_happens_is_later_than_any_time(device):
    """In sweeps as in recorded trajectories; a scene without pairs has no lowest gap."""
    never = m.first_time(m.state("block.x") > 1e6)
    choices = {"worlds": 5, "cases": slcp.Options(), "device": device}
    report = slcp.sweep(push(success=(never > 0.5) & (never > 9.0)), plan(), **choices)
    assert report.part("policy")["success"].all()
    assert not slcp.sweep(push(success=never < 9.0), plan(), **choices).part("policy")["success"].any()


def test_given_worlds_make_the_steps_that_are_asked_for(device):
    """As drawn ones do; without a word the steps that they have, under the label of these."""
    sizes, choices = (0.02, 0.01, 0.04), {"seed": 3, "cases": slcp.Options(), "device": device}
    worlds = slcp.draw_worlds(push(), 20, 3, device=device)
    drawn = slcp.sweep(push(), plan(), worlds=20, step_sizes=sizes, **choices)
    given = slcp.sweep(push(), plan(), worlds=worlds, step_sizes=sizes, **choices)
    assert given.source.keys == drawn.source.keys
    for size in sizes:
        a, b = (each.part("policy", step_size=size)["final"] for each in (drawn, given))
        np.testing.assert_array_equal(a, b, err_msg=str(size))
    fine = replace(worlds, params=np.where(np.arange(worlds.params.shape[1]) == 0, 0.01, worlds.params))
    found = slcp.sweep(push(), plan(), worlds=fine, **choices)
    assert {key[2] for key in found.source.keys} == {0.01}
    np.testing.assert_array_equal(
        found.part("policy")["final"], drawn.part("policy", step_size=0.01)["final"]
    )
    assert {key[2] for key in slcp.sweep(push(), plan(), worlds=worlds, **choices).source.keys} == {0.02}
    fine.params[:5, 0] = 0.02
    with pytest.raises(slcp.InputError, match="step_sizes is .*, of 0.01 to 0.02 s"):
        slcp.sweep(push(), plan(), worlds=fine, step_sizes=(0.02,), **choices)


def test_more_worlds_than_memory_are_refused_at_once():
    for call in (
        lambda: slcp.draw_worlds(push(), 2**31 - 1),
        lambda: slcp.sweep(push(), plan(), worlds=2**31 - 1),
        lambda: slcp.compare_sequentially(push(), {"a": plan(), "b": plan()}, worlds=2**30, batch=2**30),
        lambda: slcp.robustness_map(
            push(), plan(), ("mass", np.linspace(1.0, 2.0, 99)), ("block.x", [0.0]), worlds=2**27
        ),
    ):
        with pytest.raises(slcp.InputError, match="GiB of memory"):
            call()


def test_records_end_with_the_run():
    for every, last in ((0.5, "1"), (0.7, "0.7"), (0.4, "1.2"), (1.2, "1.2"), (0.1, "1.2")):
        found = slcp.sweep(push(), plan(), worlds=2, record=("block.x",), record_every=every).part("policy")
        assert max(name for name in found if name.startswith("recorded_")) == f"recorded_block.x_{last}"


def test_the_size_of_a_disc_or_ring_is_a_number_drawn():
    """Both of its columns have it, from 0 too, and a scenario has it again; what has two sizes takes none."""
    shapes, contact = slcp.rope("rope", None, "bob", 0.5)
    hung = slcp.Scene("hung", (slcp.Body("bob", 1.0, 0.01, joint="free"),), shapes, (contact,))
    given = {"rope.radius": slcp.Uniform(0.5, 0.6), "rope_end.radius": slcp.Uniform(0.01, 0.02)}
    task, numbers, world = drawn(hung, given)
    sizes = slcp.Parameters(hung).from_table(table(task, 200))["radius"]
    assert (sizes[..., 0] == sizes[..., 1]).all()
    low, high = sizes[..., 0].min(axis=0), sizes[..., 0].max(axis=0)
    np.testing.assert_allclose([low, high], [[0.5, 0.01], [0.6, 0.02]], rtol=0.05)
    np.testing.assert_allclose(table(scenario_of(task, numbers, world)), world.numpy().params, rtol=1e-6)
    box = replace(shapes[0], kind="rectangle", radius=(0.2, 0.1))
    with pytest.raises(slcp.ArgumentError, match="'rope' is a rectangle, .* 'rope.radius_0'"):
        drawn(
            replace(hung, shapes=(box, *shapes[1:]), contacts=()),
            {"rope.radius": given["rope.radius"]},
        )


def test_one_draw_of_several_names():
    """Names in one key, by a comma, take the same random number, of the law that each of them has."""
    scene = slcp.scenes.push_block()
    joined = {"pusher.mass, block.mass": 0.2, "friction": 0.3, "block.com_y, block.com_x": slcp.Normal(0.1)}
    task, numbers, world = drawn(scene, joined)
    own, rows = slcp.Parameters(scene), table(task, 400)
    found = own.from_table(rows)
    factor = found["mass"] / own["mass"]
    np.testing.assert_allclose(factor[:, 0], factor[:, 1], rtol=1e-6)
    assert np.log(factor[:, 0]).std() == pytest.approx(0.2, rel=0.15)
    shift = found["com"] - own["com"]
    np.testing.assert_allclose(shift[:, 1, 0], shift[:, 1, 1], atol=1e-7)
    assert abs(np.corrcoef(np.log(factor[:, 0]), shift[:, 1, 0])[0, 1]) < 0.15
    np.testing.assert_allclose(table(scenario_of(task, numbers, world)), world.numpy().params, rtol=1e-6)
    apart = own.from_table(table(drawn(scene, {"mass": 0.2})[0], 400))["mass"]
    assert abs(np.corrcoef(np.log(apart).T)[0, 1]) < 0.15
    for parameters, message in (
        ({"pusher.mass, block.mass": 0.1, "block.mass": 0.2}, "has 'block.mass' twice"),
        ({"pusher.mass,": 0.1}, "names ''"),
        ({"pusher.mass, block.weight": 0.1}, "names 'block.weight'"),
        ({"pusher.mass, block.com_x": 0.1}, "com takes normal or uniform"),
    ):
        with pytest.raises(slcp.ArgumentError, match=message):
            drawn(scene, parameters)


def test_a_report_tells_one_draw_as_one(tmp_path):
    """Sensitivities and files have both numbers, which several names share."""
    task = push(disturbances=slcp.Disturbances(parameters={"pusher.mass, block.mass": 0.2}))
    slcp.save_task(task, tmp_path / "push.json")
    again = slcp.load_task(tmp_path / "push.json")
    assert again.disturbances == task.disturbances
    np.testing.assert_array_equal(table(again, 5), table(task, 5))


def test_points_become_discs_by_their_own_name_alone():
    shapes, contact = slcp.rope("rope", None, "bob", 0.5)
    hung = slcp.Scene("hung", (slcp.Body("bob", 1.0, 0.01, joint="free"),), shapes, (contact,))
    with pytest.raises(slcp.ArgumentError, match="'rope_end' is a point, which only its own name"):
        drawn(hung, {"radius": slcp.Uniform(0.5, 0.6)})
