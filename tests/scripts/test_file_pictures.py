"""Pictures that say what is in the files: one for every file, no scale and no panel of what is not there."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import PARTICLE, report, simulated
from test_cli import call, fails

import slcp_warp as slcp
from slcp_warp.ensembles.statistics.source import MemorySource
from slcp_warp.scripts.charts import cycle
from slcp_warp.scripts.charts import report as reports
from slcp_warp.scripts.charts.files import chart_files, picture_names
from slcp_warp.scripts.stages.task_sweep import NONE, comparison, report_tables
from slcp_warp.scripts.support.records import RecordError


def test_every_file_has_a_picture_of_its_own(tmp_path):
    files = [tmp_path / folder / "report.csv" for folder in ("one", "two")]
    for file in files:
        file.parent.mkdir()
        report().save(file)
    report().save(tmp_path / "one" / "report.npz")
    out = tmp_path / "pictures"
    said = call("chart", files[0].parent, files[1], files[1], "--out", out).output
    assert sorted(path.name for path in out.iterdir()) == [
        "report.png", "report_csv.png", "report_npz.png",
    ] and said.count("wrote") == 3  # fmt: skip


def test_a_folder_is_drawn_whatever_its_files_are_called(tmp_path):
    """Files were chosen by the names that commands give them, and others left out without a word."""
    folder, out = tmp_path / "runs", tmp_path / "pictures"
    folder.mkdir()
    report().save(folder / "mine.csv")
    report().save(folder / ".hidden.csv")
    (folder / "notes.csv").write_text("day,what\n1,bought\n")
    (folder / "rare.csv").write_text("margin,reached,accepted,share,low,high\n0.0,0.1,nan,0.1,0.05,0.2\n")
    said = " ".join(call("chart", folder, "--out", out).output.split())
    assert sorted(path.name for path in out.iterdir()) == ["mine.png"]
    assert "notes.csv is left out" in said and "rare.csv is left out" in said and "hidden" not in said
    (folder / "mine.csv").unlink()
    assert "no .csv that a picture is made of" in fails("chart", folder, "--out", out)


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["a/run.npz"], ["run"]),
        (["a/run.npz", "a/plan.npz"], ["run", "plan"]),
        (["a/run.npz", "b/run.npz", "b/plan.npz"], ["a_run", "b_run", "plan"]),
        (["x/a/run.npz", "y/a/run.npz"], ["x_a_run", "y_a_run"]),
        (["a/run.npz", "a/../a/run.npz"], ["run"]),
        (["a/run.csv", "a/run.npz"], ["run_csv", "run_npz"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_pictures_are_named_by_what_tells_their_files_apart(files, names):
    assert list(picture_names([Path(file) for file in files]).values()) == names


@pytest.mark.parametrize(
    ("impulse", "scale", "says"),
    [(2.0, 2.0, None), (0.0, None, "nothing touches"), (None, None, "impulses were not recorded")],
)
def test_a_scale_of_colours_is_that_of_impulses(tmp_path, monkeypatch, impulse, scale, says):
    """A hard run without contact, and a replay, which records none, had one from 0 to 1e-9."""
    structure = PARTICLE.structure
    recorded = None if impulse is None else np.full((1, 3, structure.nr), impulse / structure.nr)
    states = np.cumsum(np.ones((1, 4, 2 * structure.nv)), axis=1)
    run = slcp.Trajectory(states, np.zeros(1, np.int32), impulse=recorded, simulated=simulated())
    drawn = []
    monkeypatch.setattr(cycle, "save", lambda figure, path: drawn.append(figure))
    cycle.frames_chart(run, tmp_path / "frames.png")
    bars = [ax for ax in drawn[0].axes if "impulse" in ax.get_ylabel()]
    assert [ax.get_ylim()[1] for ax in bars] == pytest.approx([] if scale is None else [scale])
    assert (drawn[0].get_supxlabel() or None) == says
    assert run.animate(tmp_path / "run.gif").stat().st_size > 1000


def never() -> slcp.Report:
    """Two policies under which nothing ends a run, and one world that is late."""
    source = MemorySource()
    for policy in ("a", "b"):
        rows = {"world": np.arange(3), "x": np.array([0.5, 0.4, 0.3]), "failure_time": np.full(3, np.inf),
                "late": np.array([np.inf, np.inf, 2.0]), "success": np.ones(3, bool),
                "status": np.zeros(3, np.int32)}  # fmt: skip
        source.add((policy, "hard", 0.05, "disturbed"), rows)
    return slcp.Report(None, source)


def test_what_never_happens_has_no_panel_and_no_nan(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(reports, "save", lambda figure, path: drawn.append(figure))
    path = never().save(tmp_path / "report.csv")
    reports.report_chart(path, tmp_path / "report.png")
    assert [ax.get_xlabel() for ax in drawn[0].axes] == ["success [%]; ○ undisturbed", "x"]
    assert drawn[0].get_supxlabel().endswith("failure_time, late")
    for table in (*report_tables(never()), comparison(never(), "a", "b")):
        cells = {column.header: list(column.cells) for column in table.columns}
        assert set(cells["failure_time"]) == {NONE}
        assert not any("nan" in cell for column in cells.values() for cell in column)
    assert "nan" not in str(never()) and NONE in str(never())


def many() -> slcp.Report:
    """Two policies, judged by twelve measures."""
    source = MemorySource()
    for offset, policy in ((0, "a"), (100, "b")):
        rows = {f"m{j}": offset + j + np.array([0.0, 0.5, 1.0]) for j in range(12)}
        rows |= {"world": np.arange(3), "success": np.ones(3, bool), "status": np.zeros(3, np.int32)}
        source.add((policy, "hard", 0.05, "disturbed"), rows)
    return slcp.Report(None, source)


def test_many_measures_have_rows_of_a_table_and_rows_of_pictures(tmp_path, monkeypatch):
    success, means = report_tables(many())
    assert [column.header for column in success.columns][-1] == "unsolved"
    cells = {column.header: list(column.cells) for column in means.columns}
    assert cells["measure"] == [f"m{j}" for j in range(12)]
    assert cells["b\nhard, h = 0.05"][3] == "104" and cells["a\nhard, h = 0.05"][3] == "3.5"
    drawn = []
    monkeypatch.setattr(reports, "save", lambda figure, path: drawn.append(figure))
    reports.report_chart(many().save(tmp_path / "report.csv"), tmp_path / "report.png")
    seen = [ax.get_xlabel() for ax in drawn[0].axes if ax.get_visible()]
    assert seen == ["success [%]; ○ undisturbed", *(f"m{j}" for j in range(12))]
    width, height = drawn[0].get_size_inches()
    assert width < 15.0 and height < 8.0
    named = [ax.get_xlabel() for ax in drawn[0].axes if ax.get_visible() and ax.get_yticklabels()]
    assert named == ["success [%]; ○ undisturbed", "m4", "m9"]


def test_what_is_the_same_but_for_roundings_looks_the_same(tmp_path, monkeypatch):
    source = MemorySource()
    noise = np.array([-1.0, 0.0, 1.0])
    rows = {
        "lasts": 7.0 + 1e-6 * noise,
        "rests": 1e-17 * noise,
        "falls": -2.0 + 0.0 * noise,
        "varies": 7.0 + 1e-2 * noise,
    }
    rows |= {"world": np.arange(3), "success": np.ones(3, bool), "status": np.zeros(3, np.int32)}
    source.add(("a", "hard", 0.05, "disturbed"), rows)
    drawn = []
    monkeypatch.setattr(reports, "save", lambda figure, path: drawn.append(figure))
    reports.report_chart(slcp.Report(None, source).save(tmp_path / "report.csv"), tmp_path / "report.png")
    seen = {ax.get_xlabel(): ax.get_xlim() for ax in drawn[0].axes}
    assert seen["lasts"] == pytest.approx((6.65, 7.35)) and seen["rests"] == (-1.0, 1.0)
    assert seen["falls"][0] < -2.05 and seen["falls"][1] > -1.95
    assert 6.9 < seen["varies"][0] < 6.99 and 7.01 < seen["varies"][1] < 7.1


def test_a_table_without_a_picture_is_named_before_any_is_drawn(tmp_path):
    """It was read as a table of another command, after the files before it had been drawn."""
    rare, grid = tmp_path / "rare.csv", tmp_path / "map.csv"
    rare.write_text("margin,reached,accepted,share,low,high\n0.0,0.1,nan,0.1,0.05,0.2\n")
    grid.write_text("x_value,y_value,success\n0.0,0.0,1.0\n")
    with pytest.raises(RecordError, match=r"rare.csv holds a 'rare', which no picture is made of"):
        chart_files([grid, rare], tmp_path / "out")
    assert not (tmp_path / "out").exists()
