"""`slcp bench charts`: its file, resuming, failures, ratios with known answers, charts from rows alone."""

import math
import types

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
pytest.importorskip("scipy")

from typer.testing import CliRunner

import slcp_warp as slcp
from slcp_warp.scripts.app import app
from slcp_warp.scripts.benchmarks.accuracy import command, contact
from slcp_warp.scripts.benchmarks.accuracy.charts import ratios
from slcp_warp.scripts.benchmarks.accuracy.results import read_results
from slcp_warp.scripts.support.tables import write_csv

SIZES = (0.05, 0.02, 0.01)


def call(*arguments, code=0):
    """Output of `slcp` with these arguments, which must end with this exit code."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output + str(result.exception)
    return result.output


def made_up(curve, program="slcp-warp", problem="finger impact", per_step=1e-6, error=lambda h: h, **facts):
    """Rows of a contact study with a cost per step [s] and an error that are given."""
    return [
        {"study": "contact", "problem": problem, "program": program, "curve": curve, "knob": "h", "value": h,
         "h": h, "error": error(h), "error_of": "mean over 32 starts at T = 2 s [rad, rad/s]",
         "seconds": per_step / h, "penetration": 1e-3, "missed": 0, "solved_share": 1.0} | facts
        for h in SIZES
    ]  # fmt: skip


ROWS = (
    made_up("Coulomb", error=lambda h: h**2)
    + made_up("MuJoCo, default", "MuJoCo", per_step=2e-5, error=lambda h: 0.5 * h, penetration=0.1, missed=1)
    + made_up("MuJoCo, RK4", "MuJoCo", "pendulum chain", 8e-5, lambda h: h**4)
    + made_up("Coulomb", problem="pendulum chain", penetration="")
)


@pytest.fixture
def two_studies(monkeypatch):
    """`contact` and `solver` give made-up rows, `sweep` is not there; a list of those that ran."""
    ran = []

    def rows(name, found):
        def run(say):
            ran.append(name)
            return found

        return types.SimpleNamespace(rows=run)

    modules = {
        "contact": rows("contact", ROWS),
        "solver": rows("solver", [{**ROWS[0], "study": "solver"}]),
    }
    load = command.load
    monkeypatch.setattr(command, "load", lambda name: modules.get(name) or load(name))
    monkeypatch.setattr(command, "STUDIES", {
        "contact": command.Study("contact", {"ratios.md": "charts.ratios"}),
        "solver": command.Study("solver", {}), "sweep": command.Study("none", {}),
    })  # fmt: skip
    return ran


def test_every_study_and_chart_is_there():
    for study in command.STUDIES.values():
        assert callable(command.load(study.module).rows)
        assert study.peers is None or callable(command.load(study.peers).rows)
        assert all(callable(command.load(module).draw) for module in study.charts.values())


def test_a_file_gives_its_rows_back(tmp_path):
    path = tmp_path / "results.csv"
    rows = [row | {"commit": "12e4567", "mujoco": "4.0", "note": "a, b"} for row in ROWS]
    write_csv(path, rows)
    assert read_results(path) == rows
    assert [file.name for file in tmp_path.iterdir()] == ["results.csv"]


def test_bad_files_are_named(tmp_path):
    path = tmp_path / "results.csv"
    write_csv(path, ROWS)
    text = path.read_bytes()
    for content, message in (
        (text[:-40], "cut off or damaged: line 13"),
        (text[:-2], "cut off"),
        (text.split(b"\n")[0] + b"\n", "no rows"),
        (b"study,program\n1,2\n", "no columns problem, curve"),
        (b"\xff\xfe\x00", "it is no text"),
    ):
        path.write_bytes(content)
        with pytest.raises(slcp.FileError, match=message):
            read_results(path)
    path.write_bytes(text[:-40])
    assert "is cut off" in call("chart", path, "--out", tmp_path, code=2)
    path.write_text("a,b\n1,2\n")
    assert "a falsification or a table of `slcp paper size`" in call("chart", path, "--out", tmp_path, code=2)


def test_studies_run_and_resume(tmp_path, two_studies):
    output = call("bench", "charts", "--out", tmp_path, "--study", "contact")
    assert "12 rows" in output and two_studies == ["contact"]
    kept = read_results(tmp_path / "results.csv")
    assert all(row["cpu"] and row["time"] for row in kept)
    output = call("bench", "charts", "--out", tmp_path, "--resume", code=1)
    assert two_studies == ["contact", "solver"] and "contact: in" in output
    assert "study sweep failed: ModuleNotFoundError" in output
    assert [row["study"] for row in read_results(tmp_path / "results.csv")] == ["contact"] * 12 + ["solver"]
    call("bench", "charts", "--out", tmp_path, "--study", "solver")
    assert two_studies[-1] == "solver" and len(read_results(tmp_path / "results.csv")) == 13
    write_csv(tmp_path / "results.csv", [row | {"commit": "another"} for row in kept])
    output = call("bench", "charts", "--out", tmp_path, "--resume", "--study", "contact")
    assert "contact: of another commit, version or machine, left out" in output
    assert two_studies[-1] == "contact"
    assert len(read_results(tmp_path / "results_before.csv")) == 12


def test_an_interrupted_run_keeps_what_is_finished(tmp_path, two_studies, monkeypatch):
    def stop(say):
        raise KeyboardInterrupt

    load = command.load
    monkeypatch.setattr(
        command, "load",
        lambda name: types.SimpleNamespace(rows=stop) if name == "solver" else load(name),
    )  # fmt: skip
    assert "--resume goes on" in call("bench", "charts", "--out", tmp_path, code=130)
    assert len(read_results(tmp_path / "results.csv")) == 12


@pytest.fixture
def in_pieces(monkeypatch):
    """A study `contact` of four pieces; which ran, and the number of the one that is interrupted."""
    ran, ends = [], {"at": None}

    def measure(i):
        if ends["at"] == i:
            raise KeyboardInterrupt
        ran.append(i)
        return [ROWS[i] | {"error": np.float64(0.1) / (i + 1), "note": f"piece {i}"}] if i != 2 else []

    module = types.SimpleNamespace(
        pieces=lambda say: [(f"problem {i}", lambda i=i: measure(i)) for i in range(4)]
    )
    monkeypatch.setattr(command, "load", lambda name: module)
    monkeypatch.setattr(command, "STUDIES", {"contact": command.Study("contact", {})})
    return ran, ends


def test_a_study_goes_on_from_its_finished_pieces(tmp_path, in_pieces):
    pytest.importorskip("pyarrow")
    ran, ends = in_pieces
    arguments = ("bench", "charts", "--out", tmp_path)
    ends["at"] = 3
    assert "--resume goes on" in call(*arguments, code=130)
    assert ran == [0, 1, 2] and not (tmp_path / "results.csv").exists()
    ends["at"] = None
    said = call(*arguments, "--resume")
    assert ran == [0, 1, 2, 2, 3], "what gave no rows is tried again"
    assert "contact, problem 1: kept from before" in said
    assert [path.name for path in tmp_path.iterdir()] == ["results.csv"]
    call(*arguments)
    fresh, resumed = (
        [{name: value for name, value in row.items() if name not in ("time", "load")} for row in rows]
        for rows in (read_results(tmp_path / "results.csv"), read_results(tmp_path / "results_before.csv"))
    )
    assert resumed == fresh and len(fresh) == 3


def test_pieces_of_another_commit_are_measured_again(tmp_path, in_pieces, monkeypatch):
    pytest.importorskip("pyarrow")
    ran, ends = in_pieces
    ends["at"] = 2
    call("bench", "charts", "--out", tmp_path, code=130)
    there = command.machine()
    monkeypatch.setattr(command, "machine", lambda: there | {"commit": "another"})
    ran.clear()
    call("bench", "charts", "--out", tmp_path, "--resume", code=130)
    assert ran == [0, 1]
    ran.clear()
    call("bench", "charts", "--out", tmp_path, code=130)
    assert ran == [0, 1], "without --resume everything is measured again"


def test_an_unknown_study_names_the_choices(tmp_path):
    output = call("bench", "charts", "--out", tmp_path, "--study", "contacts", code=2)
    assert "--study is 'contacts'; choose from contact, solver" in output


def test_charts_from_the_file_alone(tmp_path):
    write_csv(tmp_path / "results.csv", ROWS + [{**ROWS[0], "error": math.inf}])
    output = call("chart", tmp_path, "--out", tmp_path / "figures")
    for name in command.STUDIES["contact"].charts:
        assert name in output and (tmp_path / "figures" / name).stat().st_size > 100


def test_cost_of_an_error():
    """cost = 1 / error between the points; nothing beyond them."""
    curve = [(1e-3, 1e3), (1e-2, 1e2), (1e-1, 1e1)]
    for error in (1e-3, 3e-3, 0.05):
        assert ratios.cost_of_error(curve, error) == pytest.approx(1.0 / error)
    assert ratios.cost_of_error(curve, 1.0) == 10.0
    assert ratios.cost_of_error(curve, 1e-4) == math.inf


def test_ratios_at_equal_step_and_error():
    """Our error is h^2 at a cost of 1e-6 / h, the peer's h / 2 at 2e-5 / h, which is ours at sqrt(h / 2), or
    already at h = .05. The chain's fourth order is not reached.
    """
    finger, chain = ratios.compare(ROWS)
    np.testing.assert_allclose(finger.equal_step["Coulomb"], 20.0)
    assert finger.equal_step["Anitescu"] == []
    expected = {0.5 * h: (2e-5 / h) / (1e-6 / min(math.sqrt(0.5 * h), 0.05)) for h in SIZES}
    for error, _, ratio in finger.equal_error:
        assert ratio == pytest.approx(expected[error])
    assert chain.worst[2] == 0.0
    assert ratios.behind(ROWS) == [
        "MuJoCo, RK4 on pendulum chain: error 1e-08 at 8e+03 us; ours does not reach it"
    ]
    assert ratios.short(ROWS) == [
        "pendulum chain: 0 at equal error (median 0); the goal is 10",
    ]
    assert len(ratios.table(ROWS)) == 4 and "100 mm, 3 missed" in ratios.table(ROWS)[2]


def test_points_that_miss_contacts_reach_no_error():
    ours = made_up("Coulomb", missed=1) + made_up("Anitescu", per_step=1e-5)
    (found,) = ratios.compare(ours + made_up("MuJoCo", "MuJoCo", per_step=1e-5))
    assert [ratio for *_, ratio in found.equal_error] == pytest.approx([1.0, 1.0, 1.0])


@pytest.mark.slow
def test_a_problem_in_earnest():
    """The block that friction stops: first order with Euler's method, nothing overlaps."""
    coulomb = contact.CURVES[:1]
    rows = contact.all_rows(print, (), ("sliding stop",), coulomb, (0.02, 0.01), 2, processes=1)
    coarse, fine = rows
    assert fine["error"] < 0.011 and 1.8 < coarse["error"] / fine["error"] < 2.2
    for row in rows:
        assert row["penetration"] < 1e-9 and row["missed"] == 0 and row["solved_share"] == 1.0
        assert row["batch"] % 32 == 0 and row["batch"] / row["h"] >= contact.STEPS
        assert 0.0 < row["seconds"] < 1.0 and row["compile_seconds"] > 0.0
