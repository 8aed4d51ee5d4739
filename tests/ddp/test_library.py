"""Receding-horizon chains, the library's file, and the policies made from it."""

import functools
import json
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from ddp_examples import made_library as made
from simulators import scene, simulator

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import ARRAYS, scene_digest
from slcp_warp.ddp.library.receding import _Chains

FINGER = scene("flicking_finger")
HORIZON = 20
OPTIONS = {"offset": 4, "entries": 2, "chains": 2, "unperturbed": 1, "perturb_every": 8, "passes": 3,
           "first_passes": 10, "seed": 5}  # fmt: skip


@functools.cache
def problem(device="cpu"):
    sim = simulator("flicking_finger", device, wp.float64, "none")
    params = sim.params.replace(step_size=0.05, sigma=0.1)
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, HORIZON, params)


@functools.cache
def library(device="cpu", **changes):
    return ddp.build_library(problem(device), FINGER.x0, 24, **{**OPTIONS, **changes})


def test_chains_begin_with_controls_that_are_given(device):
    us = np.linspace(-0.5, 0.5, 2 * HORIZON).reshape(HORIZON, 2)
    own = {"first": us, "first_passes": 0, "noisy": 0, "recalled": 0, "perturb_every": 0}
    found = ddp.build_library(problem(device), FINGER.x0, 2, **{**OPTIONS, **own, "chains": 1})
    np.testing.assert_array_equal(found.u, us[:2])
    with pytest.raises(slcp.ArgumentError, match=r"RecedingOptions.first has shape \(20, 2\); \(40, 2\)"):
        ddp.build_library(replace(problem(device), horizon=40), FINGER.x0, 2, **{**OPTIONS, "first": us})


def test_files_of_earlier_versions_fit_their_scene():
    """The digest that they state is from before scenes had rules of damping and stiffness."""
    before = "c0c5a8888eb050e5"
    made(np.zeros((2, 6)), header={"scene": FINGER.name, "digest": before}).check_scene(FINGER)
    assert scene_digest(replace(FINGER, implicit_damping=True)) == scene_digest(FINGER)
    hopper = slcp.scenes.hopper()
    assert scene_digest(replace(hopper, implicit_stiffness=True)) == scene_digest(hopper)
    with pytest.raises(ddp.LibraryError, match="built for scene"):
        made(np.zeros((2, 6))).check_scene(slcp.scenes.hopper())


def test_a_library_without_entries_can_be_among_others():
    some = made(np.zeros((2, 6)))
    both = ddp.concatenate([some.select([]), some])
    assert len(both) == 2
    np.testing.assert_array_equal(both.chain, some.chain)


# --- chains ---


@pytest.mark.slow
def test_chains_store_the_first_controllers_of_every_plan(device):
    lib = library(device)
    assert len(lib) == 24 and lib.K.shape == (24, 2, 6) and lib.u.shape == (24, 2)
    np.testing.assert_array_equal(lib.age, np.tile([0, 1], 12))
    np.testing.assert_array_equal(lib.chain, np.tile([0, 0, 1, 1], 6))
    np.testing.assert_array_equal(lib.plan, np.repeat(np.arange(6), 4))
    assert (
        lib.header["offset"] == 4 and lib.header["step_size"] == 0.05 and lib.header["scene"] == FINGER.name
    )
    np.testing.assert_array_equal(lib.period, [0, 0, np.pi, 0, 0, 0])
    first = lib.age == 0  # entries of one plan share its cost, and the second is one step further along it
    np.testing.assert_array_equal(lib.cost[first], lib.cost[~first])
    sim, params = problem(device).dynamics, problem(device).params
    np.testing.assert_allclose(sim.step(lib.x[first], lib.u[first], params).state, lib.x[~first], atol=1e-8)


@pytest.mark.slow
def test_plans_gain_over_zero_controls(device):
    lib = library(device)
    sim, params = problem(device).dynamics, problem(device).params
    start = lib.x[lib.age == 0]
    rest = sim.rollout(start, np.zeros((len(start), HORIZON, 2)), params).states
    passive = (-rest[:, :-1, 2]).sum(axis=1)
    np.testing.assert_allclose(lib.gain[lib.age == 0], passive - lib.cost[lib.age == 0], atol=1e-6)
    assert (lib.gain > -1e-9).all() and lib.gain.max() > 1e-3


@pytest.mark.slow
def test_only_perturbed_chains_are_kicked(device):
    """A plan starts `offset` steps along the one before; every second shift kicks chain 1's rates."""
    lib = library(device, entries=4, perturb_variance=4.0)
    quiet = library(device, entries=4, perturb_every=0)
    sim, params = problem(device).dynamics, problem(device).params
    for one, kicked in ((lib, True), (quiet, False)):
        for chain in (0, 1):
            rows = one.chain == chain
            last, first = rows & (one.age == 3), rows & (one.age == 0)
            arrived = sim.step(one.x[last], one.u[last], params).state[: first.sum() - 1]
            jump = one.x[first][1:][: len(arrived)] - arrived
            np.testing.assert_allclose(jump[:, :3], 0.0, atol=1e-7)
            size = np.abs(jump[:, 3:]).max(axis=1)
            if kicked and chain == 1:
                assert (size[1::2] > 0.1).all() and (size[::2] < 1e-7).all(), size
            else:
                assert (size < 1e-7).all()


