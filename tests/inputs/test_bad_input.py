"""Bad input: one clear error that names the argument, what came and what is needed; or a world's status.

docs/reference/bad_input.md holds the table of these cases.
"""

import numpy as np
import pytest
import warp as wp
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ArrayError, OptionError, ParameterError, SceneError, ddp
from slcp_warp.ddp.library.entries import LibraryError, scene_digest

FINGER = scene("flicking_finger")
X, U = FINGER.x0, np.zeros(2)
WORLDS = np.tile(X, (3, 1))
NAN = np.nan


def sim():
    return simulator("flicking_finger", "cpu", wp.float64, "none")


def grasp():
    return simulator("grasp")


class Stranger:
    """A policy that no kernel knows."""

    def kernel(self, sim):
        return "mine", None


def library(**header):
    zeros = np.zeros(3)
    return ddp.Library(
        x=WORLDS + 0.1 * np.arange(3)[:, None], u=np.zeros((3, 2)), K=np.zeros((3, 2, 6)), cost=zeros,
        gain=zeros, age=zeros, chain=zeros, plan=zeros, period=FINGER.state_period,
        header={"scene": FINGER.name, "digest": scene_digest(FINGER), **header},
    )  # fmt: skip


def tracking(worlds=1, nx=6, period=None):
    """A policy that tracks zeros."""
    numbers = dict.fromkeys(
        ("k", "Vx", "Vxx", "cost", "status", "iterations", "gradient", "min_pivot", "lower", "upper", "trace")
    )
    xs, us, K = np.zeros((worlds, 6, nx)), np.zeros((worlds, 5, 2)), np.zeros((worlds, 5, 2, nx))
    result = ddp.Result(xs=xs, us=us, K=K, **numbers)
    return ddp.TrackingPolicy(result, period)


def problem(**changes):
    return ddp.Problem(
        **{"dynamics": sim(), "cost": slcp.tasks.flicking_finger().cost, "horizon": 20, **changes}
    )


def solve(x0=X, u0=np.zeros((20, 2)), options=None, **changes):  # noqa: B008
    return ddp.solve(problem(**changes), x0, u0, options)


def build(x0=X, count=4, options=None, p=None, **changes):
    return ddp.build_library(problem() if p is None else p, x0, count, options, **changes)


def spec(**changes):
    short = {"worlds": 4, "duration": 1.0, "sample_every": 0.1, "residuals": ("rem-logistic",)}
    return slcp.SweepSpec(**{**short, **changes})


def sweep(policy=None, spec=None, **changes):
    policy = library().policy() if policy is None else policy
    return slcp.sweep(FINGER, policy, spec or globals()["spec"](), scaling="none", device="cpu", **changes)


def replace(**changes):
    return sim().params.replace(**changes)


def mechanism(*shapes, **parts):
    """A scene of one body `a`."""
    return slcp.Scene("s", (slcp.Body("a", 1.0, 1.0, joint="free"),), shapes, **parts)


