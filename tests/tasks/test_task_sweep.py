"""Sweeps of tasks: measures inside the kernels against recorded rollouts, paired worlds, limits, errors."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp import measures as m
from slcp_warp.ensembles.tasks import TaskSweep

SCENE = replace(slcp.scenes.push_block(), step_size=0.02, sigma=0.05)
COST = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
PAIR = SCENE.pair_names[-1]
N = 60
MEASURES = {
    "initial": m.initial("pusher.shift", start=0.2),
    "final": m.final("block.x", end=1.0),
    "rate": m.rate("block.x", 0.1, 1.01),
    "mean": m.mean("pusher.vshift"),
    "integral": m.integral(m.control("pusher.shift")),
    "total": m.total(m.normal_impulse(PAIR)),
    "largest": m.largest("block.angle"),
    "smallest": m.smallest(m.cosine("block.angle")),
    "apart": m.smallest(m.state("block.x", "pusher.shift")),
    "share": m.share_of_time((m.state("block.vx") > 0.01) & (m.time() < 0.9)),
    "first": m.first_time(m.contact(PAIR) > 0.5),
    "or": m.first_time((m.state("block.x") > 5.0) | (m.gap(PAIR) < 0.02)),
    "settled": m.settled(m.state("block.x") > 0.02),
    "never": m.settled(m.state("block.x") > 9.0),
    "touches": m.count(m.contact() > 0.5),
    "contact": m.contact_share(),
    "gap": m.lowest_gap(PAIR),
    "far": m.largest(m.gap(PAIR)),
    "apart by": m.mean(m.gap()),
    "never far": m.first_time(m.gap(SCENE.pair_names[0]) > 0.3),
    "impulse": m.impulse(),
    "late": m.mean("block.x", start=1.199, end=1.1995),
    "change": m.change("pusher.shift"),
    "slid": m.excursion(m.state("block.x", "pusher.shift"), start=0.4),
    "swung": m.largest(abs(m.state("block.angle"))),
    "rms": m.rms("block.vx", 0.1),
    "rubbed": m.integral(abs(m.slip("ground/block"))),
    "pace": m.mean("block.vx", where=m.contact("block/pusher") > 0.5),
    "back": m.share_of_time((m.since_start("block.vx") < 0.05) & (abs(m.state("block.x", 0)) < 0.2)),
}


def plan(scale: float = 1.0) -> ddp.TrackingPolicy:
    """Forces that push the block, on their own."""
    us = scale * (3.0 + 2.0 * np.sin(0.3 * np.arange(N)))[:, None]
    return ddp.TrackingPolicy(SimpleNamespace(us=us, xs=np.zeros((N + 1, 8)), K=np.zeros((N, 1, 8))))


def task(**changes) -> slcp.Task:
    fields = {
        "name": "push", "scene": SCENE, "cost": COST, "horizon": N, "measures": MEASURES,
        "disturbances": slcp.Disturbances(parameters={"mass": 0.1}, start={"pusher.shift": 0.02}, torque=0.3),
        "success": (m.final("block.x") > 0.15) & (m.largest("block.angle") < 0.5),
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


@pytest.mark.parametrize("residual, strategy", [("rem-logistic", "specialised"), ("hard", "generic")])
def test_measures_are_those_of_the_recorded_run(device, residual, strategy):
    starts = SCENE.x0 + np.outer(np.linspace(-0.05, 0.05, 5), np.eye(8)[0])
    options = slcp.Options(residual=residual)
    report = slcp.sweep(
        task(start=starts), plan(), worlds=1, cases=options, dtype="float64", device=device, strategy=strategy
    )
    found = report.part("policy", arm="undisturbed")
    sim = slcp.Simulator(SCENE, options, dtype="float64", device=device)
    run = sim.rollout(starts, policy=plan(), steps=N, record=("controls", "impulse", "gap"))
    assert (found["status"] == 0).all() and (run.status == 0).all()
    for name, measure in MEASURES.items():
        np.testing.assert_allclose(found[name], run.measure(measure), rtol=1e-9, atol=1e-12, err_msg=name)
    assert found["success"].tolist() == run.measure(task().success).tolist()
    assert 0.0 < found["contact"].min() and np.isinf(found["never"]).all() and np.isnan(found["late"]).all()


@pytest.mark.parametrize(
    "residual, strategy",
    [("rem-logistic", "specialised"), pytest.param("hard", "generic", marks=pytest.mark.full)],
)
def test_records_are_those_of_the_recorded_run(device, residual, strategy):
    """Several states at once, less their start, in the undisturbed world and through a kick."""
    kicked = task(disturbances=slcp.Disturbances(kick_times=(0.2,), kick=1.0))
    options, names = slcp.Options(residual=residual), ("block.x", "pusher.vshift")
    choices = {"worlds": 3, "cases": options, "dtype": "float64", "device": device, "strategy": strategy}
    report = slcp.sweep(kicked, plan(), record=names, record_every=0.1, **choices)
    found, hit = report.part("policy", arm="undisturbed"), report.part("policy")
    states = slcp.Simulator(SCENE, options, dtype="float64", device=device).rollout(
        SCENE.x0, policy=plan(), steps=N
    ).states  # fmt: skip
    plain = slcp.sweep(kicked, plan(), **choices)
    assert report.measures == plain.measures == tuple(MEASURES)
    for name in names:
        place = SCENE.state_index(name)
        for n in range(13):
            column, exact = f"recorded_{name}_{n * 0.1:.9g}", states[5 * n, place] - states[0, place]
            np.testing.assert_allclose(found[column], exact, rtol=1e-6, atol=1e-9, err_msg=column)
            moved = np.abs(hit[column] - found[column]) > 1e-6
            assert not moved.any() if n <= 2 else moved.any(), "a record comes before the kick of its time"
    assert set(hit) - set(plain.part("policy")) == {
        f"recorded_{name}_{n * 0.1:.9g}" for name in names for n in range(13)
    }
    for name in plain.part("policy"):
        np.testing.assert_array_equal(hit[name], plain.part("policy")[name], err_msg=name)


@pytest.mark.parametrize(
    "record, every, text",
    [
        ("block.x", 0.1, "record is 'block.x'; a tuple of states"),
        (("block.z",), 0.1, "block.z"),
        (("block.x", 1), 0.1, "each state once"),
        (("block.x",), 2.0, "record_every is 2.0; at most the duration 1.2"),
        (("block.x",), 1e-12, "record_every is 1e-12; at most"),
        ((), 0.0, "record_every is 0.0"),
    ],
)
def test_bad_records_are_refused(record, every, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.sweep(task(), plan(), worlds=2, record=record, record_every=every)


def test_policies_meet_the_same_worlds(device):
    report = slcp.sweep(task(), {"all": plan(), "half": plan(0.5)}, worlds=300, seed=3, device=device)
    full, half = report.part("all"), report.part("half")
    for name in (n for n in full if n.startswith("drawn_")):
        np.testing.assert_array_equal(full[name], half[name])
    assert len(np.unique(full["drawn_pusher.mass"])) == 300
    mean, low, high = report.compare("all", "half")["final"]
    assert 0.0 < low < mean < high and mean == pytest.approx(np.mean(full["final"] - half["final"]))
    again = slcp.sweep(task(), plan(), worlds=300, seed=3, chunk=77, device=device)
    np.testing.assert_array_equal(again.part("policy")["final"], full["final"])
    table = report.table
    assert {len(column) for column in table.values()} == {2 * 2 * (300 + 1)}
    assert set(table["arm"]) == {"disturbed", "undisturbed"} and set(table["case"]) == {
        "rem-logistic",
        "hard",
    }
    assert [row["worlds"] for row in report.summary] == [300, 1] * 4
    rate = report.summary[0]["success"]
    assert rate[1] <= rate[0] <= rate[2] and rate[0] == full["success"].mean()


def test_limits_hold_whatever_the_policy_says(device):
    bound = {"most": m.largest(m.control(0)), "least": m.smallest(m.control(0))}
    still = slcp.Disturbances()
    limited = task(measures=bound, success=None, control_limits=(-1.0, 2.5), disturbances=still)
    found = slcp.sweep(limited, plan(), worlds=3, device=device, cases=slcp.Options()).part("policy")
    assert (found["most"] == 2.5).all() and (found["least"] >= 0.999).all() and found["success"].all()


def test_kicks_come_when_they_are_due(device):
    """The pusher's speed is the same until the kick, which adds normal numbers of the size asked for."""
    speeds = {"before": m.final("pusher.vshift", end=0.4), "after": m.initial("pusher.vshift", start=0.4)}
    still = task(measures=speeds, success=None, disturbances=slcp.Disturbances())
    kicked = still.replace(disturbances=slcp.Disturbances(kick_times=(0.4,), kick=0.5))
    runs = [slcp.sweep(t, plan(), worlds=200, device=device, cases=slcp.Options()) for t in (still, kicked)]
    a, b = (run.part("policy") for run in runs)
    np.testing.assert_array_equal(a["before"], b["before"])
    added = b["after"] - a["after"]
    assert len(np.unique(added)) == 200 and abs(added.mean()) < 0.15 and 0.4 < added.std() < 0.6


