"""The Kalman filter against textbook matrices, closed forms through contact, statistics of its errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

import slcp_warp as slcp
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.policies import Belief, KalmanFilter
from slcp_warp.scripts.studies.online import sensors

H, MASS = 0.05, 2.0
CART = slcp.Scene(
    "cart",
    bodies=(slcp.Body("cart", MASS, 0.01, joint="prismatic"),),
    actuators=(slcp.Actuator("cart"),),
    step_size=H,
)
BALL = slcp.Scene(  # on a vertical rail above a floor
    "ball on a rail",
    bodies=(slcp.Body("ball", 0.5, 0.01, joint="prismatic", axis=(0.0, 1.0)),),
    shapes=(slcp.Shape("ball", "ball", "disc", 0.1), slcp.Shape("floor", None, "halfplane", angle=np.pi / 2)),
    contacts=(slcp.Contact("ball", "floor"),),
    step_size=0.02,
)
SHUT = slcp.Scene(  # a slider between two walls; they shut where it is told that they overlap it
    "shut",
    bodies=(slcp.Body("slider", 1.0, 0.01, joint="prismatic"),),
    shapes=(
        slcp.Shape("disc", "slider", "disc", 0.1),
        slcp.Shape("left", None, "halfplane", offset=(-0.2, 0.0)),
        slcp.Shape("right", None, "halfplane", offset=(0.2, 0.0), angle=np.pi),
    ),
    contacts=(slcp.Contact("disc", "left"), slcp.Contact("disc", "right")),
    gravity=(0.0, 0.0),
    step_size=0.02,
)


def cart(**given):
    sim = slcp.Simulator(CART, slcp.Options(residual="hard"), device="cpu")
    return KalmanFilter(sim, **({"sensors": {"cart.shift": 0.02}, "process": 0.3} | given))


def strayed(process, h):
    """What white noise on the velocity, of this standard deviation in a second, has done after h."""
    return process**2 * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])


def test_without_contact_it_is_the_textbook_filter():
    rng, steps = np.random.default_rng(1), 30
    us, y = rng.normal(size=(steps, 1)), rng.normal(size=(3, steps + 1, 1))
    found = cart(start=(0.4, 0.7), x0=(0.1, -0.2)).estimate(y, us)
    A, B, C = np.array([[1.0, H], [0.0, 1.0]]), np.array([H * H, H]) / MASS, np.array([[1.0, 0.0]])
    m, P = np.tile([0.1, -0.2], (3, 1)), np.diag([0.16, 0.49])
    for k in range(steps + 1):
        if k:
            m, P = m @ A.T + B * us[k - 1], A @ P @ A.T + strayed(0.3, H)
        K = P @ C.T / (C @ P @ C.T + 0.02**2)
        m, P = m + (y[:, k] - m @ C.T) @ K.T, P - K @ C @ P
        np.testing.assert_allclose(found.mean[:, k], m, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.covariance[:, k], np.tile(P, (3, 1, 1)), rtol=0, atol=1e-12)
    assert not found.failures.any()


def test_steps_of_another_size_are_whole_ones():
    filter = cart(start=0.3)
    after = filter.predict(filter.begin(1), [2.0], 2.4 * H)  # two steps of 1.2 h
    h, A = 1.2 * H, np.array([[1.0, 1.2 * H], [0.0, 1.0]])
    P = np.eye(2) * 0.09
    for _ in range(2):
        P = A @ P @ A.T + strayed(0.3, h)
    np.testing.assert_allclose(after.mean[0], [3.0 * h * h * 2.0 / MASS, 2.0 * h * 2.0 / MASS], atol=1e-14)
    np.testing.assert_allclose(after.covariance[0], P, atol=1e-14)


def test_errors_are_as_large_as_it_says():
    """Runs of a cart with the noise that is believed: (x - m)' P^-1 (x - m) is chi-squared."""
    rng, worlds, steps = np.random.default_rng(5), 4000, 12
    filter = cart(start={"cart.shift": 0.1, "cart.vshift": 0.5})
    x = rng.normal(size=(worlds, 2)) * [0.1, 0.5]
    us, seen = rng.normal(size=(worlds, steps, 1)), []
    for k in range(steps + 1):
        if k:
            v = x[:, 1] + H * us[:, k - 1, 0] / MASS
            x = np.stack([x[:, 0] + H * v, v], axis=1)
            x += rng.normal(size=(worlds, 2)) @ np.linalg.cholesky(strayed(0.3, H)).T
        seen.append(x[:, :1] + 0.02 * rng.normal(size=(worlds, 1)))
    belief = filter.estimate(np.stack(seen, axis=1), us)
    off = x - belief.mean[:, -1]
    distance = np.einsum("bi,bij,bj->b", off, np.linalg.inv(belief.covariance[:, -1]), off)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 2 * worlds) / worlds
    assert low < distance.mean() < high