FIVE = np.zeros((5, 2))
# what: (call, exception, words of its message in this order)
ERRORS = {
    # arrays
    "state too short": (
        lambda: sim().step(np.zeros(5)), ArrayError, r"x has shape \(5,\); \(B, 6\) or \(6\)"),
    "state of three axes": (lambda: sim().step(np.zeros((2, 2, 6))), ArrayError, r"x has shape \(2, 2, 6\)"),
    "text for a state": (lambda: sim().step("abc"), ArrayError, "x is 'abc'; an array of numbers"),
    "no state": (lambda: sim().step(None), ArrayError, "x is None; an array of numbers"),
    "ragged lists": (lambda: sim().step([[1, 2], [3]]), ArrayError, "x is .*; an array of numbers"),
    "masked state": (
        lambda: sim().step(np.ma.masked_less(X, 0.5)), ArrayError, "x is .*; an array of numbers"),
    "complex state": (lambda: sim().step(X + 1j), ArrayError, "x is .*; an array of numbers"),
    "controls of another scene": (
        lambda: sim().step(X, np.zeros(3)), ArrayError, r"u has shape \(3,\).*\(2\)"),
    "controls for other worlds": (
        lambda: sim().step(WORLDS, np.zeros((2, 2))), ArrayError, "u is given for 2 worlds, the state for 3"),
    "Warp array of another dtype": (
        lambda: sim().step(wp.zeros((2, 6), dtype=wp.float32, device="cpu")), ArrayError,
        "x is a Warp array of float32 on cpu; float64 on cpu is needed"),
    "warm start too short": (
        lambda: sim().step(X, warm_start=np.zeros(3)), ArrayError, r"warm_start has shape \(3,\)"),
    "force without bodies": (
        lambda: sim().step(X, external_force=np.zeros((2, 3))), ArrayError,
        r"external_force has shape \(2, 3\); \(B, 3, 3\)"),
    "linearize, wrong state": (lambda: sim().linearize(np.zeros(4)), ArrayError, r"x has shape \(4,\)"),
    # simulator
    "scene by name": (lambda: slcp.Simulator("finger"), TypeError, "scene is a str; a slcp_warp.Scene"),
    "options as a dict": (
        lambda: slcp.Simulator(FINGER, {"residual": "hard"}), TypeError, "options is a dict"),
    "unknown residual": (
        lambda: slcp.Options(residual="soft"), OptionError, "Options.residual is 'soft'; choose"),
    "unknown scaling": (
        lambda: slcp.Options(scaling="mass"), OptionError, "Options.scaling is 'mass'; choose"),
    "unknown dtype": (
        lambda: slcp.Simulator(FINGER, dtype="float16"), ValueError, "dtype is 'float16'; choose"),
    "dtype as a list": (lambda: slcp.Simulator(FINGER, dtype=[]), ValueError, r"dtype is \[\]; choose"),
    "device as a list": (lambda: slcp.Simulator(FINGER, device=[]), ValueError, r"device is \[\]; choose"),
    "no such device": (lambda: slcp.Simulator(FINGER, device="cuda:77"), ValueError, "cuda:77"),
    "negative mass in a scene": (
        lambda: slcp.Scene("s", (slcp.Body("a", -1.0, 1.0),)), SceneError,
        "'a': mass is -1.0; it must be positive"),
    "a body without a mass": (lambda: slcp.Body("a", None, 1.0), SceneError, "'a': mass is None; a number"),
    "gravity as one number": (lambda: mechanism(gravity=-9.81), SceneError, "gravity is -9.81; 2 numbers"),
    "bodies as text": (lambda: slcp.Scene("s", "x"), SceneError, "bodies is 'x'; a tuple of Body"),
    "contact of unknown shapes": (
        lambda: slcp.Scene("s", (slcp.Body("a", 1.0, 1.0),), contacts=(slcp.Contact("p", "q"),)), SceneError,
        "no shape named 'p'"),
    "capsule without a length": (
        lambda: mechanism(slcp.Shape("s", "a", "capsule", 0.1)), SceneError,
        r"'s': radius is 0.1; a capsule needs \(radius, half length\)"),
    "a pair twice": (
        lambda: mechanism(
            slcp.Shape("s", "a", "disc", 0.1), slcp.Shape("e", None, "disc", 0.1),
            contacts=(slcp.Contact("s", "e"), slcp.Contact("e", "s"))), SceneError,
        "contacts has 'e' - 's' twice; a pair stands in it once"),
    "capsule against an ellipse": (
        lambda: mechanism(
            slcp.Shape("s", "a", "capsule", (0.1, 0.2)), slcp.Shape("e", None, "ellipse", (1, 2)),
            contacts=(slcp.Contact("s", "e"),)), SceneError,
        "a capsule and an ellipse cannot touch"),
    "spring on one body": (
        lambda: mechanism(springs=(slcp.Spring("a", "a"),)), SceneError,
        r"springs\[0\]: both ends are on 'a'; a spring needs two bodies"),
    "spring of negative length": (
        lambda: mechanism(springs=(slcp.Spring("a", None, length=-1.0),)), SceneError,
        "spring 'a' - None: length is -1.0; it must not be negative"),
    # parameters
    "stiffness where there is no spring": (
        lambda: replace(stiffness=1.0), ParameterError, "no parameter 'stiffness'; there are"),
    "unknown parameter": (
        lambda: replace(masss=1.0), ParameterError, "no parameter 'masss'; there are .*'mass'"),
    "negative mass": (
        lambda: replace(mass=[1.0, -1.0, 1.0]), ParameterError, "mass is -1.0; it must be positive"),
    "sigma = 0": (lambda: replace(sigma=0.0), ParameterError, "sigma is 0.0.*residual=\"hard\""),
    "sigma < 0": (lambda: replace(sigma=-0.1), ParameterError, "sigma is -0.1; it must be positive.*hard"),
    "step size = 0": (
        lambda: replace(step_size=0.0), ParameterError, "step_size is 0.0; it must be positive"),
    "negative friction": (
        lambda: replace(friction=-0.5), ParameterError, "friction is -0.5; it must not be negative"),
    "ellipse without width": (lambda: replace(radius=0.0), ParameterError, "radius of ellipse 'link1' is 0"),
    "NaN parameter": (
        lambda: replace(damping=NAN), ParameterError, "damping is nan; it must be finite"),
    "text for a parameter": (
        lambda: replace(mass="heavy"), ParameterError, "mass is 'heavy'; numbers are needed"),
    "parameter of wrong shape": (
        lambda: replace(mass=np.ones((2, 2))), ParameterError,
        r"mass has shape \(2, 2\); give a scalar, \(3,\), \(B,\) or \(B, 3\)"),
    "two numbers of worlds": (
        lambda: replace(mass=np.ones((2, 3)), friction=np.ones((4, 1))), ParameterError,
        "disagree on the number of worlds: .*'mass': 2, 'friction': 4"),
    "parameters as a dict": (
        lambda: sim().step(X, params={"sigma": 0.1}), TypeError, "params is a dict; use .*replace"),
    "parameters of another scene": (
        lambda: sim().step(X, params=grasp().params), ValueError,
        "params belong to scene 'grasp'; this simulator has 'flicking_finger'"),
    "parameters for other worlds": (
        lambda: sim().step(WORLDS, params=replace(mass=np.ones((2, 3)))), ArrayError,
        "params are given for 2 worlds, the arrays for 3; one a world are: mass"),
    # rollouts
    "record by number": (
        lambda: sim().rollout(X, FIVE, record=1), TypeError, "record is 1; names out of .*'impulse'"),
    "a policy of a kind of its own": (
        lambda: sim().rollout(X, policy=Stranger(), steps=3), TypeError,
        "policy.kernel gave .*'mine', None.*PolicyKernel, struct. is needed"),
    "controls of no length": (
        lambda: sim().rollout(X, np.zeros((0, 2))), ArrayError, "controls has shape .*one step"),
    "sequences for other worlds": (
        lambda: sim().rollout(WORLDS, np.zeros((2, 5, 2))), ArrayError,
        "controls is given for 2 worlds, the state for 3"),
    "neither controls nor policy": (lambda: sim().rollout(X), ValueError, "give either controls or policy"),
    "both controls and policy": (
        lambda: sim().rollout(X, FIVE, policy=tracking(), steps=5), ValueError, "give either"),
    "steps and controls disagree": (
        lambda: sim().rollout(X, FIVE, steps=4), ValueError, "steps is 4.* for 5"),
    "policy without steps": (
        lambda: sim().rollout(X, policy=tracking()), ValueError, "steps is None; a whole number"),
    "steps not whole": (lambda: sim().rollout(X, policy=tracking(), steps=2.5), ValueError, "steps is 2.5"),
    "unknown record": (
        lambda: sim().rollout(X, FIVE, record=("forces",)), ValueError,
        r"record names \['forces'\]; choose from controls, impulse, gap"),
    "library instead of its policy": (
        lambda: sim().rollout(X, policy=library(), steps=3), TypeError,
        r"policy is a Library; .*library.policy\(\)"),
    "policy of another scene": (
        lambda: grasp().rollout(scene("grasp").x0, policy=library().policy(), steps=3), LibraryError,
        "built for scene 'flicking_finger', not 'grasp'"),
    "tracking another mechanism": (
        lambda: sim().rollout(X, policy=tracking(nx=10), steps=3), ValueError,
        "trajectory has 10 states.*'flicking_finger' needs 6"),
    "tracking for other worlds": (
        lambda: sim().rollout(WORLDS, policy=tracking(2), steps=3), ArrayError,
        "policy holds 2 trajectories; 1 or 3 is needed"),
    "tracking with a short period": (
        lambda: sim().rollout(X, policy=tracking(period=np.zeros(3)), steps=3), ValueError,
        r"period of shape \(3,\)"),
    "unknown metric": (lambda: library().policy(metric="l1"), ValueError, "metric is 'l1'; choose one of"),
    "feedback limit NaN": (lambda: library().policy(feedback_limit=NAN), ValueError, "feedback_limit is nan"),
    "norm of wrong size": (
        lambda: library().policy(whiten=np.eye(3)), ValueError, r"whiten has shape \(3, 3\).*\(6, 6\)"),
    # DDP
    "a plain function as cost": (
        lambda: problem(cost=lambda x: x), TypeError, "cost must be a ddp.Cost, got function"),
    "cost of another mechanism": (
        lambda: problem(dynamics=grasp()), ValueError, "cost is for nx = 6, .* nx = 10"),
    "horizon 0": (lambda: problem(horizon=0), ValueError, "horizon is 0; a whole number of at least 1"),
    "limits crossed": (
        lambda: problem(control_limits=(1.0, -1.0)), ValueError, "control_limits: a lower limit .* upper"),
    "problem with other parameters": (
        lambda: solve(params=grasp().params), ValueError, "params belong to scene 'grasp'"),
    "initial state too short": (
        lambda: solve(np.zeros(5)), ValueError, r"x0 must have shape .*\(6,\), got \(5,\)"),
    "initial state NaN": (lambda: solve(X * NAN), ValueError, "x0 must be finite; 6 of its values"),
    "controls too short": (
        lambda: solve(u0=np.zeros((19, 2))), ValueError, r"u0 must have shape .*\(20, 2\), got \(19, 2\)"),
    "solver options as a dict": (
        lambda: solve(options={"max_iterations": 3}), TypeError, "a dict.*ddp.Options"),
    "unknown method": (lambda: ddp.Options(method="newton"), ValueError, "method must be one of .*'newton'"),
    "noise levels rising": (
        lambda: ddp.Options(sigma_schedule=(0.1, 0.2)), ValueError, "sigma_schedule must decrease"),
    # library
    "library of no entries": (lambda: build(count=0), ValueError, "count is 0; a whole number of at least 1"),
    "misspelt library option": (lambda: build(ofset=3), ValueError, r"no \['ofset'\]; there are .*'offset'"),
    "options given twice": (
        lambda: build(options=ddp.RecedingOptions(), offset=2), ValueError, "not both: .*'offset'"),
    "more entries than steps": (lambda: build(entries=9), ValueError, "entries is 9; at most the offset 4"),
    "offset beyond the horizon": (
        lambda: build(offset=30), ValueError, "offset is 30; less than the horizon, 20"),
    "chain from a short state": (lambda: build(np.zeros(5)), ValueError, r"x0 has shape \(5,\)"),
    "chain from NaN": (lambda: build(X * NAN), ValueError, "x0 .*finite numbers"),
    "library of no simulator": (lambda: build(p=3), TypeError, "whose dynamics is a slcp_warp.Simulator"),
    # sweep
    "sweep of no worlds": (lambda: spec(worlds=0), ValueError, "worlds is 0; a whole number of at least 1"),
    "half a world": (lambda: spec(worlds=2.5), ValueError, "worlds is 2.5; a whole number"),
    "sweep of an unknown residual": (lambda: spec(residuals=("soft",)), OptionError, "residual is 'soft'"),
    "residuals as text": (lambda: spec(residuals="hard"), ValueError, "residuals is 'hard'; a tuple"),
    "no cases": (lambda: spec(step_sizes=()), ValueError, "at least one case"),
    "a case twice": (lambda: spec(residuals=("hard", "hard")), ValueError, "each of them once"),
    "one step size": (lambda: spec(step_sizes=0.05), ValueError, "step_sizes is 0.05; a tuple"),
    "negative step size": (lambda: spec(step_sizes=(-0.05,)), ValueError, "step_sizes contains -0.05"),
    "spread of nothing": (
        lambda: spec(parameter_sd={"mas": 0.1}), ValueError, r"names \['mas'\]; choose from"),
    "negative spread": (lambda: spec(parameter_sd={"mass": -0.1}), ValueError, r"\['mass'\] is -0.1"),
    "kick after the end": (
        lambda: spec(kick_times=(3.0,)), ValueError, r"kick_times is \(3.0,\); .*\[0, 1.0\)"),
    "kicks out of order": (lambda: spec(kick_times=(0.5, 0.2)), ValueError, "kick_times .*rising"),
    "endless sweep": (lambda: spec(duration=NAN), ValueError, "duration is nan"),
    "seed too large": (lambda: spec(seed=2**40), ValueError, "seed is 1099511627776"),
    "sweep by a dict": (
        lambda: sweep(spec={"worlds": 4}), TypeError, "spec is a dict; a slcp_warp.SweepSpec"),
    "sweep without a policy": (lambda: sweep(policy=3), TypeError, "policy is a int; a policy is needed"),
    "sweep from a short state": (
        lambda: sweep(spec=spec(start=np.zeros((2, 5)))), ValueError, r"start has shape \(2, 5\)"),
    "sweep from NaN": (lambda: sweep(spec=spec(start=X * NAN)), ValueError, "start .*finite numbers"),
    "sweep observing nothing": (
        lambda: sweep(spec=spec(observe=9)), ValueError, r"observe is 9; a state component 0\.\.5"),
    "sweep of an unknown parameter": (
        lambda: sweep(spec=spec(parameters={"mas": 1.0})), ParameterError, "no parameter 'mas'"),
    "negative chunk": (lambda: sweep(chunk=-3), ValueError, "chunk is -3; a whole number"),
    "sweep tracking many": (
        lambda: sweep(policy=tracking(2)), ArrayError, "holds 2 trajectories; 1 or"),
}  # fmt: skip


