"""Pictures of a run show its numbers; without the libraries there is one clear error."""

import subprocess
import sys

import numpy as np
import pytest

import slcp_warp as slcp

SCENE = slcp.scenes.push_block()
HIDDEN = """
import sys
sys.modules["matplotlib"] = None
import numpy as np
import slcp_warp as slcp
scene = slcp.scenes.push_block()
sim = slcp.Simulator(scene, device="cpu")
known = slcp.results.simulated.Simulated.of(sim)
run = slcp.Trajectory(np.zeros((1, 3, 8)), np.zeros(1, int), simulated=known)
for draw in (run.plot, lambda: run.animate("run.gif")):
    try:
        draw()
    except ImportError as error:
        assert "pip install 'slcp-warp[cli]'" in str(error), error
    else:
        raise AssertionError("no error")
"""


@pytest.fixture(scope="module")
def run():
    sim = slcp.Simulator(SCENE, device="cpu")
    return sim.rollout(np.tile(SCENE.x0, (2, 1)), np.ones((2, 30, 1)), record=("controls", "impulse", "gap"))


def test_a_plot_has_every_state_by_its_name(run):
    pytest.importorskip("matplotlib").use("Agg")
    import matplotlib.pyplot as plt

    style = plt.rcParams["axes.grid"]
    figure = run.plot(world=1)
    lines = {line.get_label(): line for ax in figure.axes for line in ax.lines}
    assert set(SCENE.state_names) <= lines.keys() and plt.rcParams["axes.grid"] == style
    np.testing.assert_array_equal(lines["block.x"].get_ydata(), run.states[1, :, 1])
    np.testing.assert_allclose(lines["block.x"].get_xdata(), run.times)
    np.testing.assert_allclose(lines["all pairs"].get_ydata()[:-1], run.contact_impulse[1, :, :, 0].sum(1))
    units = [ax.get_ylabel() for ax in figure.axes if ax.get_ylabel()]
    assert units == ["[m]", "[rad]", "[m/s]", "[rad/s]", "control", "impulse [N s]"]
    plt.close(figure)


def test_an_animation_has_a_picture_for_every_tenth_of_a_second(tmp_path, run):
    pytest.importorskip("matplotlib").use("Agg")
    image = pytest.importorskip("PIL.Image")
    with image.open(run.animate(tmp_path / "run.gif")) as gif:
        assert gif.n_frames == 3
        first = np.asarray(gif.convert("L"))
        gif.seek(2)
        assert (np.asarray(gif.convert("L")) != first).any()
    with image.open(run[0].animate(tmp_path / "end.gif", seconds=0.1, rate=20)) as gif:
        assert gif.n_frames == 2
    with pytest.raises(slcp.ArgumentError, match="ends in '.mp4'; .gif is needed"):
        run.animate(tmp_path / "run.mp4")
    with pytest.raises(slcp.ArgumentError, match="world is 2"):
        run.animate(tmp_path / "run.gif", world=2)


def test_without_the_libraries_there_is_one_clear_error():
    subprocess.run([sys.executable, "-c", HIDDEN], check=True)