def test_what_is_pushed_flush_goes_on_by_the_step():
    """How a flush push divides is not unique under Coulomb's friction: steps are solved, without
    derivatives.
    """
    scene = slcp.scenes.push_block()
    sim = slcp.Simulator(scene, slcp.Options("hard", friction="coulomb"), device="cpu", dtype="float64")
    x = scene.state({"pusher.shift": 0.2, "pusher.vshift": 0.3, "block.vx": 0.3, "block.y": 0.1})
    mean, u = np.tile(x, (2, 1)), np.array([[9.0], [0.0]])
    linear, after = sim.linearize(mean, u), sim.step(mean, u)
    assert linear.status[0] != 0 and not after.status.any()
    filter = KalmanFilter(sim, {"block.x": 0.01}, 0.1, start=0.01)
    found = filter.predict(filter.begin(2)._replace(mean=mean), u)
    np.testing.assert_array_equal(found.mean, after.state)
    assert found.failures[0] == 1 and np.isfinite(found.covariance).all()


@pytest.mark.parametrize("height", [-0.01, 0.0, 0.004, 0.02])
def test_contact_is_as_soft_as_the_state_is_uncertain(height):
    """The mean through a frictionless contact is the mean of hard contact over what is believed of w."""
    h, sigma_q, sigma_v, rho = BALL.step_size, 0.003, 0.2, -0.4
    sim = slcp.Simulator(BALL, slcp.Options(residual="rem-normal", noise="state"), device="cpu")
    filter = KalmanFilter(sim, {"ball.shift": 0.01}, 0.0, start=1.0)
    assert "as soft as the state is uncertain" in repr(filter)
    cross = rho * sigma_q * sigma_v
    P = np.array([[sigma_q**2, cross], [cross, sigma_v**2]])
    mean = np.array([[0.1 + height, -0.5]])
    after = filter.predict(Belief(mean, P[None], np.zeros(1, int)), None)
    free = -0.5 - 9.81 * h
    w = free + height / h
    sigma = np.sqrt(sigma_v**2 + 2.0 * cross / h + sigma_q**2 / h**2 + 1e-12)  # and the floor of (M18)
    push = sigma * norm.pdf(w / sigma) - w * norm.cdf(-w / sigma)
    np.testing.assert_allclose(after.mean[0, 1], free + push, rtol=1e-9)
    np.testing.assert_allclose(after.mean[0, 0], mean[0, 0] + h * (free + push), rtol=1e-9)
    rng = np.random.default_rng(2)
    q, v = (mean + rng.normal(size=(200_000, 2)) @ np.linalg.cholesky(P).T).T
    hard = np.maximum(v - 9.81 * h, (0.1 - q) / h)
    assert abs(hard.mean() - after.mean[0, 1]) < 4.0 * hard.std() / np.sqrt(len(hard))