@pytest.mark.parametrize("what", ERRORS)
def test_error(what):
    call, kind, message = ERRORS[what]
    with pytest.raises(kind, match=message) as caught:
        call()
    own = {ValueError: slcp.ArgumentError, TypeError: slcp.ArgumentTypeError}
    assert type(caught.value) is own.get(kind, kind) and len(str(caught.value)) < 400
    assert isinstance(caught.value, slcp.InputError)


@pytest.mark.parametrize("what", ERRORS)
def test_the_table_in_the_docs_tells_what_comes_back(request, what):
    path = request.config.rootpath / "docs" / "reference" / "bad_input.md"
    row = next(line for line in path.read_text().splitlines() if line.startswith(f"| {what} |"))
    kind, message = row.strip("| ").split(" | ", 2)[1:]
    with pytest.raises(slcp.InputError) as caught:
        ERRORS[what][0]()
    assert kind == type(caught.value).__name__
    assert str(caught.value).startswith(message.removesuffix("..."))
    assert message.endswith("...") or message == str(caught.value)


def test_no_worlds_in_generic_kernels():
    simulated = slcp.Simulator(slcp.scenes.stack(3), device="cpu", strategy="generic")
    none, us, n = np.zeros((0, 18)), np.zeros((0, 5, 0)), (0, 6, 18)
    assert simulated.step(none).state.shape == (0, 18) and simulated.rollout(none, us).states.shape == n
    assert simulated.linearize(none).A.shape == simulated.linearize(none, second=True).A.shape == (0, 18, 18)
    assert slcp.vjp(simulated, none, us, np.zeros(n)).x0.shape == (0, 18)
    assert slcp.jvp(simulated, none, us, none).tangent.shape == n


