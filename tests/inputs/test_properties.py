"""Public functions under Hypothesis: one argument is replaced by anything; either the call works, or the
package's own error names the argument. Never a raw error, a hang or a crash.

No kernel is compiled or run: what is wrong is found before. `HYPOTHESIS_PROFILE=full` tries thousands of
values for every function.
"""

import contextlib
import dataclasses
import functools
import inspect
import pathlib
import typing

import numpy as np
import pytest
import warp as wp
from file_examples import report as rows
from hostile import arguments, judge, no_kernels, values
from hypothesis import given
from hypothesis import strategies as st

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest

HOPPER = pathlib.Path(__file__).parents[2] / "examples" / "scenes" / "hopper.xml"

FINGER = slcp.scenes.flicking_finger()
PULLED = dataclasses.replace(FINGER, tendons=(slcp.Tendon("bar", ("link1.angle",), (1.0,)),))
X, U = np.zeros((2, 6)), np.zeros((2, 2))
US = np.zeros((2, 5, 2))


@functools.cache
def sim(**options):
    return slcp.Simulator(FINGER, slcp.Options(**options), device="cpu")


def kalman():
    return slcp.policies.KalmanFilter(sim(), {"link1.angle": 0.1}, 0.1, start=1.0)


def exact():
    model = slcp.Simulator(FINGER, slcp.Options(), device="cpu", dtype="float64")
    return slcp.policies.KalmanFilter(model, {"link1.angle": 0.1}, 0.1, start=1.0)


def library():
    zeros = np.zeros(3)
    return ddp.Library(
        x=np.arange(18.0).reshape(3, 6), u=np.zeros((3, 2)), K=np.zeros((3, 2, 6)), cost=zeros, gain=zeros,
        age=zeros, chain=zeros, plan=zeros, period=FINGER.state_period,
        header={"scene": FINGER.name, "digest": scene_digest(FINGER)},
    )  # fmt: skip


def problem():
    return ddp.Problem(sim(), slcp.tasks.flicking_finger().cost, 5)


def make_step(dtype, VX, VU):
    raise AssertionError("nothing is compiled")


def build(**changes):
    return ddp.build_library(problem(), X[0], 2, **changes)


@dataclasses.dataclass
class Plan:
    us: np.ndarray = dataclasses.field(default_factory=lambda: US[0])
    xs: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((6, 6)))
    K: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((5, 2, 6)))


