"""Scenes in files: exact round trips, the schema, one clear error for everything else."""

import json
import pathlib
import tomllib

import pytest
from simulators import MAKERS

import slcp_warp as slcp
from slcp_warp.description.scene_file import json_schema, scene_content, scene_of

EXAMPLE = pathlib.Path(__file__).parents[2] / "examples" / "scenes" / "cart_pole.toml"


@pytest.mark.parametrize("name", MAKERS)
def test_round_trip_is_exact(tmp_path, name):
    scene = MAKERS[name]()
    slcp.save_scene(scene, tmp_path / "scene.json")
    again = slcp.load_scene(tmp_path / "scene.json")
    assert again == scene and again.structure == scene.structure
    for key, value in scene.default_parameters().items():
        assert (again.default_parameters()[key] == value).all(), key
    assert [p.name for p in tmp_path.iterdir()] == ["scene.json"]


def test_toml_example_is_a_scene():
    scene = slcp.load_scene(EXAMPLE)
    assert scene.nv == 2 and scene.nu == 1 and [c.friction for c in scene.contacts] == [0.3, None]
    assert scene.bodies[0].lower == -1.0 and scene.structure.lower == (True, False)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_byte_order_mark_is_no_part_of_the_text(suffix, tmp_path):
    scene, path = slcp.load_scene(EXAMPLE), tmp_path / f"scene{suffix}"
    if suffix == ".json":
        slcp.save_scene(scene, path)
    else:
        path.write_bytes(EXAMPLE.read_bytes())
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert slcp.load_scene(path) == scene


def test_files_fit_the_schema(tmp_path):
    fastjsonschema = pytest.importorskip("fastjsonschema")
    schema = json_schema()
    schema["$schema"] = (
        "http://json-schema.org/draft-07/schema#"  # the newest draft that it knows; no difference here
    )
    valid = fastjsonschema.compile(schema)
    for name in MAKERS:
        slcp.save_scene(MAKERS[name](), tmp_path / "scene.json")
        valid(json.loads((tmp_path / "scene.json").read_text()))
    valid(tomllib.loads(EXAMPLE.read_text()))
    valid(boxed(CRATE))
    for key, wrong in (("version", 4), ("bodies", []), ("gravity", [0.0]), ("colour", "red"),
                       ("implicit_damping", 1), ("implicit_stiffness", 1)):  # fmt: skip
        content = json.loads((tmp_path / "scene.json").read_text())
        content[key] = wrong
        if key != "bodies":
            with pytest.raises(fastjsonschema.JsonSchemaException):
                valid(content)


def test_shipped_schema_is_the_one_of_the_classes():
    path = pathlib.Path(slcp.__file__).parent / "description" / "scene_schema.json"
    assert json.loads(path.read_text()) == json_schema()  # python -m slcp_warp.description.scene_schema


def boxed(*shapes, **more):
    """Content of a file with a crate and a ball on a ground."""
    bodies = [{"name": n, "mass": 1.0, "inertia": 0.01, "joint": "free"} for n in ("crate", "ball")]
    there = (
        {"name": "ground", "kind": "halfplane"},
        {"name": "ball", "body": "ball", "kind": "disc", "radius": 0.1},
    )
    return {
        "format": "slcp-scene",
        "version": 3,
        "name": "a",
        "bodies": bodies,
        "shapes": [*there, *shapes],
        **more,
    }


CRATE = {"name": "crate", "body": "crate", "kind": "box", "width": 0.4, "height": 0.2}


def test_a_box_of_a_file_is_that_of_python():
    contacts = [
        {"shape_a": "ground", "shape_b": "crate", "friction": 0.5},
        {"shape_a": "ball", "shape_b": "ground"},
    ]
    found = scene_of(boxed(CRATE | {"offset": [0.1, 0.0], "angle": 0.3}, contacts=contacts))
    made = slcp.box("crate", "crate", 0.4, 0.2, offset=(0.1, 0.0), angle=0.3)
    assert found.shapes[2:] == made
    assert found.contacts[:4] == slcp.touching(made, found.shapes[:1], 0.5) and len(found.contacts) == 5
    sides = CRATE | {"corner_radius": 0.02, "sides": True}
    contacts += [{"shape_a": "crate", "shape_b": "ball"}]
    found = scene_of(boxed(sides, contacts=contacts))
    made = slcp.box("crate", "crate", 0.4, 0.2, 0.02, sides=True)
    assert found.shapes[2:] == made and len(found.contacts) == 4 + 1 + 8
    assert [c.shape_a for c in found.contacts[5:]] == [shape.name for shape in made]
    assert scene_of(scene_content(found)) == found
    assert scene_of(boxed(sides, contacts="auto", friction=0.5)).shapes[2:] == made
    bowl = {"name": "bowl", "kind": "ring", "radius": 1.0}
    found = scene_of(boxed(sides, bowl, contacts=[{"shape_a": "bowl", "shape_b": "crate"}]))
    assert [c.shape_b for c in found.contacts] == [shape.name for shape in made[:4]]  # corners, not sides