@pytest.mark.parametrize(
    "fields, text",
    [
        ({"parameters": {"frict": 0.1}}, "names 'frict'; friction is like it; choose from"),
        ({"parameters": {"mass": 2.0}}, r"in \[0, 2.0\)"),
        ({"parameters": {"mass": -0.1}}, r"Disturbances.parameters\['mass'\]"),
        ({"torque": -1.0}, "Disturbances.torque"),
        ({"kick_times": 1.0}, "Disturbances.kick_times is 1.0"),
        ({"start": [1.0]}, "Disturbances.start"),
    ],
)
def test_what_is_no_disturbance_is_refused(fields, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.Disturbances(**fields)


def test_worlds_that_fail_count_for_no_measure(device):
    """Infinite speed from the kick on: measures are not a number, comparisons leave these worlds out."""
    own = task(disturbances=slcp.Disturbances(kick_times=(0.4,), kick=1e30), success=None)
    report = slcp.sweep(own, {"a": plan(), "b": plan(0.5)}, worlds=20, device=device, cases=slcp.Options())
    failed = report.part("a")
    assert (failed["status"] != 0).all() and not failed["success"].any()
    assert all(np.isnan(failed[name]).all() for name in MEASURES)
    assert np.isnan(report.summary[0]["final"][0]) and np.isnan(report.compare("a", "b")["final"][0])


def test_short_tasks_run(device):
    short = task(duration=0.05, measures={"end": m.final(m.time())}, success=None)
    report = slcp.sweep(short, plan(), worlds=2, device=device, cases=slcp.Options())
    assert short.steps == 3 and report.part("policy")["end"] == pytest.approx([0.06, 0.06])
    one = task(horizon=1, duration=None, measures={"end": m.final(m.time())}, success=None)
    alone = slcp.sweep(one, plan(), worlds=1, device=device, cases=slcp.Options())
    assert alone.part("policy")["end"] == pytest.approx([0.02])
    hard = task(options=slcp.Options(residual="hard"), measures={}, success=None)
    assert len(slcp.sweep(hard, plan(), worlds=1, device=device).parts) == 2


@wp.func
def kinetic_energy(x: wp.types.vector(8, wp.float32), u: wp.types.vector(1, wp.float32), time: wp.float64):
    return wp.float32(0.5) * (x[5] * x[5] + x[6] * x[6])


@wp.func
def root(x: Any, u: Any, time: wp.float64):
    return wp.sqrt(wp.float64(0.61) - time)


def test_a_measure_of_a_users_function(device):
    """Half the squared speed of the block, by a Warp function and by the speeds' own measures. What is no
    number later is told: the largest and the smallest value of before were.
    """
    lost = m.function(root)
    own = {"energy": m.largest(m.function(kinetic_energy)), "speed": m.largest("block.vx"),
           "up": m.largest("block.vy"), "down": m.smallest("block.vy"),
           "most": m.largest(lost), "least": m.smallest(lost), "last": m.final(lost),
           "before": m.smallest(lost, end=0.61), "began": m.largest(lost, end=0.61)}  # fmt: skip
    found = slcp.sweep(task(measures=own), plan(), worlds=20, device=device, cases=slcp.Options()).part(
        "policy"
    )
    assert all(np.isnan(found[name]).all() for name in ("most", "least", "last"))
    np.testing.assert_allclose(found["before"], 0.1, rtol=1e-5)
    np.testing.assert_allclose(found["began"], np.sqrt(0.61), rtol=1e-12)
    most = 0.5 * (found["speed"] ** 2 + np.maximum(np.abs(found["up"]), np.abs(found["down"])) ** 2)
    assert (found["energy"] >= 0.5 * found["speed"] ** 2 * (1 - 1e-6)).all()
    assert (found["energy"] <= most * (1 + 1e-6)).all() and found["energy"].min() > 0.0


@pytest.mark.parametrize(
    "changes, text",
    [
        ({"name": ""}, "Task.name is ''"),
        ({"scene": "push"}, "Task.scene is a str"),
        ({"cost": 1.0}, "Task.cost is a float"),
        ({"cost": slcp.tasks.flicking_finger().cost}, "Task.cost is for nx = 6, scene 'push_block' has 8"),
        ({"horizon": 0}, "Task.horizon is 0"),
        ({"duration": -1.0}, "Task.duration is -1.0"),
        ({"options": "hard"}, "Task.options is a str"),
        ({"control_limits": (1.0, -1.0)}, "a lower limit is above"),
        ({"control_limits": (np.zeros((2, 1)), np.ones((2, 1)))}, "Task.control_limits are 2 rows"),
        ({"start": np.zeros(7)}, r"Task.start has shape \(1, 7\)"),
        ({"start": {"block.z": 1.0}}, "'block.z'"),
        ({"disturbances": slcp.Disturbances(start={"cart.x": 1.0})}, "'cart.x'"),
        ({"disturbances": {"mass": 0.1}}, "Task.disturbances is"),
        ({"measures": {"x": m.final("block.z")}}, r"Task.measures\['x'\]: .*'block.z'"),
        ({"measures": {"x": m.final(m.control("cart"))}}, "control is 'cart'"),
        ({"success": m.final("block.z") > 1.0}, "Task.success: final: .*'block.z'"),
        ({"success": m.final("block.x")}, "Task.success is"),
        ({"measures": {"world": m.final(0)}}, "Task.measures names 'world', which every"),
        ({"measures": {"worlds": m.final(0)}}, "Task.measures names 'worlds', which every"),
        ({"measures": {"drawn_mass_0": m.final(0)}}, "Task.measures names 'drawn_mass_0'"),
        ({"measures": {"x": m.mean(0, start=1.2)}}, "counts from 1.2 s on; a run ends"),
        ({"disturbances": slcp.Disturbances(kick_times=(1.3,), kick=1.0)}, "times before the end"),
        ({"disturbances": slcp.Disturbances(delay=1.3)}, "delay holds 1.3; times before the end"),
        ({"disturbances": slcp.Disturbances(kick_times=(1.195,), kick=1.0)}, "1.195; .* up to 1.19 are felt"),
    ],
)
def test_what_is_no_task_is_refused(changes, text):
    with pytest.raises(slcp.InputError, match=text):
        task(**changes)


@pytest.mark.parametrize(
    "given, text",
    [
        ({"policy": {}}, "policies is {}"),
        ({"policy": 3}, "policy"),
        ({"cases": "hard"}, "cases is 'hard'"),
        ({"cases": {}}, "cases is {}"),
        ({"cases": {"": slcp.Options("hard")}}, "by name are needed"),
        ({"cases": [slcp.Options("hard")] * 2}, "each of them once"),
        ({"worlds": 0}, "worlds is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"step_sizes": (0.0,)}, "step_size"),
        ({"step_sizes": 0.02}, "step_sizes is 0.02; at least one, in a tuple"),
        ({"step_sizes": (0.02, 0.02)}, "each of them once"),
        ({"spec": slcp.SweepSpec()}, "a task has its own"),
    ],
)
def test_sweeps_that_cannot_be_made(given, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.sweep(task(), given.pop("policy", plan()), device="cpu", **given)


def test_a_step_too_coarse_for_the_last_kick_is_refused():
    own = task(disturbances=slcp.Disturbances(kick_times=(1.18,), kick=1.0))
    with pytest.raises(slcp.InputError, match=r"1.18; of a run of 1.2 s in steps of 0.1 s .* up to 1.15"):
        slcp.sweep(own, plan(), device="cpu", worlds=1, step_sizes=(0.1,))


def test_a_report_says_what_there_is(tmp_path):
    report = slcp.sweep(task(), plan(), worlds=5, device="cpu", cases=slcp.Options())
    told = str(report).splitlines()
    assert told[0] == "Report of task 'push': 2 parts" and " disturbed " in told[2] and "  5  " in told[2]
    after = told[2].split("disturbed")[1].split()
    assert "worlds  unsolved " in told[1] and after[:2] == ["5", "0"]
    unknown = {
        "policy is 'mine'; choose from": ("mine",),
        "case is 'mine'; choose from": ("policy", "mine"),
        "step_size is 9.0; choose from": ("policy", None, 9.0),
        "arm is 'mine'; choose from": ("policy", None, None, "mine"),
    }
    for named, arguments in unknown.items():
        with pytest.raises(slcp.InputError, match=named):
            report.part(*arguments)
    text = report.save(tmp_path / "report.csv").read_text().splitlines()
    assert len(text) == 1 + 5 + 1 and text[0].startswith("policy,case,step_size,arm,world,drawn_pusher.mass")
    with pytest.raises(slcp.InputError, match=".csv, .npz or .parquet is needed"):
        report.save(tmp_path / "report.txt")


@pytest.mark.parametrize("name", slcp.tasks.NAMED)
def test_named_tasks_are_tasks(name):
    found = slcp.tasks.NAMED[name]()
    assert (
        found.name == name and found.measures and found.success is not None and found.steps >= found.horizon
    )
    assert found.start.shape == (1, 2 * found.scene.nv)


def test_chunks_on_their_own_are_the_sweep(device):
    """Run backwards, every second time after another part's, chunks have the rows that the sweep has."""
    fields = {"worlds": 30, "seed": 3, "chunk": 8, "device": device, "cases": slcp.Options()}
    work = TaskSweep(task(), {"all": plan(), "half": plan(0.5)}, **fields)
    report = slcp.sweep(task(), {"all": plan(), "half": plan(0.5)}, **fields)
    assert [chunk.worlds for chunk in work.chunks] == 2 * [8, 8, 8, 6, 1] and work.chunks.worlds == 62
    order = [0, 9, 1, 8, 2, 7, 3, 6, 4, 5]
    found = {index: work.run(index) for index in order}
    for name in found[0]:
        rows = np.concatenate([found[index].get(name, np.full(1, np.nan)) for index in range(10)])
        np.testing.assert_array_equal(rows, report.table[name], err_msg=name)


def test_a_sequential_comparison_stops_when_it_is_decided(device):
    """Its worlds are the first ones of the sweep with its seed; half the force moves the block less far."""
    policies = {"all": plan(), "half": plan(0.5)}
    found = slcp.compare_sequentially(
        task(), policies, worlds=300, batch=64, seed=3, case=slcp.Options(), device=device
    )
    assert found.decision == "larger" and found.report.complete
    report = slcp.sweep(task(), policies, worlds=300, seed=3, cases=slcp.Options(), device=device)
    for name in policies:
        part = found.report.part(name)
        assert len(part["world"]) == found.worlds < 300
        for column, values in part.items():
            np.testing.assert_array_equal(values, report.part(name)[column][: found.worlds], err_msg=column)
    assert found.difference[0] == found.report.compare("all", "half")["success"][0] > 0.0
    assert "all less half" in repr(found) and "all is larger" in repr(found)
    how = {"measure": "final", "margin": 0.01, "worlds": 300, "batch": 100, "device": device}
    equals = {"a": plan(), "b": plan()}
    same = slcp.compare_sequentially(task(), equals, statistic="mean", **how)  # no variance, no interval
    assert (same.decision, same.worlds, same.difference) == ("undecided", 300, (0.0, -np.inf, np.inf))
    same = slcp.compare_sequentially(task(), equals, **how)
    assert (same.decision, same.worlds, same.difference) == ("equal", 100, (0.0, 0.0, 0.0))
    bounded = slcp.compare_sequentially(task(), policies, bounds=(0.0, 0.5), **how)
    assert (bounded.statistic, bounded.decision) == ("mean", "larger") and "median" not in repr(bounded)
    for wrong in ({"bounds": (1, 0)}, {"statistic": "mode"}, {"measure": "success", "statistic": "median"}):
        with pytest.raises(slcp.InputError, match=r"bounds is|statistic is '(mode|median)'"):
            slcp.compare_sequentially(task(), policies, **how | wrong)
    with pytest.raises(slcp.InputError, match="policies is"):
        slcp.compare_sequentially(task(), {"a": plan()})
    with pytest.raises(slcp.InputError, match="measure is 'speed'"):
        slcp.compare_sequentially(task(), policies, measure="speed")


def test_sensitivity_names_what_matters(device):
    """Of the start's place nothing but its own draw; of the end the same as a sweep's table says."""
    noise = {"parameters": {"mass": 0.1, "inertia": 0.1}, "start": {"pusher.shift": 0.02}, "torque": 0.3}
    own = task(
        measures={"begin": m.initial("pusher.shift"), "final": MEASURES["final"]},
        disturbances=slcp.Disturbances(**noise),
    )
    policy, options = {"push": plan()}, {"case": slcp.Options(), "device": device}
    found = slcp.sensitivity(own, policy, measure="begin", samples=64, **options)
    drawn = ("pusher.mass, pusher.inertia", "block.mass, block.inertia", "pusher.shift", "noise of steps")
    assert set(found.names) == set(drawn) and found.worlds == 64 * 6 and found.policy == "push"
    for name, first, total in zip(found.names, found.first, found.total):
        assert total[0] == pytest.approx(1.0 if name == "pusher.shift" else 0.0, abs=0.3)
        assert (name == "pusher.shift") or (first == total == (0.0, 0.0, 0.0))
    found = slcp.sensitivity(own, policy, measure="final", samples=512, seed=1, **options)
    assert ".mass" in found.names[found.order[0]] and sum(each[0] for each in found.first) < 1.2
    rows = slcp.sweep(own, policy, worlds=2048, seed=2, cases=slcp.Options(), device=device)
    free = rows.sensitivity("final")
    for name, (value, low, high) in zip(free.names, free.first):
        first = found.first[found.names.index(name)]
        assert abs(value - first[0]) < 2.0 * (high - low + first[2] - first[1])
    with pytest.raises(slcp.InputError, match="nothing is drawn"):
        slcp.sensitivity(task(disturbances=slcp.Disturbances()), policy, **options)
    with pytest.raises(slcp.InputError, match="policy is .*; one is needed"):
        slcp.sensitivity(own, {"a": plan(), "b": plan()}, **options)
