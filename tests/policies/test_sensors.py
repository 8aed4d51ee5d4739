"""Sensors of points, of forces, of a function: geometry by hand, closed forms, Gaussian conditioning."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from test_identify import PUCK as FREE_PUCK
from test_kalman import BALL

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.costs import Point, centre_of_mass
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.policies import KalmanFilter, Sensor

H = 0.01
ARM = slcp.Scene(
    "arm",
    bodies=(
        slcp.Body("upper", 1.0, 0.02, com=(0.2, 0.0), anchor=(0.1, 0.3), angle=0.4),
        slcp.Body("fore", 0.8, 0.015, parent="upper", anchor=(0.4, 0.05), com=(0.15, 0.02)),
    ),
    actuators=(slcp.Actuator("upper"), slcp.Actuator("fore")),
    step_size=H,
)
PUCK = replace(FREE_PUCK, actuators=(slcp.Actuator("puck"),))
SPRUNG = slcp.Scene(
    "sprung",
    bodies=(slcp.Body("cart", 2.0, 0.01, joint="prismatic"),),
    tendons=(slcp.Tendon("spring", ("cart.shift",), (1.0,), stiffness=30.0, damping=4.0),),
    step_size=H,
)
LOAD = {"load": Sensor(m.normal_force("ball/floor"), 0.1)}
PULL = {"pull": Sensor(m.tendon_force("spring"), 0.1)}
TIP = Point("fore", (0.35, -0.1))
OF_ARM = {
    "tip x": Sensor(m.point(TIP, "x"), 0.002),
    "tip y": Sensor(m.point(TIP, "y", minus=Point("upper", (0.1, 0.0))), 0.003),
    "apart": Sensor(m.distance(TIP, Point(None, (1.0, -0.5))), 0.004),
    "mass": Sensor(m.point(centre_of_mass(), "x"), 0.01),
    "turned": Sensor(m.state("upper.angle") + 2.0 * m.state("fore.angle"), 0.01, period=2.0 * np.pi),
    "swing": Sensor(m.cosine("upper.angle") * m.state("fore.vangle"), 0.05),
    "own": Sensor(lambda x: np.sin(x[:, 0]) * x[:, 3] ** 2, 0.1),
    "fore.vangle": 0.2,
}


def simulator(scene, **options):
    return slcp.Simulator(scene, slcp.Options("hard", **options), device="cpu", dtype="float64")


def of_arm(**given):
    return KalmanFilter(simulator(ARM), **({"sensors": OF_ARM, "process": 0.1} | given))


def turned(angle, x, y):
    return np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=-1)


def by_hand(x, anchors=((0.1, 0.3), (0.4, 0.05)), lean=0.4, masses=(1.0, 0.8)):
    """What the sensors of the arm show, by trigonometry."""
    first = lean + x[:, 0]
    second = first + x[:, 1]
    (ax, ay), (bx, by) = anchors
    shoulder = np.stack([ax + 0.0 * first, ay + 0.0 * first], axis=-1)
    elbow = shoulder + turned(first, bx, by)
    tip = elbow + turned(second, 0.35, -0.1)
    centres = shoulder + turned(first, 0.2, 0.0), elbow + turned(second, 0.15, 0.02)
    mass = (masses[0] * centres[0] + masses[1] * centres[1]) / (masses[0] + masses[1])
    on_upper = shoulder + turned(first, 0.1, 0.0)
    return np.stack([
        tip[:, 0], (tip - on_upper)[:, 1], np.hypot(*(tip - [1.0, -0.5]).T), mass[:, 0],
        x[:, 0] + 2.0 * x[:, 1], np.cos(x[:, 0]) * x[:, 3], np.sin(x[:, 0]) * x[:, 3] ** 2, x[:, 3],
    ], axis=1)  # fmt: skip


def states(rng, count, scene=ARM):
    return rng.normal(size=(count, 2 * scene.nv))


def test_what_is_shown_and_its_slopes():
    x, sensing = states(np.random.default_rng(1), 20), of_arm().sensing
    assert sensing.names == tuple(OF_ARM)
    np.testing.assert_allclose(sensing.expected(x), by_hand(x), rtol=0, atol=1e-13)
    step = 1e-4 * np.eye(4)
    far = [
        (8.0 * (by_hand(x + e) - by_hand(x - e)) - by_hand(x + 2 * e) + by_hand(x - 2 * e)) / 12e-4
        for e in step
    ]
    np.testing.assert_allclose(sensing.slopes(x), np.stack(far, axis=2), rtol=0, atol=1e-8)


def test_points_are_by_the_numbers_of_each_world():
    """A mechanism that is looked for has lengths, angles and masses of its own."""
    rng, filter = np.random.default_rng(2), of_arm()
    x = states(rng, 3)
    anchors = rng.normal(size=(3, 2, 2))
    lean, masses = rng.normal(size=(3, 2)) * [1.0, 0.0], np.exp(rng.normal(size=(3, 2)))
    params = filter.params.replace(anchor=anchors, angle=lean, mass=masses)
    found = filter.sensing.expected(x, params)
    for b in range(3):
        own = by_hand(x[b : b + 1], anchors[b], lean[b, 0], masses[b])
        np.testing.assert_allclose(found[b], own[0], rtol=0, atol=1e-13)
    one = filter.params.replace(anchor=anchors[1], angle=lean[1], mass=masses[1])
    np.testing.assert_allclose(filter.sensing.expected(x, one)[1], found[1], rtol=0, atol=1e-13)


def test_errors_are_as_large_as_it_says():
    """Runs of the arm with the noise that is believed: (x - m)' P^-1 (x - m) is chi-squared."""
    rng, worlds, steps = np.random.default_rng(5), 3000, 20
    filter = of_arm(start=(0.02, 0.02, 0.1, 0.1), process=0.2, x0=(-0.9, 0.7, 0.5, -0.3))
    x = filter.x0 + rng.normal(size=(worlds, 4)) * [0.02, 0.02, 0.1, 0.1]
    strayed = 0.2**2 * np.block([
        [H**3 / 3.0 * np.eye(2), H**2 / 2.0 * np.eye(2)], [H**2 / 2.0 * np.eye(2), H * np.eye(2)]
    ])  # fmt: skip
    us, seen = rng.normal(size=(worlds, steps, 2)), []
    for k in range(steps + 1):
        if k:
            x = np.asarray(filter.model.step(x, us[:, k - 1]).state)
            x = x + rng.normal(size=x.shape) @ np.linalg.cholesky(strayed).T
        shown = by_hand(x) + np.sqrt(filter.variance) * rng.normal(size=(worlds, len(OF_ARM)))
        shown[:, 4] = np.mod(shown[:, 4], 2.0 * np.pi)
        shown[rng.uniform(size=shown.shape) < 0.3] = np.nan
        seen.append(shown)
    belief = filter.estimate(np.stack(seen, axis=1), us)
    off = x - belief.mean[:, -1]
    distance = np.einsum("bi,bij,bj->b", off, np.linalg.inv(belief.covariance[:, -1]), off)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 4 * worlds) / worlds
    assert 0.98 * low < distance.mean() < 1.02 * high  # sensors are not quite linear


