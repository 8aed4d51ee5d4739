"""Numbers that are tuned over worlds, against those that a formula gives for the same worlds."""

from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.ensembles.questions.tuning.tune import NEW, SEARCHED
from slcp_warp.ensembles.questions.tuning.wanted import Outcome, Wanted, ranks
from slcp_warp.ensembles.worlds.seeds import seed_apart

STEPS, H = 20, 0.05
FAR = H * H * STEPS * (STEPS + 1) / 2.0  # x at the end of a unit acceleration, step by step
CART = slcp.Scene(
    "cart",
    bodies=(slcp.Body("cart", 2.0, 0.01, joint="prismatic"),),
    actuators=(slcp.Actuator("cart"),),
    step_size=H,
)
WORLDS = {"worlds": 200, "test_worlds": 300, "seed": 5}


def push(force: float, late: float = 0.0) -> slcp.policies.OpenLoop:
    """A constant force; `late` changes nothing but the last steps' force by a factor."""
    us = np.full((STEPS, 1), force)
    us[STEPS - 2 :] *= 1.0 + late
    return slcp.policies.OpenLoop(us, H)


def task(**changes) -> slcp.Task:
    fields = {
        "name": "cart", "scene": CART, "duration": STEPS * H,
        "measures": {"place": m.final("cart.shift"), "effort": m.integral(m.control("cart.shift"))},
        "success": m.final("cart.shift") > 1.0,
        "disturbances": slcp.Disturbances(parameters={"cart.mass": 0.3}),
    }  # fmt: skip
    return slcp.Task(**{**fields, **changes})


def masses(count: int, use: int, seed: int = 5) -> np.ndarray:
    """Of the cart in the worlds of a search, or in those of its judgement."""
    drawn = slcp.draw_worlds(task(), count, seed_apart(seed, use), dtype="float64")
    place = slcp.Simulator(CART, dtype="float64").params.layout.columns
    start = next(start for name, start, _ in place if name == "mass")
    return np.asarray(drawn.params)[:, start]


def test_the_least_force_is_that_of_the_heaviest_worlds_that_count(device):
    """x = f FAR / m: 90 % of the worlds reach 1 m where f is at least their mass's order statistic / FAR."""
    found = slcp.tune(
        task(), push, {"force": (1.0, 40.0)}, minimise="force", success=0.9, resolution=1e-4, device=device,
        dtype="float64", **WORLDS,
    )  # fmt: skip
    exact = np.sort(masses(200, SEARCHED))[179] / FAR
    assert exact < found.numbers["force"] < 1.003 * exact
    assert found.ended == "resolution" and found.at_end == ()
    share = (found.numbers["force"] * FAR / masses(300, NEW) > 1.0).mean()
    assert found.best.success[0] == pytest.approx(share, abs=1e-12)
    assert found.best.success[1] < share < found.best.success[2]
    assert found.first.numbers == {"force": 20.5} and found.first.success[0] == 1.0
    assert found.better[0] == pytest.approx(share - 1.0) and found.best.value[0] == found.numbers["force"]
    np.testing.assert_array_equal(found.policy.us, push(found.numbers["force"]).us)
    assert found.share == 0.9 and "are not kept" not in " ".join(str(found).split())
    flattered = replace(found, best=replace(found.best, success=(0.85, 0.82, 0.88)))
    told = " ".join(str(flattered).split())
    assert "! 90 % are not kept in worlds that the search has not seen" in told
    few = replace(found, tried=found.tried | {"success_share": 0.5 * found.tried["success_share"]})
    told = " ".join(str(few).split())
    assert "! no candidate reached 90 %; the best of them succeeded in 50 % of the search's own" in told


def test_the_force_that_reaches_a_mark_most_often(device):
    """1 < f FAR / m < 1.5: the share is that of masses in an interval, and no force has one much larger."""
    marked = task(success=(m.final("cart.shift") > 1.0) & (m.final("cart.shift") < 1.5))
    found = slcp.tune(marked, push, {"force": (0.5, 100.0)}, log="force", device=device, **WORLDS)
    drawn = masses(200, SEARCHED)

    def share(force):
        return ((force * FAR / drawn > 1.0) & (force * FAR / drawn < 1.5)).mean()

    most = max(map(share, np.geomspace(0.5, 100.0, 2000)))
    assert most - 0.011 <= share(found.numbers["force"]) <= most
    assert found.tried["force"][0] == pytest.approx(np.sqrt(50.0)) and found.value_name is None
    for force, told in zip(found.tried["force"], found.tried["success_share"], strict=True):
        assert told == pytest.approx(share(force), abs=0.006)  # float32 at the bounds