@pytest.mark.parametrize(
    "shapes, contacts, text",
    [
        ([CRATE | {"width": -1.0}], [], r"shapes\[2\]: width is -1.0"),
        ([CRATE | {"wdth": 1.0}], [], r"shapes\[2\]: no field 'wdth'; did you mean 'width'"),
        ([{k: v for k, v in CRATE.items() if k != "height"}], [], r"shapes\[2\]: height is missing"),
        ([CRATE | {"name": 3}], [], r"shapes\[2\]: name is 3; a name is needed"),
        ([CRATE | {"sides": True}], [], r"shapes\[2\]: corner_radius is 0.0; sides need a positive one"),
        ([CRATE | {"name": "ball"}], [], r"shapes\[2\]: another shape is named 'ball', too"),
        ([CRATE, CRATE], [], r"shapes\[2\]: another shape is named 'crate', too"),
        ([CRATE | {"body": "crates"}], [], "'crates'"),
        ([CRATE, CRATE | {"name": "b"}], [{"shape_a": "crate", "shape_b": "b"}], r"contacts\[0\]: two boxes"),
        ([CRATE, {"name": [], "kind": "disc"}], [{"shape_a": "crate", "shape_b": []}], "name"),
        ([CRATE], [{"shape_a": "crate", "shape_b": "floor"}], "no shape named 'floor'"),
        ([CRATE], [{"shape_a": "ground", "shape_b": "crate", "mu": 1}], r"contacts\[0\]: no field 'mu'"),
    ],
)  # fmt: skip
def test_boxes_that_cannot_be(shapes, contacts, text):
    with pytest.raises(slcp.SceneFileError, match=text):
        scene_of(boxed(*shapes, contacts=contacts))


GOOD = {"format": "slcp-scene", "version": 3, "name": "a",
        "bodies": [{"name": "b", "mass": 1.0, "inertia": 1.0}]}  # fmt: skip


def bad(**changes):
    return json.dumps({**GOOD, **changes})


BODY = GOOD["bodies"][0]


@pytest.mark.parametrize("text, message", [
    ("", "not readable as JSON"),
    (json.dumps(GOOD)[:40], "not readable as JSON"),
    ("[1, 2]", "format is a list"),
    (bad(format="urdf"), "format is 'urdf'; a scene file has format = 'slcp-scene'"),
    (bad(version=7), "version is 7; this program reads 1, 2, 3"),
    (bad(bodys=[]), "no field 'bodys'; did you mean 'bodies'"),
    (bad(bodies=[{**BODY, "mas": 1}]), r"bodies\[0\]: no field 'mas'; did you mean 'mass'"),
    (bad(bodies=[{"name": "b", "mass": 1.0}]), r"bodies\[0\]: inertia is missing"),
    (bad(bodies=[{**BODY, "mass": "heavy"}]), r"bodies\[0\]: body 'b': mass is 'heavy'; a number is needed"),
    (bad(bodies=[{**BODY, "mass": True}]), "mass is True; a number is needed"),
    (bad(bodies=[{**BODY, "joint": "ball"}]), "joint 'ball' is unknown; choose one of .*'prismatic'"),
    (bad(gravity=[0.0, float("nan")]), r"gravity\[1\] is nan; it must be finite"),
    (bad(gravity=[1.0]), "gravity has 1 entries; 2 are needed"),
    (bad(implicit_damping="no"), "implicit_damping is .no.; True or False is needed"),
    (bad(name=3), "name is 3; a name is needed"),
    (bad(bodies={}), "bodies: {}; a list is needed"),
    (bad(bodies=[{**BODY, "mass": -1.0}]), "mass is -1.0; it must be positive"),
    (bad(actuators=[{"body": "b", "dof": 0.5}]), "dof is 0.5; a whole number of at least 0 is needed"),
])  # fmt: skip
def test_what_is_no_scene_is_named(tmp_path, text, message):
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(slcp.SceneError, match=message):
        slcp.load_scene(path)


def test_files_from_when_damping_was_explicit_keep_it(tmp_path):
    path = tmp_path / "scene.json"
    for content, implicit in (
        (bad(), True),
        (bad(version=1), False),
        (bad(version=1, implicit_damping=True), True),
    ):
        path.write_text(content)
        assert slcp.load_scene(path).implicit_damping is implicit
    slcp.save_scene(slcp.scenes.flicking_finger(), path)
    content = json.loads(path.read_text())
    del content["implicit_damping"]
    path.write_text(json.dumps(content | {"version": 1}))
    assert slcp.load_scene(path) == slcp.scenes.flicking_finger()


def test_files_from_when_springs_were_explicit_keep_it(tmp_path):
    """Version 2 and before; what has no spring is the same in all."""
    path = tmp_path / "scene.json"
    sprung = [{**BODY, "stiffness": 2.0}]
    for content, implicit in (
        (bad(bodies=sprung), True),
        (bad(bodies=sprung, version=2), False),
        (bad(bodies=sprung, version=1), False),
        (bad(bodies=sprung, version=2, implicit_stiffness=True), True),
        (bad(bodies=sprung, implicit_stiffness=False), False),
        (bad(version=2), True),
    ):
        path.write_text(content)
        scene = slcp.load_scene(path)
        assert scene.implicit_stiffness is implicit
        assert scene.structure.implicit_stiffness is (implicit and "stiffness" in content)
        assert ("explicit springs" in str(scene)) is not implicit
        slcp.save_scene(scene, path)
        assert slcp.load_scene(path) == scene


def test_foreign_files(tmp_path):
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "scene.yaml").write_text("name: x")
    (tmp_path / "scene.toml").write_text("name = ")
    messages = {"binary.json": "it is no text", "folder.json": "a directory",
                "scene.yaml": "toml, .json or .xml", "scene.toml": "not readable as TOML"}  # fmt: skip
    for name, message in messages.items():
        with pytest.raises(slcp.SceneError, match=message):
            slcp.load_scene(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        slcp.load_scene(tmp_path / "nowhere.json")
    with pytest.raises(slcp.SceneError, match="written as .json"):
        slcp.save_scene(MAKERS["particle"](), tmp_path / "scene.toml")
