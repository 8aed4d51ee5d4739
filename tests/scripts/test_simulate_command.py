"""`slcp simulate` says what overlaps, where a world fails, and which options exclude others."""

import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from test_cli import call, fails

import slcp_warp as slcp


def test_simulate_says_what_overlaps_where_a_world_fails(tmp_path):
    """A disc of .25 m in the middle of a box of .4 m, whose sides are capsules of .02 m .18 m off."""
    held = slcp.Scene(
        name="held",
        bodies=tuple(slcp.Body(name, 1.0, 0.01, joint="free") for name in ("box", "ball")),
        shapes=(
            *slcp.box("b", "box", 0.4, 0.4, corner_radius=0.02, sides=True),
            slcp.Shape("disc", "ball", "disc", 0.25),
        ),
        contacts="auto",
    )
    file, out = tmp_path / "held.json", tmp_path / "held.npz"
    slcp.save_scene(held, file)
    given = ("simulate", "--scene", file, "--steps", 3, "--residual", "hard", "--device", "cpu", "--out", out)
    lines = call(*given, code=1).stderr.splitlines()
    start = next(line for line in lines if line.startswith("slcp: the start overlaps: "))
    assert all(f"b{side}/disc by 0.09" in start for side in ("01", "12", "23", "30"))
    failed = next(line for line in lines if line.startswith("slcp: world 0 is INFEASIBLE in step 1 of 3; "))
    assert failed.count("/disc by 0.09") == 3 and failed.endswith("and 5 more")
    assert out.exists()
    apart = call(*given, "--start", "0,0,0,2,0,0,0,0,0,0,0,0").stderr
    assert "overlaps" not in apart


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--set", "mass=1", "--set", "mass=2"], "--set mass is given more than once"),
        (["--set", "step_size=.1", "--step-size", ".2"], "--set step_size and --step-size are both given"),
        (["--set", "sigma=.1", "--sigma", ".2"], "--set sigma and --sigma are both given"),
        (["--steps", "99999999999999999999"], "--steps is 99999999999999999999; a whole number below 2^31"),
        (["--steps", "2000000000", "--worlds", "1000"], "--steps would take 1.192e+05 GiB"),
        (["--residual", "hard", "--sigma", ".1"], "--sigma is 0.1, which the hard problem has not"),
    ],
)
def test_what_would_be_dropped_or_does_not_fit_is_refused(options, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert says in fails("simulate", "--device", "cpu", *options)
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_takes_policies_by_name_and_cases_once(tmp_path):
    out = tmp_path / "still.npz"
    call("sweep", "--policy", "zero", "--worlds", 2, "--duration", 1, "--residuals", "hard", "--step-sizes",
         0.05, "--device", "cpu", "--out", out)  # fmt: skip
    assert slcp.SweepReport.load(out).cases[0]["worlds"] == 2
    said = fails("sweep", "push_to_mark", "--policy", "zero", "--residuals", "hard,hard", "--device", "cpu")
    assert "--residuals is 'hard,hard', which names hard more than once" in said
