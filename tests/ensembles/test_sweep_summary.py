"""The summary of a case counts what its table holds."""

import numpy as np

import slcp_warp as slcp
from slcp_warp import Status
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
