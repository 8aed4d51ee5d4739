"""What moves bodies as one changes nothing between them: no rounding of large terms takes its place."""

import numpy as np

import slcp_warp as slcp

WORLDS = 60
STIFFNESS = np.tile(10.0 ** np.arange(3, 9), WORLDS // 6)[:, None]


def tree(integrator: str, dtype: str) -> slcp.Simulator:
    """A tree of three bodies and one of two, each on a hinge and with a spring inside."""
    bodies = (
        slcp.Body("a", 2.0, 0.3, com=(0.1, -0.2)),
        slcp.Body("b", 0.5, 0.02, parent="a", anchor=(0.4, 0.1), com=(0.2, 0.05)),
        slcp.Body("c", 0.1, 0.001, parent="b", joint="prismatic", axis=(0.6, 0.8), com=(0.0, 0.1)),
        slcp.Body("d", 1.0, 0.1, com=(0.3, 0.0)),
        slcp.Body("e", 0.3, 0.01, parent="d", anchor=(0.5, 0.0), com=(0.1, 0.1)),
    )
    spring = slcp.Spring("a", "c", (0.3, -0.1), (0.05, 0.2), 1.0, 0.1, 0.4)
    other = slcp.Spring("d", "e", (0.2, 0.3), (0.1, -0.1), 1.0, 0.0, 0.2)
    sc = slcp.Scene("joined", bodies, springs=(spring, other), gravity=(0.0, 0.0), step_size=0.01)
    return slcp.Simulator(
        sc, slcp.Options("hard", integrator=integrator), device="cpu", dtype=dtype, strategy="specialised"
    )


def thrown() -> tuple[np.ndarray, np.ndarray]:
    """States (B, 10) that float32 holds, and stiffnesses (B, 2) of 1e3 to 1e8 N/m."""
    x = np.random.default_rng(3).standard_normal((WORLDS, 10)).astype(np.float32).astype(float)
    return x, np.repeat(STIFFNESS, 2, 1)


def test_a_turn_of_all_that_a_spring_joins_has_no_part_in_what_happens():
    """By the first joints' angles v' has no derivative, whatever the springs' forces; in float32 it had
    one of up to .6 1/s.
    """
    sim = tree("euler", "float32")
    x, k = thrown()
    lin = sim.linearize(x, None, sim.params.replace(spring_stiffness=k))
    assert (lin.status == 0).all()
    assert np.abs(lin.A[:, 5:, [0, 3]]).max() == 0.0
    assert (np.abs(lin.A[:, 5:, [1, 2, 4]]).max((1, 2)) > 1.0).all()


def test_a_stiff_spring_costs_few_digits_in_single_precision():
    """The trapezoidal rule's K_q has accelerations of up to 1e9 rad/s^2 in it, of which the derivatives of M
    by a turn of the whole tree make nothing; computed as a difference they made up to .3 % of v', and 1e-4 in
    one world of ten.
    """
    x, k = thrown()
    single, double = (
        sim.step(x, None, sim.params.replace(spring_stiffness=k))
        for sim in (tree("trapezoidal", "float32"), tree("trapezoidal", "float64"))
    )
    assert (single.status == 0).all() and (double.status == 0).all()
    missed = np.abs(single.state - double.state)[:, 5:].max(1) / np.abs(double.state[:, 5:]).max(1)
    assert missed.max() < 6e-4 and np.quantile(missed, 0.9) < 2e-5
