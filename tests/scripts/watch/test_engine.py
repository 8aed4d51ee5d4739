"""What a watcher does to the mechanism: the spring of the mouse, knobs, policies, records."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import slcp_warp as slcp
from slcp_warp.description.kinematics import turn
from slcp_warp.results.pictures.contacts import contact_points
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.scripts.commands.watch import watched
from slcp_warp.scripts.watch.engine import Engine
from slcp_warp.scripts.watch.messages import parsed
from slcp_warp.scripts.watch.player import Player
from slcp_warp.scripts.watch.pull import PROBE, catch
from slcp_warp.scripts.watch.record import Replay
from slcp_warp.scripts.watch.scenario import buttons_of
from slcp_warp.scripts.watch.world import Subject, Worlds
from slcp_warp.stepping.acting import acting
from slcp_warp.storage.files import FileError

ELLIPSE = [0.2, -3.05]  # a point of the free ellipse at the start
ME, OTHER = 1, 2


def finger_engine(tmp_path=None, worlds=1, **more):
    return Engine(watched("flicking_finger", worlds, 0), folder=tmp_path, **more)


def stepped(engine, steps):
    for _ in range(steps):
        engine.advance(engine.worlds.step_size)
    return engine


def grabbed(engine, target, at=ELLIPSE, client=ME):
    engine.send(client, {"do": "grab", "at": at, "world": 0})
    engine.send(client, {"do": "drag", "at": target})
    engine.advance(0.0)
    return engine


@pytest.mark.parametrize(
    ("stiffness", "target"),
    [(1.0, [0.9, -2.6]), (30.0, [0.25, -2.95])],
    ids=["as caught", "30 times as stiff"],
)
def test_the_spring_obeys_its_law_at_the_end_of_the_step(stiffness, target):
    """F = k (p* - p') - c (p' - p)/h, computed from the states alone; explicit it would diverge at 30 k."""
    engine = grabbed(finger_engine(), target)
    pull, mechanism = engine.pull, engine.worlds.mechanism
    pull.stiffness *= stiffness
    pull.most = np.inf
    assert pull.stiffness * engine.worlds.step_size**2 > (0.3 if stiffness == 1.0 else 8.0)
    for _ in range(60):
        before = pull.where(mechanism, engine.worlds.state[0, :3])
        engine.tick()
        after = pull.where(mechanism, engine.worlds.state[0, :3])
        law = pull.stiffness * (pull.target - after) - pull.damping * (after - before) / 0.05
        np.testing.assert_allclose(pull.force, law, atol=1.5 * PROBE * pull.stiffness)
    assert np.abs(engine.worlds.state[0, 3:]).max() < 0.05


def test_a_drag_turns_the_ellipse_and_a_release_lets_it_go():
    engine = stepped(grabbed(finger_engine(), [0.9, -2.2]), 8)
    assert engine.worlds.state[0, 2] > 0.4 + 0.2 and np.linalg.norm(engine.pull.force) > 0.1
    engine.send(ME, {"do": "release"})
    stepped(engine, 1)
    assert engine.pull is None and not engine.worlds.force.any()
    untouched = stepped(finger_engine(), 8)
    assert abs(untouched.worlds.state[0, 2] - 0.4) < 0.2


def test_only_who_grabbed_drags_and_lets_go():
    engine = grabbed(finger_engine(), [0.9, -2.2])
    engine.send(OTHER, {"do": "drag", "at": [5.0, 5.0]})
    engine.send(OTHER, {"do": "release"})
    engine.advance(0.0)
    np.testing.assert_array_equal(engine.pull.target, [0.9, -2.2])


def test_the_nearest_body_within_reach_is_caught():
    mechanism, q = finger_engine().worlds.mechanism, np.array([-0.3, -0.3, 0.4])
    assert catch(mechanism, q, np.array([0.0, -3.0]), 4.0).body == 2
    assert catch(mechanism, q, np.array([0.76, -0.24]), 4.0).body == 0
    assert catch(mechanism, q, np.array([3.0, 3.0]), 4.0) is None


def test_knobs_turn_the_scenes_numbers_and_refuse_what_is_outside():
    engine = finger_engine()
    own, gravity = (np.array(engine.worlds.params[name]) for name in ("sigma", "gravity"))
    for name, value in (("gravity", 0.5), ("sigma", 2.0), ("step_size", 0.02), ("friction", 0.0)):
        engine.send(ME, {"do": "set", "name": name, "value": value})
    engine.advance(0.0)
    params = engine.worlds.params
    np.testing.assert_allclose(params["gravity"], gravity / 2.0)
    np.testing.assert_allclose(params["sigma"], 2.0 * own)
    assert params["step_size"] == 0.02 and not params["friction"].any()
    engine.send(ME, {"do": "set", "name": "sigma", "value": 1e9})
    engine.send(ME, {"do": "set", "name": "mass", "value": 1.0})
    engine.advance(0.0)
    np.testing.assert_allclose(engine.worlds.params["sigma"], 2.0 * own)
    assert "mass" in engine.said


def test_time_follows_the_clock_and_drops_what_is_late():
    engine = finger_engine()
    made = [engine.advance(1.0 / 60.0) for _ in range(60)]
    assert abs(engine.time - 1.0) <= 0.05 + 1e-9 and max(made) == 1
    assert engine.advance(10.0) == 8  # a pause of the machine is not made up for
    assert engine.advance(0.0) <= 1
    engine.send(ME, {"do": "pause", "value": True})
    assert engine.advance(1.0) == 0
    engine.send(ME, {"do": "step"})
    before = engine.steps
    assert engine.advance(1.0) == 0 and engine.steps == before + 1
    for _ in range(900):
        engine.send(ME, {"do": "step"})
    engine.advance(0.0)
    assert engine.steps == before + 9


def test_a_policy_acts_as_in_a_rollout():
    """A library's kernel asked step by step gives the controls of one launch."""
    task = slcp.tasks.flicking_finger()
    sim = task.simulator()
    gains = np.random.default_rng(0).normal(0.0, 0.5, (2, 6))
    policy = slcp.policies.Linear(gains, task.start[0], np.zeros(2))
    engine = Engine(Subject.of(task), {"linear": policy})
    states = [engine.worlds.state[0]]
    for _ in range(20):
        engine.tick()
        states.append(engine.worlds.state[0])
    rolled = sim.rollout(task.start[0], policy=policy, steps=20)
    np.testing.assert_allclose(np.array(states), rolled.states, atol=1e-9)


