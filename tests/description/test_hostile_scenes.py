"""Scene files and MJCF made to hurt: depth, lengths, numbers, what repeats itself; all come back at once."""

import json
import os
import re

import pytest
from file_examples import MJCF, TOML

import slcp_warp as slcp

GOOD = {"format": "slcp-scene", "version": 2, "name": "a",
        "bodies": [{"name": "b", "mass": 1.0, "inertia": 1.0}]}  # fmt: skip


def refused(path, error=slcp.SceneFileError):
    """What is said of a file that is none; the error names it."""
    with pytest.raises(error) as caught:
        slcp.load_scene(path)
    assert type(caught.value) is error and path.name in str(caught.value) and len(str(caught.value)) < 600
    return str(caught.value)


def text_of(**changes):
    return json.dumps(GOOD | changes)


BODY = GOOD["bodies"][0]
JSON = {
    "deep lists": (text_of()[:-1] + ', "gravity": ' + "[" * 100_000, "nested more than 32"),
    "deep tables": ('{"a":' * 100_000, "nested more than 32"),
    "a key twice": ('{"name": "x", ' + text_of()[1:], "'name' comes twice"),
    "a body's key twice": (text_of().replace('"mass"', '"mass": 2.0, "mass"'), "'mass' comes twice"),
    "a number beyond floats": (text_of(bodies=[BODY | {"mass": 10**400}]), "mass"),
    "a number of many digits": (text_of().replace("1.0", "1" * 10_000), "digits"),
    "an infinite number": (text_of().replace("1.0", "1e999"), "mass"),
    "no number": (text_of().replace("1.0", "NaN"), "mass"),
    "a truth for a number": (text_of(bodies=[BODY | {"mass": True}]), "mass"),
    "a truth for the version": (text_of(version=True), "version is True"),
    "a long name of a field": (text_of(**{"x" * 10**6: 1}), "no field 'xxx"),
    "a long list": (text_of(bodies=[BODY] * 5000), "5000 entries; at most 4096"),
    "no bodies": (text_of(bodies=[]), "bodies"),
    "bodies of nothing": (text_of(bodies=[None]), r"bodies\[0\]"),
    "a pair of one": (text_of(gravity=[1.0]), "gravity"),
    "an empty radius": (
        text_of(shapes=[{"name": "s", "body": "b", "kind": "disc", "radius": []}]), "radius"),
    "empty limits": (text_of(bodies=[BODY | {"lower": []}]), "lower"),
    "a table for a number": (text_of(bodies=[BODY | {"mass": {"a": 1}}]), "mass"),
    "a large file": (text_of() + " " * 2**24, "at most 16777216 are read"),
}  # fmt: skip


@pytest.mark.parametrize("what", JSON)
def test_json(tmp_path, what):
    text, message = JSON[what]
    path = tmp_path / "scene.json"
    path.write_text(text)
    assert re.search(message, refused(path))


TOMLS = {
    "deep lists": (TOML + "\nperiod = " + "[" * 100_000, "nested too deeply"),
    "deep tables": (TOML + "\nperiod = " + "{a=" * 100_000, "nested too deeply"),
    "a long word": ("a" * 4 * 10**6, "not readable as TOML"),
    "a long text": ('"' + "a." * 10**6, "not readable as TOML"),
    "many spaces": ("a" + " " * 4 * 10**6, "not readable as TOML"),
    "a large file": (TOML + "\n" * 2**22, "at most 4194304 are read"),
    "many quotes": ('"' * 10**6, "not readable as TOML"),
    "a key of many parts": ("a." * 100_000 + "b = 1", "more than 16 parts"),
    "a table of many parts": ("[" + "a . " * 100_000 + "b]", "more than 16 parts"),
    "a key twice": (TOML + '\nname = "x"\nname = "y"\n', "not readable as TOML"),
    "a number beyond floats": (TOML.replace("2.5", "1" + "0" * 400), "mass"),
    "no number": (TOML.replace("2.5", "nan"), "mass"),
    "a date": (TOML.replace("2.5", "1979-05-27"), "mass"),
}