@pytest.mark.slow
def test_the_seed_determines_a_library(device):
    again = ddp.build_library(problem(device), FINGER.x0, 24, **OPTIONS)
    other = ddp.build_library(problem(device), FINGER.x0, 24, **{**OPTIONS, "seed": 6})
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(library(device), name), getattr(again, name))
    assert not np.array_equal(library(device).x, other.x)


@pytest.mark.slow
def test_interrupt_keeps_the_entries(device):
    def stop(done, total):
        if done >= 8:
            raise KeyboardInterrupt

    part = ddp.build_library(problem(device), FINGER.x0, 24, progress=stop, **OPTIONS)
    assert 8 <= len(part) < 24
    np.testing.assert_array_equal(part.x, library(device).x[: len(part)])
    with pytest.raises(KeyboardInterrupt):
        ddp.build_library(problem(device), FINGER.x0, 24, progress=lambda *_: stop(8, 24), **OPTIONS)


def test_chains_without_a_plan_end():
    """They went on for good, with a part in the folder for every shift."""
    started = []
    x0 = np.array([0.0, 0.0, 0.0, 1e200, 0.0, 0.0])
    with pytest.raises(slcp.ArgumentError, match=r"x0 is .*1e\+200.* no plan of 20 has a finite cost"):
        ddp.build_library(problem(), x0, 4, progress=lambda done, of: started.append(done), **OPTIONS)
    assert len(started) == 20 and not any(started)


@pytest.mark.slow
def test_chains_that_lose_their_plans_leave_what_they_have(monkeypatch):
    shift = _Chains.shift

    def lost(self):
        shift(self)
        self.cost = np.full_like(self.cost, np.nan if self.index > 2 else 1.0)

    monkeypatch.setattr(_Chains, "shift", lost)
    with pytest.warns(
        RuntimeWarning, match="chains ended at 12 of 24 entries: no plan of the last 20 shifts"
    ):
        found = ddp.build_library(problem(), FINGER.x0, 24, **OPTIONS)
    np.testing.assert_array_equal(found.x, library().x[:12])


def test_libraries_that_are_joined_have_the_same_periods():
    x = np.zeros((2, 6))
    with pytest.raises(ddp.LibraryError, match=r"periods are \[0.0, 6.28.* and \[0.0, 0.0"):
        ddp.concatenate(
            [made(x, period=np.array([0.0, 2.0 * np.pi, 0, 0, 0, 0])), made(x, period=np.zeros(6))]
        )
    both = ddp.concatenate(
        [made(x, header={"offset": 3}), made(x, header={"offset": 4})]
    )  # of no run's steps
    assert len(both) == 4


def test_concatenation_renumbers_the_chains():
    rng = np.random.default_rng(1)
    a = made(rng.standard_normal((5, 6)), chain=np.array([0, 1, 0, 1, 2]))
    b = made(rng.standard_normal((3, 6)), chain=np.array([0, 0, 1]))
    both = ddp.concatenate([a, b])
    assert both.chain.tolist() == [0, 1, 0, 1, 2, 3, 3, 4] and len(both) == 8
    np.testing.assert_array_equal(both.x, np.concatenate([a.x, b.x]))
    with pytest.raises(ddp.LibraryError, match="different scenes"):
        ddp.concatenate([a, made(b.x, header={"scene": "grasp", "digest": "x"})])
    with pytest.raises(ddp.LibraryError, match="libraries is empty"):
        ddp.concatenate([])


# --- the file ---


def written(tmp_path):
    rng = np.random.default_rng(3)
    lib = made(rng.standard_normal((6, 6)), K=rng.standard_normal((6, 2, 6)), cost=rng.standard_normal(6))
    return lib, lib.save(tmp_path / "library.npz")


def test_a_saved_library_comes_back_bit_for_bit(tmp_path):
    lib, path = written(tmp_path)
    loaded = ddp.Library.load(path)
    for name in (*ARRAYS, "period"):
        mine, theirs = getattr(lib, name), getattr(loaded, name)
        assert mine.dtype == theirs.dtype and mine.tobytes() == theirs.tobytes(), name
    assert loaded.header == {"format": "slcp-warp-library", "version": 2, **lib.header}
    assert not list(tmp_path.glob("*.part"))