ROUND = (slcp.Shape("a", "ellipse", "disc", 0.1),)
A, B = np.stack([np.eye(3)] * 2), np.zeros((2, 3))
# name: (function, good arguments, names that an error may use for an argument)
TASK = slcp.Task("turn", FINGER, slcp.tasks.flicking_finger().cost, 5, slcp.Options(scaling="none"))
KICKED = TASK.replace(disturbances=slcp.Disturbances(velocity=1.0))
ENVIRONMENT = slcp.Environment(KICKED, 2, device="cpu")
ENVIRONMENT.reset()
JUDGED = KICKED.replace(success=slcp.measures.final("ellipse.angle") > 0.0)
NAMED_PARTS = {name: ("policy", "there is no") for name in ("first", "second", "policy", "case", "step_size")}
CALLS = {
    "Body": (slcp.Body, {"name": "a", "mass": 1.0, "inertia": 1.0}, {}),
    "Body, free": (slcp.Body, {"name": "a", "mass": 1.0, "inertia": 1.0, "joint": "free",
        "lower": (0.0,) * 3}, {}),
    "Shape": (slcp.Shape, {"name": "a", "body": None, "kind": "disc"}, {}),
    "Shape, capsule": (slcp.Shape, {"name": "a", "body": None, "kind": "capsule", "radius": (0.1, 0.2)}, {}),
    "Contact": (slcp.Contact, {"shape_a": "a", "shape_b": "b"}, {}),
    "Actuator": (slcp.Actuator, {"body": "a"}, {}),
    "Spring": (slcp.Spring, {"body_a": "a", "body_b": None}, {}),
    "Tendon": (slcp.Tendon, {"name": "a", "coordinates": ("b.x",), "coefficients": (1.0,)},
        {"coefficients": ("coordinates",)}),
    "Actuator of a tendon": (slcp.Actuator, {"tendon": "a"}, {"body": ("tendon",)}),
    "Scene": (slcp.Scene, {f.name: getattr(FINGER, f.name) for f in dataclasses.fields(FINGER) if f.init},
        {"shapes": ("shape",), "bodies": ("body",)}),
    "box": (slcp.box, {"name": "a", "body": None, "width": 1.0, "height": 1.0}, {"name": ("shape",)}),
    "rope": (slcp.rope, {"name": "a", "body_a": None, "body_b": "b", "length": 1.0, "bit": 4},
             {"name": ("shape",), "body_a": ("body",), "body_b": ("body",)}),
    "pin": (slcp.pin, {"body_a": None, "body_b": "b", "point_a": (0.0, 0.0), "point_b": (0.1, 0.0),
                       "stiffness": 1e4, "damping": 10.0, "arm": 0.5}, {}),
    "polygon": (slcp.polygon, {"name": "a", "body": None, "vertices": ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)),
                               "corner_radius": 0.01}, {"name": ("shape",), "body": ("body",)}),
    "polygon_mass": (slcp.polygon_mass, {"vertices": ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)),
                                         "density": 2.0}, {}),
    "brake": (slcp.brake, {"body": slcp.Body("b", 1.0, 0.1), "holds": 1.0, "bit": 4}, {}),
    "servo": (slcp.servo, {"body": slcp.Body("b", 1.0, 0.1), "stiffness": 2.0, "damping": 0.5}, {}),
    "limited_servo": (slcp.limited_servo, {"body": slcp.Body("b", 1.0, 0.1), "stiffness": 2.0,
                                           "force_limit": 3.0, "damping": 0.5}, {}),
    "Environment": (slcp.Environment, {"task": KICKED, "worlds": 2, "device": "cpu"},
        {"period": ("controls",)}),
    "Sensor": (slcp.policies.Sensor, {"of": "link1.angle", "noise": 0.1, "period": 6.0,
        "every": 0.1, "late": 0.1, "lost": 0.1}, {}),
    "KalmanFilter": (slcp.policies.KalmanFilter, {"model": sim(), "sensors": {"link1.angle": 0.1},
        "process": 0.1}, {}),
    "KalmanFilter.predict": (lambda **given: kalman().predict(kalman().begin(2), **given), {"u": U}, {}),
    "KalmanFilter.correct": (lambda **given: kalman().correct(kalman().begin(2), **given),
        {"measured": U[:, :1]}, {}),
    "KalmanFilter.estimate": (lambda **given: kalman().estimate(**given),
        {"measured": np.zeros((2, 6, 1)), "controls": US}, {}),
    "Estimated": (slcp.policies.Estimated, {"policy": slcp.policies.Linear(np.zeros((2, 6))),
        "filter": slcp.policies.KalmanFilter(sim(), {"link1.angle": 0.1}, 0.1)}, {}),
    "Estimated.of_task": (slcp.policies.Estimated.of_task, {"task": KICKED, "process": 0.1,
        "policy": slcp.policies.Linear(np.zeros((2, 6))), "sensors": {"link1.angle": 0.1}},
        {"policy": ("step_size",)}),
    "Environment.step": (ENVIRONMENT.step, {"controls": U}, {}),
    "Environment.reset": (ENVIRONMENT.reset, {}, {}),
    "touching": (slcp.touching, {"shapes": ROUND, "others": ROUND}, {}),
    "Options": (slcp.Options, {}, {}),
    "Options, tolerance": (slcp.Options, {"tolerance": 1e-8}, {}),
    "Simulator": (slcp.Simulator, {"scene": FINGER, "device": "cpu"}, {}),
    "Parameters": (slcp.Parameters, {"scene": FINGER}, {"values": ("parameter", "mass")}),
    "Parameters.gradient": (lambda name: sim().params.track().gradient(name), {"name": "mass"},
        {"name": ("parameter",)}),
    "Parameters[]": (lambda name: sim().params[name], {"name": "mass"}, {"name": ("parameter",)}),
    "Parameters.replace": (
        lambda **changes: sim().params.replace(**changes), {n: sim().params[n] for n in sim().params.names},
        {}),
    "step": (
        sim().step, {"x": X, "u": U}, {"x": ("state", "params", "worlds")}),
    "rollout": (
        sim().rollout, {"x0": X, "controls": US}, {"x0": ("state",), "policy": ("controls",),
        "steps": ("controls",)}),
    "rollout under a policy": (
        sim().rollout, {"x0": X, "policy": library().policy(), "steps": 3}, {"controls": ("policy",)}),
    "linearize": (sim().linearize, {"x": X, "u": U}, {"x": ("state",)}),
    "SweepSpec": (slcp.SweepSpec, {}, {"residuals": ("residual",), "step_sizes": ("duration",),
        "window": ("kick_times",)}),
    "SweepSpec, kicks": (slcp.SweepSpec, {"kick_times": (1.0,)}, {"residuals": ("residual",),
        "step_sizes": ("duration",), "duration": ("sample_every", "kick_times"), "window": ("kick_times",)}),
    "sweep": (
        slcp.sweep,
        {"scene": FINGER, "policy": library().policy(), "device": "cpu",
         "spec": slcp.SweepSpec(2, 1.0, ("hard",), sample_every=0.1)}, {}),
    "solve_complementarity": (slcp.solve_complementarity, {"A": A, "b": B}, {"A": ("b", "device")}),
    "vjp of a solution": (
        lambda impulse_grad: slcp.solve_complementarity(A, B).vjp(impulse_grad), {"impulse_grad": B}, {}),
    "residual": (slcp.residual, {"name": "min", "a": 1.0, "b": 1.0}, {}),
    "vjp": (
        slcp.vjp, {"sim": sim(), "x0": X, "controls": US, "weights": np.zeros((2, 6, 6))},
        {"x0": ("controls",), "controls": ("weights",)}),
    "jvp": (
        slcp.jvp, {"sim": sim(), "x0": X, "controls": US, "dx0": X}, {"x0": ("controls",),
        "controls": ("dcontrols",)}),
    "energies": (slcp.energies, {"states": X, "params": sim().params}, {"params": ("states",)}),
    "momentum": (slcp.momentum, {"states": X, "params": sim().params}, {"params": ("states",)}),
    "weighted_hessian": (
        slcp.weighted_hessian, {"sim": sim(), "x": X, "u": U, "weights": X}, {"x": ("u", "weights")}),
    "particles": (
        slcp.particles, {"sim": sim(residual="hard"), "x": X[0], "covariance": np.eye(6), "count": 3}, {}),
    "particle_rollout": (
        slcp.particle_rollout,
        {"sim": sim(residual="hard"), "x0": X[0], "us": US[0], "covariance": np.eye(6), "count": 3}, {}),
    "load_scene": (slcp.load_scene, {"path": "/nowhere/scene.toml"}, {}),
    "save_scene": (slcp.save_scene, {"scene": FINGER, "path": "/nowhere/scene.json"}, {}),
    "load_mjcf": (slcp.load_mjcf, {"path": HOPPER}, {}),
    "mjcf_control_limits": (slcp.mjcf_control_limits, {"path": HOPPER}, {}),
    "Regularization": (
        lambda **fields: ddp.Regularization(**fields).rows(), dataclasses.asdict(ddp.Regularization()),
        {"state_weight": ("control_weight",)}),
    "ddp.Options": (ddp.Options, {}, {}),
    "Problem": (
        ddp.Problem, {"dynamics": sim(), "cost": slcp.tasks.flicking_finger().cost, "horizon": 5},
        {"dynamics": ("dynamics",)}),
    "Cost": (ddp.Cost, {"make": make_step}, {}),
    "plain": (ddp.costs.plain, {"make": make_step}, {}),
    "flicking_finger": (slcp.tasks.flicking_finger, {}, {}),
    "quadratic": (ddp.costs.quadratic, {"Q": np.eye(6), "R": np.eye(2)}, {}),
    "Disturbances": (
        slcp.Disturbances, {}, {name: ("parameters", "start") for name in ("parameters", "start")}),
    "Task": (
        slcp.Task, {"name": "turn", "scene": FINGER, "cost": slcp.tasks.flicking_finger().cost, "horizon": 5},
        {"start": ("state", "value"), "scene": ("cost",)}),
    "Term": (slcp.costs.Term, {"kind": "square", "weight": 1.0, "state": 2}, {"state": ("control",)}),
    "effort": (slcp.costs.effort, {"weight": 1.0}, {"weight": ("Term.weight",)}),
    "terms": (slcp.costs.terms, {"scene": FINGER, "running": [slcp.costs.effort(1.0)]}, {}),
    "Scene.state": (FINGER.state, {"values": {"ellipse.angle": 0.5}}, {"values": ("value", "state")}),
    "Scene.state_index": (FINGER.state_index, {"which": 1}, {"which": ("state component",)}),
    "Scene.tendon_index": (PULLED.tendon_index, {"which": "bar"}, {"which": ("tendon",)}),
    "Scene.control_index": (FINGER.control_index, {"which": "link1.angle"}, {"which": ("control",)}),
    "plan": (ddp.plan, {"task": TASK, "starts": 1}, {"methods": ("method",)}),
    "load_task": (slcp.load_task, {"name": "/nowhere/task.toml"}, {}),
    "save_task": (slcp.save_task, {"task": TASK, "path": "/nowhere/task.json"}, {}),
    "problem_of": (ddp.problem_of, {"task": TASK}, {}),
    "WarpDynamics": (ddp.WarpDynamics, {"make": make_step, "nx": 2, "nu": 1, "device": "cpu"}, {
        "parameters": ("parameter",)}),
    "ddp.Parameters": (
        ddp.Parameters, {"shapes": {"a": ()}, "values": {"a": 1.0}, "dtype": wp.float64, "device": "cpu"},
        {"shapes": ("values", "parameter"), "values": ("parameter",)}),
    "linear_system": (ddp.linear_system, {"A": np.eye(2), "B": np.zeros((2, 1)), "device": "cpu"}, {}),
    "Workspace": (ddp.Workspace, {"problem": problem(), "batch": 2}, {}),
    "solve": (
        ddp.solve, {"problem": problem(), "x0": X, "u0": US}, {"x0": ("u0",), "K0": ("xs0",),
        "xs0": ("K0",)}),
    "solve_continuation": (
        ddp.solve_continuation, {"problem": problem(), "x0": X, "u0": US, "sigmas": (0.1, 0.05)},
        {"sigmas": ("sigma",), "K0": ("xs0",), "xs0": ("K0",), "x0": ("u0",)}),
    "solve_multistart": (
        ddp.solve_multistart, {"problem": problem(), "x0": X[0], "starts": US}, {}),
    "RecedingOptions": (ddp.RecedingOptions, {}, {}),
    "build_library": (
        ddp.build_library, {"problem": problem(), "x0": X[0], "count": 2}, {}),
    "build_refined": (
        ddp.build_refined, {"problem": problem(), "x0": X[0], "count": 2, "score": ddp.turning(2),
        "rounds": 0}, {}),
    "stuck_states": (
        ddp.stuck_states,
        {"library": library(), "sim": sim(), "score": ddp.turning(2), "count": 2, "seed": 0}, {}),
    "turning": (ddp.turning, {"component": 2}, {}),
    "NearestPolicy": (ddp.NearestPolicy, {"library": library()}, {}),
    "TrackingPolicy": (ddp.TrackingPolicy, {"result": Plan()}, {"result": ("us",)}),
    "Library": (ddp.Library, {f.name: getattr(library(), f.name) for f in dataclasses.fields(ddp.Library)},
        {}),
    "Library.select": (library().select, {"keep": [0, 2]}, {}),
    "concatenate": (ddp.concatenate, {"libraries": [library()]}, {}),
    "Library.load": (ddp.Library.load, {"path": "/nowhere/library.npz"}, {}),
    "compare_sequentially": (
        slcp.compare_sequentially,
        {"task": TASK, "policies": {"a": library().policy(), "b": library().policy()}, "device": "cpu"},
        {"case": ("cases",), "batch": ("chunk",), "step_size": ("step_sizes",), "worlds": ("batch",)}),
    "sensitivity": (
        slcp.sensitivity, {"task": KICKED, "policy": library().policy(), "device": "cpu"},
        {"case": ("cases",), "policy": ("policies",)}),
    "robustness_map": (
        slcp.robustness_map,
        {"task": TASK, "policy": library().policy(), "x": ("mass", (1.0,)), "y": ("friction", (1.0,)),
         "device": "cpu"}, {"case": ("cases",), "policy": ("policies",)}),
    "identify": (slcp.identify, {"filter": exact(), "measured": np.zeros((2, 6, 1)), "controls": US,
        "parameters": {"mass": 0.1}, "bias": {"link1.angle": 0.1}, "sensor_noise": 0.1, "process_noise": 0.1},
        {"starts": ("candidates",), "controls": ("run",)}),
    "load_log": (slcp.load_log, {"path": "/nowhere/log.csv", "filter": kalman()}, {}),
    "tune": (
        slcp.tune,
        {"task": JUDGED, "policy": library().policy(), "parameters": {"mass": (0.5, 2.0)}, "device": "cpu"},
        {"case": ("cases",), "policy": ("policies",), "success": ("minimise", "maximise")}),
    "Dropout": (slcp.Dropout, {"start": 0.1, "duration": 0.2}, {}),
    "Push": (slcp.Push, {"body": "ellipse", "start": 0.1, "duration": 0.2}, {}),
    "LogNormal": (slcp.LogNormal, {"sd": 0.1}, {}),
    "Normal": (slcp.Normal, {"sd": 0.1}, {}),
    "Uniform": (slcp.Uniform, {"low": 0.0, "high": 1.0}, {"low": ("high",)}),
    "UniformFactor": (slcp.UniformFactor, {"low": 0.5, "high": 1.0}, {"low": ("high",)}),
    "Worlds": (slcp.Worlds, {"x0": X}, {"x0": ("worlds",)}),
    "load_worlds": (slcp.load_worlds, {"path": "/nowhere/worlds.npz"}, {}),
    "save_worlds": (slcp.save_worlds, {"worlds": slcp.Worlds(X), "path": "/nowhere/worlds.npz"}, {}),
    "draw_worlds": (slcp.draw_worlds, {"task": KICKED, "worlds": 2, "device": "cpu"}, {}),
    "replay": (
        slcp.replay, {"task": KICKED, "policy": library().policy(), "worlds": slcp.draw_worlds(KICKED, 2),
            "device": "cpu"}, {}),
    "failure_share": (
        slcp.failure_share, {"task": JUDGED, "policy": library().policy(), "device": "cpu"},
        {"options": ("cases",), "policy": ("policies",), "step_size": ("step_sizes",)}),
    "falsify": (
        slcp.falsify, {"task": JUDGED, "policy": library().policy(), "device": "cpu"},
        {"options": ("cases",), "policy": ("policies",), "time": ("kick", "Push"), "by": ("kick", "push"),
         "duration": ("Push",), "at": ("Push",)}),
    "load_report": (slcp.load_report, {"path": "/nowhere/report.npz"}, {}),
    "MPC": (
        ddp.MPC, {"problem": problem()},
        {"passes": ("starts",), "delay": ("replan",), "starts": ("improved",)}),
    "library_of_runs": (  # of a planner whose steps do not fit: nothing runs
        ddp.library_of_runs, {"task": TASK, "mpc": ddp.MPC(problem().with_params(step_size=0.03))},
        dict.fromkeys(("task", "worlds", "entries", "seed", "progress"), ("mpc",))),
    "plan_in_worlds": (
        ddp.plan_in_worlds, {"task": slcp.tasks.grasp_hold(), "starts": 1}, {"problem": ("task",)}),
    "Sampling": (ddp.Sampling, {}, {}),
    "Sampler": (ddp.Sampler, {"problem": problem(), "batch": 2}, {}),
    "sample": (ddp.sample, {"problem": problem(), "x0": X}, {"x0": ("us0",)}),
    "Report.quantiles": (rows().quantiles, {}, {}),
    "Report.sensitivity": (rows().sensitivity, {}, NAMED_PARTS),
    "Report.compare": (rows().compare, {"first": "a", "second": "b"}, NAMED_PARTS),
    "Report.load": (slcp.Report.load, {"path": "/nowhere/report.npz"}, {}),
    "SweepReport.load": (slcp.SweepReport.load, {"path": "/nowhere/sweep.npz"}, {}),
    **{f"scenes.{name}": (make, {}, {}) for name, make in slcp.scenes.NAMED.items()},
}  # fmt: skip