def test_a_margin_leads_where_no_world_succeeds(device):
    """Success is a twentieth of the range away from where any candidate of the first round is."""
    far = task(success=(m.final("cart.shift") > 1.0) & (m.final("cart.shift") < 1.6))
    options = {"start": {"force": 390.0}, "device": device, "worlds": 50, "test_worlds": 50, "seed": 1}
    found = slcp.tune(far, push, {"force": (0.0, 400.0)}, **options)
    assert found.first.success[0] == 0.0 < 0.5 < found.best.success[0]


def test_a_measure_alone_and_two_numbers(device):
    """The mean place is least at the least force and `late`; both are at the ends of their ranges."""
    ranges = {"force": (1.0, 3.0), "late": (-0.5, 0.5)}
    options = {"device": device, "worlds": 20, "test_worlds": 40, "rounds": 60}
    found = slcp.tune(task(success=None), push, ranges, minimise="place", **options)
    assert found.at_end == ("force", "late") and found.best.success[0] == 1.0
    assert found.numbers == pytest.approx({"force": 1.0, "late": -0.5}, abs=0.02)
    most = slcp.tune(task(success=None), push, ranges, maximise="place", **options)
    assert most.numbers == pytest.approx({"force": 3.0, "late": 0.5}, abs=0.02)
    assert most.best.value[1] < most.best.value[0] < most.best.value[2]
    assert most.best.value[0] > most.first.value[0] > found.best.value[0]
    assert {"mean_place", "success_share"} < set(most.tried)


def test_numbers_of_the_scene(device):
    """A factor on what was drawn, and the number itself, of which nothing is drawn then."""
    least = {"maximise": "place", "device": device, "worlds": 30, "test_worlds": 30, "rounds": 30}
    factor = slcp.tune(task(), push(4.0), parameters={"cart.mass": (0.5, 2.0)}, log=("cart.mass",), **least)
    assert factor.numbers["cart.mass"] == pytest.approx(0.5, rel=0.02)
    assert factor.best.value[0] == pytest.approx(4.0 * FAR * (2.0 / masses(30, NEW, 0)).mean(), rel=0.02)
    itself = slcp.tune(task(), push(4.0), parameters={"cart.mass=": (1.0, 4.0)}, **least)
    assert itself.best.value[0] == pytest.approx(4.0 * FAR / itself.numbers["cart.mass="], rel=1e-5)
    assert itself.best.success[0] == 1.0 and itself.best.value[1] == pytest.approx(itself.best.value[2])


def test_its_worlds_are_those_of_a_sweep(device):
    """Of the same seed and numbers, with noise and kicks; a search changes nothing about them."""
    noisy = task(
        disturbances=slcp.Disturbances(
            parameters={"cart.mass": 0.3}, torque=0.5, sensor=0.1, kick_times=(0.2,), kick=0.3
        )
    )
    found = slcp.tune(
        noisy, push, {"force": (1.0, 40.0)}, rounds=1, candidates=4, seed=2, worlds=40, test_worlds=30,
        device=device,
    )  # fmt: skip
    assert found.ended == "rounds" and len(found.tried["round"]) == 5
    for place, (use, count) in enumerate({SEARCHED: 40, NEW: 30}.items()):
        worlds = slcp.draw_worlds(noisy, count, seed_apart(2, use))
        force = found.tried["force"][3] if place == 0 else found.numbers["force"]
        seed = seed_apart(2, use)  # of the noise, too: what chose has met other torques
        report = slcp.sweep(noisy, push(force), worlds=worlds, seed=seed, cases=noisy.options, device=device)
        share = report.part("policy")["success"].mean()
        assert share == (found.tried["success_share"][3] if place == 0 else found.best.success[0])


def test_an_interrupt_keeps_what_was_best(device):
    calls = []

    def progress(done, total):
        calls.append((done, total))
        if len(calls) == 7:
            raise KeyboardInterrupt

    found = slcp.tune(
        task(), push, {"force": (1.0, 10.0)}, worlds=10, test_worlds=10, progress=progress, device=device
    )
    assert found.ended == "interrupted" and len(calls) == 9 and calls[-1][1] == 10 * (1 + 8 * 40) + 20
    assert len(found.tried["round"]) == 6
    assert found.numbers["force"] in found.tried["force"]


def test_the_table_is_saved(device, tmp_path):
    ranges = {"force": (1.0, 10.0)}
    found = slcp.tune(task(), push, ranges, rounds=1, worlds=10, test_worlds=10, device=device)
    lines = found.save(tmp_path / "tuned.csv").read_text().splitlines()
    assert lines[0] == "round,force,success_share" and len(lines) == 10
    assert "most success: force = " in repr(found) and "success [%]" in str(found)
    assert "..." not in repr(found) and f"worlds each, ended by {found.ended}" in " ".join(str(found).split())


