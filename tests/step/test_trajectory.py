"""Trajectories know what they are of: worlds picked out, tables, files, measures, checkpoints."""

import dataclasses
import json

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.results import contact_impulse
from slcp_warp.storage.archive import write_archive

SCENE = slcp.scenes.push_block()
N = 30
ALL = ("controls", "impulse", "gap")


@pytest.fixture(scope="module")
def sim():
    return slcp.Simulator(SCENE, device="cpu")


@pytest.fixture(scope="module")
def start():
    """Three worlds: as the scene begins, with a faster pusher, and with a block that is apart."""
    return np.stack([SCENE.x0, SCENE.state({"pusher.vshift": 3.0}), SCENE.state({"block.x": 1.0})])


@pytest.fixture(scope="module")
def run(sim, start):
    params = sim.params.replace(mass=np.array([[0.5, 1.0], [0.6, 1.1], [0.7, 1.2]]))
    controls = np.random.default_rng(0).normal(size=(3, N, 1))
    return sim.rollout(start, controls, params, record=ALL)


def test_it_knows_what_it_is_of(sim, run):
    assert run.scene is sim.scene and run.options == sim.options and run.step_size == SCENE.step_size
    np.testing.assert_array_equal(run.params["mass"][2], [0.7, 1.2])
    np.testing.assert_allclose(run.times, SCENE.step_size * np.arange(N + 1))
    slow = dataclasses.replace(
        run,
        simulated=dataclasses.replace(
            run.simulated, parameters=run.params.replace(step_size=[0.01, 0.02, 0.03])
        ),
    )
    np.testing.assert_allclose(slow.times[:, -1], [0.01 * N, 0.02 * N, 0.03 * N])


def test_worlds_are_picked_out_with_their_parameters(run):
    assert len(run) == 3 and len(list(run)) == 3
    one = run[1]
    assert not one.batched and one.params.worlds is None and one.params["mass"].tolist() == [0.6, 1.1]
    np.testing.assert_array_equal(one.states, run.states[1])
    np.testing.assert_array_equal(one.gap, run.gap[1])
    for which in (slice(1, None), [1, 2], np.array([False, True, True]), [-2, -1]):
        some = run[which]
        np.testing.assert_array_equal(some.states, run.states[1:])
        np.testing.assert_array_equal(some.params["mass"], run.params["mass"][1:])
    for wrong in ("block", 0.5, True, [[0]], [True, False]):
        with pytest.raises(slcp.ArgumentError, match="worlds are"):
            run[wrong]
    with pytest.raises(IndexError, match="there are 3"):
        run[3]
    with pytest.raises(slcp.ArgumentError, match="one world"):
        one[0]


def test_worlds_of_warp_arrays_stay_warp_arrays(sim, start):
    run = sim.rollout(wp.array(start, dtype=wp.float64, device="cpu"), steps=N, controls=np.zeros((3, N, 1)))
    assert isinstance(run[1:].states, wp.array) and run[1:].states.shape == (2, N + 1, 8)
    assert run[0].states.shape == (N + 1, 8) and run[0].status.shape == (1,)
    np.testing.assert_array_equal(run[2].states.numpy(), run.recorded("states")[2])


def test_a_table_has_a_row_for_every_world_and_state(run):
    table = run.table()
    names = [*SCENE.state_names, *(f"control {n}" for n in SCENE.control_names)]
    names += [f"{kind} {row}" for kind in ("impulse", "gap") for row in SCENE.row_names]
    assert list(table) == ["world", "time", "status", *names]
    assert {each.shape for each in table.values()} == {(3 * (N + 1),)}
    at = 2 * (N + 1) + 7
    assert table["world"][at] == 2 and table["time"][at] == pytest.approx(7 * SCENE.step_size)
    assert table["block.x"][at] == run.states[2, 7, SCENE.state_index("block.x")]
    assert table["control pusher.shift"][at] == run.controls[2, 7, 0]
    last = f"gap {SCENE.row_names[-1]}"
    assert table[last][at] == run.gap[2, 7, -1] and np.isnan(table[last][N])
    assert list(dataclasses.replace(run, controls=None, impulse=None, gap=None).table())[-1] == "block.vangle"


def test_a_table_opens_in_pandas(run):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(run.table())
    ends = frame.groupby("world")["block.x"].last()
    np.testing.assert_array_equal(ends, run.states[:, -1, SCENE.state_index("block.x")])


def test_a_table_opens_in_pyarrow(run):
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table(run.table())
    assert table.num_rows == 3 * (N + 1) and "block.angle" in table.column_names


@pytest.mark.parametrize("record", [ALL, (), ("impulse",), "controls"])
@pytest.mark.parametrize("batched", [True, False])
def test_what_was_saved_is_loaded(tmp_path, run, record, batched):
    whole = run if batched else run[1]
    saved = dataclasses.replace(whole, **{n: None for n in ALL if n not in record}, header={"seed": 3})
    again = slcp.Trajectory.load(saved.save(tmp_path / "run.npz"))
    assert again.scene == SCENE and again.options == run.options and again.header == {"seed": 3}
    for name in ("states", "status", *ALL):
        found, expected = getattr(again, name), getattr(saved, name)
        assert (found is None) == (expected is None)
        if found is not None:
            np.testing.assert_array_equal(found, expected)
    for name in run.params.names:
        np.testing.assert_array_equal(again.params[name], saved.params[name])
    sim = slcp.Simulator(again.scene, again.options, device="cpu")
    if "controls" in record:
        twice = sim.rollout(saved.states[..., 0, :], again.controls, again.params)
        np.testing.assert_allclose(
            twice.states, again.states, rtol=0, atol=1e-11
        )  # other kernels round otherwise


