"""Both arms of every named task: which commands make them, what is kept, what the picture is of."""

import csv

import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from test_cli import call, fails

from slcp_warp.scripts.studies.online import arms

TASKS = ("--only", "push_to_mark", "--only", "flicking_finger")


@pytest.fixture
def commands(monkeypatch):
    """What is run in place of commands: a report in which every eighth disturbed world fails."""
    run = []

    def pretend(*words):
        out = words[words.index("--out") + 1]
        run.append(tuple(map(str, words)))
        if words[0] == "library":
            out.write_bytes(b"library")
            return
        worlds = int(words[words.index("--worlds") + 1])
        with out.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("policy", "case", "step_size", "arm", "world", "success", "status"))
            rows.writerow(("any", "hard", 0.02, "undisturbed", 0, True, 0))
            rows.writerows(("any", "hard", 0.02, "disturbed", i, i % 8 > 0, 0) for i in range(worlds))

    monkeypatch.setattr(arms, "_slcp", pretend)
    return run


def test_arms_are_made_once_and_told(tmp_path, commands):
    """MPC plans the push itself; the finger, whose run is longer than a plan, from the library."""
    table, chart = tmp_path / "table.csv", tmp_path / "chart.png"
    size = ("--worlds", 64, "--mpc-worlds", 16)
    call("paper", "success", tmp_path, *TASKS, *size, "--csv", table, "--chart", chart)
    assert [words[:2] for words in commands] == [
        *[(what, "push_to_mark") for what in ("library", "sweep", "sweep")],
        *[(what, "flicking_finger") for what in ("library", "sweep", "sweep")],
    ]
    library = str(tmp_path / "flicking_finger" / "library.npz")
    policies = [words[words.index("--policy") + 1] for words in commands if words[0] == "sweep"]
    assert policies[1:] == ["mpc", library, f"mpc:{library}"]
    assert all(words[words.index("--residuals") + 1] == "hard" for words in commands if words[0] == "sweep")
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["arm"], row["worlds"]) for row in rows] == [("library", "64"), ("mpc", "16")] * 2
    assert all(
        float(row["success"]) == 0.875 and float(row["low"]) < 0.875 < float(row["high"]) for row in rows
    )
    assert chart.stat().st_size > 10_000
    before = len(commands)
    call("paper", "success", tmp_path, *TASKS, *size)
    assert len(commands) == before


def test_a_task_that_is_none_is_named(tmp_path, commands):
    assert "--only names ['juggle']" in fails("paper", "success", tmp_path, "--only", "juggle")
    assert not commands
