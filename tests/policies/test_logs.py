"""Logs from tables, and `slcp identify`."""

import csv

import numpy as np
import pytest
from test_identify import CART, H, cart, carts
from typer.testing import CliRunner

import slcp_warp as slcp
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