def test_a_file_that_fits_itself_not_is_refused(tmp_path, run):
    path = run.save(tmp_path / "run.npz")
    with np.load(path) as archive:
        data = dict(archive)
    header = json.loads(str(data.pop("header")))
    write_archive(path, header, data | {"controls": data["controls"][:, 1:]})
    with pytest.raises(slcp.FileError, match="run.npz cannot be read as a trajectory: array 'controls'"):
        slcp.Trajectory.load(path)
    with pytest.raises(slcp.ArgumentError, match="ends in '.csv'; .npz is needed"):
        run.save(tmp_path / "run.csv")


def test_measures_of_a_trajectory(run):
    x = run.states[:, :, SCENE.state_index("block.x")]
    np.testing.assert_array_equal(run.measure(m.final("block.x")), x[:, -1])
    np.testing.assert_allclose(run.measure(m.mean(m.control(0))), run.controls[..., 0].mean(1), rtol=1e-12)
    pushes = contact_impulse(SCENE, run.impulse, run.params["friction"], run.options)[..., 0]
    np.testing.assert_allclose(run.measure(m.impulse()), pushes.sum((1, 2)), rtol=1e-12)
    np.testing.assert_array_equal(run.measure(m.lowest_gap("face/pusher")), run.gap[..., -1].min(1))
    success = (m.final("block.x") > 0.05) & (m.contact_share("face/pusher") < 1.0)
    np.testing.assert_array_equal(run.measure(success), x[:, -1] > 0.05)
    np.testing.assert_array_equal(run[1].measure(m.final("block.x")), x[1:2, -1])


def test_measures_of_what_was_not_recorded_are_refused(run):
    bare = dataclasses.replace(run, controls=None, impulse=None, gap=None)
    for measure, name in ((m.mean(m.control(0)), "controls"), (m.contact_share(), "impulse"),
                          (m.lowest_gap(), "gap")):  # fmt: skip
        with pytest.raises(slcp.ArgumentError, match=f"not recorded.*record='{name}'"):
            bare.measure(measure)
    with pytest.raises(slcp.ArgumentError, match="record='impulse'"):
        _ = bare.contact_impulse
    with pytest.raises(slcp.ArgumentTypeError, match="a measure of slcp_warp.measures"):
        run.measure("block.x")


def test_checkpoints_have_times_and_no_more(sim, start):
    run = sim.rollout(start, np.zeros((3, N, 1)), checkpoint=8)
    np.testing.assert_allclose(run.times, SCENE.step_size * np.array([0, 8, 16, 24, 30]))
    for wrong in (lambda: run.measure(m.final(0)), run.record):
        with pytest.raises(slcp.ArgumentError, match="checkpoints only"):
            wrong()
    assert run.table()["time"].tolist()[:5] == run.times.tolist()


def test_without_a_scene_it_says_so():
    with pytest.raises(slcp.ArgumentError, match="does not know its scene"):
        slcp.Trajectory(np.zeros((1, 3, 8)), np.zeros(1)).table()


def test_worlds_of_tensors_stay_tensors(tmp_path, sim, start):
    torch = pytest.importorskip("torch")
    controls = torch.ones((3, N, 1), dtype=torch.float64)
    run = sim.rollout(torch.tensor(start), controls, record=ALL)
    for which, worlds in (([0, 2], 2), (slice(1), 1), (np.array([True, False, True]), 2)):
        some = run[which]
        assert isinstance(some.gap, torch.Tensor) and len(some) == worlds
    assert run[1].states.shape == (N + 1, 8) and "3 SOLVED" in repr(run) and "block.x" in str(run[0])
    again = slcp.Trajectory.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.impulse, run.impulse.numpy())
    np.testing.assert_array_equal(again.measure(m.contact_share()), run.measure(m.contact_share()))


def test_controls_of_one_world_are_those_of_all(sim, start):
    us = np.random.default_rng(0).normal(size=(N, 1))
    one, all_three = sim.rollout(start, us, record="controls"), sim.rollout(start, np.tile(us, (3, 1, 1)))
    np.testing.assert_array_equal(one.states, all_three.states)
    np.testing.assert_array_equal(one.controls, np.tile(us, (3, 1, 1)))
    np.testing.assert_array_equal(sim.step(start, us[0]).state, sim.step(start, np.tile(us[0], (3, 1))).state)
    for given, kind in (
        (us[None], np.asarray),
        (us, lambda us: wp.array(us, dtype=sim.dtype, device="cpu")),
    ):
        with pytest.raises(slcp.InputError, match="controls is given for 1 worlds, the state for 3"):
            sim.rollout(start if kind is np.asarray else kind(start), kind(given))