def test_a_first_look_from_afar_finds_the_likeliest_state():
    """Angles believed to .3 rad, the tip seen to 2 mm: not the first line, but where a solver ends (M76)."""
    rng = np.random.default_rng(11)
    sensors = {name: OF_ARM[name] for name in ("tip x", "apart")}
    filter = of_arm(sensors=sensors, start=(0.3, 0.3, 0.0, 0.0), x0=(-0.5, 1.4, 0.0, 0.0))
    x = filter.x0 + [0.3, 0.3, 0.0, 0.0] * rng.normal(size=(50, 4))
    seen = by_hand(x)[:, [0, 2]] + [0.002, 0.004] * rng.normal(size=(50, 2))
    found = filter.correct(filter.begin(50), seen)

    def off(q, y):
        state = np.append(q, [0.0, 0.0])[None]
        return np.append((by_hand(state)[0, [0, 2]] - y) / [0.002, 0.004], (q - filter.x0[:2]) / 0.3)

    best = [least_squares(off, own, args=(y,)) for own, y in zip(x[:, :2], seen)]
    sd = np.sqrt([np.diag(np.linalg.inv(each.jac.T @ each.jac)) for each in best])
    near = np.abs(found.mean[:, :2] - [each.x for each in best]) < 0.2 * sd
    assert near.all(axis=1).mean() > 0.9
    told = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))[:, :2]
    assert (np.abs(told / sd - 1.0) < 0.1).all(axis=1).mean() > 0.9