def rewrite(path, fields=None, **changes):
    """The file with other header fields or arrays; None leaves an array out."""
    with np.load(path) as archive:
        data = {name: archive[name] for name in archive.files}
    if fields is not None:
        changes["header"] = np.array(json.dumps({**json.loads(str(data["header"])), **fields}))
    data |= changes
    with open(path, "wb") as file:
        np.savez(file, **{name: value for name, value in data.items() if value is not None})


DAMAGE = {
    "truncated": (lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]), "cannot be read"),
    "empty": (lambda p: p.write_bytes(b""), "cannot be read"),
    "text": (lambda p: p.write_text("x,u,K\n1,2,3\n"), "cannot be read"),
    "flipped byte": (lambda p: flip(p), "cannot be read"),
    "pickle": (lambda p: rewrite(p, x=np.array([None, 1], dtype=object)), "cannot be read"),
    "foreign archive": (lambda p: np.savez(p, a=np.zeros(3)), "it has no header"),
    "plain array": (lambda p: np.save(open(p, "wb"), np.zeros(3)), "cannot be read"),
    "no header": (lambda p: rewrite(p, header=np.array("hello")), "cannot be read"),
    "other format": (lambda p: rewrite(p, {"format": "slcp-warp-sweep"}), "'slcp-warp-library' is needed"),
    "newer": (lambda p: rewrite(p, {"version": 3}), "version 3; this program reads 1 or 2"),
    "missing array": (lambda p: rewrite(p, K=None), r"lacks the arrays \['K'\]"),
    "wrong shape": (lambda p: rewrite(p, K=np.zeros((6, 2, 5))), r"'K' has shape \(6, 2, 5\), \(6, 2, 6\)"),
    "scalar": (lambda p: rewrite(p, u=np.array(3.0)), r"'u' has shape \(\)"),
    "not finite": (
        lambda p: rewrite(p, x=np.full((6, 6), np.nan)),
        "'x' contains numbers that are not finite",
    ),
    "limits of NaN": (lambda p: rewrite(p, lower=np.full((6, 2), np.nan)), "'lower' contains numbers"),
    "limits crossed": (
        lambda p: rewrite(p, lower=np.ones((6, 2)), upper=np.zeros((6, 2))),
        "at most the upper",
    ),
    "text array": (lambda p: rewrite(p, x=np.full((6, 6), "a")), "'x'"),
}


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(bytes(data))


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_file_that_is_no_library_is_refused(tmp_path, damage):
    _, path = written(tmp_path)
    change, message = DAMAGE[damage]
    change(path)
    with pytest.raises(ddp.LibraryError, match=message) as caught:
        ddp.Library.load(path)
    assert "library.npz" in str(caught.value)


def test_a_missing_file_is_reported_as_such(tmp_path):
    with pytest.raises(FileNotFoundError):
        ddp.Library.load(tmp_path / "nowhere.npz")


def test_another_scenes_library_is_refused():
    grasp = scene("grasp")
    lib = made(np.zeros((2, 6)), header={"scene": grasp.name, "digest": scene_digest(grasp)})
    sim = simulator("flicking_finger", "cpu", wp.float64, "none")
    with pytest.raises(ddp.LibraryError, match="built for scene 'grasp', not 'flicking_finger'"):
        sim.rollout(FINGER.x0, policy=lib.policy(), steps=1)


def test_a_failed_save_leaves_the_old_file(tmp_path, monkeypatch):
    lib, path = written(tmp_path)
    before = path.read_bytes()

    def fail(*arguments, **options):
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="disk full"):
        lib.save(path)
    assert path.read_bytes() == before


@pytest.mark.slow
def test_tracking_reproduces_the_plan_and_holds_its_last_step(device):
    p = problem(device)
    result = ddp.solve(p, FINGER.x0, np.zeros((HORIZON, 2)), ddp.Options(max_iterations=15))
    policy = ddp.TrackingPolicy(result, FINGER.state_period)
    traj = p.dynamics.rollout(np.tile(FINGER.x0, (3, 1)), policy=policy, steps=HORIZON + 2, params=p.params,
                              record=("controls",))  # fmt: skip
    np.testing.assert_allclose(traj.states[0, : HORIZON + 1], result.xs, atol=1e-9)
    np.testing.assert_allclose(traj.controls[0, :HORIZON], result.us, atol=1e-9)
    held = result.us[-1] + (traj.states[0, HORIZON] - result.xs[HORIZON - 1]) @ result.K[-1].T
    np.testing.assert_allclose(traj.controls[0, HORIZON], held, atol=1e-9)
    turned = p.dynamics.rollout(
        FINGER.x0 + [0, 0, np.pi, 0, 0, 0], policy=policy, steps=HORIZON, params=p.params
    )
    np.testing.assert_allclose(turned.states[:, 2] - np.pi, result.xs[:, 2], atol=1e-8)
    pushed = FINGER.x0 + 0.02
    policy_end = p.dynamics.rollout(pushed, policy=policy, steps=HORIZON, params=p.params).states[-1]
    assert np.isfinite(policy_end).all()