with contextlib.suppress(ImportError):
    import torch

    import slcp_warp.torch as slcp_torch

    TENSORS = {"sim": sim(), "x0": torch.zeros(2, 6).double(), "controls": torch.zeros(2, 5, 2).double()}
    CALLS |= {
        "torch.rollout": (
            slcp_torch.rollout, TENSORS, {"x0": ("controls",), "params": ("mass", "parameter")}),
        "torch.step": (
            slcp_torch.step, {"sim": sim(), "x": TENSORS["x0"]},
            {"x": ("x0",), "params": ("mass", "parameter")}),
        "torch.Rollout": (slcp_torch.Rollout, {"sim": sim(), "learn": ("mass",), "log": ("mass",)}, {}),
    }  # fmt: skip


with contextlib.suppress(ImportError):
    import jax

    import slcp_warp.jax as slcp_jax

    SINGLE = slcp.Simulator(FINGER, device="cpu", dtype="float32")
    NUMBERS = {"sim": SINGLE, "x0": jax.numpy.zeros((2, 6)), "controls": jax.numpy.zeros((2, 5, 2))}
    CALLS |= {
        "jax.rollout": (
            slcp_jax.rollout, NUMBERS, {"x0": ("controls",), "params": ("mass", "parameter")}),
        "jax.step": (
            slcp_jax.step, {"sim": SINGLE, "x": NUMBERS["x0"]},
            {"x": ("x0",), "params": ("mass", "parameter")}),
        "jax.linearize": (
            slcp_jax.linearize, {"sim": SINGLE, "x": NUMBERS["x0"]},
            {"params": ("mass", "parameter")}),
    }  # fmt: skip


