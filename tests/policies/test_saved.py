"""Policies as files: what is read does the same, bit for bit."""

import json

import numpy as np
import pytest
import warp as wp
from simulators import simulator

import slcp_warp as slcp
from slcp_warp import ddp, policies
from slcp_warp.ddp.library.entries import scene_digest
from slcp_warp.storage.archive import write_archive
from slcp_warp.storage.files import FileError

SCENE = slcp.scenes.flicking_finger()
RNG = np.random.default_rng(5)


def linear():
    K, x, u = RNG.standard_normal((3, 2, 6)), RNG.standard_normal(6), RNG.standard_normal((3, 2))
    return policies.Linear(K, x, u, (-1.0, np.array([0.5, np.inf])), SCENE.state_period)


def tracking():
    shapes = {"us": (4, 2), "xs": (5, 6), "K": (4, 2, 6)}
    plan = type("Plan", (), {name: RNG.standard_normal(shape) for name, shape in shapes.items()})
    return ddp.TrackingPolicy(plan, SCENE.state_period, (-2.0, 2.0))


def nearest():
    one = {name: RNG.random(9) for name in ("cost", "gain", "age", "chain", "plan")}
    header = {"scene": SCENE.name, "digest": scene_digest(SCENE), "seed": 3}
    library = ddp.Library(
        x=RNG.standard_normal((9, 6)), u=RNG.standard_normal((9, 2)), K=RNG.standard_normal((9, 2, 6)),
        period=SCENE.state_period, header=header, **one,
    )  # fmt: skip
    return library.policy(metric="variance", min_gain=0.3, feedback_limit=0.7, control_limits=(-1.0, 2.0))


def network():
    t = pytest.importorskip("torch").nn
    parts = [
        t.Linear(6, 5),
        t.ELU(alpha=0.7),
        t.Linear(5, 9, bias=False),
        t.Softplus(beta=2.0, threshold=9.0),
    ]
    parts += [t.Sequential(t.Linear(9, 3), t.GELU(approximate="tanh"), t.Linear(3, 3)), t.Linear(3, 2)]
    return policies.Network(t.Sequential(*parts))


def around():
    limits, noise = (-0.5, np.array([0.5, 0.6])), {"ellipse.angle": 0.1}
    return policies.Around(
        policies.Around(nearest(), noise=0.2 + RNG.random(6)),
        limits,
        delay=2,
        hold=3,
        noise=noise,
        seed=8,
        before=[0.1, -0.2],
    )


def numbers(struct, prefix=""):
    """All numbers of a policy's struct, those of structs inside too."""
    found = {}
    for name in struct._cls.vars:
        value = getattr(struct, name)
        if hasattr(value, "_cls"):
            found |= numbers(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value.numpy() if hasattr(value, "numpy") else value
    return found


@pytest.mark.parametrize("make", [linear, tracking, nearest, network, around])
@pytest.mark.parametrize("dtype", [wp.float32, wp.float64])
def test_what_is_read_does_the_same(tmp_path, make, dtype):
    sim, policy = simulator("flicking_finger", "cpu", dtype), make()
    read = policies.load_policy(policies.save_policy(policy, tmp_path / "mine.npz"))
    (kernel, struct), (again, found) = policy.kernel(sim), read.kernel(sim)
    a, b = numbers(struct), numbers(found)
    assert kernel == again and type(read) is type(policy) and list(a) == list(b) and a
    for name, value in a.items():
        np.testing.assert_array_equal(np.asarray(value), np.asarray(b[name]), err_msg=name)
        assert np.asarray(value).dtype == np.asarray(b[name]).dtype


def test_what_is_no_data_is_refused(tmp_path):
    class Own:
        def content(self):
            raise AssertionError

    callback = policies.Callback(lambda x, time: np.zeros(2))
    for policy in (Own(), callback, policies.Around(callback)):
        with pytest.raises(slcp.InputError, match="is no data: give it as a text, 'file.py:name'"):
            policies.save_policy(policy, tmp_path / "mine.npz")
    with pytest.raises(slcp.InputError, match=".npz is needed"):
        policies.save_policy(linear(), tmp_path / "mine.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "kind, text",
    [
        ("plan", r"holds a plan; give ddp.TrackingPolicy\(ddp.Result.load\('mine.npz'\), scene.state_period"),
        ("library", r"holds a library; give ddp.Library.load\('mine.npz'\).policy\(\)"),
    ],
)
def test_files_of_plans_and_libraries_say_how_they_become_policies(tmp_path, kind, text):
    write_archive(tmp_path / "mine.npz", {"format": f"slcp-warp-{kind}", "version": 2}, {"a": np.zeros(2)})
    with pytest.raises(FileError, match=f"mine.npz cannot be read as a policy: it {text}"):
        slcp.sweep("catch", {"mine": str(tmp_path / "mine.npz")}, worlds=1)


@pytest.mark.parametrize(
    "header, text",
    [
        ({"format": "slcp-policy"}, "its format is 'slcp-policy'"),
        ({"version": 2}, "version 2"),
        ({"policy": 3}, "says no policy"),
        ({"policy": {"class": "os:system"}}, "one of slcp_warp is needed"),
        ({"policy": {"class": "slcp_warp.policies.linear:_rows"}}, "has not got"),
        ({"policy": {"class": "slcp_warp.nothing:Linear"}}, "has not got"),
        ({"policy": {"class": "slcp_warp.policies.linear:Linear"}}, "damaged"),
    ],
)
def test_files_that_are_no_policies(tmp_path, header, text):
    whole = {"format": "slcp-warp-policy", "version": 1, "policy": {}} | header
    write_archive(tmp_path / "mine.npz", json.loads(json.dumps(whole)), {"a": np.zeros(2)})
    with pytest.raises(FileError, match=text):
        policies.load_policy(tmp_path / "mine.npz")


def test_a_name_that_a_file_has_not_got_comes_with_those_that_it_has(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("""import numpy as np
from slcp_warp import policies

steady = policies.Linear(np.zeros((1, 2)))


def make():
    return steady


def of(x):
    return x
""")
    with pytest.raises(slcp.InputError, match="no nope in it; .*; there are steady, make$"):
        policies.load_policy(f"{path}:nope")
    assert policies.load_policy(f"{path}:make").K.shape == (1, 1, 2)