def test_a_policy_that_fails_leaves_the_mechanism_without_control_and_is_named():
    def fails(x, time):
        if time > 0.2:
            raise RuntimeError("no more")
        return np.full((len(x), 2), 3.0)

    engine = stepped(finger_engine(policies={"mine": slcp.policies.Callback(fails)}), 3)
    assert (engine.controls == 3.0).all()
    stepped(engine, 4)
    assert not engine.controls.any() and engine.policy == "zero" and "no more" in engine.said
    limited = finger_engine(policies={"mine": slcp.policies.Callback(lambda x, t: np.full(2, 1e6))})
    limited.worlds.subject = Subject(**vars(limited.worlds.subject) | {"limits": (-4.0, 4.0)})
    assert (stepped(limited, 1).controls == 4.0).all()


def test_a_host_policy_is_asked_once_a_period():
    asked = []
    policy = slcp.policies.Callback(lambda x, time: asked.append(time) or np.zeros(2), period=0.2)
    sim = slcp.tasks.flicking_finger().simulator()
    held = acting(policy, sim, np.arange(1))
    for k in range(8):
        held.controls(np.zeros((1, 6)), k, 0.05 * k)
    np.testing.assert_allclose(asked, [0.0, 0.2])


@pytest.mark.parametrize("step_size", [0.012, 0.03, 0.09])
@pytest.mark.parametrize("period", [0.05, 0.15, 0.2])
def test_a_host_policy_is_asked_in_time_at_other_step_sizes(step_size, period):
    """Once in every period that a step begins in, by the clock of the scene's steps."""
    asked = []
    policy = slcp.policies.Callback(lambda x, time: asked.append(time) or np.zeros(2), period=period)
    engine = finger_engine(policies={"mine": policy})
    engine.send(ME, {"do": "set", "name": "step_size", "value": step_size})
    engine.advance(0.0)
    for _ in range(40):
        engine.tick()
    began = np.floor(np.floor(np.arange(40) * step_size / 0.05 + 0.5 + 1e-9) * 0.05 / period + 1e-9)
    assert len(asked) == len(np.unique(began)) and (np.diff(asked) > 0.0).all()
    np.testing.assert_array_equal(np.floor(np.array(asked) / period + 1e-6), np.unique(began))