# What functions give back, and protocols: made by the package, not by its users.
GIVEN = {
    "Complementarity", "CostFunctions", "Dynamics", "DynamicsFunctions", "Energies", "FailureShare",
    "Falsification", "Fit", "Identified", "Momentum",
    "Linearization", "Multistart", "ParticleRollout", "Particles", "Pullback", "Pushforward", "Report",
    "Result", "Robust", "RobustnessMap", "Sampled", "Sensitivity", "SequentialComparison", "Situation",
    "StartPolicy",
    "Status", "Step", "SweepReport", "Trace", "Trajectory", "Tuned",
}  # fmt: skip


@pytest.mark.parametrize("module", [slcp, ddp, ddp.costs], ids=lambda module: module.__name__)
def test_every_public_function_is_tried(module):
    tried = {call for call, _, _ in CALLS.values()} | {ddp.Regularization}  # its fields are checked by rows()
    public = {name: getattr(module, name) for name in module.__all__ if name not in GIVEN}
    errors = {n for n, each in public.items() if isinstance(each, type) and issubclass(each, Exception)}
    assert [n for n, each in public.items() if callable(each) and each not in tried and n not in errors] == []


@pytest.mark.parametrize("module", [slcp, ddp, slcp.measures, ddp.costs], ids=lambda module: module.__name__)
def test_public_results_are_typed(module):
    functions = {name: getattr(module, name) for name in module.__all__}
    untyped = {
        name: each
        for name, each in functions.items()
        if inspect.isfunction(each) and each.__annotations__.get("return", typing.Any) is typing.Any
    }
    assert untyped == {}


def test_a_sweep_of_a_task_gives_its_report_and_one_of_a_scene_another():
    kinds = [each.__annotations__ for each in typing.get_overloads(slcp.sweep)]
    assert [kind["return"] for kind in kinds] == [slcp.Report, slcp.SweepReport]
    own = inspect.signature(slcp.sweep).parameters
    assert set(own) == set().union(*kinds) - {"return"}
    for each in typing.get_overloads(slcp.sweep):
        for name, parameter in inspect.signature(each).parameters.items():
            assert parameter.default in (own[name].default, inspect.Parameter.empty), name


@pytest.mark.parametrize("name", CALLS)
@given(data=st.data())
def test_a_call_works_or_says_what_is_wrong(monkeypatch_session, name, data):
    call, good, aliases = CALLS[name]
    argument = data.draw(st.sampled_from(arguments(call) or list(good)), label="argument")
    value = data.draw(values(), label="value")
    with no_kernels(monkeypatch_session), np.errstate(all="ignore"):
        judge(call, good, argument, value, aliases.get(argument, ()))