@pytest.mark.parametrize("what", TOMLS)
def test_toml(tmp_path, what):
    text, message = TOMLS[what]
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert message in refused(path)


def test_a_name_may_have_brackets_and_dots(tmp_path):
    name = "[" * 50 + '"a.b.c.d\\"' + "{" * 50
    slcp.save_scene(slcp.Scene(name, (slcp.Body("b", 1.0, 1.0),)), tmp_path / "scene.json")
    assert slcp.load_scene(tmp_path / "scene.json").name == name
    (tmp_path / "scene.toml").write_text("# in [0, 1)\n" * 100 + TOML)
    assert slcp.load_scene(tmp_path / "scene.toml").name == "two"


BODIES = '<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>'


def repeated(count, inside):
    return f'<replicate count="{count}" offset="1 0 0">{inside}</replicate>'


def world(inside, before=""):
    return f"<mujoco>{before}<worldbody>{inside}</worldbody></mujoco>"


TEN = BODIES.format(x=0)
HURT = {
    "repeats": (world(repeated(200_000, TEN)), "more than 10000 elements"),
    "repeats of repeats": (world(repeated(50, repeated(50, repeated(50, TEN)))), "more than 10000 elements"),
    "repeats of nothing": (world(TEN + repeated(10**9, "")), "more than 10000 elements"),
    "repeats without a number": (world(repeated("many", TEN)), "count 'many'; a whole number"),
    "more contacts than anyone wants": (world(repeated(300, TEN)), "more than 32,768 pairs"),
    "depth": (world("<body>" * 100_000), "nested more than 100"),
    "entities": ('<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>' + world(TEN), "declares entities"),
    "a file from elsewhere": ('<!DOCTYPE x SYSTEM "file:///etc/passwd">' + world(TEN), "declares entities"),
    "itself": (world(TEN, '<include file="scene.xml"/>'), "already included"),
    "a pipe": (world(TEN, '<include file="pipe"/>'), "no plain file"),
    "a mesh of a pipe": (world(TEN, '<asset><mesh name="m" file="pipe"/></asset>'), "no plain file"),
    "an endless texture": (
        world(TEN, '<asset><texture name="t" type="2d" file="/dev/zero"/></asset>'), "no plain file"),
    "a large texture": (
        world(TEN, '<asset><texture name="t" type="2d" width="90000" height="90000"/></asset>'),
        "cells"),
    "a large height field": (
        world(TEN, '<asset><hfield name="t" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>'), "cells"),
    "numbers of a user's": (world(TEN, '<size nuser_body="100000000"/>'), "nuser_body"),
    "cut off": (MJCF[:80], "well-formed"),
    "no XML": ("hello", "well-formed"),
    "another XML": ("<robot/>", "MJCF"),
}  # fmt: skip


@pytest.mark.parametrize("what", HURT)
def test_mjcf(tmp_path, what):
    pytest.importorskip("mujoco")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
    text, message = HURT[what]
    path = tmp_path / "scene.xml"
    path.write_text(text)
    assert message in refused(path, slcp.MjcfError)


def test_includes_and_repeats_are_counted_together(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{repeated(40, TEN)}</mujocoinclude>")
    path = tmp_path / "scene.xml"
    path.write_text(world('<include file="part.xml"/>'))
    assert len(slcp.load_scene(path).bodies) == 40
    path.write_text(world(repeated(100, '<include file="part.xml"/>')))
    assert "more than 10000 elements" in refused(path, slcp.MjcfError)


def test_what_attaches_is_counted(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "part.xml").write_text(world(repeated(1000, TEN)))
    attached = "".join(f'<attach model="p" prefix="{i}"/>' for i in range(20))
    path = tmp_path / "scene.xml"
    path.write_text(world(attached, '<asset><model name="p" file="part.xml"/></asset>'))
    assert "more than 10000 elements" in refused(path, slcp.MjcfError)