def test_a_policy_that_cannot_begin_is_not_said_to_act():
    class Broken:
        def begin(self, sim, worlds):
            raise ValueError("not this mechanism")

        def act(self, x, time, worlds):
            return np.zeros(2)

    engine = finger_engine(
        policies={"broken": Broken(), "mine": slcp.policies.Callback(lambda x, t: x[:, :2])}
    )
    engine.send(ME, {"do": "policy", "name": "broken"})
    stepped(engine, 1)
    assert (engine.policy, engine.said) == ("mine", "not this mechanism")


def test_a_tasks_disturbances_are_buttons():
    """A kick changes velocities alone; a push is an impulse F t on what it acts on, whatever the step."""
    task = slcp.tasks.flicking_finger().replace(
        disturbances=slcp.Disturbances(
            kick_times=(1.0,), kicks={"ellipse.vangle": slcp.Normal(0.0, mean=0.5)},
            pushes=(slcp.Push("ellipse", 0.0, 0.12, torque=2.0),),
        )
    )  # fmt: skip
    engine = Engine(Subject.of(task), pushes=buttons_of(task))
    assert engine.hello()["pushes"] == ["kick", "push ellipse"]
    engine.worlds.state[0] = [-0.3, -0.3, 0.4, 0.0, 0.0, 0.0]  # apart from the finger
    engine.send(ME, {"do": "push", "name": "kick"})
    engine.advance(0.0)
    np.testing.assert_array_equal(engine.worlds.state[0, 3:], [0.0, 0.0, 0.5])
    engine.worlds.turn({"damping": 0.0, "gravity": 0.0})
    engine.send(ME, {"do": "push", "name": "push ellipse"})
    stepped(engine, 5)
    inertia = np.asarray(engine.worlds.params["inertia"])[2]
    assert engine.worlds.state[0, 5] == pytest.approx(0.5 + 2.0 * 0.12 / inertia, rel=1e-3)
    assert not engine.worlds.force.any()


def test_a_record_is_the_run_to_the_last_bit(tmp_path):
    engine = finger_engine(tmp_path, worlds=2)
    engine.send(ME, {"do": "record", "value": True})
    stepped(grabbed(engine, [0.9, -2.2]), 10)
    engine.send(ME, {"do": "variant", "name": "hard"})
    engine.send(ME, {"do": "set", "name": "step_size", "value": 0.02})
    stepped(engine, 10)
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    replay = Replay(tmp_path / "watch-000.npz")
    assert replay.arrays["states"].shape[1:] == (2, 6) and len(replay.arrays["controls"]) >= 20
    assert replay.arrays["forces"].any()
    alone = Worlds(Subject(*replay.task(), replay.arrays["states"][0]))  # it ended with another variant
    for worlds in (finger_engine(worlds=2).worlds, alone):
        np.testing.assert_array_equal(replay.again(worlds), replay.arrays["states"])
    player = Player(replay)
    player.tick()
    player.send(ME, {"do": "seek", "value": 1.0})
    player.advance(0.0)
    np.testing.assert_array_equal(player.worlds.state, replay.arrays["states"][-1])
    assert player.hello()["replay"] and not player.hello()["pushes"]