def test_the_covariance_goes_by_derivatives_through_contact():
    """Against differences of the step's mean, of a ball that is being pressed on; sure ones do not move."""
    sim = slcp.Simulator(BALL, slcp.Options(residual="hard"), device="cpu")
    filter = KalmanFilter(sim, {"ball.shift": 0.01}, 0.0, start=1.0)
    P = np.array([[1e-4, 2e-4], [2e-4, 0.04]])
    for x in ([0.1, -0.5], [0.3, -0.5]):
        eps = 1e-6 * np.concatenate([np.eye(2), -np.eye(2)])
        state = sim.step(np.array(x) + eps).state
        A = (state[:2] - state[2:]).T / 2e-6
        after = filter.predict(Belief(np.array([x]), P[None], np.zeros(1, int)), None)
        np.testing.assert_allclose(after.covariance[0], A @ P @ A.T, atol=1e-9)


def test_a_model_without_a_solution_goes_on_at_its_velocity():
    sim = slcp.Simulator(SHUT, slcp.Options(residual="hard"), device="cpu")
    params = sim.params.replace(shape_offset=np.array([[0.0, 0.0], [-0.05, 0.0], [0.05, 0.0]]))
    filter = KalmanFilter(sim, {"slider.shift": 0.01}, 0.5, start=0.1, params=params)
    shut, open_ = (sim.step([0.0, 0.3], params=p).status for p in (params, sim.params))
    assert shut != slcp.Status.SOLVED and open_ == slcp.Status.SOLVED
    belief = filter.begin(2)._replace(mean=np.array([[0.0, 0.3], [0.0, -0.1]]))
    after = filter.predict(filter.predict(belief, None), None)
    np.testing.assert_array_equal(after.failures, [2, 2])
    np.testing.assert_allclose(after.mean, [[0.3 * 0.04, 0.3], [-0.1 * 0.04, -0.1]], atol=1e-15)
    np.testing.assert_allclose(after.covariance[:, 1, 1], 0.01 + 0.25 * 0.04, atol=1e-15)


@pytest.mark.parametrize("options", [{"residual": "hard"}, {"residual": "rem-logistic"}])
def test_what_presses_is_seen_to_leave(options):
    """A ball that its model holds on the floor is lifted by what the model does not know of."""
    sim = slcp.Simulator(BALL, slcp.Options(**options), device="cpu")
    filter = KalmanFilter(sim, {"ball.shift": 0.003}, 1.0, start=0.05, x0=[0.1, 0.0])
    height = np.concatenate([np.full(10, 0.1), 0.1 + 0.02 * np.arange(41)])
    found = filter.estimate(height[None, :, None], np.zeros((50, 0)))
    assert abs(found.mean[0, 9, 0] - 0.1) < 0.01 and abs(found.mean[0, -1, 0] - 0.9) < 0.05
    assert found.mean[0, -1, 1] == pytest.approx(1.0, abs=0.3)


def test_angles_count_modulo_their_period():
    scene = replace(CART, bodies=(slcp.Body("wheel", 1.0, 0.5),), actuators=(slcp.Actuator("wheel"),),
                    period=(2.0 * np.pi,))  # fmt: skip
    sim = slcp.Simulator(scene, slcp.Options(residual="hard"), device="cpu")
    filter = KalmanFilter(sim, {"wheel.vangle": 0.1, "wheel.angle": 0.02}, 0.3, start=0.2, x0=(3.1, 0.0))
    near, far = (filter.correct(filter.begin(1), [[0.4, a]]) for a in (-3.12 + 2.0 * np.pi, -3.12))
    np.testing.assert_allclose(near.mean, far.mean, atol=1e-12)
    assert near.mean[0, 0] > 3.1
    turned = filter.correct(filter.begin(1), [[0.4 + 2.0 * np.pi, -3.12]])
    assert turned.mean[0, 1] > 3.0, "velocities have no period"