def test_no_worlds_at_all(device):
    simulated = simulator("flicking_finger", device, wp.float64, "none")
    assert simulated.step(np.zeros((0, 6))).state.shape == (0, 6)
    none, us = np.zeros((0, 6)), np.zeros((0, 5, 2))
    assert simulated.rollout(none, us).states.shape == (0, 6, 6)
    assert simulated.rollout(none, policy=library().policy(), steps=5).states.shape == (0, 6, 6)
    assert simulated.rollout(none, us, simulated.params.replace(mass=np.ones((0, 3)))).states.shape == (
        0,
        6,
        6,
    )
    assert simulated.linearize(none, second=True).A.shape == (0, 6, 6)
    back = slcp.vjp(simulated, none, us, np.zeros((0, 6, 6)), parameters="mass")
    assert (back.x0.shape, back.controls.shape, back.parameters["mass"].shape) == ((0, 6), (0, 5, 2), (0, 3))
    assert slcp.jvp(simulated, none, us, none).tangent.shape == (0, 6, 6)
    hessian, status = slcp.weighted_hessian(simulated, none, us[:, 0], none)
    assert hessian.shape == (0, 8, 8) and status.shape == (0,)
    solution = slcp.solve_complementarity(np.zeros((0, 3, 3)), np.zeros((0, 3)), device=device)
    assert solution.impulse.shape == (0, 3) and solution.vjp(np.zeros((0, 3)))[0].shape == (0, 3, 3)
    assert slcp.residual("min", none, none).shape == (0, 6)
    result = ddp.solve(ddp.Problem(simulated, slcp.tasks.flicking_finger().cost, 5), none, us)
    assert result.xs.shape == (0, 6, 6) and result.K.shape == (0, 5, 2, 6) and result.converged.shape == (0,)


