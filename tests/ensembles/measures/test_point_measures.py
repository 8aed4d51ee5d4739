"""Measures of points of bodies: in sweeps, of recorded states, in files, and what is refused."""

import numpy as np
import pytest
from oracle import Oracle

import slcp_warp as slcp
from slcp_warp import measures
from slcp_warp.costs import Point, centre_of_mass

TIP, MARK, BALL = Point("fore", (0.4, 0.1)), Point(None, (0.3, 0.6)), Point("ball", (0.0, 0.05))
ARM = centre_of_mass("upper", "fore")


def task():
    """An arm of two links that swings beside a ball in flight."""
    scene = slcp.Scene(
        "swing",
        (slcp.Body("upper", 1.0, 0.05, com=(0.25, 0.0), damping=0.1),
         slcp.Body("fore", 0.5, 0.02, parent="upper", anchor=(0.5, 0.0), angle=0.3, com=(0.2, 0.0)),
         slcp.Body("ball", 0.2, 0.001, joint="free", anchor=(0.4, 0.3), angle=0.2)),
        step_size=0.02,
    )  # fmt: skip
    return slcp.Task(
        name="swing",
        scene=scene,
        duration=0.4,
        start={"upper.angle": 0.5, "fore.vangle": 2.0, "ball.vx": 1.0, "ball.vangle": 3.0},
        disturbances=slcp.Disturbances(velocity=0.5),
        measures={
            "height": measures.largest(measures.point(TIP, "y")),
            "ahead": measures.final(measures.point(TIP, "x", minus=BALL)),
            "rise": measures.change(measures.point(BALL, "y")),
            "nearest": measures.smallest(measures.distance(TIP, BALL)),
            "reach": measures.mean(measures.distance(TIP, MARK)),
            "middle": measures.largest(measures.point(ARM, "x", minus=centre_of_mass())),
        },
        success=measures.smallest(measures.distance(TIP, BALL)) < 0.3,
    )


def expected(scene, states):
    """The same from the oracle's frames, of worlds (B, N+1, nx)."""
    oracle, q = Oracle(scene), states[..., : scene.nv]
    tip, ball = oracle.point(q, 1, np.array(TIP.at)), oracle.point(q, 2, np.array(BALL.at))
    near = np.linalg.norm(tip - ball, axis=-1)
    mass, com = ([getattr(body, name) for body in scene.bodies] for name in ("mass", "com"))
    moments = [mass[b] * oracle.point(q, b, np.array(com[b])) for b in range(3)]
    middle = sum(moments[:2]) / sum(mass[:2]) - sum(moments) / sum(mass)
    return {
        "height": tip[..., 1].max(1), "ahead": (tip - ball)[:, -1, 0], "nearest": near.min(1),
        "rise": ball[:, -1, 1] - ball[:, 0, 1],
        "reach": np.linalg.norm(tip - MARK.at, axis=-1)[:, :-1].mean(1),
        "success": near.min(1) < 0.3, "middle": middle[..., 0].max(1),
    }  # fmt: skip


@pytest.mark.parametrize("strategy", ["specialised", "generic"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_sweeps_and_recorded_states_have_what_the_frames_say(strategy, dtype):
    own = task()
    starts = own.start + np.random.default_rng(0).normal(size=(12, own.scene.nv * 2))
    own = own.replace(start=starts)
    hard = slcp.Options("hard")
    report = slcp.sweep(own, None, worlds=1, cases=hard, dtype=dtype, strategy=strategy, device="cpu")
    rows = report.part(report.source.keys[0][0], arm="undisturbed")
    sim = slcp.Simulator(own.scene, hard, device="cpu", dtype=dtype, strategy=strategy)
    run = sim.rollout(starts, steps=own.steps)
    known = expected(own.scene, run.states.astype(float))
    assert 0 < known["success"].sum() < 12
    bound = 1e-12 if dtype == "float64" else 1e-5
    for name, what in own.measures.items():
        np.testing.assert_allclose(run.measure(what), known[name], rtol=0.0, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(rows[name], known[name], rtol=0.0, atol=bound, err_msg=name)
    np.testing.assert_array_equal(rows["success"], known["success"])
    np.testing.assert_array_equal(run.measure(own.success), known["success"])


def test_files_keep_them(tmp_path):
    path = tmp_path / "swing.json"
    slcp.save_task(task(), path)
    again = slcp.load_task(path)
    assert again.measures == task().measures and again.success == task().success
    assert "point(Point(body='fore'" in repr(again.measures["height"])


@pytest.mark.parametrize("make, message", [
    (lambda: measures.point("tip", "x"), "which of a point is 'tip'; a costs.Point"),
    (lambda: measures.point(TIP, "z"), "axis of a point is 'z'"),
    (lambda: measures.point(TIP, None), "axis of a point is None"),
    (lambda: measures.distance(TIP, "ball.x"), "minus of a distance is 'ball.x'"),
    (lambda: measures.distance(TIP, None), "minus of a distance is None"),
    (lambda: measures.state("ball.x", minus=TIP), "a name or a whole number"),
    (lambda: task().replace(measures={"a": measures.final(measures.point(Point("hand"), "x"))}),
     "Point.body is 'hand'"),
])  # fmt: skip
def test_what_is_no_point_is_refused(make, message):
    with pytest.raises(slcp.InputError, match=message):
        make()