def test_a_controller_recovers_from_a_pull(tmp_path):
    """A balanced pole is dragged aside and let go; the recorded run, computed again, is the same."""
    task = slcp.tasks.cart_pole_walls()
    top = task.scene.state({"pole.angle": 0.0})
    top[:] = 0.0
    sim = task.simulator()
    linear = sim.linearize(top, np.zeros(1))
    P = scipy.linalg.solve_discrete_are(linear.A, linear.B, np.eye(4), np.eye(1))
    K = -np.linalg.solve(1.0 + linear.B.T @ P @ linear.B, linear.B.T @ P @ linear.A)
    balance = slcp.policies.Linear(K, top, np.zeros(1))
    subject = replace(Subject.of(task), start=top[None])
    engine = Engine(subject, {"balance": balance}, tmp_path)
    engine.send(ME, {"do": "record", "value": True})
    origin, angle = engine.worlds.mechanism.frames(top[None, :2])
    tip = origin[0, 1] + turn(angle[0, 1], 2.0 * engine.worlds.mechanism.params["com"][1])
    grabbed(engine, (tip + [0.15, 0.0]).tolist(), at=tip.tolist())
    pulled = []
    for _ in range(round(0.5 / engine.worlds.step_size)):
        engine.tick()
        pulled.append(abs(engine.worlds.state[0]).max())
    assert max(pulled) > 0.03 and np.linalg.norm(engine.pull.force) > 0.0
    engine.send(ME, {"do": "release"})
    engine.advance(0.0)
    for _ in range(round(8.0 / engine.worlds.step_size)):
        engine.tick()
    np.testing.assert_allclose(engine.worlds.state[0], 0.0, atol=1e-2)
    untouched = Engine(subject)
    untouched.worlds.state[0] = engine.worlds.state[0] + [0.0, 0.01, 0.0, 0.0]
    for _ in range(round(8.0 / engine.worlds.step_size)):
        untouched.tick()
    assert abs(untouched.worlds.state[0, 1]) > 0.5  # without the controller it falls
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    replay = Replay(tmp_path / "watch-000.npz")
    np.testing.assert_array_equal(replay.again(Engine(subject).worlds), replay.arrays["states"])