def test_what_does_not_fit_into_the_memory_is_named(monkeypatch):
    monkeypatch.setattr("slcp_warp.inputs.checks.os.sysconf", lambda name: 2**14)  # 256 MiB
    hard = slcp.Simulator(FINGER, slcp.Options(residual="hard"), device="cpu")
    many = 10**8
    for call, words in (
        (lambda: sim().rollout(X, policy=tracking(), steps=many), r"array \(1, 100000001, 6\) would take"),
        (lambda: slcp.particles(hard, X, covariance=np.eye(6), count=many), "count = 100000000: the states"),
        (lambda: ddp.Workspace(problem(horizon=many), 3), "batch 3, horizon 100000000 .* would take"),
        (lambda: sweep(spec=spec(worlds=many)), "the samples would take 4.098 GiB; cpu has 0.25 GiB"),
    ):  # fmt: skip
        with pytest.raises(slcp.ArgumentError, match=words):
            call()


def test_a_scene_without_actuators_needs_steps_alone(device):
    simulated = simulator("ball_drop", device)
    traj = simulated.rollout(simulated.scene.x0, steps=5)
    controls = np.zeros((5, 0))
    np.testing.assert_array_equal(traj.states, simulated.rollout(simulated.scene.x0, controls).states)
    with pytest.raises(slcp.ArgumentError, match="steps is 0; a whole number"):
        simulated.rollout(simulated.scene.x0, steps=0)
    with pytest.raises(slcp.ArgumentError, match="give either controls or policy"):
        sim().rollout(X, steps=5)


def test_a_sweep_file_that_is_none_is_refused(tmp_path):
    path = tmp_path / "sweep.npz"
    with pytest.raises(FileNotFoundError):
        slcp.SweepReport.load(path)
    for content in (b"", b"hello", b"PK\x03\x04" + bytes(50)):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="sweep.npz cannot be read as a sweep"):
            slcp.SweepReport.load(path)
    library().save(path)
    with pytest.raises(ValueError, match="format is 'slcp-warp-library'; 'slcp-warp-sweep' is needed"):
        slcp.SweepReport.load(path)
