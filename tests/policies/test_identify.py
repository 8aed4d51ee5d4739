"""Numbers from logs against integrals over a grid, closed forms, and the laws that they are drawn by."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import slcp_warp as slcp
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.policies import KalmanFilter

H, MASS, NOISE = 0.05, 2.0, 0.02
CART = slcp.Scene(
    "cart",
    bodies=(
        slcp.Body("cart", MASS, 0.01, joint="prismatic"),
        slcp.Body("idle", 1.0, 0.01, joint="prismatic"),
    ),
    actuators=(slcp.Actuator("cart"),),
    step_size=H,
)
PUCK = slcp.Scene(  # slides on a floor; a rod keeps it from turning
    "puck",
    bodies=(
        slcp.Body("carriage", 1e-3, 1e-5, joint="prismatic", axis=(0.0, 1.0)),
        slcp.Body("puck", 0.5, 0.01, parent="carriage", joint="prismatic"),
    ),
    shapes=(slcp.Shape("puck", "puck", "disc", 0.1), slcp.Shape("floor", None, "halfplane", angle=np.pi / 2)),
    contacts=(slcp.Contact("puck", "floor", friction=0.5),),
    step_size=0.01,
)


def simulator(scene, **options):
    return slcp.Simulator(scene, slcp.Options("hard", **options), device="cpu", dtype="float64")


def cart(**given):
    return KalmanFilter(simulator(CART), **({"sensors": {"cart.shift": NOISE}, "process": 0.3} | given))


def carts(rng, mass, runs=3, steps=40, process=0.3, bias=0.0, noise=NOISE):
    """Logs of a cart by textbook formulas, with what white noise on its speed does."""
    strayed = process**2 * np.array([[H**3 / 3.0, H**2 / 2.0], [H**2 / 2.0, H]])
    root = np.linalg.cholesky(strayed + 1e-18 * np.eye(2))
    us = 20.0 * rng.normal(size=(runs, steps, 1))
    x, seen = np.zeros((runs, 2)), []
    for k in range(steps + 1):
        if k:
            v = x[:, 1] + H * us[:, k - 1, 0] / mass
            x = np.stack([x[:, 0] + H * v, v], axis=1) + rng.normal(size=(runs, 2)) @ root.T
        seen.append(x[:, :1] + bias + noise * rng.normal(size=(runs, 1)))
    return np.stack(seen, axis=1), us


def likelihood(mass, seen, us, process, noise=NOISE):
    """Minus its logarithm by the textbook filter, of a start that is known."""
    A, B = np.array([[1.0, H], [0.0, 1.0]]), np.array([H * H, H]) / mass
    Q = process**2 * np.array([[H**3 / 3.0, H**2 / 2.0], [H**2 / 2.0, H]])
    total = 0.0
    for y, u in zip(seen, us):
        m, P = np.zeros(2), np.zeros((2, 2))
        for k in range(len(y)):
            if k:
                m, P = A @ m + B * u[k - 1, 0], A @ P @ A.T + Q
            if not np.isfinite(y[k, 0]):
                continue
            S = P[0, 0] + noise**2
            off = y[k, 0] - m[0]
            total += 0.5 * (off**2 / S + np.log(S))
            m, P = m + P[:, 0] / S * off, P - np.outer(P[:, 0], P[0]) / S
    return total


def test_what_is_known_of_a_mass_is_the_integral_over_a_grid():
    rng = np.random.default_rng(3)
    seen, us = carts(rng, 2.9)
    seen[0, 5:20] = np.nan
    short = [seen[0], seen[1], seen[2][:25]]
    controls = [us[0], us[1], us[2][:24]]
    found = slcp.identify(cart(), short, controls, {"cart.mass": 0.5}, draws=16)
    z = np.linspace(-3.0, 3.0, 401)
    cost = np.array([likelihood(MASS * np.exp(0.5 * each), short, controls, 0.3) for each in z]) + 0.5 * z**2
    weight = np.exp(cost.min() - cost)
    mean = (weight * z).sum() / weight.sum()
    sd = np.sqrt((weight * (z - mean) ** 2).sum() / weight.sum())
    assert abs(found.z[0] - mean) < 0.1 * sd
    assert abs(found.covariance[0, 0] ** 0.5 / sd - 1.0) < 0.1
    value, low, high = found.values["cart.mass"]
    ends = found.z[0] + found.covariance[0, 0] ** 0.5 * norm.ppf([0.025, 0.975])
    np.testing.assert_allclose([low, high], MASS * np.exp(0.5 * ends))
    assert low < 2.9 < high and found.learned["cart.mass"] == found.covariance[0, 0] ** 0.5
    np.testing.assert_allclose(found.params["cart.mass"], value)
    np.testing.assert_allclose(found.minima["cost"][0], cost.min(), atol=1e-2)
    assert found.fit.seen == 3 * 41 - 15 - 16 and 0.8 < found.fit.rms < 1.2
    assert found.before.cost > found.fit.cost


def test_noise_and_bias_are_found_with_the_mass():
    rng = np.random.default_rng(8)
    seen, us = carts(rng, 1.5, runs=4, steps=150, process=0.12, bias=0.07, noise=0.05)
    found = slcp.identify(
        cart(), seen, us, {"cart.mass": 0.5}, bias={"cart.shift": 0.1}, sensor_noise=1.0, process_noise=1.0
    )
    truth = {"cart.mass": 1.5, "bias of cart.shift": 0.07, "noise of cart.shift": 0.05, "process": 0.4}
    assert found.values.keys() == truth.keys()
    for name, value in truth.items():
        mean, low, high = found.values[name]
        assert abs(np.log(value / mean)) < 1.5 * np.log(high / low), name  # three deviations
        assert found.learned[name] < 0.5, name
    filter = found.filter
    np.testing.assert_allclose(filter.bias, found.values["bias of cart.shift"][0])
    np.testing.assert_allclose(np.sqrt(filter.variance), found.values["noise of cart.shift"][0])
    np.testing.assert_allclose(np.sqrt(filter.process[2]), 0.3 * found.values["process"][0])
    assert not found.fit.told() and slcp.identify(cart(), seen, us, {"cart.mass": 0.5}).fit.told()


def test_first_states_are_found_for_every_log():
    rng = np.random.default_rng(5)
    seen, us = carts(rng, 2.0, process=0.0)
    starts = rng.normal(size=3), rng.normal(size=3)
    time = H * np.arange(41)
    seen += (starts[0][:, None] + starts[1][:, None] * time)[..., None]
    filter = cart(process=0.0, start={"cart.shift": 2.0, "cart.vshift": 2.0})
    found = slcp.identify(filter, seen, us, {"cart.mass": 0.5})
    assert np.abs(found.x0[:, 0] - starts[0]).max() < 4.0 * NOISE
    assert np.abs(found.x0[:, 2] - starts[1]).max() < 4.0 * NOISE
    mass, response, velocity = MASS * np.exp(0.5 * found.z[0]), np.zeros((3, 41)), np.zeros(3)
    for k in range(40):
        velocity = velocity + H * us[:, k, 0]
        response[:, k + 1] = response[:, k] + H * velocity
    information = np.eye(1)
    for each in response:  # what a log tells of (z, x0, v0), all linear but for z
        slope = np.stack([-0.5 * each / mass, 2.0 * np.ones(41), 2.0 * time], axis=1) / NOISE
        told = slope.T @ slope
        own = np.linalg.inv(told[1:, 1:] + np.eye(2))
        information += told[:1, :1] - told[:1, 1:] @ own @ told[1:, :1]
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-3)
    value, low, high = found.values["cart.mass"]
    assert low - (high - low) < 2.0 < high + (high - low) and high / low < 1.1
    assert abs(found.judge(seen[:, :20], us[:, :19]).rms - 1.0) < 0.2


def test_noise_of_many_short_logs_whose_starts_nobody_knows():
    """First states that are fitted leave too little for noise; neither result nor fit forgets it."""
    rng = np.random.default_rng(7)
    seen, us = carts(rng, 2.0, runs=60, steps=5, process=0.0)
    speed = rng.normal(size=(60, 1))
    seen += (rng.normal(size=(60, 1)) + speed * H * np.arange(6))[..., None]
    filter = cart(process=0.0, start={"cart.shift": 1.0, "cart.vshift": 1.0})
    found = slcp.identify(filter, seen, us, {"cart.mass": 0.3}, sensor_noise=1.0)
    value, low, high = found.values["noise of cart.shift"]
    assert low < NOISE < high and high / low < 1.3
    known = slcp.identify(filter, seen, us, {"cart.mass": 0.3})
    assert (
        abs(known.fit.rms - 1.0) < 0.12 and abs(known.fit.echo["cart.shift"]) < 0.2 and not known.fit.told()
    )
    judged = known.judge(seen[:30], us[:30])
    assert abs(judged.rms - 1.0) < 0.2 and not judged.told()


def test_an_echo_is_heard_between_what_was_read():
    """A force that the model lacks, every second time read; and a sensor that was read four times."""
    rng = np.random.default_rng(1)
    seen, us = carts(rng, 2.0, steps=120, process=0.0)
    push = 3.0 * np.sin(np.arange(120) / 8.0)[:, None]
    hidden = seen + (H**2 * np.cumsum(np.cumsum(np.vstack([[0.0], push]), axis=0), axis=0) / 2.0)
    hidden[:, 1::2] = np.nan
    filter = cart(process=0.0, start={"cart.vshift": 1e-3})
    found = slcp.identify(filter, hidden, us, {"cart.mass": 0.3}, draws=16)
    assert found.fit.echo["cart.shift"] > 0.7
    assert any("a deviation tells the next" in line for line in found.fit.told())
    seen[:, 4:] = np.nan
    quiet = slcp.identify(filter, seen[:1], us[:1], {"cart.mass": 0.3}, draws=16)
    assert quiet.fit.pairs["cart.shift"] == 3
    assert not any("a deviation tells the next" in line for line in quiet.fit.told())


def slides(rng, mu, runs=6, steps=60, noise=1e-3):
    """A puck that slides and stops, in closed form."""
    h, g = PUCK.step_size, 9.81
    speed = np.linspace(0.5, 2.0, runs)[:, None]
    time = np.minimum(h * np.arange(steps + 1), speed / (mu * g))
    x = speed * time - 0.5 * mu * g * time**2
    return x[..., None] + noise * rng.normal(size=(runs, steps + 1, 1)), speed[:, 0]


def test_friction_of_what_slides_and_stops():
    rng, mu = np.random.default_rng(2), 0.31
    seen, speed = slides(rng, mu)
    x0 = np.zeros((len(speed), 4))
    x0[:, 0], x0[:, 3] = 0.1, speed
    sim = simulator(PUCK, friction="coulomb")
    filter = KalmanFilter(sim, {"puck.shift": 1e-3}, process=0.01)
    law = {"friction": slcp.Uniform(0.05, 1.0, shared=True)}
    us = np.zeros((len(speed), seen.shape[1] - 1, 0))
    found = slcp.identify(filter, seen, us, law, process_noise=1.0, x0=x0)
    value, low, high = found.values["puck/floor.friction"]
    assert 0.5 * (high - low) < 0.01 and abs(value - mu) < 0.01
    after = found.parameters["friction"]
    assert "Anitescu" not in str(found)
    assert isinstance(after, slcp.Uniform) and after.shared is True and 0.05 < after.low < value < after.high
    sd = (high - low) / (2.0 * norm.ppf(0.975))
    np.testing.assert_allclose((after.high - after.low) / np.sqrt(12.0), sd, rtol=0.02)


def test_one_factor_of_several_stays_one():
    seen, us = carts(np.random.default_rng(4), 2.5)
    given = {"mass": slcp.UniformFactor(0.5, 2.0, shared=True)}
    found = slcp.identify(cart(), seen, us, given, draws=16)
    law = found.parameters["mass"]
    assert isinstance(law, slcp.UniformFactor) and law.shared is True and 0.5 < law.low < 1.25 < law.high
    scene = replace(CART, bodies=(replace(CART.bodies[0], damping=0.0), CART.bodies[1]))
    sim = simulator(scene)
    params = sim.params.replace(damping=0.5)
    filter = KalmanFilter(sim, {"cart.shift": NOISE}, 0.3, params=params)
    found = slcp.identify(filter, seen, us, {"cart.damping": 0.3}, draws=16, candidates=8, starts=1)
    (law,) = found.parameters.values()
    (value, _, _), left = next(iter(found.values.values())), next(iter(found.learned.values()))
    assert isinstance(law, slcp.Uniform)
    ends = value * (1.0 + 0.3 * left * np.sqrt(3.0) * np.array([-1.0, 1.0]))
    np.testing.assert_allclose([law.low, law.high], ends, rtol=1e-9)


def test_what_cannot_be_right_is_told():
    seen, us = carts(np.random.default_rng(4), 2.0)
    found = slcp.identify(cart(), seen, us, {"cart.mass": slcp.Uniform(4.0, 8.0)}, draws=16)
    assert any("at the end of what was possible before" in line for line in str(found).splitlines())
    assert not any("next to nothing" in line for line in str(found).splitlines())


@pytest.mark.full
def test_bounces_are_not_taken_for_noise():
    """Softened filters, which forget an impact, explain it by noise: there is a minimum from which they do
    not come back.
    """
    pair = {"restitution": 0.5}
    scene = slcp.Scene(
        "puck between walls",
        bodies=(slcp.Body("puck", 0.5, 0.01, joint="prismatic"),),
        shapes=(
            slcp.Shape("puck", "puck", "disc", 0.1),
            slcp.Shape("left", None, "halfplane", offset=(-0.6, 0.0)),
            slcp.Shape("right", None, "halfplane", offset=(0.6, 0.0), angle=np.pi),
        ),
        contacts=(slcp.Contact("puck", "left", **pair), slcp.Contact("puck", "right", **pair)),
        step_size=0.01,
    )
    sim, rng = simulator(scene), np.random.default_rng(50)
    truth = rng.uniform(0.2, 0.95)
    x0 = np.stack([rng.uniform(-0.3, 0.3, 4), rng.uniform(1.0, 2.5, 4) * rng.choice([-1, 1], 4)], axis=1)
    us = np.zeros((4, 80, 0))
    states = sim.rollout(x0, us, sim.params.replace(restitution=truth)).states
    seen = states[:, :, :1] + 0.003 * rng.normal(size=(4, 81, 1))
    filter = KalmanFilter(sim, {"puck.shift": 0.003}, 0.05, {"puck.shift": 0.01, "puck.vshift": 2.0})
    law, guess = {"restitution": slcp.Uniform(0.0, 1.0, shared=True)}, np.zeros((4, 2))
    guess[:, 0] = seen[:, 0, 0]
    found = slcp.identify(filter, seen, us, law, process_noise=1.0, x0=guess, candidates=16, starts=2)
    name = next(iter(found.values))
    assert name.endswith("restitution") and abs(found.values[name][0] - truth) < 0.02


def test_worlds_are_drawn_from_what_is_known_together():
    rng = np.random.default_rng(4)
    seen, us = carts(rng, 2.5)
    given = {"cart.mass, cart.inertia": 0.5, "idle.mass": slcp.LogNormal(0.3, median=2.0)}
    found = slcp.identify(cart(), seen, us, given, draws=16)
    assert any("next to nothing of: idle.mass" in line for line in str(found).splitlines())
    drawn = found.draw(4000, seed=1)
    z = np.stack([np.log(drawn["cart.mass"] / MASS) / 0.5, np.log(drawn["idle.mass"] / 2.0) / 0.3], axis=1)
    np.testing.assert_allclose(z.mean(0), found.z, atol=0.08 * found.covariance.diagonal().max() ** 0.5)
    np.testing.assert_allclose(np.cov(z.T), found.covariance, atol=0.08 * found.covariance.max())
    np.testing.assert_allclose(drawn["cart.inertia"] / 0.01, drawn["cart.mass"] / MASS)
    task = slcp.Task(
        "cart", CART, slcp.costs.terms(CART, [slcp.costs.effort(1.0)]), horizon=5,
        disturbances=slcp.Disturbances(parameters={"gravity": 0.1, "cart.damping": 0.2}, velocity=0.1),
    )  # fmt: skip
    worlds, plain = found.worlds(task, 50, seed=1), slcp.draw_worlds(task, 50, seed=1, dtype="float64")
    own, other = found.params.from_table(worlds.params), found.params.from_table(plain.params)
    np.testing.assert_array_equal(own["gravity"], other["gravity"])
    np.testing.assert_array_equal(worlds.x0, plain.x0)
    np.testing.assert_array_equal(own["cart.mass"], found.draw(50, seed=1)["cart.mass"])
    law = found.parameters
    np.testing.assert_allclose(law["cart.mass, cart.inertia"].median * MASS, found.values["cart.mass"][0])
    np.testing.assert_allclose(law["idle.mass"].sd, 0.3 * found.learned["idle.mass"])
    again = task.replace(disturbances=replace(task.disturbances, parameters=law))
    table = found.params.from_table(slcp.draw_worlds(again, 4000, dtype="float64").params)
    np.testing.assert_allclose(np.log(table["cart.mass"]).std(), 0.5 * found.learned["cart.mass"], rtol=0.05)


def test_what_logs_tell_together_is_drawn_together():
    """A force through an unknown gear on an unknown mass: their quotient is seen, neither of them."""
    seen, us = carts(np.random.default_rng(6), 2.0)
    found = slcp.identify(cart(), seen, us, {"cart.mass": 0.4, "gear": 0.4})
    assert found.correlation[0, 1] > 0.99
    assert any("told together only" in line for line in str(found).splitlines())
    drawn = found.draw(500)
    quotient = np.ravel(drawn["gear"]) / np.ravel(drawn["cart.mass"])
    assert np.std(np.log(drawn["cart.mass"])) > 0.2 and np.std(np.log(quotient)) < 0.05


def test_what_does_not_fit_together_is_told():
    filter, (seen, us) = cart(), carts(np.random.default_rng(0), 2.0)
    law = {"cart.mass": 0.5}
    single = KalmanFilter(
        slcp.Simulator(CART, slcp.Options("hard"), device="cpu", dtype="float32"), {"cart.shift": 0.1}, 0.1
    )

    class Own(KalmanFilter):
        def predict(self, belief, u, seconds=None):
            return belief

    cases = [
        ((single, seen, us, law), {}, "float32"),
        ((filter, seen, us), {}, "leave nothing open"),
        ((filter, seen, us, {"wheel.mass": 0.5}), {}, "wheel"),
        ((filter, seen, us, {"step_size": 0.1}), {}, "step_size"),
        ((filter, seen[:, 1:], us, law), {}, "40 times and controls 40 steps of run 0"),
        ((filter, seen, us[:2], law), {}, "controls are of 2 runs, measured of 3"),
        ((filter, seen * np.nan, us, law), {}, "NaN only"),
        ((filter, seen, us * np.inf, law), {}, "run 0"),
        ((filter, seen, us, law), {"bias": {"idle.shift": 0.1}}, "bias"),
        ((filter, seen, us, law), {"sensor_noise": 2.5}, "sensor_noise is 2.5"),
        ((cart(process=0.0, start=1.0), seen, us, law), {"process_noise": 0.5}, "process is 0"),
        ((filter, seen, us, law), {"x0": np.zeros((2, 4))}, "x0 has shape"),
        ((filter, seen, us, law), {"candidates": 2}, "candidates is 2"),
    ]
    for given, more, said in cases:
        with pytest.raises(ArgumentError, match=said):
            slcp.identify(*given, **more)
    with pytest.raises(ArgumentTypeError, match="a Own with a predict of its own"):
        slcp.identify(Own(filter.model, {"cart.shift": 0.1}, 0.1), seen, us, law)
    found = slcp.identify(filter, seen, us, law, candidates=4, starts=1, rounds=0, draws=2)
    assert "more rounds= are needed" in str(found)
    with pytest.raises(ArgumentError, match="same mechanism"):
        found.worlds(slcp.tasks.cart_pole_walls(), 3)
