"""The fuzz oracle: at which speeds an island opens, and the forces that the trapezoidal rule predicts."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np

from slcp_warp import Body, Scene
from slcp_warp.scripts.benchmarks.fuzz.draws import Worlds
from slcp_warp.scripts.benchmarks.fuzz.judge import Outcome, judge
from slcp_warp.scripts.benchmarks.fuzz.judged import predicted
from slcp_warp.scripts.benchmarks.fuzz.problem import Problem, Truth
from slcp_warp.scripts.benchmarks.fuzz.proofs import least_motion, widest_opening
from slcp_warp.scripts.benchmarks.fuzz.tasks import Task
from slcp_warp.scripts.benchmarks.fuzz.verdicts import Verdicts, predicted_within
from slcp_warp.scripts.benchmarks.mechanics.rational import product, rational, solve


def test_an_island_opens_at_its_own_speeds():
    """A shut slot opens at 1e7 times its speeds, which another island's 1e6 m/s are no measure for; and in
    single precision not by what a rounding of its rows makes of 1e5 times.
    """
    rate, free = np.array([[0.0, -1e-2, -1e6]]), np.array([[-0.1, 0.1, -1e6]])

    def opening(lean, dtype, rates=rate, closes=free, lengths=0.0):
        jac = np.array([[[1.0, 0.0, 0.0], [-1.0, lean, 0.0], [0.0, 0.0, 1.0]]])
        drive = SimpleNamespace(h_mass=np.eye(3)[None], free=np.array([[-0.1, 0.05, 0.0]]))
        rows = {"jac": jac, "rate": rates, "free": closes, "bound": np.ones((1, 3, 3)), "dtype": dtype}
        rows |= {"tangent": np.zeros(3, bool), "size": np.full((1, 3), lengths)}
        return widest_opening(SimpleNamespace(**rows, drive=drive), 0)

    assert opening(1e-8, "float64") < 0.0 < opening(1e-3, "float64") and opening(1e-3, "float32") > 0.0
    near = np.array([[0.0, -1e-5, 0.0]])
    assert opening(9e-8, "float32", near) < 0.0 < opening(9e-8, "float64", near)
    wide = np.array([[1e-8, 1e-8, 0.0]])  # d/h, less than what rounding makes of lengths of 1 m/s h
    assert opening(0.0, "float32", wide, lengths=1.0) < 0.0 < opening(0.0, "float64", wide, lengths=1.0)


def test_the_predicted_push_has_its_digits():
    """Impulses of 2e5 whose response all but cancels: as v' - v_free the push was 1e-8 off, and a world whose
    step is right to 1e-11 silent. In fractions.
    """
    task = Task(401, 1, "specialised", 4)
    ((options, dtype),) = task.methods()
    scene = task.make_scene()
    worlds = task.worlds(0, scene).part([41])
    push, known = predicted(scene, worlds, options, dtype)
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(np.zeros(push.shape)), options.method, dtype)
    presses = least_motion(p, 0)[1] > 0.0
    mass, jac = rational(p.drive.h_mass[0]), rational(p.jac[0][presses])
    free = solve(mass, [Fraction(x) for x in p.drive.rhs[0]])
    moved = [solve(mass, row) for row in jac]
    w = [-product(row, free) - Fraction(d) for row, d in zip(jac, p.rate[0][presses])]
    lam = solve([[product(row, other) for other in moved] for row in jac], w)
    exact = [float(sum((x * y[j] for x, y in zip(lam, moved)), Fraction(0))) for j in range(scene.nv)]
    assert known[0] and max(map(abs, map(float, lam))) > 1e5
    np.testing.assert_allclose(push[0], exact, rtol=1e-11)


def test_what_a_stiff_spring_leaves_of_an_error_of_the_predicted_force():
    """N reached - h f of a slider, E = m + h^2 k/4: an error of f remains but for m/E of it."""
    for stiffness in (1e-3, 1e5):
        body = Body("a", 2.0, 0.1, joint="prismatic", stiffness=stiffness)
        scene = Scene("spring", (body,), gravity=(0.0, 0.0), step_size=0.1)
        numbers = {n: np.asarray(v)[None] for n, v in scene.default_parameters().items()}
        worlds = Worlds(numbers, np.array([[0.1, 1.0]]), np.zeros((1, 0)), np.zeros(1, int))
        e = 2.0 + 0.25 * 0.1**2 * stiffness
        guess = Truth(scene, worlds).drive(np.array([[3.0]])).guess[0, 0]
        np.testing.assert_allclose(guess, 6.0 * (1.0 - 2.0 / e), rtol=1e-5, atol=1e-6)


def test_what_the_trapezoidal_matrix_costs_where_the_mass_matrix_has_lost_digits():
    """200 g m beside 4.5 t: a change of the state by 1e-15 moves the kernels' v' by 1e-4 of 9 m/s, the
    oracle's by 1e-12. Roundings of that matrix's accelerations make 7e-6 of the motion; 1e-3 is not theirs.
    """
    task = Task(90001, 56, "specialised")
    scene = task.make_scene()
    ((options, dtype),) = task.methods()
    truth = Truth(scene, task.worlds(0, scene).part([202]))
    p = Problem(truth, truth.drive(np.zeros((1, scene.nv))), options.method, dtype)
    given = np.array([[-9.183663687793, -5.373805888209, 16.300525313834, 15.242512185402]])  # by the kernels
    none, errors = np.zeros((1, p.rate.shape[1])), []
    for share in (1.0, 100.0):
        v = p.drive.free + share * (given - p.drive.free)
        out = Outcome(np.concatenate([truth.q, v], 1), none, none, np.zeros(1, int))
        errors.append(judge(p, out).lenient["motion"][0])
    assert options.integrator == "trapezoidal" and errors[0] < 1.0 < errors[1]


def test_digits_of_other_rows_in_a_slope_of_erm():
    """A heavy row's slope has what the velocity of a light one lost to a condition of 9e4, 43 times: a step
    right to 1e-10 of that velocity was silent. One that is 1e-8 off is.
    """
    task = Task(90001, 34, "specialised")
    scene = task.make_scene()
    ((options, dtype),) = task.methods()
    worlds = task.worlds(0, scene).part([163])
    truth = Truth(scene, worlds)
    p = Problem(truth, truth.drive(), options.method, dtype)
    push = least_motion(p, 0)[1]
    verdicts = []
    for share in (1e-10, 1e-8):
        v = p.drive.free + np.linalg.solve(p.drive.h_mass[0], p.jac[0].T @ (push * (1.0 - share)))
        x = np.concatenate([truth.q + truth.h[:, None] * v, v], 1)
        out = Outcome(x, push[None] * (1.0 - share), p.rate * truth.h[:, None], np.zeros(1, int))
        verdicts.append(Verdicts(p, out, lambda _: p).verdict[0])
    assert options.residual == "erm-logistic" and verdicts == ["holds", "silent"]


def test_how_far_the_tolerance_of_rows_decides_predicted_forces():
    """A part of 20 mg m^2 flung at 7e6 m/s beside one of 20 g m^2: rows solved to 2e-5 of that leave the
    other's velocity open by 1e3 m/s, and the forces predicted from it. Other worlds of the scene are told.
    """
    task = Task(1004, 32, "specialised")
    scene = task.make_scene()
    ((options, dtype),) = task.methods()
    assert (options.integrator, options.residual, dtype) == ("trapezoidal", "hard", "float32")
    worlds = task.worlds(3, scene)
    push, known = predicted(scene, worlds, options, dtype)
    room = []
    for i in [197, 362, *np.flatnonzero(known & push.any(1))[:40]]:
        truth = Truth(scene, worlds.part([i]))
        room.append(predicted_within(Problem(truth, truth.drive(push[i : i + 1]), options.method, dtype)))
    assert min(room[:2]) > 40.0
    assert np.median(room[2:]) < 1.0
