"""`slcp bench contacts`: scenes of many contacts, both sides' models of them, outcomes, rows, comparisons."""

import sys

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("mujoco")

import slcp_warp as slcp
from slcp_warp.scripts.benchmarks.contacts.cost import Plan, bench_contacts
from slcp_warp.scripts.benchmarks.contacts.side import outcome
from slcp_warp.scripts.benchmarks.contacts.table import compared
from slcp_warp.scripts.benchmarks.contacts.worlds import world
from slcp_warp.scripts.benchmarks.mechanics.scene import distance
from slcp_warp.scripts.benchmarks.peers.mujoco_model import Peer
from slcp_warp.scripts.benchmarks.shared.workload import Workload
from slcp_warp.scripts.support.tables import write_csv


def gaps(scene, q):
    return np.array([distance(scene, q, k) for k in range(len(scene.all_contacts))]).T


@pytest.mark.parametrize("name", ["stack:3", "heap:5", "discs:5", "gas:4", "beam:4", "walker", "hopper"])
def test_mujoco_has_the_masses_and_distances_of_every_scene(name):
    scene = world(name).scene
    rng = np.random.default_rng(0)
    q = np.asarray(scene.x0)[: scene.nv] + 0.02 * rng.uniform(-1.0, 1.0, (20, scene.nv))
    deviation = Peer(scene).deviation(q)
    assert deviation.mass_matrix < 1e-12 and deviation.distance < 1e-11
    assert scene.step_size == 0.01


@pytest.mark.parametrize("name", ["stack:3", "discs:10", "beam:8"])
def test_starts_touch_without_overlap_and_rest_in_mujoco(name):
    found = world(name)
    x = found.starts("rest", 1, 0)
    near = gaps(found.scene, x[:, : found.scene.nv])
    assert near.min() > -1e-12 and (near < 1e-12).sum() >= 2 * found.bodies
    for geoms in (None, *found.geoms.values()):
        end = Peer(found.scene, 1, None, (), geoms).rollout(Workload(x, np.zeros((1, 100, 0))))[0, -1]
        assert np.abs(end - x[0]).max() < 0.06


def test_tumbling_starts_are_unit_normal_velocities_at_the_same_places():
    found = world("stack:30")
    x = found.starts("tumbling", 40, 3)
    np.testing.assert_array_equal(x, found.starts("tumbling", 40, 3))
    np.testing.assert_array_equal(x[:, :90], found.starts("rest", 40, 3)[:, :90])
    assert abs(x[:, 90:].mean()) < 0.08 and abs(x[:, 90:].std() - 1.0) < 0.06


@pytest.mark.parametrize("name", ["stack", "stack:0", "stack:1e3", "pile:3", "walker:2", "disc:3"])
def test_a_name_that_is_none_is_said(name):
    with pytest.raises(
        ValueError, match=f"--scene is '{name}'; choose from stack:N, heap:N, discs:N, boxes:N, gas:N"
    ):
        world(name)


def test_a_failed_worlds_steps_are_counted_to_the_one_that_failed():
    states = np.zeros((3, 5, 4))
    states[0, :, 0] = [0.0, 1.0, 2.0, 3.0, 4.0]  # solved
    states[1, :, 0] = [0.0, 1.0, 2.0, 2.0, 2.0]  # the third of four steps failed
    states[2, :, 0] = 0.0  # solved, at rest
    status = np.array([slcp.Status.SOLVED, slcp.Status.JAMMED, slcp.Status.SOLVED])
    assert outcome(states, status) == {"made": 4 + 3 + 4, "unsolved": 1, "moved": 4.0, "statuses": "1 JAMMED"}


def test_both_versions_and_mujoco_take_turns_on_a_scene():
    shown = []
    plan = Plan(("tumbling",), ("hard",), ("float64",), worlds=2, repeats=2, other=sys.executable, seen=3)
    rows = bench_contacts([world("discs:1")], plan, shown.append, shown.extend)
    assert shown == rows
    assert [row["program"] for row in rows] == ["MuJoCo", "MuJoCo", "slcp-warp", "other"]
    for row in rows:
        assert row["repeats"] == 2 and 0.0 < row["seconds_p10"] <= row["seconds"] <= row["seconds_p90"]
        assert (row["scene"], row["motion"], row["bodies"], row["batch"]) == ("discs:1", "tumbling", 1, 2)
    ours, other = rows[2:]
    assert (
        ours["unsolved"] == 0
        and ours["seen"] == 3
        and ours["made"] == 3 * 75
        and ours["rows"] == 6
        and ours["moved"] > 0.01
    )
    assert {k: other[k] for k in ("made", "moved", "rows")} == {k: ours[k] for k in ("made", "moved", "rows")}
    fastest = min(rows[:2], key=lambda row: row["seconds"])
    assert ours["against"] == fastest["model"] and 0.0 < ours["ratio_p10"] <= ours["ratio_p90"]


def test_two_files_are_compared_in_units_of_mujocos_time(tmp_path):
    row = {"scene": "stack:3", "motion": "rest", "program": "slcp-warp", "law": "hard", "model": "",
           "dtype": "float64", "unsolved": 1, "seen": 4}  # fmt: skip
    peer = row | {"program": "MuJoCo", "law": "", "model": "boxes", "ratio": "", "seconds": 6e-6}
    write_csv(tmp_path / "old.csv", [peer, row | {"seconds": 12e-6, "ratio": 0.5}])
    again = [row | {"law": "smoothed", "seconds": 1e-6, "ratio": 9.0}, peer]
    write_csv(tmp_path / "new.csv", [*again, row | {"seconds": 6e-6, "ratio": 2.0, "unsolved": 0}])
    (found,) = compared(tmp_path / "old.csv", tmp_path / "new.csv")
    assert (found["old"], found["new"], found["faster"]) == (12e-6, 6e-6, 4.0)  # the machine was slower, too
    assert (found["unsolved_old"], found["unsolved_new"]) == ("1 of 4", "0 of 4")