def test_sensors_that_repeat_each_other_are_one():
    """Beyond rounding: what is believed is 1e12 times as uncertain as either encoder."""
    sensors = {"one": Sensor("upper.angle", 1e-3), "two": Sensor("upper.angle", 1e-3)}
    filter = of_arm(sensors=sensors, start=(1e9, 0.0, 0.0, 0.0), x0=(0.3, 0.0, 0.0, 0.0))
    told = filter.correct(filter.begin(1), [[0.5, 0.5]])
    assert told.mean[0, 0] == pytest.approx(0.5, abs=1e-6) and np.isfinite(told.covariance).all()


def test_a_world_is_corrected_by_itself():
    """How often others are looked at again changes nothing of a world, to the last bit."""
    rng = np.random.default_rng(13)
    filter = of_arm(start=(0.3, 0.3, 0.5, 0.5), x0=(-0.5, 1.4, 0.0, 0.0))
    sd = np.append(np.full(19, 1e-4), 0.4)  # one far from what is believed
    x = filter.x0 + sd[:, None] * rng.normal(size=(20, 4))
    seen, begun = by_hand(x), filter.begin(20)
    whole = filter.correct(begun, seen)
    part = filter.correct(filter.begin(3), seen[:3])
    np.testing.assert_array_equal(part.mean, whole.mean[:3])
    np.testing.assert_array_equal(part.covariance, whole.covariance[:3])


@pytest.mark.parametrize("place", [0.0, np.pi, -np.pi])
@pytest.mark.parametrize("shown", ["mod", "arctan2"])
def test_an_angle_that_is_shown_within_a_turn_has_slopes_at_its_ends(place, shown):
    of = {
        "mod": lambda x: np.mod(x[:, 0], 2.0 * np.pi),
        "arctan2": lambda x: np.arctan2(np.sin(x[:, 0]), np.cos(x[:, 0])),
    }
    sensors = {"a": Sensor(of[shown], 0.01, period=2.0 * np.pi)}
    told = of_arm(sensors=sensors, start=0.1, x0=(place, 0.0, 0.0, 0.0))
    plain = of_arm(sensors={"upper.angle": 0.01}, start=0.1, x0=(place, 0.0, 0.0, 0.0))
    after = told.correct(told.begin(1), of[shown](np.array([[place + 0.08, 0.0]]))[:, None])
    expected = plain.correct(plain.begin(1), [[place + 0.08]])
    np.testing.assert_allclose(after.mean, expected.mean, rtol=0, atol=1e-8)
    np.testing.assert_allclose(after.covariance, expected.covariance, rtol=0, atol=1e-8)


