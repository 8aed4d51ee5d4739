"""The benchmarks' workload and MuJoCo's model of it: the scene's own mechanism, and legal states."""

import csv
import dataclasses

import numpy as np
import pytest

from slcp_warp import scenes
from slcp_warp.scripts.benchmarks.cost.chunks import bench_chunks
from slcp_warp.scripts.benchmarks.derivatives.jacobians import bench_differences
from slcp_warp.scripts.benchmarks.mechanics.scene import distance, mass_matrix
from slcp_warp.scripts.benchmarks.shared.timing import Case, tidy_rows, time_interleaved
from slcp_warp.scripts.benchmarks.shared.workload import legal_states, make_workload, windows
from slcp_warp.scripts.support.tables import write_csv

SCENE = scenes.flicking_finger()


def test_mass_matrix_of_the_finger():
    """Against the closed form of two links of length 1.6, the centre half way, and a free ellipse."""
    q = np.array([[-0.4, -0.9, 0.3], [-1.5, 0.0, 2.0]])
    m, i, half, length = SCENE.bodies[0].mass, SCENE.bodies[0].inertia, 0.8, 1.6
    c = np.cos(q[:, 1])
    expected = np.zeros((2, 3, 3))
    expected[:, 0, 0] = 2 * i + m * half**2 + m * (length**2 + half**2 + 2 * length * half * c)
    expected[:, 0, 1] = expected[:, 1, 0] = i + m * (half**2 + length * half * c)
    expected[:, 1, 1] = i + m * half**2
    expected[:, 2, 2] = SCENE.bodies[2].inertia
    np.testing.assert_allclose(mass_matrix(SCENE, q), expected, rtol=1e-14, atol=1e-14)


def test_distance_of_aligned_ellipses():
    """The finger hangs straight down to y = -3.2 over an ellipse at y = -5 that lies or stands."""
    low = dataclasses.replace(SCENE.bodies[2], anchor=(0.0, -5.0))
    scene = dataclasses.replace(SCENE, bodies=(*SCENE.bodies[:2], low))
    q = np.array([[-np.pi / 2, 0.0, 0.0], [-np.pi / 2, 0.0, np.pi / 2]])
    np.testing.assert_allclose(distance(scene, q), [5.0 - 0.5 - 3.2, 5.0 - 0.7 - 3.2], atol=1e-12)


def test_distance_of_deep_overlap_is_the_shortest_way_out():
    """Against a dense search over normals of the defining maximum."""
    q = np.array([[-np.pi / 2, 0.0, 0.3]])
    alpha = np.linspace(0.0, 2.0 * np.pi, 200001)
    down = np.array([0.0, -3.0 + 2.4])
    tip = np.hypot(0.8 * np.sin(alpha), 0.25 * np.cos(alpha))
    free = np.hypot(0.7 * np.cos(alpha - 0.3), 0.5 * np.sin(alpha - 0.3))
    dense = (np.sin(alpha) * down[1] - tip - free).max()
    np.testing.assert_allclose(distance(SCENE, q), dense, atol=1e-8)


def test_legal_states_are_inside_limits_and_apart():
    x = legal_states(SCENE, 500, np.random.default_rng(3))
    assert x.shape == (500, 6)
    assert (distance(SCENE, x[:, :3]) > 0.0).all()
    for j in (0, 1):
        body = SCENE.bodies[j]
        assert (x[:, j] >= body.lower).all() and (x[:, j] <= body.upper).all()