@pytest.mark.parametrize(
    "changes, told",
    [
        ({}, "numbers and parameters are both empty"),
        (
            {"numbers": {"force": (2.0, 1.0)}},
            r"numbers\['force'\] is \(2.0, 1.0\); \(low, high\), low < high",
        ),
        ({"numbers": {"force": (1.0,)}}, r"numbers\['force'\] has shape"),
        ({"numbers": ["force"]}, "numbers is .*a dict of ranges"),
        (
            {"numbers": {"force": (0.0, 1.0)}, "log": "force"},
            "log has 'force', whose range begins at or below 0",
        ),
        ({"numbers": {"force": (0.0, 1.0)}, "log": "fore"}, r"log names \['fore'\]; choose from force"),
        ({"numbers": {"force": (0.0, 1.0)}, "start": {"force": 2.0}}, r"start\['force'\] is 2.0"),
        ({"numbers": {"force": (0.0, 1.0)}, "start": {"fore": 2.0}}, r"start names \['fore'\]"),
        (
            {"numbers": {"force": (0.0, 1.0)}, "policy": push(1.0)},
            r"a function of \(force\) that gives a policy",
        ),
        ({"numbers": {"force": (0.0, 1.0)}, "minimise": "cost"}, "minimise is 'cost'"),
        ({"numbers": {"force": (0.0, 1.0)}, "minimise": "place", "maximise": "place"}, "are both given"),
        ({"numbers": {"force": (0.0, 1.0)}, "success": 0.9}, "success is a share that is to be kept"),
        ({"numbers": {"force": (0.0, 1.0)}, "minimise": "place", "success": 1.5}, "success is 1.5"),
        ({"numbers": {"effort": (0.0, 1.0)}, "minimise": "effort"}, "which is a measure and a number"),
        ({"parameters": {"cart.weight": (0.5, 1.0)}}, r"parameters\['cart.weight'\] is 'cart.weight'"),
        ({"parameters": {"cart.mass": (-0.5, 1.0)}}, "takes positive factors"),
        ({"parameters": {"cart.mass=": (0.5, 1.0), "mass=": (0.5, 1.0)}}, "are values of the same numbers"),
        (
            {"parameters": {"cart.mass=": (0.5, 1.0), "cart.mass": (0.5, 1.0)}},
            "are values of the same numbers",
        ),
        ({"numbers": {"mass": (0.5, 1.0)}, "parameters": {"mass": (0.5, 1.0)}}, "both have 'mass'"),
    ],
)
def test_what_cannot_be_tuned_is_refused(changes, told):
    with pytest.raises(slcp.InputError, match=told):
        slcp.tune(**{"task": task(), "policy": push} | changes)


def test_nothing_to_choose_by_is_refused():
    with pytest.raises(slcp.ArgumentError, match="neither success nor failure"):
        slcp.tune(task(success=None), push, {"force": (0.0, 1.0)})


def test_an_error_of_a_users_function_says_of_which_numbers(device):
    def broken(force):
        raise ZeroDivisionError("none")

    with pytest.raises(ZeroDivisionError) as raised:
        slcp.tune(task(), broken, {"force": (0.0, 1.0)}, device=device)
    assert raised.value.__notes__ == ["policy(force=0.5)"]
    with pytest.raises(TypeError, match=r"takes \(power\), the numbers are \(force\): missing .* 'power'"):
        slcp.tune(task(), lambda power: push(power), {"force": (0.0, 1.0)}, device=device)
    with pytest.raises(slcp.ArgumentTypeError, match=r"policy takes \(force, time\), .*\(force\): missing"):
        slcp.tune(task(), lambda force, time: push(force), {"force": (0.0, 1.0)}, device=device)


def test_unsolved_worlds_cost_most_where_a_measure_alone_counts():
    """Their mean is of the others, however small that is."""
    wanted = Wanted(replace(task(), success=None), ("force",), "place", None, None)
    none, ones = np.zeros(4, bool), np.ones(4)
    lost = wanted.cost(Outcome(none, ones, np.array([-9.0, -9.0, -9.0, np.nan])))
    kept = wanted.cost(Outcome(none, ones, np.array([5.0, 5.0, 5.0, 5.0])))
    gone = wanted.cost(Outcome(none, ones, np.full(4, np.nan)))
    assert kept < lost < gone and ranks([lost, kept, gone, kept]) == [1.0, 0.0, 2.0, 0.0]