def test_a_damaged_record_is_one_error_with_its_name(tmp_path):
    engine = finger_engine(tmp_path)
    engine.send(ME, {"do": "record", "value": True})
    stepped(engine, 2)
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    path = tmp_path / "watch-000.npz"
    whole = path.read_bytes()
    for cut in (0, 10, len(whole) // 2, len(whole) - 5):
        path.write_bytes(whole[:cut])
        with pytest.raises(FileError, match="watch-000"):
            Replay(path)
    path.write_bytes(whole)
    with np.load(path) as archive:
        arrays = dict(archive)
    for name, value in (("forces", arrays["forces"][:1]), ("variant", arrays["variant"] + 7),
                        ("states", arrays["states"] * np.nan), ("status", arrays["status"] * np.nan),
                        ("states", arrays["states"][:, :0])):  # fmt: skip
        np.savez(path, **(arrays | {name: value}))
        with pytest.raises(FileError, match=name):
            Replay(path)


def test_contact_points_agree_with_the_distance_that_the_step_sees():
    """The gap along the normal through both support points is the first contact row's."""
    sim = slcp.tasks.flicking_finger().simulator()
    rng = np.random.default_rng(3)
    mechanism = Mechanism(sim.scene, {n: np.asarray(sim.params[n]) for n in sim.params.names})
    for _ in range(10):
        x = np.concatenate([rng.uniform([-1.5, -1.0, 0.0], [-0.3, 0.5, 3.0]), np.zeros(3)])
        gap = sim.step(x).gap[4]
        point, normal = (array[0] for array in contact_points(mechanism, x[:3], [0]))
        other = mechanism.shapes(x[None, :3])
        # the support point of the tip along the normal, by its outline, finely
        angles = np.linspace(0.0, 2.0 * np.pi, 200_001)
        radius = mechanism.params["radius"][sim.scene.structure.pairs[0].shape_a]
        local = np.stack([radius[0] * np.cos(angles), radius[1] * np.sin(angles)], 1)
        a, c, s = sim.scene.structure.pairs[0].shape_a, *(f(other[1][0]) for f in (np.cos, np.sin))
        outline = other[0][0, a] + local @ np.array([[c[a], s[a]], [-s[a], c[a]]])
        assert abs((normal @ point - (outline @ normal).max()) - gap) < 1e-5


def test_arrows_are_those_of_the_pairs_that_press():
    """Of thousands of pairs only these are looked at: a disc on the ground pushes it down."""
    scene = slcp.scenes.heap(10, width=2.0)
    engine = Engine(Subject("heap", scene, slcp.Options(residual="hard"), scene.x0[None]))
    engine.worlds.impulse[0, scene.pair_names.index("ground/disc3")] = (0.2, 0.05)
    (arrow,) = engine.picture(0.0)["arrows"][0]
    np.testing.assert_allclose(arrow, [scene.x0[scene.state_index("disc3.x")], 0.0, -5.0, 20.0], atol=1e-3)


def test_a_picture_of_every_scene_can_be_sent():
    for name, make in slcp.scenes.NAMED.items():
        engine = Engine(Subject(name, make(), slcp.Options(), make().x0[None]))
        picture = engine.picture(0.5)
        assert np.isfinite(np.array(picture["poses"])).all(), name
        left, right, bottom, top = picture["bounds"]
        assert left < right and bottom < top


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@pytest.mark.parametrize("far", [1.7e308, 1e200, -1e30, np.inf, np.nan])
def test_a_picture_of_any_numbers_is_one_that_the_page_reads(far):
    """JSON has no infinite numbers; afterwards the picture finds back to the mechanism."""
    engine = finger_engine()
    window = engine.picture(1.0)["bounds"]
    start = engine.worlds.state.copy()
    engine.worlds.state, engine.controls = start + far, engine.controls + far
    engine.worlds.impulse[:] = far
    json.dumps(engine.picture(1.0), allow_nan=False)
    engine.worlds.state = start
    engine.worlds.impulse[:] = 0.0
    np.testing.assert_allclose(engine.picture(1.0)["bounds"], window, atol=1e-3)


GOOD = '{"do": "grab", "at": [0, 1.5], "world": 0}'
BAD = [
    "", "{", "[]", "null", '"grab"', '{"do": "quit"}', '{"do": ["grab"]}', '{"do": "grab"}',
    '{"do": "grab", "at": [1], "world": 0}', '{"do": "grab", "at": [NaN, 1], "world": 0}',
    '{"do": "grab", "at": [1e300, 1], "world": 0}', '{"do": "grab", "at": [1, true], "world": 0}',
    '{"do": "grab", "at": [0, 1], "world": true}', '{"do": "set", "name": "sigma", "value": "1"}',
    '{"do": "set", "name": 3, "value": 1}', '{"do": "set", "name": "sigma", "value": Infinity}',
    '{"do": "set", "name": "sigma", "value": 1' + "0" * 400 + "}", '{"do": "pause", "value": 1}',
    '{"do": "set", "name": "sigma", "value": NaN}', '{"do": "release", "path": "x"}', "[" * 3000, "x" * 5000,
]  # fmt: skip


def test_only_the_pages_messages_pass():
    assert parsed(GOOD)["at"] == [0.0, 1.5]
    for text in itertools.chain(BAD, [b"{}"]):
        with pytest.raises(ValueError):
            parsed(text)
