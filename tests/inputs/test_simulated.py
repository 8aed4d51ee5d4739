"""Files of results hold scene, options and parameters: drawn and read again without the scene's file."""

import json

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.results.simulated import Simulated
from slcp_warp.scripts.app import app
from slcp_warp.scripts.support.records import Record, RecordError, load_record
from slcp_warp.storage.archive import write_archive

PENDULUM = """
format = "slcp-scene"
version = 2
name = "{name}"
bodies = [{{ name = "rod", mass = 2.0, inertia = 0.3, com = [0.0, -1.5], damping = 0.25 }}]
initial_state = [0.4, 0.0]
"""


def call(*arguments):
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output + str(result.exception)
    return result.stdout


def simulated_file(folder, name):
    """A trajectory of a user's pendulum that is called like a named scene; its scene's file is gone."""
    scene = folder / f"{name}.toml"
    scene.write_text(PENDULUM.format(name=name))
    call("simulate", "--scene", scene, "--steps", 4, "--device", "cpu", "--set", "mass=3",
         "--out", folder / "run.npz")  # fmt: skip
    scene.unlink()
    return folder / "run.npz"


@pytest.mark.parametrize("name", ["mine", "hopper", "flicking_finger"])
def test_a_trajectory_draws_the_users_own_mechanism(tmp_path, name):
    path = simulated_file(tmp_path, name)
    record = load_record(path, "trajectory")
    assert record.scene.name == name and record.scene.nv == 1 and record.scene.bodies[0].mass == 2.0
    assert record.simulated.options == slcp.Options() and record.simulated.parameters["mass"] == [3.0]
    tip = Mechanism(record.scene, record.simulated.world(0)).links(record["states"][0, :1, :1])[0][0, 1]
    angle = record["states"][0, 0, 0]
    np.testing.assert_allclose(tip, [3.0 * np.sin(angle), -3.0 * np.cos(angle)])  # twice the com: a rod's tip
    call("chart", path, "--out", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"run.npz", "run_numbers.png", "run_frames.png", "run.gif"}


def test_scene_options_and_parameters_come_back_exactly(tmp_path):
    """Also where worlds differ, the noise is the state's, and a number is not of short decimals."""
    scene = slcp.scenes.particle()
    sim = slcp.Simulator(scene, slcp.Options(noise="state", deviation="scale", tolerance=1e-9), device="cpu")
    params = sim.params.replace(mass=[1.0 / 3.0, 2.0], velocity_covariance=[0.1, 0.7])
    nr, pairs = sim.nr, len(scene.structure.pairs)
    arrays = {"states": np.zeros((2, 3, sim.nx)), "controls": np.zeros((2, 2, sim.nu)),
              "impulse": np.zeros((2, 2, nr)), "contact_impulse": np.zeros((2, 2, pairs, 2)),
              "status": np.zeros(2, int)}  # fmt: skip
    Record("trajectory", arrays, Simulated.of(sim, params)).save(tmp_path / "run.npz")
    again = load_record(tmp_path / "run.npz", "trajectory").simulated
    assert again.scene == scene and again.scene.structure == sim.scene.structure
    assert again.options == sim.options
    for name in params.names:
        np.testing.assert_array_equal(again.parameters[name], params[name])
    np.testing.assert_array_equal(again.world(1)["mass"], [2.0])


def as_older(path, **changes):
    """The file as version 1 wrote it: the name of the scene only."""
    with np.load(path) as archive:
        data = dict(archive)
    header = json.loads(str(data.pop("header")))
    scaling = header.pop("options")["scaling"]
    del header["scene_file"]
    write_archive(path, header | {"version": 1, "scaling": scaling} | changes, data)


def test_older_files_of_named_scenes_are_read_and_others_refused(tmp_path):
    call("simulate", "--scene", "ball_drop", "--steps", 2, "--device", "cpu", "--out", tmp_path / "run.npz")
    new = load_record(tmp_path / "run.npz", "trajectory")
    as_older(tmp_path / "run.npz")
    old = load_record(tmp_path / "run.npz", "trajectory")
    assert old.scene == new.scene and old.simulated.options.scaling == new.simulated.options.scaling
    with np.load(tmp_path / "run.npz") as archive:
        data = dict(archive)
    header = json.loads(str(data.pop("header")))
    for name, message in (("mine", "without its scene, 'mine'; make it again"), ("hopper", "param_|shape")):
        write_archive(tmp_path / "run.npz", header | {"scene": name}, data)
        with pytest.raises(RecordError, match=message) as caught:
            load_record(tmp_path / "run.npz", "trajectory")
        assert "run.npz" in str(caught.value)


def test_a_plan_for_another_mechanism_of_the_same_name_is_refused(tmp_path):
    call(
        "optimise",
        "--passes",
        1,
        "--horizon",
        5,
        "--starts",
        1,
        "--device",
        "cpu",
        "--out",
        tmp_path / "plan.npz",
    )
    scene = tmp_path / "s.toml"
    scene.write_text(PENDULUM.format(name="flicking_finger"))
    result = CliRunner().invoke(app, ["simulate", "--scene", str(scene), "--policy",
                                      str(tmp_path / "plan.npz"), "--device", "cpu",
                                      "--out", str(tmp_path / "x.npz")])  # fmt: skip
    assert result.exit_code == 2 and "was planned for scene" in result.stderr


def test_which_of_several_worlds_is_drawn_is_said(tmp_path):
    scene = slcp.scenes.ball_drop()
    sim = slcp.Simulator(scene, device="cpu")
    sim.rollout(np.tile(scene.x0, (3, 1)), np.zeros((3, 5, 0))).save(tmp_path / "run.npz")
    said = call("chart", tmp_path / "run.npz", "--world", 2, "--out", tmp_path)
    assert "run.npz has 3 worlds; world 2 is drawn, another by --world" in said.replace("\n", " ")