def test_one_sensor_that_was_not_read_leaves_the_others():
    both = cart(sensors={"cart.shift": 0.02, "cart.vshift": 0.1}, start=(0.4, 0.7))
    one = cart(start=(0.4, 0.7))
    found, expected = (
        each.correct(each.predict(each.begin(1), [0.0]), [seen])
        for each, seen in ((both, [0.3, np.nan]), (one, [0.3]))
    )
    np.testing.assert_allclose(found.mean, expected.mean, atol=1e-15)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-15)
    assert expected.mean[0, 1] > 0.0


def test_what_was_not_measured_teaches_nothing():
    filter = cart(start=0.3)
    belief = filter.correct(filter.begin(2), [[np.nan], [0.5]])
    np.testing.assert_array_equal(belief.mean[0], [0.0, 0.0])
    np.testing.assert_array_equal(belief.covariance[0], 0.09 * np.eye(2))
    assert belief.mean[1, 0] > 0.4


def test_the_study_compares_what_it_says():
    """Filters see the finger's speeds better than differences; errors are as large as they say."""
    rows = {row["estimate"]: row for row in sensors.accuracy(worlds=24, seed=3)}
    speeds = [name for name in rows["filter, hard"] if name.endswith("[rad/s]")]
    assert len(speeds) == 3 and rows["filter, hard"]["touching"] > 0.3
    for name, row in rows.items():
        if name.startswith("filter"):
            assert row["off by more than three deviations"] < 0.02
            assert all(row[speed] < 0.7 * rows["differences, 0 held"][speed] for speed in speeds)


def test_differences_are_those_of_what_was_measured():
    sim = slcp.Simulator(CART, slcp.Options(residual="hard"), device="cpu")
    y = np.array([[[0.3], [0.4], [0.45]]])
    found = sensors.Differences(sim, {"cart.shift": 0.01}, held=0.25).estimate(y, np.zeros((1, 2, 1)))
    np.testing.assert_allclose(found.mean[0, :, 0], y[0, :, 0])
    np.testing.assert_allclose(found.mean[0, :, 1], [0.0, 1.5, 0.25 * 1.5 + 0.75 * 1.0])


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        (
            {"sensors": {"cart.shift": 0.0}},
            ArgumentError,
            r"sensors\['cart.shift'\] is 0.0; a .*1e-50, 1e\+50",
        ),
        ({"process": 0.0}, ArgumentError, "process and start are both 0: what is sure learns nothing"),
        ({"start": 1e200}, ArgumentError, "start is 1e\\+200; a number from 0 to 1e\\+50"),
        ({"sensors": {"cart.speed": 0.1}}, ArgumentError, "cart.speed"),
        ({"sensors": ["cart.shift"]}, ArgumentTypeError, r"sensors is \['cart.shift'\]; a dict"),
        ({"sensors": {}}, ArgumentTypeError, "sensors is {}; a dict of numbers by state name is needed"),
        ({"process": -1.0}, ArgumentError, "process is -1.0; a number from 0"),
        ({"process": (1.0, 2.0, 3.0)}, ArgumentError, r"process is .*\(2,\) of them"),
        ({"process": {"cart.vshift": -1.0}}, ArgumentError, r"process\['cart.vshift'\] is -1.0"),
        ({"x0": (0.0,)}, ArgumentError, r"x0 has shape \(1,\); \(2,\) is needed"),
    ],
)
def test_errors_name_the_argument(given, error, text):
    with pytest.raises(error, match=text):
        cart(**given)


def test_shapes_of_records_are_checked():
    filter = cart()
    with pytest.raises(ArgumentError, match=r"measured has shape \(3, 1\)"):
        filter.estimate(np.zeros((3, 1)), np.zeros((2, 1)))
    with pytest.raises(ArgumentError, match=r"controls has shape \(1, 3, 1\); \(1, 2, 1\) is needed"):
        filter.estimate(np.zeros((1, 3, 1)), np.zeros((3, 1)))
    with pytest.raises(ArgumentError, match="params has rows of 1 worlds"):
        cart(params=filter.model.params.replace(mass=np.ones((1, 1))))