def test_a_function_that_gives_no_number_is_not_read():
    """Nor is one without slopes; others are, and a look that led where there is none is given up."""
    sensors = {"root": Sensor(lambda x: np.sqrt(x[:, 0]), 0.01), "upper.angle": 0.01}
    plain = of_arm(sensors={"upper.angle": 0.01}, start=0.1, x0=(-0.05, 0.0, 0.0, 0.0))
    for start, seen in ((-0.05, [np.nan, -0.05]), (-0.05, [0.3, -0.05]), (0.0, [0.3, -0.05])):
        filter = of_arm(sensors=sensors, start=0.1, x0=(start, 0.0, 0.0, 0.0))
        after = filter.correct(filter.begin(1), [seen])
        expected = plain.correct(filter.begin(1), [seen[1:]])
        np.testing.assert_allclose(after.mean, expected.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after.covariance, expected.covariance, rtol=0, atol=1e-12)
    filter = of_arm(sensors={"root": sensors["root"]}, start=0.1, x0=(0.04, 0.0, 0.0, 0.0))
    after = filter.correct(filter.begin(1), [[-0.2]])
    assert np.isfinite(after.mean).all() and np.isfinite(after.covariance).all()


def pressed(mean, covariance, process=0.0):
    """A ball on the floor, by the formulas of one contact: mean and covariance of (x', force)."""
    h, mass, g = BALL.step_size, 0.5, 9.81
    q, v = mean
    force = mass * -(v - g * h + (q - 0.1) / h) / h
    assert force > 0.0
    after = np.array([0.1, -(q - 0.1) / h])
    to_both = np.array([[0.0, 0.0], [-1.0 / h, 0.0], [-mass / h**2, -mass / h]])
    joint = to_both @ covariance @ to_both.T
    joint[:2, :2] += process**2 * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
    return np.append(after, force), joint


