"""`slcp simulate` says what overlaps, at the start and where a world fails."""

import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from test_cli import call

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