def test_workload_is_reproducible():
    first, second = (make_workload(SCENE, 8, 5, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.x0, second.x0)
    np.testing.assert_array_equal(first.controls, second.controls)


def test_mujoco_model_has_the_scenes_masses_and_distances():
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco_model import Peer

    q = legal_states(SCENE, 200, np.random.default_rng(0))[:, :3]
    peer = Peer(SCENE, ccd_tolerance="1e-12")  # its distance is iterative
    deviation = peer.deviation(q)
    assert deviation.mass_matrix < 1e-13
    assert deviation.distance < 1e-12
    model = peer.model
    np.testing.assert_array_equal(model.dof_damping.ravel()[:3], [0.2, 0.2, 0.7])
    np.testing.assert_array_equal(model.opt.gravity, [0.0, -4.0, 0.0])
    np.testing.assert_array_equal(model.jnt_range[:2], [[b.lower, b.upper] for b in SCENE.bodies[:2]])
    assert model.jnt_limited.tolist() == [1, 1, 0] and model.opt.timestep == SCENE.step_size


def test_mujoco_falls_like_the_scene():
    """Away from contact and limits, without damping: both conserve energy to the order of a short step."""
    pytest.importorskip("mujoco")
    from slcp_warp.scripts.benchmarks.peers.mujoco_model import Peer
    from slcp_warp.scripts.benchmarks.shared.workload import Workload

    bodies = tuple(dataclasses.replace(b, damping=0.0) for b in SCENE.bodies)
    scene = dataclasses.replace(SCENE, bodies=bodies, step_size=1e-4)
    x0 = np.array([[-0.3, -0.3, 0.4, 0.0, 0.0, 0.0]])
    states = Peer(scene).rollout(Workload(x0, np.zeros((1, 3000, 2))))[0]
    q, v = states[-1, :3], states[-1, 3:]
    mass, half = SCENE.bodies[0].mass, 0.8

    def height(q):
        """Of the links' centres, summed."""
        return 3 * half * np.sin(q[0]) + half * np.sin(q[0] + q[1])

    kinetic = 0.5 * v @ mass_matrix(scene, q[None])[0] @ v
    lost = mass * 4.0 * (height(x0[0]) - height(q))
    assert lost > 0.1
    np.testing.assert_allclose(kinetic, lost, rtol=2e-3)


def test_windows_are_whole_stretches():
    states = np.arange(2 * 7)[:, None].reshape(2, 7, 1)
    controls = 100 + np.arange(2 * 6).reshape(2, 6, 1)
    chosen = np.array([[1, 1, 1, 0, 1, 1], [0, 1, 1, 1, 0, 0]], bool)
    cut = windows(states, controls, chosen, 2)
    assert cut.x0.ravel().tolist() == [0, 4, 9]
    assert cut.controls[..., 0].tolist() == [[100, 101], [104, 105], [108, 109]]
    assert cut.steps == 6
    with pytest.raises(ValueError, match="no stretch of 4"):
        windows(states, controls, chosen, 4)


def test_interleaved_times_and_ratios(tmp_path):
    """With a clock that only the cases move: times per item, overhead taken off, ratios within a round."""
    now = [0.0]

    def spend(seconds):
        def run():
            now[0] += seconds

        return run

    cases = [
        Case("slow", spend(8.0), 4),
        Case("fast", spend(3.0), 2, "slow", overhead=spend(2.0), facts={"a": 1}),
    ]
    slow, fast = time_interleaved(cases, 3, clock=lambda: now[0])
    np.testing.assert_allclose(slow.seconds, 2.0)
    np.testing.assert_allclose(fast.seconds, 0.5)
    np.testing.assert_allclose(fast.ratios, 4.0)
    write_csv(tmp_path / "new" / "bench.csv", tidy_rows("some", [slow, fast], "a clock"))
    with open(tmp_path / "new" / "bench.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [r["case"] for r in rows] == ["slow", "fast"]
    assert (float(rows[1]["seconds"]), float(rows[1]["ratio"]), rows[1]["a"], rows[0]["a"]) == (
        0.5,
        4.0,
        "1",
        "",
    )
    assert rows[0]["cpu"] and int(rows[0]["cores"]) >= 1 and rows[0]["warp-lang"]


@pytest.mark.slow
def test_commands_run_and_write_their_rows(tmp_path, monkeypatch):
    """Through the command line, on workloads far too small to time anything, float32 once."""
    pytest.importorskip("mujoco")
    typer_testing = pytest.importorskip("typer.testing")
    from slcp_warp.scripts.app import app
    from slcp_warp.scripts.benchmarks import cost

    small = ["--worlds", "60", "--steps", "40", "--repeats", "1"]
    both, wide = ("float32", "float64"), ("float64",)
    for command, options, dtypes, count in (
        ("step", small, wide, 6),
        ("jacobian", small, wide, 4),
        ("threads", small, both, 4),
        ("ddp", ["--repeats", "1"], wide, 4),
    ):
        monkeypatch.setattr(f"{cost.__name__}.{command}.DTYPES", dtypes)
        path = tmp_path / f"{command}.csv"
        result = typer_testing.CliRunner().invoke(app, ["bench", command, *options, "--csv", str(path)])
        assert result.exit_code == 0, result.output
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == count
        assert all(float(row["items"]) > 0 for row in rows)


@pytest.mark.slow
def test_chunks_are_timed_in_this_process_and_in_workers():
    pytest.importorskip("pyarrow")
    rows = bench_chunks((64, 128), count=2, workers=1)
    assert [row["rows"] for row in rows] == [64, 128] and rows[0]["kB"] < rows[1]["kB"]
    assert all(row["wall [ms]"] > 0.0 and row["check [ms]"] > 0.0 for row in rows)


@pytest.mark.slow
def test_differences_see_every_kind_of_state():
    """A third each penetrates, touches and is apart; derivatives are within 1e-6 of differences."""
    said = []
    rows = bench_differences(("particle",), ("rem-logistic",), 24, 3, said.append)
    assert [row["state"] for row in rows] == ["penetrating", "touching", "separated"]
    assert [row["states"] for row in rows] == [8, 8, 8]
    assert all(row["largest"] < 1e-6 and row["unsolved"] == 0 for row in rows)
    assert len(said) == 3