def test_a_force_is_foretold_with_the_state_after_its_step():
    mean, start = np.array([0.099, -0.1]), np.array([[4e-6, 3e-5], [3e-5, 9e-4]])
    sensors = {"load": Sensor(m.normal_force("ball/floor"), 0.3), "ball.shift": 0.002}
    filter = KalmanFilter(simulator(BALL), sensors, process=0.05, start=1.0)
    belief = filter.begin(1)._replace(mean=mean[None], covariance=start[None])
    after = filter.predict(belief, [])
    expected, joint = pressed(mean, start, 0.05)
    np.testing.assert_allclose(after.mean[0], expected[:2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(after.shown.mean[0], expected[2:], rtol=1e-9)
    np.testing.assert_allclose(after.shown.across[0], joint[:2, 2:], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(after.shown.covariance[0], joint[2:, 2:], rtol=1e-6)

    C = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    S = C @ joint @ C.T + np.diag([0.09, 4e-6])
    K = joint @ C.T @ np.linalg.inv(S)
    seen = np.array([6.0, 0.101])
    told = filter.correct(after, seen[None])
    np.testing.assert_allclose(told.mean[0], (expected + K @ (seen - C @ expected))[:2], rtol=0, atol=1e-8)
    left = joint - K @ C @ joint
    np.testing.assert_allclose(told.covariance[0], left[:2, :2], rtol=1e-5, atol=1e-11)
    nothing = filter.correct(after, [[np.nan, np.nan]])
    np.testing.assert_allclose(nothing.covariance, after.covariance, rtol=0, atol=1e-15)


def test_a_force_is_of_the_step_before():
    """At the start there is none, whatever a log holds there; a run's series is read a step later."""
    sim = simulator(BALL)
    run = sim.rollout(np.array([[0.11, 0.0]]), np.zeros((1, 30, 0)), record=("controls", "impulse"))
    force = run.series(m.normal_force("ball/floor"))
    np.testing.assert_allclose(force[:, :-1], run.impulse[:, :, 0] / BALL.step_size)
    np.testing.assert_array_equal(force[:, -1], force[:, -2])
    shown = np.concatenate([[[777.0]], force[:, :-1]], axis=1)[:, :, None]
    sensors = {"load": Sensor(m.normal_force("ball/floor"), 0.01)}
    filter = KalmanFilter(sim, sensors, process=0.01, start=0.0, x0=(0.11, 0.0))
    belief = filter.estimate(shown, np.zeros((30, 0)))
    np.testing.assert_allclose(belief.mean, run.states, rtol=0, atol=1e-9)
    assert not belief.failures.any()


def test_tendons_forces_and_their_sums():
    sim = simulator(SPRUNG)
    x0 = np.array([[0.2, -0.3]])
    run = sim.rollout(x0, np.zeros((1, 1, 0)), record=("controls", "impulse"))
    pull = run.series(m.tendon_force("spring"))[:, 0]
    both = 2.0 * m.tendon_force("spring") - m.state("cart.shift")
    filter = KalmanFilter(
        sim, {"pull": Sensor(m.tendon_force("spring"), 0.1), "both": Sensor(both, 0.1)}, 0.1
    )
    shown = filter.predict(filter.begin(1)._replace(mean=x0), []).shown
    np.testing.assert_allclose(shown.mean, np.stack([pull, 2.0 * pull - 0.2], axis=1), rtol=0, atol=1e-12)
    assert pull[0] == pytest.approx(-30.0 * 0.2 + 4.0 * 0.3, rel=0.1)


def test_a_step_that_is_not_solved_shows_no_force():
    """Its force is not read, and the state not moved by it."""
    scene = replace(
        BALL,
        shapes=(*BALL.shapes, slcp.Shape("lid", None, "halfplane", offset=(0.0, 0.1), angle=-np.pi / 2)),
        contacts=(*BALL.contacts, slcp.Contact("ball", "lid")),
    )
    sim = simulator(scene)
    filter = KalmanFilter(sim, {"load": Sensor(m.normal_force("ball/floor"), 0.1)}, 0.1, start=0.01)
    after = filter.predict(filter.begin(2)._replace(mean=np.array([[0.1, 0.0], [np.nan, 0.0]])), [])
    assert after.failures.all() and np.isnan(after.shown.mean).all()
    told = filter.correct(after, np.full((2, 1), 5.0))
    np.testing.assert_array_equal(told.mean, after.mean)


def test_a_length_is_found_from_where_the_tip_is():
    rng, sim = np.random.default_rng(4), simulator(ARM)
    truth = sim.params.replace(**{"fore.anchor": (0.43, 0.05)})
    us = 0.5 * rng.normal(size=(2, 60, 2))
    x0 = np.array([[-1.2, 0.6, 0.0, 0.0]])
    run = sim.rollout(np.repeat(x0, 2, axis=0), us, truth)
    true = np.stack([by_hand(run.states[:, k], ((0.1, 0.3), (0.43, 0.05))) for k in range(61)], axis=1)
    seen = true[:, :, [0, 2]] + 0.002 * rng.normal(size=(2, 61, 2))
    sensors = {name: Sensor(OF_ARM[name].of, 0.002) for name in ("tip x", "apart")}
    filter = KalmanFilter(sim, sensors, process=0.01, x0=x0[0])
    found = slcp.identify(filter, seen, us, {"fore.anchor_x": slcp.Normal(0.05)}, candidates=8, starts=2)
    value, low, high = found.values["fore.anchor_x"]
    assert low < 0.43 < high and high - low < 0.004
    assert found.filter.sensors == ("tip x", "apart") and 0.8 < found.fit.rms < 1.2


def test_what_is_felt_tells_what_is_pushed():
    """A push at one speed tells (u - mu m g) / m alone; felt friction and weight tell both apart."""
    rng, sim = np.random.default_rng(7), simulator(PUCK, friction="coulomb")
    truth = sim.params.replace(**{"puck.mass": 0.62, "puck/floor.friction": 0.37})
    x0, us = PUCK.state({"carriage.shift": 0.1, "puck.vshift": 0.2}), np.full((1, 50, 1), 3.0)
    run = sim.rollout(x0[None], us, truth, record=("controls", "impulse"))
    assert not run.status.any()
    felt = {"load": m.normal_force("puck/floor"), "rub": m.tangential_force("puck/floor")}
    shown = [run.states[:, :, 1]]
    shown += [np.concatenate([[[np.nan]], run.series(each)[:, :-1]], axis=1) for each in felt.values()]
    seen = np.stack(shown, axis=2) + [0.001, 0.1, 0.1] * rng.normal(size=(1, 51, 3))
    sensors = {"puck.shift": 0.001} | {name: Sensor(each, 0.1) for name, each in felt.items()}
    before = {"puck.mass": 0.5, "puck/floor.friction": slcp.Uniform(0.1, 0.9)}
    given = {"candidates": 16, "starts": 2, "draws": 32}
    blind = KalmanFilter(sim, {"puck.shift": 0.001}, 0.01, x0=x0)
    seeing = KalmanFilter(sim, sensors, 0.01, x0=x0)
    without = slcp.identify(blind, seen[:, :, :1], us, before, **given)
    found = slcp.identify(seeing, seen, us, before, **given)
    for name, true in (("puck.mass", 0.62), ("puck/floor.friction", 0.37)):
        value, low, high = found.values[name]
        assert low < true < high and value == pytest.approx(true, rel=0.03), name
        assert found.learned[name] < 0.25 * without.learned[name]
    assert without.correlation[0, 1] < -0.95 or without.correlation[0, 1] > 0.95


@pytest.mark.parametrize(
    "make, error, text",
    [
        (lambda: Sensor("upper.angle", 0.0), ArgumentError, r"Sensor.noise is 0.0; .*1e-50"),
        (lambda: Sensor("upper.angle", 0.1, every=-1.0), ArgumentError, "Sensor.every is -1.0"),
        (lambda: Sensor("upper.angle", 0.1, lost=1.5), ArgumentError, "Sensor.lost is 1.5"),
        (lambda: Sensor(3.0, 0.1), ArgumentTypeError, "Sensor.of is 3.0; a state's name, a signal of"),
        (lambda: Sensor(m.contact("a/b"), 0.1), ArgumentError, r"'a/b'\), with contact; a sensor is"),
        (lambda: Sensor(m.gap(), 0.1), ArgumentError, "with gap; a sensor is of"),
        (lambda: Sensor(m.since_start("upper.angle"), 0.1), ArgumentError, "with since_start; a sensor"),
        (lambda: of_arm(sensors={"x": Sensor("wrist", 0.1)}), ArgumentError, "Sensor.of is 'wrist'; "),
        (lambda: of_arm(sensors={"x": Sensor(m.state("wrist"), 0.1)}), ArgumentError, "wrist"),
        (lambda: of_arm(sensors={"x": Sensor(m.point(Point("wrist"), "x"), 0.1)}), ArgumentError, "'wrist'"),
        (lambda: of_arm(sensors={"x": Sensor(m.normal_force("a/b"), 0.1)}), ArgumentError, "'a/b'"),
        (lambda: of_arm(sensors={3: Sensor("upper.angle", 0.1)}), ArgumentTypeError, "has the name 3"),
        (lambda: of_arm(sensors={"x": Sensor(lambda x: x, 0.1)}), ArgumentError, r"gave shape \(2, 4\)"),
        (lambda: of_arm(sensors={"x": Sensor(lambda x: "far", 0.1)}), ArgumentError, "gave 'far' of states"),
        (lambda: of_arm(sensors={"x": Sensor(lambda x: x[:, 9], 0.1)}), ArgumentTypeError,
         "Sensor.of, a function, does not take states .*IndexError"),
        (lambda: of_arm(sensors={"x": Sensor(lambda x: np.float32(x[:, 0]), 0.1)}), ArgumentError,
         "gave float32"),
        (lambda: KalmanFilter(simulator(SPRUNG, integrator="trapezoidal"), PULL, 0.1),
         ArgumentError, "a sensor of tendon_force: the trapezoidal"),
        (lambda: of_arm(bias={"wrist": 0.1}), ArgumentError, "a name of bias is 'wrist'"),
        (lambda: KalmanFilter(slcp.Simulator(BALL, device="cpu", dtype="float32"), LOAD, 0.1),
         ArgumentError, "model is of float32, and sensors are of forces"),
    ],
)  # fmt: skip
def test_errors_name_what_came(make, error, text):
    with pytest.raises(error, match=text):
        make()
