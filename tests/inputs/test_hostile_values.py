"""Files of tasks and policies whose values are of another kind, at every place: read, or one error."""

import copy
import json
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("matplotlib")

from file_examples import FORMATS, SHOVE, outcome

import slcp_warp as slcp
from slcp_warp import ddp

OTHERS = (None, True, -1, 0, 1e308, "x", "", [], {}, [[]], {"x": 1}, [1.0, "x"])


def places(value, at=()):
    """The paths of all values in nested tables and lists."""
    yield at
    if isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(each, (*at, key))


def changed(content, at, value):
    out = copy.deepcopy(content)
    holder = out
    for key in at[:-1]:
        holder = holder[key]
    holder[at[-1]] = value
    return out


def tried(form, path, content, write):
    """How many changed contents are refused, of all."""
    rng, refused, count = np.random.default_rng(0), 0, 0
    for at in places(content):
        if at:
            for i in rng.choice(len(OTHERS), 4, replace=False):
                write(path, changed(content, at, OTHERS[i]))
                refused += outcome(form, path) is None
                count += 1
    return refused, count


@pytest.mark.parametrize("name", ["shove", "catch"])
def test_every_value_of_a_task(name, tmp_path):
    form, path = FORMATS["task"], tmp_path / "task.json"
    task = slcp.load_task(SHOVE) if name == "shove" else slcp.tasks.catch()
    slcp.save_task(task, path)
    content = json.loads(path.read_text())
    refused, count = tried(form, path, content, lambda p, c: p.write_text(json.dumps(c)))
    assert count > 200 and refused > 0.4 * count


POLICIES = {
    "around linear": lambda: slcp.policies.Around(
        slcp.policies.Linear(np.ones((1, 8)), np.zeros(8), [0.5], limits=(-1.0, 2.0)),
        delay=2,
        noise={"x": 0.1},
    ),
    "plan": lambda: ddp.TrackingPolicy(
        SimpleNamespace(us=np.ones((3, 2)), xs=np.ones((4, 6)), K=np.ones((3, 2, 6))), step_size=0.02
    ),
}


@pytest.mark.parametrize("name", POLICIES)
def test_every_value_of_a_policy(name, tmp_path):
    form, path = FORMATS["policy"], tmp_path / "policy.npz"
    slcp.policies.save_policy(POLICIES[name](), path)
    with np.load(path) as archive:
        data = {key: archive[key] for key in archive.files}
    header = json.loads(str(data["header"]))

    def write(p, given):
        np.savez(p, **(data | {"header": np.array(json.dumps(header | {"policy": given}))}))

    tried(form, path, header["policy"], write)
    for key in set(data) - {"header"}:
        for array in (np.zeros(0), np.array(["x"]), np.ones((2, 2, 2)), np.array(np.nan), None):
            others = {k: v for k, v in (data | {key: array}).items() if v is not None}
            np.savez(path, **others)
            outcome(form, path)
    for kind in (
        "os:system",
        "slcp_warp.simulator:Simulator",
        "slcp_warp.policies.saved:Content",
        "",
        3,
        None,
    ):
        write(path, header["policy"] | {"class": kind})
        assert outcome(form, path) is None, kind
