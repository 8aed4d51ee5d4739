"""Logs from tables, and `slcp identify`."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from test_identify import CART, H, cart, carts
from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp import policies
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.scripts.app import app
from slcp_warp.storage.files import FileError

HEAD = ("time", "control cart.shift", "cart.shift", "world")


def write(path, rows, head=HEAD):
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    return path


def rows_of(seen, us, every=1, start=3.0):
    """Every so many steps a row; the last without a control."""
    rows = [(start + k * H, us[k, 0] if k < len(us) else "", seen[k, 0], 0) for k in range(len(seen))]
    return rows[::every]


def test_rows_are_put_on_the_steps_of_the_model(tmp_path):
    seen, us = np.arange(9.0)[:, None], 10.0 + np.arange(8.0)[:, None]
    rows = rows_of(seen, us, every=2)
    rows[1] = (rows[1][0] + 0.2 * H, rows[1][1], "", 0)  # late, and not read
    measured, controls = slcp.load_log(write(tmp_path / "log.csv", rows), cart())
    np.testing.assert_array_equal(measured[:, 0], [0, np.nan, np.nan, np.nan, 4, np.nan, 6, np.nan, 8])
    np.testing.assert_array_equal(controls[:, 0], [10, 10, 12, 12, 14, 14, 16, 16])
    assert measured.shape == (9, 1) and controls.shape == (8, 1)


def test_tables_that_are_no_logs(tmp_path):
    good = rows_of(np.zeros((4, 1)), np.zeros((3, 1)))

    def changed(row, column, value):
        return [
            tuple(value if (i, j) == (row, column) else cell for j, cell in enumerate(each))
            for i, each in enumerate(good)
        ]

    cases = {
        "lies between steps": changed(1, 0, good[1][0] + 0.4 * H),
        "two rows in one": changed(1, 0, good[2][0] - 0.1 * H),
        "does not rise at 2": changed(2, 0, 2.0),
        "'control cart.shift' holds ''": changed(1, 1, ""),
        "'cart.shift' holds 'inf'": changed(1, 2, "inf"),
        "'time' holds 'now'": changed(0, 0, "now"),
        "rows of several worlds": changed(2, 3, 1),
        "it lasts": changed(3, 0, 1e9),
    }
    for said, rows in cases.items():
        with pytest.raises(FileError, match=f"cannot be read as a log: .*{said}"):
            slcp.load_log(write(tmp_path / "log.csv", rows), cart())
    with pytest.raises(FileError, match="no columns cart.shift"):
        slcp.load_log(
            write(tmp_path / "log.csv", good, ("time", "control cart.shift", "place", "remark")), cart()
        )
    with pytest.raises(FileNotFoundError):
        slcp.load_log(tmp_path / "none.csv", cart())
    with pytest.raises(ArgumentError, match="csv is needed"):
        slcp.load_log(tmp_path / "log.txt", cart())


def test_the_command_finds_what_python_finds(tmp_path):
    rng = np.random.default_rng(3)
    seen, us = carts(rng, 2.9)
    paths = [write(tmp_path / f"{i}.csv", rows_of(seen[i], us[i])) for i in range(3)]
    slcp.save_scene(CART, tmp_path / "cart.json")
    out = tmp_path / "found.csv"
    given = [
        *("identify", *map(str, paths[:2]), "--scene", str(tmp_path / "cart.json"), "--sensor"),
        *("cart.shift=0.02", "--process", "0.3", "--parameter", "cart.mass=0.5", "--process-noise", "0"),
        *("--judge", str(paths[2]), "--residual", "hard", "--device", "cpu", "--out", str(out)),
    ]
    run = CliRunner().invoke(app, given)
    assert run.exit_code == 0, run.output
    assert "2.csv: off by" in run.output.replace("\n", "")
    found = slcp.identify(cart(), seen[:2], us[:2], {"cart.mass": slcp.LogNormal(0.5, shared=True)})
    with open(out, newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["name"] == "cart.mass"
    told = [float(row[name]) for name in ("value", "low", "high", "deviation_left")]
    np.testing.assert_allclose(told, [*found.values["cart.mass"], found.learned["cart.mass"]], rtol=1e-9)
    for bad in ("cart.mass=heavy", "cart.mass"):
        run = CliRunner().invoke(app, [bad if each == "cart.mass=0.5" else each for each in given])
        assert run.exit_code != 0 and "--parameter is" in run.output.replace("\n", " ")
    own = tmp_path / "own.py"
    own.write_text(
        "from slcp_warp import measures, policies\n"
        'SENSORS = {"cart.shift": policies.Sensor(measures.state("cart.shift"), 0.02)}\nNONE = 3\n'
    )
    by_file = [f"{own}:SENSORS" if each == "cart.shift=0.02" else each for each in given]
    assert CliRunner().invoke(app, by_file).exit_code == 0
    with open(out, newline="") as file:
        assert list(csv.DictReader(file)) == [row]
    run = CliRunner().invoke(app, [each.replace(":SENSORS", ":NONE") for each in by_file])
    assert run.exit_code != 0 and "is a int; a dict is needed" in run.output.replace("\n", " ")


PENDULUM = slcp.Scene(
    "pendulum",
    bodies=(slcp.Body("link", 1.0, 0.02, com=(0.25, 0.0), damping=0.05),),
    actuators=(slcp.Actuator("link"),),
    step_size=0.01,
)


def swung(rng, shift=0, runs=2, steps=150, **truth):
    """A filter of a pendulum, and logs of one with other numbers; controls stand `shift` steps too early."""
    sim = slcp.Simulator(PENDULUM, slcp.Options("hard"), device="cpu", dtype="float64")
    us = 3.0 * np.sin(np.linspace(0.0, 9.0, steps) + rng.uniform(0.0, 6.0, (runs, 1)))[:, :, None]
    us += 2.0 * rng.normal(size=us.shape)
    run = sim.rollout(np.zeros((runs, 2)), us, sim.params.replace(**truth))
    seen = run.states[:, :, :1] + 0.002 * rng.normal(size=(runs, steps + 1, 1))
    filter = policies.KalmanFilter(sim, {"link.angle": 0.002}, 0.02, x0=(0.0, 0.0))
    return filter, seen, np.concatenate([us[:, shift:], us[:, :shift]], axis=1)


FEW = {"candidates": 8, "starts": 1, "draws": 16}


def test_mass_and_inertia_are_one_number_or_two():
    truth = {"link.mass": 1.3, "link.inertia": 0.02}
    filter, seen, us = swung(np.random.default_rng(0), steps=100, **truth)
    before = {"link.mass": 0.5, "link.inertia": 0.5}
    tied = slcp.identify(filter, seen, us, before, **FEW)
    assert (
        tied.names == ("link.mass",) and not tied.values["link.mass"][1] < 1.3 < tied.values["link.mass"][2]
    )
    assert "mass and inertia of link are one number here, as in drawn worlds; tied=False" in str(tied)
    apart = slcp.identify(filter, seen, us, before, tied=False, **FEW)
    assert apart.names == ("link.mass", "link.inertia") and "one number here" not in str(apart)
    for name, true in truth.items():
        value, low, high = apart.values[name]
        assert abs(np.log(true / value)) < 1.5 * np.log(high / low), name
        assert value == pytest.approx(true, rel=0.1) and high < 1.3 * low, name
    drawn = apart.draw(500)
    z = np.log([drawn["link.mass"], drawn["link.inertia"]])
    np.testing.assert_allclose(np.corrcoef(z)[0, 1], apart.correlation[0, 1], atol=0.15)
    said = slcp.identify(filter, seen, us, {"link.mass, link.inertia": 0.5}, tied=False, **FEW)
    assert len(said.names) == 1 and "one number here" not in str(said)


def test_steps_that_are_too_long_are_told():
    """What half as long steps make of a number is found by them, too; where sensors tell little none move."""
    rng, truth = np.random.default_rng(3), {"link.mass": 1.2, "link.damping": 0.07}
    hard, before = slcp.Options("hard"), {"link.mass": 0.5, "link.damping": 0.5}
    fine = slcp.Simulator(replace(PENDULUM, step_size=5e-4), hard, device="cpu", dtype="float64")
    us = 3.0 * np.sin(np.linspace(0.0, 9.0, 60) + rng.uniform(0.0, 6.0, (2, 1)))[:, :, None]
    run = fine.rollout(np.zeros((2, 2)), np.repeat(us, 40, axis=1), fine.params.replace(**truth))
    found = {}
    for h, sd in ((0.02, 0.002), (0.01, 0.002), (0.02, 1.0)):
        every = round(0.02 / h)
        sim = slcp.Simulator(replace(PENDULUM, step_size=h), hard, device="cpu", dtype="float64")
        seen = np.full((2, 60 * every + 1, 1), np.nan)
        seen[:, ::every] = run.states[:, ::40, :1] + sd * np.random.default_rng(4).normal(size=(2, 61, 1))
        filter = policies.KalmanFilter(sim, {"link.angle": sd}, 0.02, x0=(0.0, 0.0))
        found[h, sd] = slcp.identify(filter, seen, np.repeat(us, every, axis=1), before, **FEW)
        text = "steps are too long for these intervals: half as long ones move, in deviations, link."
        assert (text in str(found[h, sd])) == (sd == 0.002)
    coarse, finer = found[0.02, 0.002], found[0.01, 0.002]
    for i, name in enumerate(truth):
        moved = (finer.z - coarse.z)[i] / coarse.covariance[i, i] ** 0.5
        assert abs(moved) > 0.7 and coarse.halved[name] == pytest.approx(moved, abs=0.4), name
    blind = slcp.identify(filter, seen, us, before, halve=False, **FEW)
    assert np.isnan(list(blind.halved.values())).all()


@pytest.mark.parametrize("shift, told", [(1, "1 step later"), (-2, "2 steps earlier"), (0, None)])
def test_controls_of_another_step_are_told(shift, told):
    filter, seen, us = swung(np.random.default_rng(1), shift, **{"link.mass": 1.2})
    found = slcp.identify(filter, seen, us, {"link.mass": 0.5}, process_noise=1.0, **FEW)
    text = str(found)
    assert ("explain the logs better" in text) == (told is not None)
    assert told is None or f"controls that act {told} explain the logs better, by" in text


def test_odd_sensors_and_starts_are_told():
    filter, seen, us = swung(np.random.default_rng(2), steps=60)
    degrees = slcp.identify(filter, np.rad2deg(seen), us, {"link.mass": 0.5}, **FEW)
    assert "link.angle spans " in str(degrees) and " rad (degrees?)" in str(degrees)
    still = slcp.identify(filter, 0.0 * seen + 0.3, us, {"link.mass": 0.5}, **FEW)
    assert "link.angle stands still: 0.3 in all of 122 readings" in str(still)
    model, off = filter.model, {"link.angle": 0.01}
    far = policies.KalmanFilter(model, {"link.angle": 0.002}, 0.02, off, x0=(0.2, 0.0))
    found = slcp.identify(far, seen, us, {"link.mass": 0.5}, **FEW)
    assert "the first link.angle is " in str(
        found
    ) and "deviations from what was believed (start=, x0=)" in str(found)
    right = slcp.identify(filter, seen, us, {"link.mass": 0.5}, **FEW)
    assert right.odd == ()


def test_a_time_in_milliseconds_is_asked_about(tmp_path):
    rows = [(1000.0 * t, *rest) for t, *rest in rows_of(np.zeros((4, 1)), np.zeros((3, 1)))]
    with pytest.warns(RuntimeWarning, match="rows are 1000 steps of the model apart, of 0.05 s; is the"):
        slcp.load_log(write(tmp_path / "log.csv", rows), cart())


def test_headers_with_blanks_are_read_and_others_told(tmp_path):
    rows = rows_of(np.arange(4.0)[:, None], np.zeros((3, 1)))
    spaced = tuple(f" {name} " for name in HEAD)
    measured, _ = slcp.load_log(write(tmp_path / "log.csv", rows, spaced), cart())
    np.testing.assert_array_equal(measured[:, 0], np.arange(4.0))
    with pytest.raises(FileError, match="cart.shift; it has 'time, control cart.shift, place, world'"):
        slcp.load_log(write(tmp_path / "b.csv", rows, (*HEAD[:2], "place", HEAD[3])), cart())


def test_what_was_found_acts_on_what_its_sensors_show():
    """A bias that was found is in what sensors of a run show, and taken off again; a machine's readings have
    it by themselves.
    """
    sim = slcp.Simulator(CART, slcp.Options("hard"), device="cpu", dtype="float64")
    start = {"cart.shift": 0.5, "cart.vshift": 0.5}
    gain = policies.Linear(np.array([[-3.0, 0.0, -2.5, 0.0]]))
    runs = []
    for bias in (0.0, 0.3):
        filter = policies.KalmanFilter(sim, {"cart.shift": 1e-3}, 0.1, start, bias={"cart.shift": bias})
        policy = policies.Estimated(gain, filter)
        runs.append(sim.rollout(np.tile([0.4, 0.0, 0.0, 0.0], (2, 1)), policy=policy, steps=120).states)
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-9)
    machine = policies.Estimated(gain, filter, simulated=False)
    run = sim.rollout(np.tile([0.4, 0.0, 0.0, 0.0], (2, 1)), policy=machine, steps=120)
    assert run.states[:, -1, 0] == pytest.approx(0.3, abs=0.02)
    seen = policies.Sensor(slcp.measures.cosine("cart.shift"), 0.1)
    with pytest.raises(ArgumentError, match="simulated is False, and filter has sensors of other things"):
        policies.Estimated(gain, policies.KalmanFilter(sim, {"c": seen}, 0.1), simulated=False)
