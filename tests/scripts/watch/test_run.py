"""A trajectory's file on the page: its states, sizes and times, and what is no picture of one mechanism."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.scripts.commands.watch import shown
from slcp_warp.scripts.watch.player import Player
from slcp_warp.scripts.watch.run import Run
from slcp_warp.storage.files import FileError

BALL = slcp.Scene(
    "ball",
    (slcp.Body("ball", 1.0, 0.01, joint="free"),),
    (slcp.Shape("floor", None, "halfplane", angle=np.pi / 2), slcp.Shape("ball", "ball", "disc", 0.1)),
    (slcp.Contact("floor", "ball"),),
)
H = 0.02


def fallen(path, worlds=2, radius=0.2, status=None, **more):
    sim = slcp.Simulator(BALL, slcp.Options("hard"), device="cpu", strategy="generic")
    x0 = np.zeros((worlds, 6))
    x0[:, 1] = 0.5 + np.arange(worlds)
    run = sim.rollout(x0, params=sim.params.replace(radius=radius, step_size=H), steps=12, **more)
    if status is not None:
        run.status[:] = status
    run.save(path)
    return run


def test_a_trajectory_is_shown_as_its_worlds_were(tmp_path):
    run = fallen(tmp_path / "fall.npz", radius=[[0.0, 0.0], [0.2, 0.2]])
    player = Player(shown(tmp_path / "fall.npz"))
    assert player.hello()["replay"] and player.worlds.variant == "hard"
    assert np.ravel(player.worlds.mechanism.params["radius"])[-1] == 0.2
    for k in range(12):
        player.tick()
        np.testing.assert_array_equal(player.worlds.state, run.states[:, k + 1])
    assert player.time == pytest.approx(12 * H)
    player.tick()
    np.testing.assert_array_equal(player.worlds.state, run.states[:, 1])  # from the beginning again


def test_one_of_worlds_with_numbers_of_their_own_is_shown(tmp_path):
    """As `slcp.replay` and a slice of it leave them: every number has an axis of worlds."""
    table = slcp.scenes.box_toss()
    task = slcp.Task("toss", table, duration=0.1, disturbances=slcp.Disturbances(parameters={"mass": 0.1}))
    run = slcp.replay(task, None, slcp.draw_worlds(task, 3), case=slcp.Options("hard"), device="cpu")
    run[1:2].save(tmp_path / "one.npz")
    run.save(tmp_path / "all.npz")
    for name, worlds in (("one", 1), ("all", 3)):
        player = Player(shown(tmp_path / f"{name}.npz"))
        player.tick()
        assert (
            player.worlds.state.shape == (worlds, 2 * table.nv)
            and len(player.picture(0.5)["poses"]) == worlds
        )


def test_a_world_that_failed_stands_still(tmp_path):
    run = fallen(tmp_path / "fall.npz")
    run.states[1, 5:] = np.nan
    run.status[1] = slcp.Status.INFEASIBLE
    run.save(tmp_path / "fall.npz")
    arrays = Run(tmp_path / "fall.npz").arrays
    np.testing.assert_array_equal(arrays["states"][4:, 1], np.tile(run.states[1, 4], (9, 1)))
    assert arrays["status"][:, 0].tolist() == [0] * 12
    assert arrays["status"][:, 1].tolist() == [0] * 4 + [slcp.Status.INFEASIBLE] * 8


def test_what_is_no_picture_of_one_mechanism_is_refused(tmp_path):
    path = tmp_path / "fall.npz"
    fallen(path, worlds=65)
    with pytest.raises(ValueError, match="65 worlds; at most 64"):
        shown(path)
    fallen(path, radius=np.array([[[0.0, 0.0], [0.1, 0.1]], [[0.0, 0.0], [0.2, 0.2]]]))
    with pytest.raises(ValueError, match="worlds that differ in radius"):
        shown(path)
    slcp.Trajectory.load(path)[1:].save(path)
    assert np.ravel(shown(path).parameters["radius"])[-1] == 0.2
    path.write_bytes(b"no archive")
    with pytest.raises(FileError, match="fall.npz"):
        shown(path)
