"""The summary of a case counts what its table holds."""

import numpy as np

import slcp_warp as slcp
from slcp_warp import Status
from slcp_warp.ensembles.outcome import means_of_parts
from slcp_warp.ensembles.statistics.source import MemorySource
from slcp_warp.ensembles.summary import summary_of


def test_summary_of_a_known_table():
    table = {
        "status": np.array([0, 0, 0, 0, 2, 3, 0, 0, 0, 0]),
        "rate": np.array([0.6, 0.7, 0.2, 0.9, 0.8, 0.1, 0.5, 0.4, 0.3, 1.1]),
        "spinning": np.array([1, 1, 0, 1, 0, 0, 0, 0, 0, 0], bool),
        "recovery_time": np.array([0.0, 1.0, np.inf, 2.0, np.inf, np.inf, 4.0, np.inf, np.inf, 3.0]),
        "contact_share": np.linspace(0.0, 0.9, 10),
    }
    spec = slcp.SweepSpec(worlds=10, threshold=0.5)
    found = summary_of("hard", 0.03, table, spec, 1.5)
    assert (found["residual"], found["step_size"], found["worlds"], found["seconds"]) == (
        "hard",
        0.03,
        10,
        1.5,
    )
    assert found["share_above"][0] == 0.4  # solved, and strictly above: .6, .7, .9, 1.1
    assert found["share_spinning"][0] == 0.3
    assert found["share_recovered"][0] == 0.5
    np.testing.assert_allclose(found["mean_rate"][0], table["rate"].mean(), rtol=1e-14)
    np.testing.assert_allclose(found["contact_share"][0], 0.45, rtol=1e-14)
    assert found["median_recovery_time"][0] == np.inf  # the sixth of ten
    counts = {status.name: int((table["status"] == status).sum()) for status in Status}
    assert found["statuses"] == counts and counts["SOLVED"] == 8


def report(measures: int) -> slcp.Report:
    """Of two policies, with so many measures, which are 0.5 and more of the first, 100.5 of the second."""
    source = MemorySource()
    for offset, policy in ((0, "a"), (100, "b")):
        part = {"world": np.arange(4), "success": np.ones(4, bool), "status": np.zeros(4, int)}
        part |= {f"m{j}": np.full(4, offset + j + 0.5) for j in range(measures)}
        source.add((policy, "hard", 0.02, "disturbed"), part)
    return slcp.Report(None, source)


def test_every_measure_is_printed():
    few, many = str(report(3)), str(report(9))
    assert few.count("\n") == 3 and "mean m2" in few and "102.5" in few
    for j in range(9):
        line = next(line for line in many.splitlines() if line.split()[:1] == [f"m{j}"])
        assert line.split() == [f"m{j}", f"{j + 0.5:g}", f"{100 + j + 0.5:g}"]
    assert "a, hard" in many and "b, hard" in many and "more" not in many


def test_means_of_many_parts_are_all_printed():
    """Measures that do not stand beside their parts are rows; where parts are too many for columns, columns;
    where neither fit, several tables.
    """

    def told(policies: int, measures: int) -> list[str]:
        names = tuple(f"m{i}" for i in range(measures))
        one = {"policy": "", "case": "hard", "step_size": 0.01, "arm": "disturbed", "finite": {}}
        rows = [one | {"policy": f"p{i}"} | {name: (100.0 * i + j, 0.0, 0.0) for j, name in enumerate(names)}
                for i in range(policies)]  # fmt: skip
        for row in rows:
            row["finite"] = dict.fromkeys(names, 1)
            row["worlds"] = 1
        return [table.text() for table in means_of_parts(rows, names)]

    assert [len(told(*sizes)) for sizes in ((4, 12), (12, 5), (20, 12))] == [1, 1, 3]
    for policies, measures in ((4, 12), (12, 5), (20, 12)):
        text = "\n".join(told(policies, measures))
        words = text.split()
        for i in range(policies):
            assert f"p{i}, hard" in text
            for j in range(measures):
                assert words.count(f"{100.0 * i + j:.4g}") == 1
        assert "more" not in words
